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
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fembridge.results import Result
    from fembridge.results.one_sided import OneSidedStress
    from fembridge.results.printed import PrintTable
    from fembridge.trace import StressTrace

EXAMPLE = "fembridge ingest sine_20_250/job.frd -o traces.csv"
LAST = "last"  # increment
# Of plots and decks: what --list shows as it is.
_PLAIN = (
    "title", "schema", "precision", "increments", "end_ms", "tables", "columns",
    "over_time", "nodes", "arrays", "not_described",
)  # fmt: skip
_SINGULAR = {"contact_bodies": "contact body"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    add = parser.add_argument
    many: dict[str, Any] = {"nargs": "+", "action": "extend"}
    add(
        "result",
        type=Path,
        metavar="RESULT",
        help="a .frd, .dat, .sta or .cvg of CalculiX; a .t16, .t19 or .sts of Marc; "
        "a plot that Mentat saved, .txt; or a run folder",
    )
    add("--list", action="store_true", help="show what the file holds, write nothing")
    add(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="table to write (default: RESULT's name and what it is, here); "
        "for --field .npz or .csv",
    )
    add(
        "--stress-unit",
        choices=("MPa", "kPa", "Pa"),
        help="unit of the file's stress (default: MPa, which is N and mm)",
    )
    add(
        "--partial",
        action="store_true",
        help="take what is whole of a run that did not end normally",
    )

    add = parser.add_argument_group("traces at nodes of a .frd, .t16 or .t19").add_argument
    add("--node", type=int, metavar="N", help="nodes by number", **many)
    add(
        "--set",
        metavar="NAME",
        dest="sets",
        help="nodes of a set: of the file, or of its deck",
        **many,
    )
    add(
        "--near",
        type=place,
        metavar="X,Y[,Z]",
        help="the node with results nearest to a place in mm of the undeformed mesh; "
        "before a negative X write --near=-X,Y",
        **many,
    )
    add(
        "--deck",
        type=Path,
        metavar="DECK",
        help="where --set looks (default: the sets in a .t16 or .t19; of a .frd the "
        "deck of the same name in .inp)",
    )
    add(
        "--afferents",
        action="store_true",
        help="the nodes of run.toml's afferents (the default where there is one)",
    )
    add(
        "--across-materials",
        action="store_true",
        help="allow nodes between two materials, where stress is a mean over both",
    )
    add(
        "--one-sided",
        nargs="?",
        const="",
        metavar="ELSET",
        help="of such --node, the stress in each material for itself; of a .frd from "
        "the points that the .dat beside it prints of this element set",
    )

    add = parser.add_argument_group("from integration points of a .t16 or .t19").add_argument
    add(
        "--extrapolate",
        choices=("linear", "translate", "average"),
        help="how values get to the nodes: by the polynomial through the points "
        "(the default), from the nearest point, or as the element's mean",
    )
    add(
        "--von-mises",
        choices=("tensor", "scalar"),
        help="von Mises stress of the nodal tensor (the default), or of the points, "
        "carried to the nodes as a number, as Mentat plots it",
    )

    add = parser.add_argument_group("whole fields of a .frd, .t16 or .t19").add_argument
    add("--field", metavar="QUANTITY", help="all nodes at one increment: STRESS, DISP")
    add(
        "--increment",
        default=LAST,
        metavar="[STEP:]N",
        help="which increment, or mode, --field takes (default: last)",
    )
    add(
        "--vtu", type=Path, metavar="FOLDER", help="every increment as VTU, and a PVD, for ParaView"
    )
    add(
        "--derived",
        metavar="NAME",
        help="what --vtu computes beside them: von_mises (the default), principal, "
        "max_shear, mean_stress, strain_energy_density",
        **many,
    )
    add(
        "--quantity",
        metavar="NAME",
        help="only these: of a .frd for --vtu, of a .dat one for its table",
        **many,
    )

    add = parser.add_argument_group("prints in a .dat").add_argument
    add(
        "--point",
        type=point,
        metavar="ELEMENT:POINT",
        help="stress traces at integration points, which no averaging has touched; "
        "in the table their node is ELEMENT times 100 plus POINT",
        **many,
    )
    add("--print-set", metavar="NAME", help="of which set, if several are printed")


def place(text: str) -> tuple[float, ...]:
    """``X,Y`` or ``X,Y,Z``."""
    values = tuple(float(word) for word in text.split(","))
    if len(values) not in (2, 3):
        raise ValueError(text)
    return values


def point(text: str) -> tuple[int, int]:
    """``ELEMENT:POINT``."""
    element, _, number = text.partition(":")
    return int(element), int(number)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """List, or read and write; the summary says what was written."""
    from fembridge.results import open_result
    from fembridge.results.printed import print_table_of

    result = open_result(
        args.result,
        partial=args.partial,
        across_materials=args.across_materials,
        stress_unit=args.stress_unit,
        extrapolate=args.extrapolate,
        von_mises=args.von_mises,
        log=lambda words: print(f"{result.path}: {words}", file=sys.stderr),
    )
    path, printed = result.path, print_table_of(result.path)
    if path.suffix.lower() == ".dat":  # of a Marc deck, too
        from decks.marc.grammar import is_marc_deck

        if is_marc_deck(path):
            return _deck(args, path)
    kind = _kind(args, path, printed is not None)
    if kind == "list":
        held = result.describe() if printed is None else printed.describe(path)
        if not args.json:
            _show(path, held)
        return held
    if kind == "traces":
        return _traces(args, result)
    if kind == "points":
        from fembridge.results.printed import read_point_traces

        found = read_point_traces(path, args.point, args.print_set, result.options)
        return _written(args, result, found, foreign=True)
    if kind == "table" and printed is not None:
        return _table(args, result, printed)
    return {"sides": _sides, "plot": _plot, "field": _field, "vtu": _vtu}[kind](args, result)


def _kind(args: argparse.Namespace, path: Path, printed: bool) -> str:
    """What is asked for: list, vtu, field, table, plot, points, sides or traces.

    Raises
    ------
    UsageError
        Words that do not go together, or not with this kind of file.
    """
    from fembridge.errors import UsageError

    given = {"--node": args.node, "--set": args.sets, "--near": args.near}
    by_node = [word for word, value in given.items() if value]
    given = {"--list": args.list, "--vtu": args.vtu, "--field": args.field, "--point": args.point}
    asked = [word for word, value in given.items() if value]
    if args.afferents:
        asked += [*by_node, "--afferents"]
    else:
        asked += by_node[:1]
    if len(asked) > 1:
        raise UsageError(f"{asked[0]} and {asked[1]} do not go together")
    word = asked[0] if asked else ""
    if printed and word not in ("", "--list", "--point"):
        raise UsageError(f"{path}: {word} is for a .frd, .t16 or .t19")
    if args.point and path.suffix.lower() != ".dat":
        raise UsageError(f"{path}: --point is for a .dat")
    if args.increment != LAST and word != "--field":
        raise UsageError("--increment is for --field")
    if args.derived and word != "--vtu":
        raise UsageError("--derived is for --vtu")
    if args.one_sided is not None:
        if printed or by_node != ["--node"]:
            raise UsageError("--one-sided is for the --node of a .frd, .t16 or .t19")
        if args.von_mises:
            raise UsageError("--one-sided and --von-mises do not go together")
        return "sides"
    if word in ("--list", "--vtu", "--field"):
        if args.von_mises:
            raise UsageError(f"{word} and --von-mises do not go together")
        return word.removeprefix("--")
    if printed:
        return "points" if args.point else "table"
    if not word and path.suffix.lower() == ".txt":
        from fembridge.results.mentat import is_over_time

        return "traces" if is_over_time(path) else "plot"
    return "traces"


def _traces(args: argparse.Namespace, result: "Result") -> dict[str, Any]:
    """Write the traces at chosen nodes, or of the afferents of ``run.toml``."""
    from fembridge.errors import UsageError

    nodes: Sequence[int] | None = args.node
    chosen = args.node or args.sets or args.near
    if result.run is None and not chosen:
        nodes = result.reader.named_nodes(result.path)
        if not nodes:
            held = result.describe()
            if not args.json:
                _show(result.path, held)
            wants = "choose with --node N, --set NAME or --near X,Y"
            if args.afferents:
                wants = "--afferents needs one"
            raise UsageError(f"{result.path}: no run.toml beside it; {wants}")
    found = result.traces(nodes, sets=args.sets or (), near_mm=args.near or (), deck=args.deck)
    return _written(args, result, found, foreign=result.run is None)


def _written(
    args: argparse.Namespace, result: "Result", found: Sequence["StressTrace"], *, foreign: bool
) -> dict[str, Any]:
    """Write traces, and say what they are."""
    from fembridge.tables import write_traces

    output: Path = args.output or Path(f"{result.path.stem}_traces.csv")
    write_traces(output, found)
    first = found[0]
    if not args.json:
        print(
            f"{output}: {len(found)} trace{'s' * (len(found) > 1)}, "
            f"{first.start_ms:g} to {first.times_ms[-1]:g} ms "
            f"every {first.dt_ms:g} ms; {_unit_words(args, result, foreign)}"
        )
        for trace in found:
            who = f"{trace.afferent} " if trace.afferent else ""
            print(f"  {who}node {trace.node}: peak {trace.stress_pa.max():.6g} Pa")
    return {
        "output": str(output),
        "stress_unit": result.options.stress_unit,
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


def _sides(args: argparse.Namespace, result: "Result") -> dict[str, Any]:
    """Write the stress at nodes as each layer there has it."""
    from fembridge.results.one_sided import write_sides

    found = [side for node in dict.fromkeys(args.node) for side in _sides_of(args, result, node)]
    output: Path = args.output or Path(f"{result.path.stem}_sides.csv")
    write_sides(output, found)
    if not args.json:
        print(f"{output}: {len(found)} sides; {_unit_words(args, result)}")
        for side in found:
            print(f"  node {side.node} in {side.name}: peak {side.von_mises_pa.max():.6g} Pa")
    return {
        "output": str(output),
        "stress_unit": result.options.stress_unit,
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


def _sides_of(
    args: argparse.Namespace, result: "Result", node: int
) -> "tuple[OneSidedStress, ...]":
    from fembridge.errors import UsageError

    if result.reader.points:
        from fembridge.results.marc import read_one_sided

        if args.one_sided:
            raise UsageError("--one-sided of a Marc post file takes no name: it has all elements")
        return read_one_sided(result.path, node, result.options)
    from fembridge.results.one_sided import one_sided_stress

    if not args.one_sided:
        raise UsageError("--one-sided takes the element set that the .dat beside a .frd prints")
    return one_sided_stress(result.path, node, args.one_sided, options=result.options)


def _table(args: argparse.Namespace, result: "Result", printed: "PrintTable") -> dict[str, Any]:
    """Write the prints of a solver as a table."""
    from fembridge.errors import UsageError
    from fembridge.results.printed import write_print_table

    path = result.path
    suffix = path.suffix.lower()
    if args.quantity and (len(args.quantity) > 1 or suffix != ".dat"):
        raise UsageError(f"{path}: --quantity takes one name, and of a .dat")
    output: Path = args.output or Path(f"{path.stem}_{suffix[1:]}.csv")
    quantity = args.quantity[0] if args.quantity else None
    columns, rows = write_print_table(printed, path, output, result.options, quantity)
    if not args.json:
        unit = f"; {_unit_words(args, result)}" if suffix == ".dat" else ""
        print(f"{output}: {rows} rows{unit}")
    return {
        "output": str(output),
        "format": printed.name,
        "rows": rows,
        "columns": list(columns),
        "stress_unit": result.options.stress_unit,
    }


def _plot(args: argparse.Namespace, result: "Result") -> dict[str, Any]:
    """Write a plot saved from Mentat as a table, number by number."""
    from fembridge.results.mentat import write_plot_table

    columns = result.describe()["columns"]
    output: Path = args.output or Path(f"{result.path.stem}_plot.csv")
    rows = write_plot_table(result.path, output)
    if not args.json:
        print(f"{output}: {rows} rows of {', '.join(columns)}; numbers as in the file")
    return {"output": str(output), "format": "mentat-plot", "rows": rows, "columns": columns}


def _field(args: argparse.Namespace, result: "Result") -> dict[str, Any]:
    """Write one quantity of one increment at all nodes."""
    from fembridge.results.fields import read_field, write_field

    found = read_field(result.path, args.field, args.increment, result.options)
    name = f"{found.name.lower().replace(' ', '_')}_{found.step}_{found.increment}"
    output: Path = args.output or Path(f"{result.path.stem}_{name}.npz")
    write_field(output, found)
    if not args.json:
        when = f"{found.axis} {found.axis_value:g}"
        if found.time_ms == found.time_ms:
            when = f"{found.time_ms:g} ms"
        print(
            f"{output}: {found.name} of {found.nodes.size} nodes, step {found.step}, "
            f"increment {found.increment}, {when}; {_unit_words(args, result)}"
        )
    return {
        "output": str(output),
        "quantity": found.name,
        "components": list(found.components),
        "units": list(found.units),
        "step": found.step,
        "increment": found.increment,
        "time_ms": found.time_ms,
        "nodes": int(found.nodes.size),
        "stress_unit": result.options.stress_unit,
    }


def _vtu(args: argparse.Namespace, result: "Result") -> dict[str, Any]:
    """Write every increment for ParaView."""
    from fembridge.results.vtu import write_vtu_series

    options = result.options
    collection = write_vtu_series(
        result.path,
        args.vtu,
        quantities=args.quantity,
        derived=tuple(dict.fromkeys(args.derived or ("von_mises",))),
        partial=options.partial,
        stress_unit=options.stress_unit,
        extrapolate=options.extrapolate,
        log=options.log,
    )
    count = len(list(args.vtu.glob("*.vtu")))
    if not args.json:
        print(f"{collection}: {count} increments; {_unit_words(args, result)}")
    return {
        "output": str(collection),
        "increments": count,
        "stress_unit": options.stress_unit,
    }


def _unit_words(args: argparse.Namespace, result: "Result", foreign: bool = True) -> str:
    """In which unit the file's stress was taken."""
    words = f"stress in the file taken as {result.options.stress_unit}"
    if foreign and args.stress_unit is None:
        words += " (--stress-unit says otherwise)"
    return words


def _show(path: Path, held: dict[str, Any]) -> None:
    """Print what `held`, a description of `path`, says."""
    print(f"{path}: {held['format']}, {held['bytes']} bytes")
    for name, value in held.get("header", {}).items():
        print(f"  {name}: {value}")
    if "mesh_nodes" in held:
        _show_results(held)
    for one in held.get("sets", ()):
        print(f"  set {one['name']}: {one['members']} of kind {one['kind']}")
    for name, count in held.get("sections", {}).items():
        print(f"  {name}: {count} time{'s' * (count != 1)}")
    for name in () if "mesh_nodes" in held else _PLAIN:
        if held.get(name) not in (None, [], ""):
            value = held[name]
            words = ", ".join(map(str, value)) if isinstance(value, list) else value
            print(f"  {name.replace('_', ' ')}: {words}")
    if "rows" in held:
        print(f"  {held['rows']} row{'s' * (held['rows'] != 1)}")
    if held.get("last"):
        last = (f"{name} {value}" for name, value in held["last"].items())
        print(f"  last: {', '.join(last)}")
    for remark in held.get("remarks", ()):
        print(f"  remark: {remark}")
    if held.get("problem"):
        print(f"  problem: {held['problem']}")


def _show_results(held: dict[str, Any]) -> None:
    types = ", ".join(
        f"{count} of type {number}" for number, count in held.get("element_types", {}).items()
    )
    print(f"  mesh: {held['mesh_nodes']} nodes, {held['elements']} elements{types and ': '}{types}")
    if held.get("codes"):
        print(f"  element post codes: {', '.join(map(str, held['codes']))}")
    if held["materials"]:
        names = (f"{number} {name}" for number, name in held["materials"].items())
        print(f"  materials: {', '.join(names)}")
    for one in held["quantities"]:
        where = "no nodes"
        if one["nodes"]:
            where = f"{one['nodes']} nodes, {one['lowest_node']} to {one['highest_node']}"
        if one.get("at", "nodes") != "nodes":
            where = f"at {one['at']}"
        spans = []
        count, first, last = (one[key] for key in ("increments", "first_ms", "last_ms"))
        if count:
            when = f"{first:g} to {last:g} ms" if count > 1 else f"at {last:g} ms"
            spans.append(f"{count} increment{'s' * (count != 1)}, {when}")
        count, first, last = (one[key] for key in ("modes", "first_value", "last_value"))
        if count:
            span = f"{first:g} to {last:g}" if count > 1 else f"{last:g}"
            spans.append(f"{count} mode{'s' * (count != 1)} without time, {one['axis']} {span}")
        components = ", ".join(one["components"])
        print(f"  {one['name']}: {components}; {'; '.join(spans)}; {where}; {one['storage']}")


def _deck(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    """Say what a Marc deck is: it has the suffix of CalculiX's prints."""
    from decks.marc.contents import describe_marc_deck
    from fembridge.errors import UsageError

    if not args.list:
        raise UsageError(
            f"{path}: a Marc deck, no results; --list shows what it holds, results "
            f"are in {path.stem}.t16 or {path.stem}.t19"
        )
    held = describe_marc_deck(path)
    if args.json:
        return held
    print(f"{path}: {held['format']}, {held['bytes']} bytes")
    for name, value in held.items():
        plain = name.replace("_", " ")
        one_of = _SINGULAR.get(name, plain.removesuffix("s"))
        if name in ("format", "bytes", "sections", "remarks"):
            continue
        if isinstance(value, list):
            for one in value:
                print(f"  {one_of}: {_in_words(one, ', ')}")
        elif isinstance(value, dict) and any(isinstance(x, dict) for x in value.values()):
            for key, one in value.items():
                print(f"  {one_of} {key}: {_in_words(one, ', ')}")
        elif name == "elements":
            types = (f"{count} of type {number}" for number, count in value.items())
            print(f"  elements: {', '.join(types)}")
        elif value not in (None, "", {}):
            print(f"  {plain}: {_in_words(value, '; ')}")
    for remark in held.get("remarks", ()):
        print(f"  remark: {remark}")
    return held


def _in_words(value: object, between: str) -> str:
    """A dict as ``key value``, a list item by item; what is empty is left out."""
    if isinstance(value, dict):
        return between.join(
            str(key).replace("_", " ")
            if one is True
            else f"{str(key).replace('_', ' ')} {_in_words(one, ' ')}"
            for key, one in value.items()
            if one not in (None, False, [], "")
        )
    if isinstance(value, list):
        return " ".join(_in_words(one, " ") for one in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
