"""From stimuli to spikes: solve the finger, take the stress, fire the afferents.

With ccx on the PATH one indentation is solved and answers every stimulus
(--method map), or the solver follows each whole waveform (--method transient): where
skin relaxes or slips under friction, the probe slides or inertia counts, that is
what is done.
Without ccx the stored response of the reference finger is taken. Rates, spikes,
stress traces and a raster are written to the output folder.
"""

import argparse
from typing import Any

from fembridge.commands import written
from fembridge.commands.options import (
    LIMITS,
    PROBE_USES,
    SOLVING,
    STIMULUS,
    WAVE_USES,
    Use,
    add_export_option,
    add_from,
    add_output_option,
    add_probe_options,
    probe_from,
    words_of,
)
from fembridge.terminal import Notes, SolverBars, print_table

EXAMPLE = "fembridge simulate --stimulus noise_25_250 -o out"

USES = (
    *PROBE_USES,
    *WAVE_USES,
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
    """Declare what the verb understands."""
    from fembridge.api import simulate

    add_from(parser, simulate, *STIMULUS, "finger")
    add_probe_options(parser)
    how = "interpolate in one indentation, or solve each waveform; auto is the map where stress "
    add_from(
        parser,
        simulate,
        *SOLVING,
        *LIMITS,
        "parameters",
        element=(("CPE4", "CPE4R", "CPE8R"), "element of the finger"),
        method=(("auto", "map", "transient"), f"{how}depends on depth alone"),
        stored="take the stored response even where ccx is installed",
    )
    add_output_option(parser, default="out")
    add_export_option(parser)
    add = parser.add_argument
    yes = "solve transients also where that takes more than ten minutes"
    add("--yes", action="store_true", help=yes)  # in Python nobody is asked
    no_plot = "draw no raster; an earlier one in DIR is removed"
    add("--no-plot", action="store_true", help=no_plot)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Simulate; the summary holds the rates."""
    from decks.presets import finger_table, read_finger
    from fembridge.api import simulate
    from fembridge.recording import EXPORTED, Recording, exports, require_libraries
    from fembridge.simulation import (
        RASTER_FILE,
        RATES_FILE,
        SPIKES_FILE,
        TRACES_FILE,
        check_finger,
    )
    from fembridge.store import remove_file

    require_libraries(args.export)
    finger = read_finger(args.finger)
    # A map is of the finger as it is at once.
    check_finger(args.output, finger_table(finger.at_once()))
    notes = Notes()
    with SolverBars() as bars:
        words = {**words_of(args, simulate), "finger": finger, "probe": probe_from(args)}
        simulation = simulate(**words, log=notes, on_progress=bars)
    exported = exports(Recording.of(simulation), args.export) if args.export else {}
    simulation.write(args.output, plot=not args.no_plot, more=exported)
    if args.no_plot and (args.output / RASTER_FILE).is_file():
        remove_file(args.output / RASTER_FILE)  # of other spikes than those beside it
    count, rates = len(simulation.traces[0]), simulation.mean_rates
    print_table(
        ["stimulus", *(f"{rate.afferent:>6}" for rate in rates[:count]), " impulses/s"],
        [
            [
                one.id,
                *(f"{rate.rate_ips:.1f}" for rate in rates[row * count : (row + 1) * count]),
                "",
            ]
            for row, one in enumerate(simulation.stimuli)
        ],
        rest=RATES_FILE,
    )
    files = [RATES_FILE, SPIKES_FILE, TRACES_FILE, *exported, *[RASTER_FILE] * (not args.no_plot)]
    return {
        **written(args.output, files, EXPORTED),
        "method": simulation.origin["method"],
        "parameters": simulation.origin.get("parameter_set", ""),
        "notes": notes,
        "rates": [
            {"stimulus": r.stimulus, "afferent": r.afferent, "rate_ips": r.rate_ips} for r in rates
        ],
    }
