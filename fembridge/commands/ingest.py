"""Take traces, fields or tables from a solver's result file.

Traces: beside a run.toml of fembridge they are those of its afferents, on the
clock of the stimulus: time 0 is its start, and the first sample is the state
before it moves. Of any other .frd (CalculiX), .t16 or .t19 (Marc) choose nodes:
--node, --set, --near; of a .dat integration points: --point; of a history plot saved
from Mentat (.txt) its curves. Fields: --field writes one increment, --vtu all of them
for ParaView. Tables: a .dat, .sta, .cvg or .sts becomes a long CSV, and so does a
path plot. --list shows what a file holds. A run that did not end normally is refused,
unless --partial takes what is whole.
"""

import argparse
from pathlib import Path
from typing import Any

from fembridge.commands.ingest_options import add_arguments, kind_of

EXAMPLE = "fembridge ingest sine_20_250/job.frd -o traces.csv"

__all__ = ["EXAMPLE", "add_arguments", "run"]


def run(args: argparse.Namespace) -> dict[str, Any]:
    """List, or read and write; the summary tells what was written."""
    from fembridge.commands import ingest_traces, ingest_whole
    from fembridge.results import result_file
    from fembridge.results.marc_deck import is_marc_deck
    from fembridge.results.printed.print_tables import print_table_of

    path = result_file(args.result)
    if is_marc_deck(path):
        return _deck(args, path)
    printed = print_table_of(path)
    kind = kind_of(args, path, printed is not None)
    if kind == "list":
        return _list(args, path)
    run_kind = {
        "traces": ingest_traces.traces,
        "points": ingest_traces.points,
        "sides": ingest_traces.sides,
        "table": ingest_whole.table,
        "plot": ingest_whole.plot_table,
        "field": ingest_whole.field,
        "vtu": ingest_whole.vtu,
    }[kind]
    return run_kind(args, path)


def _list(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    from fembridge.commands.ingest_words import listed
    from fembridge.results import describe
    from fembridge.results.printed.print_tables import print_table_of

    printed = print_table_of(path)
    held = describe(path) if printed is None else printed.describe(path)
    return listed(path, held, args.json)


def _deck(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    """Say what a Marc deck is: it has the suffix of CalculiX's prints."""
    from fembridge.commands.ingest_listing import show_deck
    from fembridge.errors import UsageError
    from fembridge.results.marc_deck import describe

    if not args.list:
        raise UsageError(
            f"{path}: a Marc deck, no results; --list shows what it holds, results "
            f"are in {path.stem}.t16 or {path.stem}.t19"
        )
    held = describe(path)
    if not args.json:
        show_deck(path, held)
    return held
