"""All of a file, or of an increment: tables, fields, files for ParaView."""

import argparse
from pathlib import Path
from typing import Any

from fembridge.commands.ingest_words import options_of, stress_unit_of, teller, unit_words


def table(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    """Write the prints of a solver as a table."""
    from fembridge.errors import UsageError
    from fembridge.results.printed.print_tables import print_table_of, write_print_table

    kind = print_table_of(path)
    assert kind is not None  # kind_of looked
    if args.quantity and (len(args.quantity) > 1 or kind.suffix != ".dat"):
        raise UsageError(f"{path}: --quantity takes one name, and of a .dat")
    output: Path = args.output or Path(f"{path.stem}_{kind.suffix[1:]}.csv")
    quantity = args.quantity[0] if args.quantity else None
    rows = write_print_table(kind, path, output, options_of(args, path), quantity)
    if not args.json:
        unit = f"; {unit_words(args, path, True)}" if kind.suffix == ".dat" else ""
        print(f"{output}: {rows} rows{unit}")
    return {
        "output": str(output),
        "format": kind.name,
        "rows": rows,
        "columns": list(kind.columns),
        "stress_unit": stress_unit_of(args, path),
    }


def plot_table(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    """Write a plot saved from Mentat as a table, number by number."""
    from fembridge.results.mentat import describe, write_plot_table

    columns = describe(path)["columns"]
    output: Path = args.output or Path(f"{path.stem}_plot.csv")
    rows = write_plot_table(path, output)
    if not args.json:
        print(f"{output}: {rows} rows of {', '.join(columns)}; numbers as in the file")
    return {"output": str(output), "format": "mentat-plot", "rows": rows, "columns": columns}


def field(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    """Write one quantity of one increment at all nodes."""
    from fembridge.results.field_file import read_field, write_field

    found = read_field(path, args.field, args.increment, options_of(args, path))
    name = found.name.lower().replace(" ", "_")
    output: Path = args.output or Path(f"{path.stem}_{name}_{found.step}_{found.increment}.npz")
    write_field(output, found)
    when = f"{found.axis} {found.axis_value:g}"
    if found.time_ms == found.time_ms:
        when = f"{found.time_ms:g} ms"
    if not args.json:
        print(
            f"{output}: {found.name} of {found.nodes.size} nodes, step {found.step}, "
            f"increment {found.increment}, {when}; {unit_words(args, path, True)}"
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
        "stress_unit": stress_unit_of(args, path),
    }


def vtu(args: argparse.Namespace, path: Path) -> dict[str, Any]:
    """Write every increment for ParaView."""
    from fembridge.results.vtu import write_vtu_series

    collection = write_vtu_series(
        path,
        args.vtu,
        quantities=args.quantity,
        derived=tuple(dict.fromkeys(args.derived or ("von_mises",))),
        partial=args.partial,
        stress_unit=stress_unit_of(args, path),
        extrapolate=args.extrapolate,
        tell=teller(path),
    )
    count = len(list(args.vtu.glob("*.vtu")))
    if not args.json:
        print(f"{collection}: {count} increments; {unit_words(args, path, True)}")
    return {
        "output": str(collection),
        "increments": count,
        "stress_unit": stress_unit_of(args, path),
    }
