"""Take stress traces from a solver's result file.

Beside a run.toml of fembridge the traces are those of its afferents, on the
clock of the stimulus: time 0 is its start, and the first sample is the state
before it moves. Of any other file name the nodes; --list shows what it holds.
A run that did not end normally is refused, unless --partial takes what is whole.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

EXAMPLE = "fembridge ingest sine_20_250/job.frd -o traces.csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    parser.add_argument(
        "result",
        type=Path,
        metavar="RESULT",
        help="a result file (.frd of CalculiX), or a run folder",
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--node",
        type=int,
        nargs="+",
        action="extend",
        metavar="N",
        help="numbers of the nodes to read",
    )
    which.add_argument(
        "--afferents",
        action="store_true",
        help="the nodes of run.toml's afferents (the default where there is one)",
    )
    which.add_argument(
        "--list", action="store_true", help="show what the file holds, write nothing"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="CSV",
        help="table to write (default: RESULT's name and _traces.csv, here)",
    )
    parser.add_argument(
        "--stress-unit",
        choices=("MPa", "kPa", "Pa"),
        help="unit of the file's stress (default: MPa, which is N and mm)",
    )
    parser.add_argument(
        "--partial",
        action="store_true",
        help="take what is whole of a run that did not end normally",
    )
    parser.add_argument(
        "--across-materials",
        action="store_true",
        help="allow nodes between two materials, where stress is a mean over both",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """List, or read and write; the summary tells of each trace."""
    from fembridge.errors import UsageError
    from fembridge.results import describe, read, result_file, run_folder_of
    from fembridge.tables import write_traces

    path = result_file(args.result)
    if args.list:
        return _list(path, describe(path), args.json)
    run_folder = run_folder_of(path)
    if run_folder is None and not args.node:
        _list(path, describe(path), args.json)
        wants = "--afferents needs one" if args.afferents else "choose with --node N"
        raise UsageError(f"{path}: no run.toml beside it; {wants}")

    def tell(words: str) -> None:
        print(f"{path}: {words}", file=sys.stderr)

    traces = read(
        path,
        args.node,
        partial=args.partial,
        across_materials=args.across_materials,
        stress_unit=args.stress_unit or "MPa",
        tell=tell,
    )
    output: Path = args.output or Path(f"{path.stem}_traces.csv")
    write_traces(output, traces)
    first = traces[0]
    unit = args.stress_unit or "MPa"
    if not args.json:
        taken = f"stress in the file taken as {unit}"
        if run_folder is None and args.stress_unit is None:
            taken += " (--stress-unit says otherwise)"
        print(
            f"{output}: {len(traces)} trace{'s' * (len(traces) > 1)}, "
            f"{first.start_ms:g} to {first.times_ms[-1]:g} ms "
            f"every {first.dt_ms:g} ms; {taken}"
        )
        for trace in traces:
            who = f"{trace.afferent} " if trace.afferent else ""
            print(f"  {who}node {trace.node}: peak {trace.stress_pa.max():.6g} Pa")
    return {
        "output": str(output),
        "stress_unit": unit,
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


def _list(path: Path, held: dict[str, Any], quiet: bool) -> dict[str, Any]:
    if quiet:
        return held
    print(f"{path}: {held['format']}, {held['bytes']} bytes")
    print(f"  mesh: {held['mesh_nodes']} nodes, {held['elements']} elements")
    if held["materials"]:
        names = (f"{number} {name}" for number, name in held["materials"].items())
        print(f"  materials: {', '.join(names)}")
    for quantity in held["quantities"]:
        span = f"{quantity['first_ms']:g} to {quantity['last_ms']:g} ms"
        where, count = "no nodes", quantity["increments"]
        if quantity["nodes"]:
            where = (
                f"{quantity['nodes']} nodes, {quantity['lowest_node']} to "
                f"{quantity['highest_node']}"
            )
        print(
            f"  {quantity['name']}: {', '.join(quantity['components'])}; "
            f"{count} increment{'s' * (count != 1)}, {span}; {where}; "
            f"{quantity['storage']}"
        )
    if held["problem"]:
        print(f"  problem: {held['problem']}")
    return held
