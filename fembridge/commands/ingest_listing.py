"""How ``fembridge ingest --list`` shows what a file holds."""

from pathlib import Path
from typing import Any


def show(path: Path, held: dict[str, Any]) -> None:
    """Print what `held`, a description of `path`, says."""
    print(f"{path}: {held['format']}, {held['bytes']} bytes")
    if "quantities" in held:
        _show_results(held)
    for name, count in held.get("sections", {}).items():
        print(f"  {name}: {count} time{'s' * (count != 1)}")
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
    print(f"  mesh: {held['mesh_nodes']} nodes, {held['elements']} elements")
    if held["materials"]:
        names = (f"{number} {name}" for number, name in held["materials"].items())
        print(f"  materials: {', '.join(names)}")
    for quantity in held["quantities"]:
        where = "no nodes"
        if quantity["nodes"]:
            where = (
                f"{quantity['nodes']} nodes, {quantity['lowest_node']} to "
                f"{quantity['highest_node']}"
            )
        print(
            f"  {quantity['name']}: {', '.join(quantity['components'])}; "
            f"{_span(quantity)}; {where}; {quantity['storage']}"
        )


def _span(quantity: dict[str, Any]) -> str:
    words = []
    count, first, last = (quantity[k] for k in ("increments", "first_ms", "last_ms"))
    if count:
        when = f"{first:g} to {last:g} ms" if count > 1 else f"at {last:g} ms"
        words.append(f"{count} increment{'s' * (count != 1)}, {when}")
    count, first, last = (quantity[k] for k in ("modes", "first_value", "last_value"))
    if count:
        span = f"{first:g} to {last:g}" if count > 1 else f"{last:g}"
        what = f"{count} mode{'s' * (count != 1)} without time"
        words.append(f"{what}, {quantity['axis']} {span}")
    return "; ".join(words)
