"""Simulate stimuli: the stress in the finger, and the spikes of its afferents.

With ccx on the PATH one indentation is solved and answers every stimulus (--method map),
or the solver follows each whole waveform (--method transient). A waveform is solved where
skin relaxes or slips under friction, the probe slides, or inertia counts. Without ccx the
stored response of the reference finger is read. Rates, spikes, stress traces and a raster
are written to the output folder.
"""

import argparse
from statistics import fmean
from typing import TYPE_CHECKING, Any

from fembridge.commands import written
from fembridge.commands.options import (
    LIMITS,
    PROBE_USES,
    SOLVING,
    STIMULUS,
    WAVE_USES,
    WAVEFORM,
    Use,
    add_export_option,
    add_from,
    add_output_option,
    add_probe_options,
    probe_from,
    words_of,
)
from fembridge.host.terminal import SolverBars, print_table

if TYPE_CHECKING:
    from fembridge.simulation.simulation import Simulation

EXAMPLE = "fembridge simulate --stimulus noise_25_250 -o out"

USES = (
    *PROBE_USES,
    *WAVE_USES,
    Use(
        "--newton-per-um --mpa-per-um",
        "--response of a deck that a load drives",
        lambda args: args.response is not None,
    ),
    Use(
        "--finger --probe-shape --probe-diameter-mm --probe-fillet-mm --probe-x-mm --whole-section "
        "--inertia --law --element --stored --threads --jobs --time-limit --no-cache --yes",
        "our finger, not for --response",
        lambda args: args.response is None,
    ),
    Use(
        "--whole-section --threads --jobs --time-limit --no-cache --yes",
        "a solver, not for --stored",
        lambda args: not args.stored,
    ),
    Use(
        "--jobs --yes",
        "waveforms that the solver follows, not for --method map",
        lambda args: args.method != "map",
    ),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.io.waveform import Waveform
    from fembridge.simulation.simulate import simulate
    from fembridge.solver.analysis import Analysis
    from fembridge.solver.settings import Solver

    add_from(parser, simulate, *STIMULUS)
    add_from(parser, Waveform, *WAVEFORM)
    add_from(parser, simulate, "finger")
    add_probe_options(parser)
    how = "interpolate in one indentation, or solve each waveform; auto: the map where stress "
    add_from(
        parser,
        simulate,
        "parameters",
        method=(("auto", "map", "transient"), f"{how}depends on depth alone"),
        stored="read the stored response even with ccx installed",
        response=(
            "DIR|FILE.toml",
            "response map of your own deck (`fembridge map`) or finger: nothing is solved; of a "
            "deck --preindent-um is 0 by default",
        ),
        newton_per_um=("N", "newtons for each um of the waveform (default: as of the map)"),
        mpa_per_um=("P", "MPa for each um of the waveform (default: as of the map)"),
    )
    add_from(
        parser,
        Analysis,
        *SOLVING,
        element=(("CPE4", "CPE4R", "CPE8R"), "element of the finger (default: CPE4)"),
    )
    add_from(parser, Solver, *LIMITS)
    add_output_option(parser, default="out")
    add_export_option(parser)
    add = parser.add_argument
    yes = "also solve transients that take more than ten minutes"
    add("--yes", action="store_true", help=yes)  # Python solves them without a confirmation
    no_plot = "draw no raster; an earlier one in DIR is removed"
    add("--no-plot", action="store_true", help=no_plot)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Simulate; the summary has the rates."""
    from decks.presets import finger_table, read_finger
    from fembridge.io.recording import require_libraries
    from fembridge.io.waveform import Waveform
    from fembridge.simulation.folder import check_finger
    from fembridge.simulation.simulate import simulate
    from fembridge.solver.analysis import Analysis
    from fembridge.solver.settings import Solver

    require_libraries(args.export)
    finger = read_finger(args.finger)
    if args.response is not None:
        return _from_response(args)
    # The record of a map has the finger without relaxation.
    check_finger(args.output, finger_table(finger.at_once()))
    with SolverBars() as bars:
        settings = Solver(**words_of(args, Solver), runs_folder=args.output, on_progress=bars)
        simulation = simulate(
            Waveform(args.stimulus, **words_of(args, Waveform)),
            parameters=args.parameters,
            finger=finger,
            probe=probe_from(args),
            preindent_um=args.preindent_um,
            method=args.method,
            stored=args.stored,
            analysis=Analysis(**words_of(args, Analysis)),
            solver=settings,
            yes=args.yes,
        )
    return _written(args, simulation)


def _from_response(args: argparse.Namespace) -> dict[str, Any]:
    """Simulate by a response map; the summary has the rates."""
    from fembridge.io.waveform import Waveform
    from fembridge.response.response_map import load_response
    from fembridge.simulation.folder import check_finger
    from fembridge.simulation.simulate import simulate

    response = load_response(args.response)
    if "finger" in response.origin:
        check_finger(args.output, response.origin["finger"])
    simulation = simulate(
        Waveform(args.stimulus, **words_of(args, Waveform)),
        parameters=args.parameters,
        preindent_um=args.preindent_um,
        response=response,
        newton_per_um=args.newton_per_um,
        mpa_per_um=args.mpa_per_um,
    )
    return _written(args, simulation)


def _written(args: argparse.Namespace, simulation: "Simulation") -> dict[str, Any]:
    """Write the files of a simulation, and print its rates; the summary has them."""
    from fembridge.host.store import remove_file
    from fembridge.io.recording import EXPORTED, exports
    from fembridge.simulation.folder import (
        FINGER_FILE,
        RASTER_FILE,
        RATES_FILE,
        RECORD_FILE,
        SPIKES_FILE,
        TRACES_FILE,
        has_finger,
    )

    exported = exports(simulation.to_recording(), args.export) if args.export else {}
    simulation.write(args.output, plot=not args.no_plot, more=exported)
    if args.no_plot and (args.output / RASTER_FILE).is_file():
        remove_file(args.output / RASTER_FILE)  # it would show other spikes than those of the run
    rates = simulation.mean_rates
    classes = list(dict.fromkeys(rate.afferent for rate in rates))
    by_class: dict[tuple[str, str], list[float]] = {}
    for rate in rates:
        by_class.setdefault((rate.stimulus, rate.afferent), []).append(rate.rate_ips)
    print_table(
        ["stimulus", *(f"{name:>6}" for name in classes), " impulses/s"],
        [
            [
                stimulus.id,
                *(f"{fmean(by_class[stimulus.id, name]):.1f}" for name in classes),
                "",
            ]
            for stimulus in simulation.stimuli
        ],
        rest=RATES_FILE,
    )
    files = [RATES_FILE, SPIKES_FILE, TRACES_FILE, *exported, *[RASTER_FILE] * (not args.no_plot)]
    files += [RECORD_FILE, *[FINGER_FILE] * has_finger(args.output)]
    return {
        **written(args.output, files, EXPORTED),
        "method": simulation.origin["method"],
        "parameters": simulation.origin.get("parameter_set", ""),
        "rates": [
            {
                "stimulus": rate.stimulus,
                "afferent": rate.afferent,
                **({"unit": rate.unit} if rate.unit else {}),
                "rate_ips": rate.rate_ips,
            }
            for rate in rates
        ],
    }
