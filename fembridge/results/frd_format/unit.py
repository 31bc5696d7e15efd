"""The unit of each number in a ``.frd``: CalculiX names none, its quantities do.

Decks speak mm, N and s; stress in whatever the reader's options say. What leaves
here is Pa for stresses and for energy densities (1 Pa is 1 J/m³), mm, mm/s, N.
A quantity that is not listed is left as the file has it, with the unit "".
"""

from fembridge.results.frd_format.block import FrdBlock
from fembridge.results.read_options import ReadOptions

PA, AS_IS = "Pa", ""
# By quantity; one that ends in I is the imaginary part of the same.
_UNIT_OF_QUANTITY = {
    "DISP": "mm", "VELO": "mm/s", "FORC": "N",
    "STRESS": PA, "STRPOS": PA, "STRMID": PA, "STRNEG": PA, "ZZSTR": PA,
    "MSTRESS": PA, "ENER": PA,
    "TOSTRAIN": "1", "MESTRAIN": "1", "PE": "1", "ERROR": "%",
}  # fmt: skip
# By component, in quantities that mix units.
_UNIT_OF_COMPONENT = {
    "COPEN": "mm", "CSLIP1": "mm", "CSLIP2": "mm",
    "CPRESS": PA, "CSHEAR1": PA, "CSHEAR2": PA,
}  # fmt: skip
_MAGNITUDE, _PHASE = "MAG", "PHA"
_UNIT_OF_MAGNITUDE = {"PDISP": "mm", "PSTRESS": PA}


def units_of(block: FrdBlock) -> tuple[str, ...]:
    """Give the unit of each component of `block`, once `scales_of` is applied."""
    return tuple(_unit(block.name, component) for component in block.components)


def scales_of(block: FrdBlock, options: ReadOptions) -> tuple[float, ...]:
    """Give the factor of each component, from the file's unit to ours."""
    return tuple(options.pa_per_unit if unit == PA else 1.0 for unit in units_of(block))


def _unit(name: str, component: str) -> str:
    if component in _UNIT_OF_COMPONENT:
        return _UNIT_OF_COMPONENT[component]
    if name in _UNIT_OF_MAGNITUDE:
        if component.startswith(_MAGNITUDE):
            return _UNIT_OF_MAGNITUDE[name]
        return "deg" if component.startswith(_PHASE) else AS_IS
    plain = _UNIT_OF_QUANTITY.get(name.removesuffix("I"), AS_IS)
    return _UNIT_OF_QUANTITY.get(name, plain)
