"""From stimuli to spikes: solve the finger, take the stress, fire the afferents.

With ccx on the PATH one indentation is solved and answers every stimulus
(--method map), or the solver follows each whole waveform (--method transient): where
skin relaxes or slips under friction, the probe slides or inertia counts, that is
what is done.
Without ccx the stored response of the reference finger is taken. Rates, spikes,
stress traces and a raster are written to the output folder.
"""

import argparse
import sys
from typing import TYPE_CHECKING, Any

from fembridge.commands.options import (
    FINGER,
    LIMITS,
    SOLVING,
    STIMULUS,
    add_options,
    add_output_option,
    probe_from,
    words_of,
)

if TYPE_CHECKING:
    from fembridge.simulation import Simulation

EXAMPLE = "fembridge simulate --stimulus noise_25_250 -o out"

# Rows that a table on the screen shows before it is cut.
_SHOWN = 30


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    add_options(parser, (*STIMULUS, *FINGER, *SOLVING, *LIMITS))
    add_options(parser, ("parameters",), default="fitted")
    add_output_option(parser, default="out")
    parser.add_argument(
        "--element",
        choices=("CPE4", "CPE4R", "CPE8R"),
        default="CPE4",
        help="element of the finger (default: CPE4)",
    )
    parser.add_argument(
        "--method",
        choices=("auto", "map", "transient"),
        default="auto",
        help="interpolate in one indentation, or solve each waveform (default: auto, "
        "the map where stress depends on depth alone)",
    )
    parser.add_argument(
        "--stored", action="store_true", help="take the stored response even where ccx is installed"
    )
    parser.add_argument(
        "--no-plot", action="store_true", help="draw no raster; an earlier one in DIR is removed"
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Simulate; the summary holds the rates."""
    from pathlib import Path

    from fembridge.api import simulate
    from fembridge.progress import SolverBars
    from fembridge.simulation import RASTER_FILE, RATES_FILE, SPIKES_FILE, TRACES_FILE

    output = Path(args.output)
    lines: list[str] = []

    def log(line: str) -> None:
        lines.append(line)
        print(line, file=sys.stderr)

    names = ("finger", "element", "method", "stored", "parameters", "threads", "jobs")
    with SolverBars() as bars:
        simulation = simulate(
            **words_of(args, *STIMULUS, *SOLVING, *names),
            probe=probe_from(args),
            output=output,
            time_limit_s=args.time_limit,
            log=log,
            on_progress=bars,
        )
    simulation.write(output, plot=not args.no_plot)
    if args.no_plot and (output / RASTER_FILE).is_file():
        (output / RASTER_FILE).unlink()  # of other spikes than those beside it
    if not args.json:
        _print_rates(simulation)
        raster = "" if args.no_plot else f", {RASTER_FILE}"
        print(f"{RATES_FILE}, {SPIKES_FILE}, {TRACES_FILE}{raster}: {output}")
    return {
        "output": str(output),
        "method": simulation.origin["method"],
        "parameters": simulation.origin.get("parameter_set", ""),
        "notes": lines,
        "rates": [
            {"stimulus": r.stimulus, "afferent": r.afferent, "rate_ips": r.rate_ips}
            for r in simulation.mean_rates
        ],
    }


def _print_rates(simulation: "Simulation") -> None:
    afferents = list(dict.fromkeys(rate.afferent for rate in simulation.mean_rates))
    by_key = {(r.stimulus, r.afferent): r.rate_ips for r in simulation.mean_rates}
    ids = [stimulus.id for stimulus in simulation.stimuli]
    width = max(len("stimulus"), *map(len, ids[:_SHOWN]))
    header = "".join(f"{name:>8}" for name in afferents)
    print(f"{'stimulus':<{width}}{header}   impulses/s")
    for name in ids[:_SHOWN]:
        cells = "".join(f"{by_key[name, a]:8.1f}" for a in afferents)
        print(f"{name:<{width}}{cells}")
    if len(ids) > _SHOWN:
        print(f"... {len(ids) - _SHOWN} more in rates.csv")
