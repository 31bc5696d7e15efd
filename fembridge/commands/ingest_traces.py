"""Traces from a result file: at nodes, at integration points, on sides of a layer."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fembridge.commands.ingest_words import listed, options_of, stress_unit_of, teller, unit_words

if TYPE_CHECKING:
    from fembridge.results.one_sided import OneSidedStress
    from fembridge.trace import StressTrace


def traces(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    """Write the traces at chosen nodes, or of the afferents of ``run.toml``."""
    from fembridge.errors import UsageError
    from fembridge.results import describe, named_nodes, read, run_folder_of
    from fembridge.results.node_choice import NodeChoice
    from fembridge.tables import write_traces

    run_folder = run_folder_of(path)
    choice = NodeChoice(args.node or (), args.sets or (), args.near or (), args.deck)
    nodes: Sequence[int] | None = None
    if choice:
        nodes = choice.resolve(path, teller(path))
    elif run_folder is None:
        nodes = named_nodes(path)
        if not nodes:
            listed(path, describe(path), args.json)
            wants = (
                "--afferents needs one"
                if args.afferents
                else "choose with --node N, --set NAME or --near X,Y"
            )
            raise UsageError(f"{path}: no run.toml beside it; {wants}")
    found = read(
        path,
        nodes,
        partial=args.partial,
        across_materials=args.across_materials,
        stress_unit=args.stress_unit,
        extrapolate=args.extrapolate,
        von_mises=args.von_mises,
        tell=teller(path),
    )
    output: Path = args.output or Path(f"{path.stem}_traces.csv")
    write_traces(output, found)
    return _told(args, path, output, found, run_folder is None)


def points(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    """Write the traces at integration points that a ``.dat`` prints."""
    from fembridge.results.printed.dat import read_point_traces
    from fembridge.tables import write_traces

    found = read_point_traces(path, args.point, args.print_set, options_of(args, path))
    output: Path = args.output or Path(f"{path.stem}_traces.csv")
    write_traces(output, found)
    return _told(args, path, output, found, True)


def sides(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    """Write the stress at nodes as each layer there has it."""
    from fembridge.results.one_sided import write_sides

    found = [side for node in dict.fromkeys(args.node) for side in _sides_of(args, path, node)]
    output: Path = args.output or Path(f"{path.stem}_sides.csv")
    write_sides(output, found)
    if not args.json:
        print(f"{output}: {len(found)} sides; {unit_words(args, path, True)}")
        for side in found:
            print(f"  node {side.node} in {side.name}: peak {side.von_mises_pa.max():.6g} Pa")
    return {
        "output": str(output),
        "stress_unit": stress_unit_of(args, path),
        "sides": [
            {
                "node": side.node,
                "material": side.name,
                "elements": list(side.elements),
                "peak_pa": float(side.von_mises_pa.max()),
            }
            for side in found
        ],
    }


def _sides_of(args: argparse.Namespace, path: Path, node: int) -> "tuple[OneSidedStress, ...]":
    from fembridge.errors import UsageError
    from fembridge.results import reader_of

    options = options_of(args, path)
    if reader_of(path).points:
        from fembridge.results.marc import read_one_sided

        if args.one_sided:
            raise UsageError("--one-sided of a Marc post file takes no name: it has all elements")
        return read_one_sided(path, node, options)
    from fembridge.results.one_sided import one_sided_stress

    if not args.one_sided:
        raise UsageError("--one-sided takes the element set that the .dat beside a .frd prints")
    return one_sided_stress(path, node, args.one_sided, options=options)


def _told(
    args: argparse.Namespace,
    path: Path,
    output: Path,
    found: Sequence["StressTrace"],
    foreign: bool,
) -> dict[str, Any]:
    first = found[0]
    if not args.json:
        print(
            f"{output}: {len(found)} trace{'s' * (len(found) > 1)}, "
            f"{first.start_ms:g} to {first.times_ms[-1]:g} ms "
            f"every {first.dt_ms:g} ms; {unit_words(args, path, foreign)}"
        )
        for trace in found:
            who = f"{trace.afferent} " if trace.afferent else ""
            print(f"  {who}node {trace.node}: peak {trace.stress_pa.max():.6g} Pa")
    return {
        "output": str(output),
        "stress_unit": stress_unit_of(args, path),
        "dt_ms": first.dt_ms,
        "start_ms": first.start_ms,
        "samples": int(first.stress_pa.size),
        "traces": [
            {
                "afferent": trace.afferent,
                "node": trace.node,
                "peak_pa": float(trace.stress_pa.max()),
            }
            for trace in found
        ],
    }
