"""How ``fembridge ingest --list`` shows what a file holds."""

from pathlib import Path
from typing import Any

# Of plots and decks: what is shown as it is.
_PLAIN = (
    "title", "schema", "precision", "increments", "end_ms", "tables", "columns",
    "over_time", "nodes", "arrays", "not_described",
)  # fmt: skip
_SINGULAR = {"contact_bodies": "contact body"}


def show(path: Path, held: dict[str, Any]) -> None:
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


def show_deck(path: Path, held: dict[str, Any]) -> None:
    """Print what `held`, a description of the Marc deck `path`, says."""
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


def _in_words(value: object, between: str) -> str:
    """Say a dict as ``key value``, a list item by item; what is empty is left out."""
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
    for quantity in held["quantities"]:
        where = "no nodes"
        if quantity["nodes"]:
            where = (
                f"{quantity['nodes']} nodes, {quantity['lowest_node']} to "
                f"{quantity['highest_node']}"
            )
        if quantity.get("at", "nodes") != "nodes":
            where = f"at {quantity['at']}"
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
