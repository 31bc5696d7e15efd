"""Read traces, fields or tables from a solver's result file.

Traces: beside a run.toml of fembridge they are those of its afferents, on the
clock of the stimulus: time 0 is its start, and the first sample is the state
before it moves. Of any other .frd (CalculiX), .t16 or .t19 (Marc) choose nodes:
--node, --node-set, --near-mm; without them the file is listed, with a command that takes a
trace. What it holds is written as it is, one increment or uneven ones, several steps or
modes; --resample-ms makes the even step that encode needs. --quantity takes another
than von Mises stress. Of a .dat choose integration points: --point; a history plot saved
from Mentat (.txt) has its curves. Fields: --field writes one increment, --vtu all of them
for ParaView. Tables: a .dat, .sta, .cvg or .sts becomes a long CSV, and so does a
path plot. --list shows what a file holds. A run that did not end normally is refused,
unless --partial takes what is whole.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fembridge.commands.options import (
    NODE,
    NUMBERS,
    RepeatedOption,
    Several,
    Use,
    check_uses,
    parse_column,
)
from fembridge.errors import UsageError

if TYPE_CHECKING:
    from fembridge.results import Result
    from fembridge.results.read_options import ReadOptions

EXAMPLE = "fembridge ingest sine_20_250/job.frd -o traces.csv"
LAST = "last"  # increment
ALL = "all"  # nodes
_SELECTIONS = {"--node", "--node-set", "--near-mm", "--afferents", "--point", "--field", "--vtu"}
# Without a choice of nodes they would do nothing.
_OF_NODES = {
    *("--afferents", "--output", "--quantity", "--resample-ms", "--modes", "--deck"),
    *("--extrapolate", "--von-mises", "--across-materials"),
}
# Of nodes themselves, not of elements.
_NODAL = {"displacement", "reaction-force", "reaction force", "external force"}
_SHOWN = 12  # nodes, a line each
_ROWS_AT_ONCE = 1 << 16


def node(text: str) -> int | str:
    """A number, or ``all``."""
    return text if text == ALL else int(NODE(text))


def position_mm(text: str) -> tuple[float, ...]:
    """``X,Y`` or ``X,Y,Z``."""
    values = tuple(map(NUMBERS["near_mm"], text.split(",")))
    if len(values) not in (2, 3):
        raise UsageError(found=text, expected="X,Y or X,Y,Z")
    return values


def point(text: str) -> tuple[int, int]:
    """``ELEMENT:POINT``."""
    element, colon, number = text.partition(":")
    if not colon:
        raise UsageError(found=text, expected="ELEMENT:POINT")
    return int(NODE(element)), int(NODE(number))


_MANY: dict[str, Any] = {"action": Several}
_YES: dict[str, Any] = {"action": "store_true"}
# By group: option, help, and how it is read.
_OPTIONS: dict[str, Sequence[tuple[str, str, dict[str, Any]]]] = {
    "": (
        ("--list", "show what the file holds, write nothing", _YES),
        ("--output", "table to write (default: RESULT's name and what it is, here); for --field "
         ".npz or .csv", {"type": Path, "metavar": "FILE"}),
        ("--quantity", "of nodes: von-mises (the default), stress (the tensor), principal, "
         "max-shear, mean-stress, displacement, reaction-force, strain, temperature, or the "
         "file's name of any other; with --vtu only these; of a .dat the one of its table",
         {"metavar": "NAME", **_MANY}),
        ("--stress-unit", "unit of the file's stress (default: that of its heading or "
         "--length-unit, else MPa, which is N and mm)", {"choices": ("MPa", "kPa", "Pa", "psi")}),
        ("--length-unit", "unit of the file's lengths (default: that of its heading, else mm)",
         {"choices": ("mm", "m", "in")}),
        ("--partial", "read the complete part of a run that did not end normally", _YES),
    ),
    "traces at nodes of a .frd, .t16 or .t19": (
        ("--node", "nodes by number, or all", {"type": node, "metavar": "N", **_MANY}),
        ("--node-set", "nodes of a set: of the file, or of its deck",
         {"metavar": "NAME", **_MANY}),
        ("--near-mm", "the node with results nearest to a position in mm of the undeformed mesh; "
         "several as words or by repetition",
         {"type": position_mm, "metavar": "X,Y[,Z]", "action": RepeatedOption}),
        ("--deck", "deck that defines --node-set (default: the sets in a .t16 or .t19; of a .frd "
         "the deck of the same name in .inp)", {"type": Path, "metavar": "DECK"}),
        ("--afferents", "the nodes of run.toml's afferents (the default where there is one)", _YES),
        ("--across-materials",
         "allow nodes between two materials, where stress is a mean over both", _YES),
        ("--resample-ms", "an even step, by PCHIP of the stress tensor or of the --quantity; "
         "nothing before the first or after the last increment is made up",
         {"type": NUMBERS["resample_ms"], "metavar": "DT"}),
        ("--modes", "the modes of frequency and buckling steps, of a file that has times too",
         _YES),
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
    ),
    "any other result: CSV, NPZ, or VTU, PVD, XDMF": (
        ("--columns", "which column or array is what: time (in s) or time_ms, value (von Mises, or "
         "an array of tensors) or xx, yy, zz, xy, yz, zx, node, afferent",
         {"type": parse_column, "metavar": "time=NAME,value=NAME", **_MANY}),
    ),
    "printed results in a .dat": (
        ("--point", "stress traces at integration points, which no averaging has touched; in the "
         "table their node is ELEMENT times 100 plus POINT",
         {"type": point, "metavar": "ELEMENT:POINT", **_MANY}),
        ("--print-set", "of which set, if several are printed", {"metavar": "NAME"}),
    ),
}  # fmt: skip


def _uses(kind: str, suffix: str) -> tuple[Use, ...]:
    """What options are for, where `kind`, see `_kind`, is taken of a file with this `suffix`."""
    from fembridge.results.history import VON_MISES

    of_dat = kind == "table" and suffix == ".dat"

    def kinds(*names: str) -> Callable[[argparse.Namespace], bool]:
        return lambda args: kind in names

    return (
        Use("--output", "what is written, not for --list", lambda args: not args.list),
        Use(
            "--stress-unit --length-unit",
            "stress and lengths, which are not taken here",
            lambda args: of_dat or not (args.list or kind == "table"),
        ),
        Use("--deck", "--node-set", lambda args: args.node_set),
        Use(
            "--node-set --near-mm",
            "chosen nodes, not for --node all",
            lambda args: args.node != [ALL],
        ),
        Use("--print-set", "--point", kinds("point")),
        Use("--increment", "--field", kinds("field")),
        Use("--derived", "--vtu", kinds("vtu")),
        Use(
            "--quantity",
            "a table at nodes or points, a table of a .dat, or --vtu",
            lambda args: of_dat or kind in ("traces", "point", "vtu"),
        ),
        Use("--resample-ms", "a table at nodes or points", kinds("traces", "point")),
        Use("--modes", "a table at nodes, or --vtu", kinds("traces", "vtu")),
        Use(
            "--von-mises",
            "von Mises stress at nodes",
            lambda args: kind == "traces" and _names(args) <= {VON_MISES},
        ),
        Use(
            "--across-materials",
            "stress or strain at nodes",
            lambda args: (
                kind == "traces" and suffix in (".frd", ".t16", ".t19") and not _is_nodal(args)
            ),
        ),
        Use(
            "--extrapolate",
            "values carried to nodes",
            lambda args: kind in ("traces", "sides", "field", "vtu") and not _is_nodal(args),
        ),
        Use("--one-sided", "--node N of a .frd, .t16 or .t19", kinds("sides")),
    )


def _names(args: argparse.Namespace) -> set[str]:
    """Quantities that --quantity names, in lower case."""
    return {name.lower() for name in args.quantity or ()}


def _is_nodal(args: argparse.Namespace) -> bool:
    """Whether all that --quantity names is of nodes, without elements."""
    return bool(args.quantity) and _names(args) <= _NODAL


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    files = "a .frd, .dat, .sta or .cvg of CalculiX; a .t16, .t19 or .sts of Marc; "
    files += "a plot that Mentat saved, .txt; any .csv, .npz, .vtu, .pvd, .xdmf by --columns; "
    files += "or a run folder; .frd and .dat also as .gz"
    parser.add_argument("result", type=Path, metavar="RESULT", help=files)
    for title, options in _OPTIONS.items():
        group = parser.add_argument_group(title) if title else parser
        for option, help_text, settings in options:
            short = ("-o",) if option == "--output" else ()
            group.add_argument(*short, option, help=help_text, **settings)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """List, or read and write; the summary says what was written."""
    from fembridge.results import open_result

    with open_result(
        args.result,
        partial=args.partial,
        across_materials=args.across_materials,
        stress_unit=args.stress_unit,
        length_unit=args.length_unit,
        extrapolate=args.extrapolate,
        von_mises=args.von_mises,
        columns=dict(args.columns) if args.columns else None,
    ) as result:
        return _run(args, result)


def _run(args: argparse.Namespace, result: "Result") -> dict[str, Any]:
    from fembridge.results.byte_file import suffix_of

    path, suffix = result.source.path, suffix_of(result.source.path)
    if suffix == ".dat":  # of a Marc deck, too
        from decks.marc.grammar import is_marc_deck

        if is_marc_deck(path):
            return _deck(args, path)
    kind = _kind(args, result)
    check_uses(args, _uses(kind, suffix))
    foreign = kind == "traces" and (result.run is None or not result.run.afferents)
    if kind == "list" or (foreign and _has_no_nodes(args, result)):
        description = result.source.describe()
        commands = [] if kind == "list" else _extraction_commands(args, result)
        if not args.json:
            _print_description(path, description)
            print(*commands, sep="\n", end="\n" if commands else "")
        return description | ({"commands": commands} if commands else {})
    if args.output and kind not in ("field", "vtu") and args.output.suffix.lower() != ".csv":
        raise UsageError(argument="output", found=str(args.output), expected="a name in .csv")
    write = {
        "traces": _traces, "point": _traces, "sides": _sides, "table": _table, "field": _field,
        "vtu": _vtu,
    }[kind]  # fmt: skip
    summary, headline, lines = write(args, result)
    if kind != "table" or suffix == ".dat":
        from_run = kind == "traces" and result.run is not None
        headline += _unit_note(args, result.source.options, summary, from_run)
    if not args.json:
        print(f"{summary['output']}: {headline}", *(f"  {row}" for row in lines), sep="\n")
    return summary


def _refuse_unused_units(
    args: argparse.Namespace, options: "ReadOptions", quantity: str, units: Sequence[str]
) -> None:
    """Refuse a unit of stress where nothing, or the name of a column, is in another one."""
    from fembridge.results.columns import stress_units_in

    if "--stress-unit" not in args.explicit:
        return
    if not {"Pa", "N"} & set(units):
        problem = f"is for stress or forces, not for {quantity}"
        raise UsageError(problem, argument="stress_unit", found=options.stress_unit)
    if options.columns:
        unit, is_open = stress_units_in(options.columns, options.stress_unit)
        if not is_open:
            problem = f"is for columns whose names state no unit, not {unit}"
            raise UsageError(problem, argument="stress_unit", found=options.stress_unit)


def _unit_note(
    args: argparse.Namespace, options: "ReadOptions", summary: dict[str, Any], from_run: bool
) -> str:
    """The unit that the file was taken to be in, in words and in the `summary`."""
    unit, is_open = options.stress_unit, True
    if options.columns:
        from fembridge.results.columns import stress_units_in

        unit, is_open = stress_units_in(options.columns, unit)
    summary["stress_unit"] = unit
    if "mm" in summary.get("units", ()):
        summary["length_unit"] = options.length_unit
        hint = " (--length-unit says otherwise)" if args.length_unit is None else ""
        return f"; lengths in the file taken as {options.length_unit}{hint}"
    if summary.get("units", ("Pa",))[0] != "Pa":
        return ""
    hint = " (--stress-unit says otherwise)"
    unit_is_certain = args.stress_unit is not None or from_run or not is_open
    return f"; stress in the file taken as {unit}{'' if unit_is_certain else hint}"


def _kind(args: argparse.Namespace, result: "Result") -> str:
    """Output that the options select: list, vtu, field, table, point, sides or traces."""
    from fembridge.results.byte_file import suffix_of
    from fembridge.results.printed import is_abaqus
    from fembridge.results.readers import PRINTS

    path, suffix = result.source.path, suffix_of(result.source.path)
    if args.afferents and result.run is None and result.run_error is None:
        problem = "is for a file with a run.toml in its folder"
        raise UsageError(problem, path, argument="afferents")
    node_options = {"--node": args.node, "--node-set": args.node_set, "--near-mm": args.near_mm}
    by_node = [option for option, value in node_options.items() if value]
    output_options = {
        "--list": args.list,
        "--vtu": args.vtu,
        "--field": args.field,
        "--point": args.point,
    }
    requested = [option for option, value in output_options.items() if value]
    requested += [*by_node, "--afferents"] if args.afferents else by_node[:1]
    option = requested[0] if requested else ""
    sides = args.one_sided is not None
    is_file_wide = option in ("--list", "--vtu", "--field")
    printed = suffix in PRINTS
    if suffix == ".dat" and not (args.point or args.quantity or args.list):
        # Abaqus prints at nodes, too, and its runs are read there.
        from_abaqus = result.run is not None and result.run.solver == "abaqus"
        printed = not ((by_node or args.afferents or from_abaqus) and is_abaqus(path))
    misuse = (
        (len(requested) > 1, option, f"cannot be combined with {' '.join(requested[1:2])}"),
        (
            printed and option not in ("", "--list", "--point"),
            option,
            "is for a .frd, .t16 or .t19",
        ),
        (args.point and suffix != ".dat", "--point", "is for a .dat"),
        (
            sides and (printed or by_node != ["--node"]),
            "--one-sided",
            "is for the --node of a .frd, .t16 or .t19",
        ),
        (sides and args.von_mises, "--one-sided", "cannot be combined with --von-mises"),
        (sides and ALL in (args.node or ()), "--one-sided", "requires numbers of nodes"),
    )
    for is_wrong, argument, problem in misuse:
        if is_wrong:
            raise UsageError(problem, path, argument=argument)
    if sides:
        return "sides"
    if is_file_wide or option == "--point":
        return option.removeprefix("--")
    if not option and path.suffix.lower() == ".txt":
        return "traces" if result.source.describe()["over_time"] else "table"
    return "table" if printed else "traces"


Written = tuple[dict[str, Any], str, list[str]]
"""The summary of a command, what was written in words, and a line each of its parts."""


def _traces(args: argparse.Namespace, result: "Result") -> Written:
    """A quantity at chosen nodes, or traces at points, or of the afferents of ``run.toml``."""
    from fembridge.io.text_table import write_table
    from fembridge.io.trace_table import write_origin
    from fembridge.results.history import STRESS, VON_MISES

    quantity, origin = _one_quantity(args, result.source.path), None
    if args.point:
        from fembridge.results.printed import read_point_history

        history = read_point_history(
            result.source.path, args.point, args.print_set, result.source.options
        )
        history = history.selected(
            quantity or VON_MISES, args.resample_ms, result.source.options.quiet
        )
    else:
        all_nodes = args.node == [ALL]
        if ALL in (args.node or ()) and not all_nodes:
            raise UsageError(
                path=result.source.path,
                argument="node",
                found=args.node,
                expected="all, or numbers",
            )
        plain = (quantity or VON_MISES).lower() == VON_MISES
        from_start = result.run is not None and plain and not (all_nodes or args.modes)
        history = result.history(
            None if all_nodes else args.node,
            quantity=VON_MISES if from_start else quantity,
            all_nodes=all_nodes,
            modes=args.modes,
            resample_ms=args.resample_ms,
            sets=args.node_set or (),
            near_mm=args.near_mm or (),
            deck=args.deck,
            from_start=from_start,
        )
        if from_start and result.run is not None:
            origin = result.run.origin()
    _refuse_unused_units(args, result.source.options, history.quantity, history.units)
    if history.quantity.lower() in _NODAL:  # by default, of a file without stress
        for option in ("--extrapolate", "--across-materials"):
            if option in args.explicit:
                problem = f"is for stress or strain, not for {history.quantity}"
                raise UsageError(problem, argument=option)
    table = history.columns()
    if _names(args) == {STRESS} and "von_mises_pa" in table:
        problem = f"is {STRESS}, but the file has von Mises stress and no tensor"
        raise UsageError(problem, result.source.path, argument="quantity", found=STRESS)
    plain = history.over_time and history.quantity == VON_MISES
    kind = "traces" if plain else history.quantity.lower().replace(" ", "_")
    kind = kind if history.over_time else f"modes_{kind}"
    output: Path = args.output or Path(f"{result.source.path.stem}_{kind}.csv")
    rows = (
        row
        for start in range(0, len(table["node"]), _ROWS_AT_ONCE)
        for row in zip(
            *(column[start : start + _ROWS_AT_ONCE].tolist() for column in table.values()),
            strict=True,
        )
    )
    write_table(output, list(table), rows)
    write_origin(output, origin)
    traces = list(
        zip(
            history.afferents or [None] * len(history.nodes),
            history.nodes,
            history.peaks(),
            strict=True,
        )
    )
    summary = {
        "output": str(output),
        "quantity": history.quantity,
        "columns": list(table),
        "units": list(dict.fromkeys(history.units)),
        "axis": history.axis,
        "dt_ms": history.dt_ms,
        "resample_ms": history.resample_ms if plain and history.uneven else None,
        "start_ms": float(history.at[0]) if history.over_time else None,
        "samples": int(history.at.size),
        "traces": [
            {"afferent": afferent, "node": number}
            | ({"peak_pa": peak} if plain else {"peak": peak, "column": name})
            for afferent, number, (name, peak) in traces
        ],
    }
    count = _count_text(len(traces), "trace" if plain else "node")
    headline = (
        f"{count}, {history.form}" if plain else f"{history.quantity} of {count}, {history.form}"
    )
    if plain and history.uneven:
        headline += f"; --resample-ms {history.resample_ms:g} makes the even step that encode needs"
    lines = [
        f"{afferent or ''} node {number}: ".lstrip()
        + (f"peak {peak:.6g} Pa" if plain else f"largest {name} {peak:.6g}")
        for afferent, number, (name, peak) in traces[:_SHOWN]
    ]
    if len(traces) > _SHOWN:
        lines.append(f"and {len(traces) - _SHOWN} more")
    return summary, headline, lines


def _one_quantity(args: argparse.Namespace, path: Path) -> str | None:
    """The quantity of ``--quantity``; None without the option."""
    if args.quantity and len(args.quantity) > 1:
        names = ", ".join(args.quantity)
        raise UsageError(path=path, argument="quantity", found=names, expected="one name")
    return args.quantity[0] if args.quantity else None


def _has_no_nodes(args: argparse.Namespace, result: "Result") -> bool:
    """Whether neither the user nor a run names nodes: the file is listed then."""
    if args.node or args.node_set or args.near_mm or result.named_nodes():
        return False
    advice = "choose with --node N or all, --node-set NAME or --near-mm X,Y"
    if args.afferents:
        advice = "--afferents needs them"
    if args.explicit & _OF_NODES:
        reason = (
            "no run.toml in its folder" if result.run is None else "its run.toml has no afferents"
        )
        raise UsageError(f"{reason}; {advice}", result.source.path)
    return True


def _extraction_commands(args: argparse.Namespace, result: "Result") -> list[str]:
    """What to say of how something is taken out of `result`: commands that were tried."""
    import shlex

    from fembridge.errors import FembridgeError

    command = f"fembridge ingest {shlex.quote(str(args.result))}"
    for option, unit in (("stress", args.stress_unit), ("length", args.length_unit)):
        command += f" --{option}-unit {unit}" if unit else ""
    try:
        number, options, history = result.largest_node()
    except FembridgeError as error:
        if error.argument == "columns":
            return [error.message("--columns")]
        return [f"nothing at nodes to take: {error}"]
    command += f" --node {number}"
    command += "".join(f" --{name.replace('_', '-')}" for name, needed in options.items() if needed)
    lines = [f"{history.quantity} where it is largest:", f"  {command}"]
    if history.uneven:
        lines.append(f"  {command} --resample-ms {history.resample_ms:g}")
    return lines


def _sides(args: argparse.Namespace, result: "Result") -> Written:
    """Stress at nodes as each layer there has it: a row a time and side."""
    import numpy as np

    from fembridge.io.text_table import write_table
    from fembridge.results.von_mises import TENSOR

    nodes = dict.fromkeys(args.node)
    sides = [side for node in nodes for side in result.source.sides(node, args.one_sided)]
    output: Path = args.output or Path(f"{result.source.path.stem}_sides.csv")
    stresses = ["von_mises_pa", *(f"{name}_pa" for name in TENSOR)]
    samples = (
        (time_ms, side.node, side.name, *stress_pa)
        for side in sides
        for time_ms, stress_pa in zip(
            side.times_ms.tolist(),
            np.column_stack([side.von_mises_pa, side.tensor_pa]).tolist(),
            strict=True,
        )
    )
    write_table(output, ("time_ms", "node", "material", *stresses), samples)
    rows = [
        {
            "node": side.node,
            "material": side.name,
            "elements": list(side.elements),
            "peak_pa": float(side.von_mises_pa.max()),
        }
        for side in sides
    ]
    lines = [f"node {r['node']} in {r['material']}: peak {r['peak_pa']:.6g} Pa" for r in rows]
    return {"output": str(output), "sides": rows}, f"{len(sides)} sides", lines


def _table(args: argparse.Namespace, result: "Result") -> Written:
    """The prints of a solver, or a plot saved from Mentat, as a table."""
    from fembridge.results.byte_file import suffix_of

    path, suffix = result.source.path, suffix_of(result.source.path)
    quantity, plot = _one_quantity(args, path), suffix == ".txt"
    if quantity and suffix != ".dat":
        raise UsageError("is for a .dat", path, argument="quantity")
    output: Path = args.output or Path(f"{path.stem}_{'plot' if plot else suffix[1:]}.csv")
    columns, rows = result.source.write_table(output, quantity)
    summary = {
        "output": str(output),
        "format": result.source.format,
        "rows": rows,
        "columns": list(columns),
    }
    if plot:
        return summary, f"{rows} rows of {', '.join(columns)}; numbers as in the file", []
    return summary | {"stress_unit": result.source.options.stress_unit}, f"{rows} rows", []


def _field(args: argparse.Namespace, result: "Result") -> Written:
    """One quantity of one increment at all nodes."""
    from fembridge.results.fields import write_field

    field = result.source.field(args.field, args.increment)
    _refuse_unused_units(args, result.source.options, field.name, field.units)
    name = f"{field.name.lower().replace(' ', '_')}_{field.step}_{field.increment}"
    output: Path = args.output or Path(f"{result.source.path.stem}_{name}.npz")
    write_field(output, field)
    time_text = f"{field.axis} {field.axis_value:g}"
    if field.time_ms == field.time_ms:  # not NaN, as of a mode
        time_text = f"{field.time_ms:g} ms"
    summary = {
        "output": str(output),
        "quantity": field.name,
        "components": list(field.components),
        "units": list(field.units),
        "step": field.step,
        "increment": field.increment,
        "time_ms": field.time_ms,
        "nodes": int(field.nodes.size),
    }
    increment_text = f"step {field.step}, increment {field.increment}, {time_text}"
    return summary, f"{field.name} of {field.nodes.size} nodes, {increment_text}", []


def _vtu(args: argparse.Namespace, result: "Result") -> Written:
    """Every increment for ParaView."""
    from fembridge.results.vtu import write_frames

    derived = tuple(dict.fromkeys(args.derived or ("von_mises",)))
    collection, count = write_frames(result.source, args.vtu, args.quantity, derived, args.modes)
    summary = {"output": str(collection), "increments": count}
    return summary, f"{count} increments", []


def _deck(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    """What a Marc deck is: it has the suffix of CalculiX's prints."""
    from decks.marc.contents import describe_marc_deck

    check_uses(args, _uses("list", ".dat"))
    if not args.list or args.explicit & _SELECTIONS:
        raise UsageError(
            f"a deck of Marc without results: results are in {path.stem}.t16 or {path.stem}.t19; "
            "--list shows the contents of the deck",
            path,
        )
    description = describe_marc_deck(path)
    if not args.json:
        _print_description(
            path, {name: value for name, value in description.items() if name != "sections"}
        )
    return description


def _count_text(count: int, noun: str) -> str:
    return f"{count} {noun}{'s' * (count != 1)}"


def _print_description(path: Path, description: dict[str, Any]) -> None:
    """Print what `description`, one of `path`, says: a line a name, or a line each of many."""
    print(f"{path}: {description['format']}, {description['bytes']} bytes")
    for name, value in (description | description.get("header", {})).items():
        if name not in ("format", "bytes", "header") and value not in (None, "", [], {}):
            print(
                *(f"  {line}" for line in _description_lines(name.replace("_", " "), value)),
                sep="\n",
            )


def _description_lines(name: str, value: Any) -> Iterator[str]:  # noqa: ANN401 - whatever JSON can hold
    """The lines of one name of a description."""
    singular = name.replace("bodies", "body").removesuffix("s")
    if name == "quantities":
        yield from map(_quantity_line, value)
    elif name == "sets":  # of a deck by name
        if isinstance(value, dict):
            value = [{"name": key, **item} for key, item in value.items()]
        for kind in dict.fromkeys(item["kind"] for item in value):
            set_texts = [
                f"{item['name']} {item['members']}" for item in value if item["kind"] == kind
            ]
            yield f"{kind} sets: {', '.join(set_texts)}"
    elif name == "sections":
        yield from (f"{section}: {_count_text(count, 'time')}" for section, count in value.items())
    elif isinstance(value, list) and (isinstance(value[0], dict) or name == "remarks"):
        yield from (f"{singular}: {_value_text(item, ', ')}" for item in value)
    elif isinstance(value, dict) and any(isinstance(item, dict) for item in value.values()):
        yield from (f"{singular} {key}: {_value_text(item, ', ')}" for key, item in value.items())
    elif isinstance(value, dict) and name in ("elements", "element types"):
        yield f"{name}: {', '.join(f'{count} of type {kind}' for kind, count in value.items())}"
    elif isinstance(value, list):
        yield f"{name}: {', '.join(map(str, value))}"
    else:
        yield f"{name}: {_value_text(value, '; ' if name == 'post' else ', ')}"


def _quantity_line(quantity: dict[str, Any]) -> str:
    """A quantity of a ``.frd``, ``.t16`` or ``.t19``: components, increments, modes and where."""
    parts = [", ".join(quantity["components"])]
    count, first, last = (quantity[key] for key in ("increments", "first_ms", "last_ms"))
    if count:
        times = f"{first:g} to {last:g} ms" if count > 1 else f"at {last:g} ms"
        parts.append(f"{_count_text(count, 'increment')}, {times}")
    count, first, last = (quantity[key] for key in ("modes", "first_value", "last_value"))
    if count:
        span = f"{first:g} to {last:g}" if count > 1 else f"{last:g}"
        parts.append(f"{_count_text(count, 'mode')} without time, {quantity['axis']} {span}")
    location = f"at {quantity.get('at', 'nodes')}"
    if location == "at nodes":
        location = _count_text(quantity["nodes"], "node")
        if quantity["nodes"]:
            location += f", {quantity['lowest_node']} to {quantity['highest_node']}"
    return f"{quantity['name']}: {'; '.join([*parts, location, quantity['storage']])}"


def _value_text(value: object, separator: str) -> str:
    """A dict as ``key value``, a list item by item; what is empty is left out."""
    if isinstance(value, dict):
        entries = {str(key).replace("_", " "): item for key, item in value.items()}
        return separator.join(
            key if item is True else f"{key} {_value_text(item, ' ')}"
            for key, item in entries.items()
            if item not in (None, False, [], "")
        )
    if isinstance(value, list):
        return " ".join(_value_text(item, " ") for item in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
