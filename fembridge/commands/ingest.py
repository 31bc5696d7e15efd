"""Take traces, fields or tables from a solver's result file.

Traces: beside a run.toml of fembridge they are those of its afferents, on the
clock of the stimulus: time 0 is its start, and the first sample is the state
before it moves. Of any other .frd choose nodes: --node, --set, --near; of a .dat
integration points: --point. Fields: --field writes one increment, --vtu all of
them for ParaView. Tables: a .dat, .sta or .cvg becomes a long CSV. --list shows
what a file holds. A run that did not end normally is refused, unless --partial
takes what is whole.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fembridge.commands.ingest_options import add_arguments, kind_of

if TYPE_CHECKING:
    from fembridge.results.read_options import ReadOptions
    from fembridge.trace import StressTrace

EXAMPLE = "fembridge ingest sine_20_250/job.frd -o traces.csv"

__all__ = ["EXAMPLE", "add_arguments", "run"]


def run(args: argparse.Namespace) -> dict[str, Any]:
    """List, or read and write; the summary tells what was written."""
    from fembridge.results import describe, result_file
    from fembridge.results.printed.print_tables import print_table_of

    path = result_file(args.result)
    printed = print_table_of(path)
    kind = kind_of(args, printed is not None)
    if kind == "list":
        held = describe(path) if printed is None else printed.describe(path)
        return _listed(path, held, args.json)
    run_kind = {
        "traces": _traces,
        "points": _points,
        "sides": _sides,
        "table": _table,
        "field": _field,
        "vtu": _vtu,
    }[kind]
    return run_kind(args, path)


def _traces(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    from fembridge.errors import UsageError
    from fembridge.results import describe, read, run_folder_of
    from fembridge.results.node_choice import NodeChoice
    from fembridge.tables import write_traces

    run_folder = run_folder_of(path)
    choice = NodeChoice(args.node or (), args.sets or (), args.near or (), args.deck)
    if run_folder is None and not choice:
        _listed(path, describe(path), args.json)
        wants = (
            "--afferents needs one"
            if args.afferents
            else "choose with --node N, --set NAME or --near X,Y"
        )
        raise UsageError(f"{path}: no run.toml beside it; {wants}")
    traces = read(
        path,
        choice.resolve(path, _teller(path)) if choice else None,
        partial=args.partial,
        across_materials=args.across_materials,
        stress_unit=args.stress_unit or "MPa",
        tell=_teller(path),
    )
    output: Path = args.output or Path(f"{path.stem}_traces.csv")
    write_traces(output, traces)
    return _told_traces(args, output, traces, run_folder is None)


def _points(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    from fembridge.results.printed.dat import read_point_traces
    from fembridge.tables import write_traces

    traces = read_point_traces(path, args.point, args.print_set, _options(args, path))
    output: Path = args.output or Path(f"{path.stem}_traces.csv")
    write_traces(output, traces)
    return _told_traces(args, output, traces, True)


def _sides(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    from fembridge.results.one_sided import one_sided_stress, write_sides

    options = _options(args, path)
    sides = [
        side
        for node in dict.fromkeys(args.node)
        for side in one_sided_stress(path, node, args.one_sided, options=options)
    ]
    output: Path = args.output or Path(f"{path.stem}_sides.csv")
    write_sides(output, sides)
    if not args.json:
        print(f"{output}: {len(sides)} sides; {_unit(args, True)}")
        for side in sides:
            print(
                f"  node {side.node} in {side.name}: "
                f"peak {side.von_mises_pa.max():.6g} Pa"
            )
    return {
        "output": str(output),
        "stress_unit": args.stress_unit or "MPa",
        "sides": [
            {
                "node": side.node,
                "material": side.name,
                "elements": list(side.elements),
                "peak_pa": float(side.von_mises_pa.max()),
            }
            for side in sides
        ],
    }


def _table(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    from fembridge.errors import UsageError
    from fembridge.results.printed.print_tables import print_table_of, write_print_table

    table = print_table_of(path)
    assert table is not None  # kind_of looked
    if args.quantity and (len(args.quantity) > 1 or table.suffix != ".dat"):
        raise UsageError(f"{path}: --quantity takes one name, and of a .dat")
    output: Path = args.output or Path(f"{path.stem}_{table.suffix[1:]}.csv")
    quantity = args.quantity[0] if args.quantity else None
    rows = write_print_table(table, path, output, _options(args, path), quantity)
    if not args.json:
        unit = f"; {_unit(args, True)}" if table.suffix == ".dat" else ""
        print(f"{output}: {rows} rows{unit}")
    return {
        "output": str(output),
        "format": table.name,
        "rows": rows,
        "columns": list(table.columns),
        "stress_unit": args.stress_unit or "MPa",
    }


def _field(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    from fembridge.results.field_file import read_field, write_field

    field = read_field(path, args.field, args.increment, _options(args, path))
    output: Path = args.output or Path(
        f"{path.stem}_{field.name.lower()}_{field.step}_{field.increment}.npz"
    )
    write_field(output, field)
    when = f"{field.axis} {field.axis_value:g}"
    if field.time_ms == field.time_ms:
        when = f"{field.time_ms:g} ms"
    if not args.json:
        print(
            f"{output}: {field.name} of {field.nodes.size} nodes, step {field.step}, "
            f"increment {field.increment}, {when}; {_unit(args, True)}"
        )
    return {
        "output": str(output),
        "quantity": field.name,
        "components": list(field.components),
        "units": list(field.units),
        "step": field.step,
        "increment": field.increment,
        "time_ms": field.time_ms,
        "nodes": int(field.nodes.size),
        "stress_unit": args.stress_unit or "MPa",
    }


def _vtu(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    from fembridge.results.vtu import write_vtu_series

    collection = write_vtu_series(
        path,
        args.vtu,
        quantities=args.quantity,
        derived=tuple(dict.fromkeys(args.derived or ("von_mises",))),
        partial=args.partial,
        stress_unit=args.stress_unit or "MPa",
        tell=_teller(path),
    )
    count = len(list(args.vtu.glob("*.vtu")))
    if not args.json:
        print(f"{collection}: {count} increments; {_unit(args, True)}")
    return {
        "output": str(collection),
        "increments": count,
        "stress_unit": args.stress_unit or "MPa",
    }


def _told_traces(
    args: argparse.Namespace,
    output: Path,
    traces: Sequence["StressTrace"],
    foreign: bool,
) -> dict[str, Any]:
    first = traces[0]
    if not args.json:
        print(
            f"{output}: {len(traces)} trace{'s' * (len(traces) > 1)}, "
            f"{first.start_ms:g} to {first.times_ms[-1]:g} ms "
            f"every {first.dt_ms:g} ms; {_unit(args, foreign)}"
        )
        for trace in traces:
            who = f"{trace.afferent} " if trace.afferent else ""
            print(f"  {who}node {trace.node}: peak {trace.stress_pa.max():.6g} Pa")
    return {
        "output": str(output),
        "stress_unit": args.stress_unit or "MPa",
        "dt_ms": first.dt_ms,
        "start_ms": first.start_ms,
        "samples": int(first.stress_pa.size),
        "traces": [
            {
                "afferent": trace.afferent,
                "node": trace.node,
                "peak_pa": float(trace.stress_pa.max()),
            }
            for trace in traces
        ],
    }


def _unit(args: argparse.Namespace, foreign: bool) -> str:
    words = f"stress in the file taken as {args.stress_unit or 'MPa'}"
    if foreign and args.stress_unit is None:
        words += " (--stress-unit says otherwise)"
    return words


def _options(args: argparse.Namespace, path: Path) -> "ReadOptions":
    from fembridge.results.read_options import ReadOptions

    return ReadOptions(
        partial=args.partial,
        across_materials=args.across_materials,
        stress_unit=args.stress_unit or "MPa",
        tell=_teller(path),
    )


def _teller(path: Path) -> Callable[[str], None]:
    return lambda words: print(f"{path}: {words}", file=sys.stderr)


def _listed(path: Path, held: dict[str, Any], quiet: bool) -> dict[str, Any]:
    if not quiet:
        from fembridge.commands.ingest_listing import show

        show(path, held)
    return held
