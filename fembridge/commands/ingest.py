"""Read traces, fields or tables from a solver's result file.

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
    files = "a .frd, .dat, .sta or .cvg of CalculiX; a .t16, .t19 or .sts of Marc; "
    files += "a plot that Mentat saved, .txt; or a run folder"
    add("result", type=Path, metavar="RESULT", help=files)
    add("--list", action="store_true", help="show what the file holds, write nothing")
    table = "table to write (default: RESULT's name and what it is, here); for --field .npz or .csv"
    add("-o", "--output", type=Path, metavar="FILE", help=table)
    unit = "unit of the file's stress (default: MPa, which is N and mm)"
    add("--stress-unit", choices=("MPa", "kPa", "Pa"), help=unit)
    partial = "read the complete part of a run that did not end normally"
    add("--partial", action="store_true", help=partial)

    add = parser.add_argument_group("traces at nodes of a .frd, .t16 or .t19").add_argument
    add("--node", type=int, metavar="N", help="nodes by number", **many)
    sets = "nodes of a set: of the file, or of its deck"
    add("--set", metavar="NAME", dest="sets", help=sets, **many)
    near = "the node with results nearest to a place in mm of the undeformed mesh; "
    near += "before a negative X write --near=-X,Y"
    add("--near", type=place, metavar="X,Y[,Z]", help=near, **many)
    deck = "where --set looks (default: the sets in a .t16 or .t19; of a .frd the "
    deck += "deck of the same name in .inp)"
    add("--deck", type=Path, metavar="DECK", help=deck)
    afferents = "the nodes of run.toml's afferents (the default where there is one)"
    add("--afferents", action="store_true", help=afferents)
    across = "allow nodes between two materials, where stress is a mean over both"
    add("--across-materials", action="store_true", help=across)
    sides = "of such --node, the stress in each material separately; of a .frd from "
    sides += "the points that the .dat beside it prints of this element set"
    add("--one-sided", nargs="?", const="", metavar="ELSET", help=sides)

    add = parser.add_argument_group("from integration points of a .t16 or .t19").add_argument
    carried = "how values get to the nodes: by the polynomial through the points "
    carried += "(the default), from the nearest point, or as the element's mean"
    add("--extrapolate", choices=("linear", "translate", "average"), help=carried)
    mises = "von Mises stress of the nodal tensor (the default), or of the points, "
    mises += "carried to the nodes as a number, as Mentat plots it"
    add("--von-mises", choices=("tensor", "scalar"), help=mises)

    add = parser.add_argument_group("whole fields of a .frd, .t16 or .t19").add_argument
    add("--field", metavar="QUANTITY", help="all nodes at one increment: STRESS, DISP")
    which = "which increment, or mode, --field takes (default: last)"
    add("--increment", default=LAST, metavar="[STEP:]N", help=which)
    series = "every increment as VTU, and a PVD, for ParaView"
    add("--vtu", type=Path, metavar="FOLDER", help=series)
    derived = "what --vtu computes beside them: von_mises (the default), principal, "
    derived += "max_shear, mean_stress, strain_energy_density"
    add("--derived", metavar="NAME", help=derived, **many)
    only = "only these: of a .frd for --vtu, of a .dat one for its table"
    add("--quantity", metavar="NAME", help=only, **many)

    add = parser.add_argument_group("printed results in a .dat").add_argument
    points = "stress traces at integration points, which no averaging has touched; "
    points += "in the table their node is ELEMENT times 100 plus POINT"
    add("--point", type=point, metavar="ELEMENT:POINT", help=points, **many)
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
    from fembridge.results.printed import PRINT_TABLES

    result = open_result(
        args.result,
        partial=args.partial,
        across_materials=args.across_materials,
        stress_unit=args.stress_unit,
        extrapolate=args.extrapolate,
        von_mises=args.von_mises,
        log=lambda words: print(f"{result.path}: {words}", file=sys.stderr),
    )
    path = result.path
    suffix = path.suffix.lower()
    printed = PRINT_TABLES.get(suffix)
    if suffix == ".dat":  # of a Marc deck, too
        from decks.marc.grammar import is_marc_deck

        if is_marc_deck(path):
            return _deck(args, path)
    kind = _kind(args, path, printed is not None)
    if kind == "list":
        held = result.describe() if printed is None else printed.describe(path)
        if not args.json:
            _show(path, held)
        return held
    if printed is not None and kind == "table":
        summary, lines = _table(args, result, printed)
    else:
        writers = {
            "traces": _traces, "points": _points, "sides": _sides, "plot": _plot,
            "field": _field, "vtu": _vtu,
        }  # fmt: skip
        summary, lines = writers[kind](args, result)
    if not args.json:
        print(*lines, sep="\n")
    return summary


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
    asked += [*by_node, "--afferents"] if args.afferents else by_node[:1]
    word = asked[0] if asked else ""
    sides = args.one_sided is not None
    whole = word in ("--list", "--vtu", "--field")
    misuse = (
        (len(asked) > 1, " and ".join(asked[:2]) + " do not go together"),
        (printed and word not in ("", "--list", "--point"), f"{word} is for a .frd, .t16 or .t19"),
        (args.point and path.suffix.lower() != ".dat", "--point is for a .dat"),
        (args.increment != LAST and word != "--field", "--increment is for --field"),
        (args.derived and word != "--vtu", "--derived is for --vtu"),
        (
            sides and (printed or by_node != ["--node"]),
            "--one-sided is for the --node of a .frd, .t16 or .t19",
        ),
        (sides and args.von_mises, "--one-sided and --von-mises do not go together"),
        (whole and args.von_mises, f"{word} and --von-mises do not go together"),
    )
    for wrong, words in misuse:
        if wrong:
            raise UsageError(f"{path}: {words}")
    if sides:
        return "sides"
    if whole:
        return word.removeprefix("--")
    if printed:
        return "points" if args.point else "table"
    if not word and path.suffix.lower() == ".txt":
        from fembridge.results.mentat import is_over_time

        return "traces" if is_over_time(path) else "plot"
    return "traces"


Written = tuple[dict[str, Any], list[str]]
"""The summary of a command, and its lines for people."""


def _traces(args: argparse.Namespace, result: "Result") -> Written:
    """Traces at chosen nodes, or of the afferents of ``run.toml``."""
    from fembridge.errors import UsageError

    nodes: Sequence[int] | None = args.node
    if result.run is None and not (args.node or args.sets or args.near):
        nodes = result.named_nodes()
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


def _points(args: argparse.Namespace, result: "Result") -> Written:
    """Traces at integration points."""
    from fembridge.results.printed import read_point_traces

    found = read_point_traces(result.path, args.point, args.print_set, result.options)
    return _written(args, result, found, foreign=True)


def _written(
    args: argparse.Namespace, result: "Result", found: Sequence["StressTrace"], *, foreign: bool
) -> Written:
    from fembridge.tables import write_traces

    output: Path = args.output or Path(f"{result.path.stem}_traces.csv")
    write_traces(output, found)
    first = found[0]
    rows = [
        {"afferent": one.afferent, "node": one.node, "peak_pa": float(one.stress_pa.max())}
        for one in found
    ]
    lines = [
        f"{output}: {len(found)} trace{'s' * (len(found) > 1)}, "
        f"{first.start_ms:g} to {first.times_ms[-1]:g} ms "
        f"every {first.dt_ms:g} ms; {_unit_words(args, result, foreign)}"
    ]
    for row in rows:
        who = f"{row['afferent']} " if row["afferent"] else ""
        lines.append(f"  {who}node {row['node']}: peak {row['peak_pa']:.6g} Pa")
    return {
        "output": str(output),
        "stress_unit": result.options.stress_unit,
        "dt_ms": first.dt_ms,
        "start_ms": first.start_ms,
        "samples": int(first.stress_pa.size),
        "traces": rows,
    }, lines


def _sides(args: argparse.Namespace, result: "Result") -> Written:
    """Stress at nodes as each layer there has it."""
    from fembridge.errors import UsageError
    from fembridge.results.one_sided import one_sided_stress, write_sides

    of_marc = result.reader.points
    if of_marc and args.one_sided:
        raise UsageError("--one-sided of a Marc post file takes no name: it has all elements")
    if not of_marc and not args.one_sided:
        raise UsageError("--one-sided takes the element set that the .dat beside a .frd prints")
    found: list[OneSidedStress] = []
    for node in dict.fromkeys(args.node):
        if of_marc:
            from fembridge.results.marc import read_one_sided

            found += read_one_sided(result.path, node, result.options)
        else:
            found += one_sided_stress(result.path, node, args.one_sided, options=result.options)
    output: Path = args.output or Path(f"{result.path.stem}_sides.csv")
    write_sides(output, found)
    rows = [
        {
            "node": side.node,
            "material": side.name,
            "elements": list(side.elements),
            "peak_pa": float(side.von_mises_pa.max()),
        }
        for side in found
    ]
    lines = [f"{output}: {len(found)} sides; {_unit_words(args, result)}"]
    lines += [f"  node {r['node']} in {r['material']}: peak {r['peak_pa']:.6g} Pa" for r in rows]
    unit = result.options.stress_unit
    return {"output": str(output), "stress_unit": unit, "sides": rows}, lines


def _table(args: argparse.Namespace, result: "Result", printed: "PrintTable") -> Written:
    """The prints of a solver as a table."""
    from fembridge.errors import UsageError
    from fembridge.results.printed import write_print_table

    path, suffix = result.path, result.path.suffix.lower()
    if args.quantity and (len(args.quantity) > 1 or suffix != ".dat"):
        raise UsageError(f"{path}: --quantity takes one name, and of a .dat")
    output: Path = args.output or Path(f"{path.stem}_{suffix[1:]}.csv")
    quantity = args.quantity[0] if args.quantity else None
    columns, rows = write_print_table(printed, path, output, result.options, quantity)
    unit = f"; {_unit_words(args, result)}" if suffix == ".dat" else ""
    return {
        "output": str(output),
        "format": printed.name,
        "rows": rows,
        "columns": list(columns),
        "stress_unit": result.options.stress_unit,
    }, [f"{output}: {rows} rows{unit}"]


def _plot(args: argparse.Namespace, result: "Result") -> Written:
    """A plot saved from Mentat as a table, number by number."""
    from fembridge.results.mentat import write_plot_table

    columns = result.describe()["columns"]
    output: Path = args.output or Path(f"{result.path.stem}_plot.csv")
    rows = write_plot_table(result.path, output)
    words = f"{output}: {rows} rows of {', '.join(columns)}; numbers as in the file"
    summary = {"output": str(output), "format": "mentat-plot", "rows": rows, "columns": columns}
    return summary, [words]


def _field(args: argparse.Namespace, result: "Result") -> Written:
    """One quantity of one increment at all nodes."""
    from fembridge.results.fields import read_field, write_field

    found = read_field(result.path, args.field, args.increment, result.options)
    name = f"{found.name.lower().replace(' ', '_')}_{found.step}_{found.increment}"
    output: Path = args.output or Path(f"{result.path.stem}_{name}.npz")
    write_field(output, found)
    when = f"{found.axis} {found.axis_value:g}"
    if found.time_ms == found.time_ms:  # not NaN, as of a mode
        when = f"{found.time_ms:g} ms"
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
    }, [
        f"{output}: {found.name} of {found.nodes.size} nodes, step {found.step}, "
        f"increment {found.increment}, {when}; {_unit_words(args, result)}"
    ]


def _vtu(args: argparse.Namespace, result: "Result") -> Written:
    """Every increment for ParaView."""
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
    return {
        "output": str(collection),
        "increments": count,
        "stress_unit": options.stress_unit,
    }, [f"{collection}: {count} increments; {_unit_words(args, result)}"]


def _unit_words(args: argparse.Namespace, result: "Result", foreign: bool = True) -> str:
    """In which unit the file's stress was taken."""
    words = f"stress in the file taken as {result.options.stress_unit}"
    if foreign and args.stress_unit is None:
        words += " (--stress-unit says otherwise)"
    return words


def _show(path: Path, held: dict[str, Any]) -> None:
    """Print what `held`, a description of `path`, says."""
    lines = [f"{path}: {held['format']}, {held['bytes']} bytes"]
    lines += [f"  {name}: {value}" for name, value in held.get("header", {}).items()]
    if "mesh_nodes" in held:
        lines += _of_results(held)
    for one in held.get("sets", ()):
        lines.append(f"  set {one['name']}: {one['members']} of kind {one['kind']}")
    for name, count in held.get("sections", {}).items():
        lines.append(f"  {name}: {_counted(count, 'time')}")
    for name in () if "mesh_nodes" in held else _PLAIN:
        value = held.get(name)
        if value not in (None, [], ""):
            words = ", ".join(map(str, value)) if isinstance(value, list) else value
            lines.append(f"  {name.replace('_', ' ')}: {words}")
    if "rows" in held:
        lines.append(f"  {_counted(held['rows'], 'row')}")
    if held.get("last"):
        last = (f"{name} {value}" for name, value in held["last"].items())
        lines.append(f"  last: {', '.join(last)}")
    lines += [f"  remark: {remark}" for remark in held.get("remarks", ())]
    if held.get("problem"):
        lines.append(f"  problem: {held['problem']}")
    print(*lines, sep="\n")


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'s' * (count != 1)}"


def _of_results(held: dict[str, Any]) -> list[str]:
    """Mesh, materials and quantities of a ``.frd``, ``.t16`` or ``.t19``."""
    types = [f"{count} of type {one}" for one, count in held.get("element_types", {}).items()]
    mesh = f"  mesh: {held['mesh_nodes']} nodes, {held['elements']} elements"
    lines = [f"{mesh}: {', '.join(types)}" if types else mesh]
    if held.get("codes"):
        lines.append(f"  element post codes: {', '.join(map(str, held['codes']))}")
    if held["materials"]:
        names = (f"{number} {name}" for number, name in held["materials"].items())
        lines.append(f"  materials: {', '.join(names)}")
    for one in held["quantities"]:
        where = "no nodes"
        if one["nodes"]:
            where = f"{one['nodes']} nodes, {one['lowest_node']} to {one['highest_node']}"
        if one.get("at", "nodes") != "nodes":
            where = f"at {one['at']}"
        words = [", ".join(one["components"])]
        count, first, last = (one[key] for key in ("increments", "first_ms", "last_ms"))
        if count:
            when = f"{first:g} to {last:g} ms" if count > 1 else f"at {last:g} ms"
            words.append(f"{_counted(count, 'increment')}, {when}")
        count, first, last = (one[key] for key in ("modes", "first_value", "last_value"))
        if count:
            span = f"{first:g} to {last:g}" if count > 1 else f"{last:g}"
            words.append(f"{_counted(count, 'mode')} without time, {one['axis']} {span}")
        lines.append(f"  {one['name']}: {'; '.join([*words, where, one['storage']])}")
    return lines


def _deck(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    """What a Marc deck is: it has the suffix of CalculiX's prints."""
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
        held = {str(key).replace("_", " "): one for key, one in value.items()}
        return between.join(
            key if one is True else f"{key} {_in_words(one, ' ')}"
            for key, one in held.items()
            if one not in (None, False, [], "")
        )
    if isinstance(value, list):
        return " ".join(_in_words(one, " ") for one in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
