"""Turn stress traces into spikes and firing rates.

Takes a table time_ms,afferent,node,von_mises_pa with a trace of an SA, an RA or a
PC afferent (one of each at most, every 0.5 ms) and writes into the output folder
  spikes.csv  stimulus,afferent,repeat,spike_time_ms
  rates.csv   stimulus,afferent,rate_ips
  raster.png  the spikes, a panel for each class
What ingest wrote beside the table (CSV.toml) says of which run it is: the name of the
stimulus, the window in which spikes count, the parameters. Of a table without it the
parameters are fitted, which hold for a probe that stood 75 um deep before time 0;
published are those of Ishizuka et al., Table 2. Of a population of cells every one is
written, numbered by repeat, and the rate is their mean.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fembridge.commands.options import add_options

if TYPE_CHECKING:
    from fembridge.trace import StressTrace

EXAMPLE = "fembridge encode traces.csv -o encoded --window-ms 5 250"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    add = parser.add_argument
    add("traces", type=Path, metavar="CSV", help="table of traces")
    add(
        "-o",
        "--output",
        type=Path,
        default=Path("encoded"),
        metavar="DIR",
        help="folder to write into (default: encoded)",
    )
    whose = "fitted, published (Table 2 of the paper) or a TOML file (default: those that the "
    add_options(parser, ("parameters",), help=f"{whose}run of the traces names, else fitted)")
    named = "what the tables call the stimulus (default: as its run, else the file's name)"
    add("--stimulus", metavar="ID", help=named)
    add(
        "--afferent",
        choices=("SA", "RA", "PC"),
        nargs="+",
        help="what to take a trace for that names no afferent: one class or more",
    )
    add(
        "--window-ms",
        type=float,
        nargs=2,
        metavar=("START", "END"),
        help="count spikes after START up to END (default: as in its run, else the whole trace)",
    )
    add(
        "--derivative",
        choices=("backward", "central", "forward"),
        default="backward",
        help="scheme of the stress derivatives (default: backward)",
    )
    add_options(parser, ("export",))
    add("--no-raster", action="store_true", help="write the tables alone")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Encode and write; the summary holds the rate of each afferent."""
    from fembridge.api import parameters_for
    from fembridge.recording import Recording, export
    from fembridge.simulation import encode_traces
    from fembridge.store import filling
    from fembridge.tables import Rate, read_traces, write_rates, write_spikes
    from neural import mean_rate_ips
    from neural.rates import spikes_inside

    def log(line: str) -> None:
        print(line, file=sys.stderr)

    found = read_traces(args.traces, log)
    origin = found.origin
    traces = _one_of_each(found, args.afferent, args.traces)
    window_asked = args.window_ms or (list(origin.window_ms) if origin else None)
    windows_ms = [_window(trace, window_asked) for trace in traces]
    stimulus = args.stimulus or (origin.stimulus if origin else args.traces.stem)
    notes: list[str] = []
    chosen = parameters_for(found, args.parameters, notes.append)
    trains = encode_traces(traces, chosen.parameters, stimulus, args.derivative)
    rates: list[Rate] = []
    afferents: dict[str, dict[str, Any]] = {}
    for trace, window_ms in zip(traces, windows_ms, strict=True):
        name = str(trace.afferent)
        cells_ms = [train.times_ms for train in trains if train.afferent == name]
        rates.append(Rate(stimulus, name, mean_rate_ips(cells_ms, window_ms)))
        afferents[name] = {
            "node": trace.node,
            "cells": len(cells_ms),
            "spikes": sum(times_ms.size for times_ms in cells_ms),
            "spikes_in_window": sum(spikes_inside(times_ms, window_ms) for times_ms in cells_ms),
            "rate_ips": rates[-1].rate_ips,
            "window_ms": list(window_ms),
        }
    files = [args.output / "spikes.csv", args.output / "rates.csv"]
    with filling(args.output, last="rates.csv") as draft:
        write_spikes(draft / "spikes.csv", trains)
        write_rates(draft / "rates.csv", rates)
        if not args.no_raster:
            from fembridge.plots.raster import raster_figure
            from fembridge.plots.style import save_figure

            files.append(args.output / "raster.png")
            span_ms = (
                min(trace.start_ms for trace in traces),
                max(float(trace.times_ms[-1]) for trace in traces),
            )
            window = tuple(window_asked) if window_asked else None
            figure = raster_figure(trains, span_ms=span_ms, window_ms=window)
            save_figure(figure, draft / "raster.png")
    if args.export:
        t_stop_ms = max(float(trace.times_ms[-1]) for trace in traces)
        nodes = {str(trace.afferent): trace.node for trace in traces}
        recording = Recording.of_trains(trains, traces[0].dt_ms, t_stop_ms, nodes)
        files += [args.output / name for name in export(recording, args.output, args.export)]
    for note in notes:
        log(note)
    if window_asked is None:
        log("rates over the whole trace; narrow it with --window-ms START END")
    if not args.json:
        print(f"{'afferent':<9}{'node':>7}{'spikes':>8}{'rate_ips':>10}  window_ms")
        for name, row in afferents.items():
            start, end = row["window_ms"]
            print(
                f"{name:<9}{row['node']:>7}{row['spikes_in_window']:>8}"
                f"{row['rate_ips']:>10.2f}  {start:g} to {end:g}"
            )
        print(*files, sep="\n")
    return {
        "stimulus": stimulus,
        "parameters": chosen.name,
        "derivative": args.derivative,
        "afferents": afferents,
        "files": [str(path) for path in files],
    }


def _one_of_each(
    traces: "list[StressTrace]", unnamed: list[str] | None, path: Path
) -> "list[StressTrace]":
    """A trace a class, in the order of the table."""
    from fembridge.errors import TableError

    chosen: dict[str, StressTrace] = {}
    for trace in traces:
        classes = [trace.afferent] if trace.afferent else dict.fromkeys(unnamed or ())
        if not classes:
            raise TableError(f"node {trace.node} has no afferent: name it by --afferent", path)
        for name in classes:
            if name in chosen:
                both = f"nodes {chosen[name].node} and {trace.node} are both {name}"
                raise TableError(f"{both}, expected one; split the table", path)
            chosen[name] = replace(trace, afferent=name)
    return list(chosen.values())


def _window(trace: "StressTrace", asked_ms: list[float] | None) -> tuple[float, float]:
    """The window to count in: what was asked, if the trace covers it."""
    from fembridge.errors import UsageError

    first, last = float(trace.times_ms[0]), float(trace.times_ms[-1])
    start, end = asked_ms or (first, last)
    slack = 1e-3 * trace.dt_ms
    # The first sample may be one increment after the start of the stimulus.
    if not (first - trace.dt_ms - slack <= start < end <= last + slack):
        raise UsageError(
            f"window {start:g} to {end:g} ms, expected start < end inside "
            f"{first:g} to {last:g} ms, the {trace.afferent} trace"
        )
    return start, end
