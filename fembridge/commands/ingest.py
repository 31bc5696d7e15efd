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
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fembridge.results import Result
    from fembridge.trace import StressTrace

EXAMPLE = "fembridge ingest sine_20_250/job.frd -o traces.csv"
LAST = "last"  # increment


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


_MANY: dict[str, Any] = {"nargs": "+", "action": "extend"}
_YES: dict[str, Any] = {"action": "store_true"}
# By group: option, help, and how it is read.
_OPTIONS: dict[str, Sequence[tuple[str, str, dict[str, Any]]]] = {
    "": (
        ("--list", "show what the file holds, write nothing", _YES),
        ("--output", "table to write (default: RESULT's name and what it is, here); for --field "
         ".npz or .csv", {"type": Path, "metavar": "FILE"}),
        ("--stress-unit", "unit of the file's stress (default: MPa, which is N and mm)",
         {"choices": ("MPa", "kPa", "Pa")}),
        ("--partial", "read the complete part of a run that did not end normally", _YES),
    ),
    "traces at nodes of a .frd, .t16 or .t19": (
        ("--node", "nodes by number", {"type": int, "metavar": "N", **_MANY}),
        ("--set", "nodes of a set: of the file, or of its deck",
         {"metavar": "NAME", "dest": "sets", **_MANY}),
        ("--near", "the node with results nearest to a place in mm of the undeformed mesh; "
         "before a negative X write --near=-X,Y", {"type": place, "metavar": "X,Y[,Z]", **_MANY}),
        ("--deck", "where --set looks (default: the sets in a .t16 or .t19; of a .frd the deck "
         "of the same name in .inp)", {"type": Path, "metavar": "DECK"}),
        ("--afferents", "the nodes of run.toml's afferents (the default where there is one)", _YES),
        ("--across-materials",
         "allow nodes between two materials, where stress is a mean over both", _YES),
        ("--one-sided", "of such --node, the stress in each material separately; of a .frd from "
         "the points that the .dat beside it prints of this element set",
         {"nargs": "?", "const": "", "metavar": "ELSET"}),
    ),
    "from integration points of a .t16 or .t19": (
        ("--extrapolate", "how values get to the nodes: in a line from the element's mean through "
         "the nearest point (the default), from the nearest point, or as the element's mean",
         {"choices": ("linear", "translate", "average")}),
        ("--von-mises", "von Mises stress of the nodal tensor (the default), or of the points, "
         "carried to the nodes as a number, as Mentat plots it",
         {"choices": ("tensor", "scalar")}),
    ),
    "whole fields of a .frd, .t16 or .t19": (
        ("--field", "all nodes at one increment: STRESS, DISP", {"metavar": "QUANTITY"}),
        ("--increment", "which increment, or mode, --field takes (default: last)",
         {"default": LAST, "metavar": "[STEP:]N"}),
        ("--vtu", "every increment as VTU, and a PVD, for ParaView",
         {"type": Path, "metavar": "FOLDER"}),
        ("--derived", "what --vtu computes beside them: von_mises (the default), principal, "
         "max_shear, mean_stress, strain_energy_density", {"metavar": "NAME", **_MANY}),
        ("--quantity", "only these: of a .frd for --vtu, of a .dat one for its table",
         {"metavar": "NAME", **_MANY}),
    ),
    "printed results in a .dat": (
        ("--point", "stress traces at integration points, which no averaging has touched; in the "
         "table their node is ELEMENT times 100 plus POINT",
         {"type": point, "metavar": "ELEMENT:POINT", **_MANY}),
        ("--print-set", "of which set, if several are printed", {"metavar": "NAME"}),
    ),
}  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    files = "a .frd, .dat, .sta or .cvg of CalculiX; a .t16, .t19 or .sts of Marc; "
    files += "a plot that Mentat saved, .txt; or a run folder"
    parser.add_argument("result", type=Path, metavar="RESULT", help=files)
    for title, options in _OPTIONS.items():
        group = parser.add_argument_group(title) if title else parser
        for option, words, how in options:
            short = ("-o",) if option == "--output" else ()
            group.add_argument(*short, option, help=words, **how)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """List, or read and write; the summary says what was written."""
    from fembridge.results import open_result
    from fembridge.results.printed import PRINTS, describe_print

    result = open_result(
        args.result,
        partial=args.partial,
        across_materials=args.across_materials,
        stress_unit=args.stress_unit,
        extrapolate=args.extrapolate,
        von_mises=args.von_mises,
        log=lambda words: print(f"{result.path}: {words}", file=sys.stderr),
    )
    path, suffix = result.path, result.path.suffix.lower()
    if suffix == ".dat":  # of a Marc deck, too
        from decks.marc.grammar import is_marc_deck

        if is_marc_deck(path):
            return _deck(args, path)
    kind = _kind(args, path, suffix in PRINTS)
    if kind == "list":
        held = describe_print(path) if suffix in PRINTS else result.describe()
        if not args.json:
            _show(path, held)
        return held
    write = {
        "traces": _traces, "point": _traces, "sides": _sides, "table": _table, "plot": _plot,
        "field": _field, "vtu": _vtu,
    }[kind]  # fmt: skip
    summary, words, rows = write(args, result)
    if (suffix in PRINTS and suffix != ".dat") or kind == "plot":
        unit = ""
    else:
        summary["stress_unit"] = result.options.stress_unit
        unit = f"; stress in the file taken as {result.options.stress_unit}"
        if args.stress_unit is None and (kind != "traces" or result.run is None):
            unit += " (--stress-unit says otherwise)"
    if not args.json:
        print(f"{summary['output']}: {words}{unit}", *(f"  {row}" for row in rows), sep="\n")
    return summary


def _kind(args: argparse.Namespace, path: Path, printed: bool) -> str:
    """What is asked for: list, vtu, field, table, plot, point, sides or traces.

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
    if whole or word == "--point":
        return word.removeprefix("--")
    if not word and path.suffix.lower() == ".txt":
        from fembridge.results.mentat import is_over_time

        return "traces" if is_over_time(path) else "plot"
    return "table" if printed else "traces"


Written = tuple[dict[str, Any], str, list[str]]
"""The summary of a command, what was written in words, and a line each of its parts."""


def _traces(args: argparse.Namespace, result: "Result") -> Written:
    """Traces at chosen nodes or integration points, or of the afferents of ``run.toml``."""
    from fembridge.tables import write_traces

    found: Sequence[StressTrace]
    if args.point:
        from fembridge.results.printed import read_point_traces

        found = read_point_traces(result.path, args.point, args.print_set, result.options)
    else:
        nodes: Sequence[int] | None = args.node
        if result.run is None and not (args.node or args.sets or args.near):
            nodes = result.named_nodes()
            if not nodes:
                _refuse_without_nodes(args, result)
        found = result.traces(nodes, sets=args.sets or (), near_mm=args.near or (), deck=args.deck)
    output: Path = args.output or Path(f"{result.path.stem}_traces.csv")
    write_traces(output, found)
    first = found[0]
    rows = [
        {"afferent": one.afferent, "node": one.node, "peak_pa": float(one.stress_pa.max())}
        for one in found
    ]
    summary = {
        "output": str(output),
        "dt_ms": first.dt_ms,
        "start_ms": first.start_ms,
        "samples": int(first.stress_pa.size),
        "traces": rows,
    }
    words = (
        f"{len(found)} trace{'s' * (len(found) > 1)}, {first.start_ms:g} to "
        f"{first.times_ms[-1]:g} ms every {first.dt_ms:g} ms"
    )
    who = [f"{row['afferent'] or ''} node {row['node']}".lstrip() for row in rows]
    peaks = [f"peak {row['peak_pa']:.6g} Pa" for row in rows]
    return summary, words, [f"{one}: {peak}" for one, peak in zip(who, peaks, strict=True)]


def _refuse_without_nodes(args: argparse.Namespace, result: "Result") -> None:
    from fembridge.errors import UsageError

    held = result.describe()
    if not args.json:
        _show(result.path, held)
    wants = "choose with --node N, --set NAME or --near X,Y"
    if args.afferents:
        wants = "--afferents needs one"
    raise UsageError(f"{result.path}: no run.toml beside it; {wants}")


def _sides(args: argparse.Namespace, result: "Result") -> Written:
    """Stress at nodes as each layer there has it."""
    from fembridge.errors import UsageError
    from fembridge.results.one_sided import OneSidedStress, one_sided_stress, write_sides

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
    lines = [f"node {r['node']} in {r['material']}: peak {r['peak_pa']:.6g} Pa" for r in rows]
    return {"output": str(output), "sides": rows}, f"{len(found)} sides", lines


def _table(args: argparse.Namespace, result: "Result") -> Written:
    """The prints of a solver as a table."""
    from fembridge.errors import UsageError
    from fembridge.results.printed import PRINTS, write_print_table

    path, suffix = result.path, result.path.suffix.lower()
    if args.quantity and (len(args.quantity) > 1 or suffix != ".dat"):
        raise UsageError(f"{path}: --quantity takes one name, and of a .dat")
    output: Path = args.output or Path(f"{path.stem}_{suffix[1:]}.csv")
    quantity = args.quantity[0] if args.quantity else None
    columns, rows = write_print_table(path, output, result.options, quantity)
    summary = {
        "output": str(output),
        "format": PRINTS[suffix],
        "rows": rows,
        "columns": list(columns),
        "stress_unit": result.options.stress_unit,
    }
    return summary, f"{rows} rows", []


def _plot(args: argparse.Namespace, result: "Result") -> Written:
    """A plot saved from Mentat as a table, number by number."""
    from fembridge.results.mentat import write_plot_table

    columns = result.describe()["columns"]
    output: Path = args.output or Path(f"{result.path.stem}_plot.csv")
    rows = write_plot_table(result.path, output, result.options)
    summary = {"output": str(output), "format": "mentat-plot", "rows": rows, "columns": columns}
    return summary, f"{rows} rows of {', '.join(columns)}; numbers as in the file", []


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
    summary = {
        "output": str(output),
        "quantity": found.name,
        "components": list(found.components),
        "units": list(found.units),
        "step": found.step,
        "increment": found.increment,
        "time_ms": found.time_ms,
        "nodes": int(found.nodes.size),
    }
    where = f"step {found.step}, increment {found.increment}, {when}"
    return summary, f"{found.name} of {found.nodes.size} nodes, {where}", []


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
    summary = {"output": str(collection), "increments": count}
    return summary, f"{count} increments", []


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
    if not args.json:
        _show(path, {name: value for name, value in held.items() if name != "sections"})
    return held


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'s' * (count != 1)}"


def _show(path: Path, held: dict[str, Any]) -> None:
    """Print what `held`, a description of `path`, says: a line a name, or a line each of many."""
    print(f"{path}: {held['format']}, {held['bytes']} bytes")
    for name, value in (held | held.get("header", {})).items():
        if name not in ("format", "bytes", "header") and value not in (None, "", [], {}):
            print(*(f"  {line}" for line in _lines(name.replace("_", " "), value)), sep="\n")


def _lines(name: str, value: Any) -> Iterator[str]:  # noqa: ANN401 - whatever JSON can hold
    """The lines of one name of a description."""
    one_of = name.replace("bodies", "body").removesuffix("s")
    if name == "quantities":
        yield from map(_quantity, value)
    elif name == "sections":
        yield from (f"{section}: {_counted(count, 'time')}" for section, count in value.items())
    elif isinstance(value, list) and (isinstance(value[0], dict) or name == "remarks"):
        yield from (f"{one_of}: {_in_words(one, ', ')}" for one in value)
    elif isinstance(value, dict) and any(isinstance(one, dict) for one in value.values()):
        yield from (f"{one_of} {key}: {_in_words(one, ', ')}" for key, one in value.items())
    elif isinstance(value, dict) and name in ("elements", "element types"):
        yield f"{name}: {', '.join(f'{count} of type {kind}' for kind, count in value.items())}"
    elif isinstance(value, list):
        yield f"{name}: {', '.join(map(str, value))}"
    else:
        yield f"{name}: {_in_words(value, '; ' if name == 'post' else ', ')}"


def _quantity(one: dict[str, Any]) -> str:
    """A quantity of a ``.frd``, ``.t16`` or ``.t19``: components, increments, modes and where."""
    words = [", ".join(one["components"])]
    count, first, last = (one[key] for key in ("increments", "first_ms", "last_ms"))
    if count:
        when = f"{first:g} to {last:g} ms" if count > 1 else f"at {last:g} ms"
        words.append(f"{_counted(count, 'increment')}, {when}")
    count, first, last = (one[key] for key in ("modes", "first_value", "last_value"))
    if count:
        span = f"{first:g} to {last:g}" if count > 1 else f"{last:g}"
        words.append(f"{_counted(count, 'mode')} without time, {one['axis']} {span}")
    where = f"at {one.get('at', 'nodes')}"
    if where == "at nodes":
        where = _counted(one["nodes"], "node")
        if one["nodes"]:
            where += f", {one['lowest_node']} to {one['highest_node']}"
    return f"{one['name']}: {'; '.join([*words, where, one['storage']])}"


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
