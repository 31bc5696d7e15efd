"""Turn stress traces into spikes and firing rates.

Stress comes from
  a table  time_ms,afferent,node,von_mises_pa, as `fembridge ingest` writes it: any number
           of traces of SA, RA and PC afferents, distinguished by the columns node, unit or
           stimulus; with --columns another table
  a folder of `fembridge simulate`, or its traces.npz; a run folder with results
in any even step. The output folder gets
  spikes.csv  stimulus,afferent,cell,spike_time_ms, with unit if a class has several
  rates.csv   stimulus,afferent,rate_ips, the same
  stress.npz  the encoded stress
  encoding.toml  inputs and versions; fembridge.Encoding.read reads the folder
  raster.png  the spikes, a panel for each class
The signal of a robot's sensor is a table, too: a column of time, and each other column of
numbers as a channel, are recognised, or named by --columns. --calibration is the file that
`fembridge calibrate` makes of one press; --gain-pa states the stress in Pa of a value of 1. Samples
at uneven times are put on an even grid, and a channel is felt by all classes (--afferent selects).
The file that ingest writes next to the table (CSV.toml) describes its run: the name of
the stimulus, the window in which spikes count, the parameters. Without it the parameters
are fitted, for a probe at a pre-indentation of 75 um; published are those of Ishizuka et
al., Table 2. Each cell of a population is written, numbered in the column cell; the rate is the
mean over the cells.
"""

import argparse
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fembridge.commands import written
from fembridge.commands.options import (
    Several,
    add_export_option,
    add_from,
    add_output_option,
    parse_column,
    parse_gain,
    parse_window,
    words_of,
)
from fembridge.host.terminal import print_table

_LOGGER = logging.getLogger(__name__)

EXAMPLE = "fembridge encode traces.csv -o encoded --window-ms 5:250"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.simulation.encode import encode

    add = parser.add_argument
    add("traces", type=Path, metavar="CSV|NPZ|DIR", help="table of traces, or a folder")
    add_output_option(parser, default="encoded")
    parameters = "fitted, published (Table 2 of the paper) or a TOML file (default: those of the "
    parameters += "run of the traces, else fitted)"
    stimulus = "name of the stimulus in the tables (default: that of the run, else the file's "
    stimulus += "name), or the one of several to encode"
    add(
        "--afferent",
        action=Several,
        choices=("SA", "RA", "PC"),
        help="classes to encode; a trace without a class is encoded as each of them",
    )
    add(
        "--columns",
        action=Several,
        type=parse_column,
        metavar="time=NAME,value=NAME",
        help="columns of another table: time (in s, or as its name ends: _ms, _us) or time_ms, "
        "value (each is a trace), afferent, unit, node, stimulus",
    )
    gain = "stress of a value of 1, of all classes or by class, as SA=2e4,PC=400 (default: by the "
    gain += "end of the column's name: _pa, _kpa, _mpa)"
    add_from(
        parser,
        encode,
        parameters=("NAME", parameters),
        stimulus=("ID", stimulus),
        gain_pa=({"type": parse_gain, "metavar": "PA"}, gain),
        calibration=("FILE", "gains and offset of a sensor, of `fembridge calibrate`"),
        resample_ms=(
            "MS",
            "put samples on an even grid of this step, by PCHIP (default: of a sensor at uneven "
            "times 0.5, or 0.1 if it is faster)",
        ),
        derivative=(("backward", "central", "forward"), "scheme of the stress derivatives"),
    )
    window_help = "count spikes after START up to END (default: the window of the run, else of "
    window_help += "--stimulus ID, else the whole trace)"
    add("--window-ms", type=parse_window, metavar="START:END", help=window_help)
    add_export_option(parser)
    add("--no-raster", action="store_true", help="write only the tables")


def columns_by_key(pairs: Sequence[tuple[str, str]] | None) -> dict[str, list[str]] | None:
    """Names of the option ``--columns`` by key; None without the option."""
    columns: dict[str, list[str]] = {}
    for key, name in pairs or ():
        columns.setdefault(key, []).append(name)
    return columns or None


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Encode and write; the summary has the rate of each trace."""
    from fembridge.io.recording import EXPORTED, exports, require_libraries
    from fembridge.simulation.encode import encode
    from fembridge.simulation.encoding import RECORD_FILE, STRESS_FILE
    from fembridge.simulation.folder import RASTER_FILE, RATES_FILE, SPIKES_FILE
    from neural.rates import spikes_inside

    require_libraries(args.export)
    encoding = encode(
        **{**words_of(args, encode), "columns": columns_by_key(args.columns)},
        afferents=args.afferent,
    )
    rows: list[dict[str, Any]] = [
        {
            "stimulus": trace.stimulus,
            "afferent": str(trace.afferent),
            "unit": trace.unit,
            "node": trace.node or None,
            "cells": len(cells_ms),
            "spikes": sum(times_ms.size for times_ms in cells_ms),
            "spikes_in_window": sum(spikes_inside(times_ms, window_ms) for times_ms in cells_ms),
            "rate_ips": rate.rate_ips,
            "window_ms": window_ms,
        }
        for trace, cells_ms, window_ms, rate in zip(
            encoding.traces,
            encoding.cells_ms,
            encoding.windows_ms,
            encoding.mean_rates,
            strict=True,
        )
    ]
    exported = exports(encoding.to_recording(), args.export) if args.export else {}
    encoding.write(args.output, plot=not args.no_raster, more=exported)
    pictures = [RASTER_FILE] * (not args.no_raster)
    files = [SPIKES_FILE, *pictures, *exported, RATES_FILE, STRESS_FILE, RECORD_FILE]
    spans_ms = [(trace.start_ms, float(trace.times_ms[-1])) for trace in encoding.traces]
    is_default = args.window_ms is None and not encoding.traces.windows_ms
    if is_default and spans_ms == encoding.windows_ms:
        _LOGGER.info("rates over the whole trace; --window-ms START:END selects a part")
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
        text_columns=len(names),
        rest="rates.csv",
    )
    return {
        **written(args.output, files, ["raster.png", *EXPORTED]),
        "parameters": encoding.parameters.name,
        "derivative": args.derivative,
        "rates": rows,
    }
