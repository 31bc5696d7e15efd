"""Turn stress traces into spikes and firing rates.

Takes stress from
  a table  time_ms,afferent,node,von_mises_pa, as `fembridge ingest` writes it: any number
           of traces of SA, RA and PC afferents, distinguished by node, unit or stimulus
           (columns of these names); with --columns a table of another kind
  a folder of `fembridge simulate`, or its traces.npz; a run folder with results
in any even step, and writes into the output folder
  spikes.csv  stimulus,afferent,repeat,spike_time_ms, with unit where a class has several
  rates.csv   stimulus,afferent,rate_ips, the same
  raster.png  the spikes, a panel for each class
The signal of a robot's sensor is a table, too: its time and value by --columns, what a
value of 1 is in Pa by --gain-pa, and the classes that feel it by --afferent.
What ingest wrote beside the table (CSV.toml) says of which run it is: the name of the
stimulus, the window in which spikes count, the parameters. Of a table without it the
parameters are fitted, which hold for a probe that stood 75 um deep before time 0;
published are those of Ishizuka et al., Table 2. Of a population of cells every one is
written, numbered by repeat, and the rate is their mean.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fembridge.commands import Content, write_files, written
from fembridge.commands.options import (
    Several,
    add_export_option,
    add_from,
    add_output_option,
    column,
    window,
    words_of,
)
from fembridge.terminal import log, print_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fembridge.tables import SpikeTrain

# Up to so many units have a row each in the raster.
_MOST_ROWS = 60

EXAMPLE = "fembridge encode traces.csv -o encoded --window-ms 5:250"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    from fembridge.api import encode

    add = parser.add_argument
    add("traces", type=Path, metavar="CSV|NPZ|DIR", help="table of traces, or a folder")
    add_output_option(parser, default="encoded")
    whose = "fitted, published (Table 2 of the paper) or a TOML file (default: those that the "
    whose += "run of the traces names, else fitted)"
    named = "what the tables call the stimulus (default: as its run, else the file's name), or "
    named += "which of several"
    add(
        "--afferent",
        action=Several,
        choices=("SA", "RA", "PC"),
        help="classes to encode, and those that a trace without one is taken for",
    )
    add(
        "--columns",
        action=Several,
        type=column,
        metavar="time=NAME,value=NAME",
        help="columns of another table: time (in s, or as its name ends: _ms, _us) or time_ms, "
        "value (each is a trace), afferent, unit, node, stimulus",
    )
    gain = "Pa that a value of 1 is (default: as the column's name ends: _pa, _kpa, _mpa)"
    add_from(
        parser,
        encode,
        parameters=("NAME", whose),
        stimulus=("ID", named),
        gain_pa=("PA", gain),
        resample_ms=("MS", "put samples on an even grid of this step, by PCHIP"),
        derivative=(("backward", "central", "forward"), "scheme of the stress derivatives"),
    )
    counted = "count spikes after START up to END (default: as in its run, else of "
    counted += "--stimulus ID, else the whole trace)"
    add("--window-ms", type=window, metavar="START:END", help=counted)
    add_export_option(parser)
    add("--no-raster", action="store_true", help="write the tables alone")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Encode and write; the summary holds the rate of each trace."""
    from fembridge.encoding import encode
    from fembridge.recording import EXPORTED, Recording, exports, require_libraries
    from fembridge.tables import Rate, write_rates, write_spikes
    from neural import mean_rate_ips
    from neural.rates import spikes_inside

    require_libraries(args.export)
    named: dict[str, list[str]] = {}
    for key, name in args.columns or ():
        named.setdefault(key, []).append(name)
    notes: list[str] = []  # said at the end
    encoded = encode(
        args.traces,
        **{**words_of(args, encode), "columns": named or None},
        unnamed=args.traces.stem,
        afferents=args.afferent,
        log=log,
        note=notes.append,
    )
    found, traces, trains = encoded.source, encoded.traces, encoded.trains
    windows_ms = encoded.windows_ms(args.window_ms, args.stimulus)
    rows: list[dict[str, Any]] = [
        {
            "stimulus": trace.stimulus,
            "afferent": str(trace.afferent),
            "unit": trace.unit,
            "node": trace.node or None,
            "cells": len(cells_ms),
            "spikes": sum(times_ms.size for times_ms in cells_ms),
            "spikes_in_window": sum(spikes_inside(times_ms, window_ms) for times_ms in cells_ms),
            "rate_ips": mean_rate_ips(cells_ms, window_ms),
            "window_ms": window_ms,
        }
        for trace, cells_ms, window_ms in zip(traces, encoded.cells_ms, windows_ms, strict=True)
    ]
    rates = [Rate(row["stimulus"], row["afferent"], row["rate_ips"], row["unit"]) for row in rows]
    files: dict[str, Content] = {"spikes.csv": lambda path: write_spikes(path, trains)}
    spans_ms = [(trace.start_ms, float(trace.times_ms[-1])) for trace in traces]
    span_ms = min(first for first, _ in spans_ms), max(last for _, last in spans_ms)
    if not args.no_raster:
        from fembridge.plots.spikes import raster_figure

        shown = set(windows_ms).pop() if len(set(windows_ms)) == 1 else None
        window_ms = None if shown == span_ms else shown
        files["raster.png"] = raster_figure(_in_rows(trains), span_ms=span_ms, window_ms=window_ms)
    if args.export:
        nodes = {(str(trace.afferent), trace.unit): trace.node for trace in traces}
        recording = Recording.of_trains(trains, traces[0].dt_ms, span_ms[1], nodes)
        files |= exports(recording, args.export)
    files["rates.csv"] = lambda path: write_rates(path, rates)
    write_files(args.output, files)
    if args.window_ms is None and not found.windows_ms and spans_ms == windows_ms:
        notes.append("rates over the whole trace; narrow it with --window-ms START:END")
    for note in notes:
        log(note)
    keys = ("stimulus", "afferent", "unit")
    names = [key for key in keys if key == "afferent" or len({row[key] for row in rows}) > 1]
    print_table(
        [*names, "node", "spikes", "rate_ips", "window_ms"],
        [
            [
                *(row[name] for name in names),
                str(row["node"] or "-"),
                str(row["spikes_in_window"]),
                f"{row['rate_ips']:.2f}",
                "{:g} to {:g}".format(*row["window_ms"]),
            ]
            for row in rows
        ],
        words=len(names),
        rest="rates.csv",
    )
    return {
        **written(args.output, list(files), ["raster.png", *EXPORTED]),
        "parameters": encoded.parameters.name,
        "derivative": args.derivative,
        "rates": rows,
    }


def _in_rows(trains: "Sequence[SpikeTrain]") -> "Sequence[SpikeTrain]":
    """Trains whose stimulus is the row of a raster: a unit has its own where these are few."""
    rows = [" ".join(filter(None, (train.stimulus, train.unit))) for train in trains]
    if not any(train.unit for train in trains) or len(set(rows)) > _MOST_ROWS:
        return trains
    if len({train.stimulus for train in trains}) == 1:
        rows = [train.unit for train in trains]
    return [replace(one, stimulus=row) for one, row in zip(trains, rows, strict=True)]
