"""What the post codes of a Marc file amount to: tensors and single numbers.

A tensor is requested by one code and stored as six consecutive ones, in the order 11 22 33
12 23 31, which is our xx yy zz xy yz zx: no column moves. Single components (codes 11 to
16) make the same tensor where all six are there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fembridge.errors import ResultError
from fembridge.results.marc_post import NodalQuantity, PostCode
from fembridge.results.stress import TENSOR

PA, AS_IS = "Pa", ""
_TENSORS = {
    301: ("Total Strain", "E"), 311: ("Stress", "S"), 321: ("Plastic Strain", "P"),
    331: ("Creep Strain", "C"), 341: ("Cauchy Stress", "S"),
    401: ("Elastic Strain", "E"), 411: ("Stress in Global System", "S"),
    431: ("Plastic Strain in Global System", "P"),
    # Mentat wrote it for `*add_post_tensor log_strain`; a public reader calls it a
    # stress, and is wrong.
    681: ("Logarithmic Strain", "E"),
    1: ("Strain 1 to 6", "E"), 11: ("Stress 11 to 16", "S"),
    41: ("Cauchy Stress 41 to 46", "S"),
}  # fmt: skip
# The stress that traces are made of: the first of these that the file has. Cauchy stress,
# which CalculiX gives too, comes before "stress", which is that only where the job follows
# the deformation (updated Lagrange).
STRESS_CODES = (341, 311, 41, 11, 411)
EQUIVALENT_CODES = (47, 17)
_SCALARS = {
    7: "Equivalent Plastic Strain", 9: "Temperature",
    17: "Equivalent Von Mises Stress", 18: "Mean Normal Stress",
    47: "Equivalent Cauchy Stress", 48: "Strain Energy Density",
    58: "Elastic Strain Energy Density", 127: "Equivalent Elastic Strain",
}  # fmt: skip
_PA_CODES = frozenset(
    {*range(11, 19), *range(41, 49), 58, *(base + k for base in STRESS_CODES for k in range(6))}
)
# By nodal post code.
_NODAL_UNITS = {
    1: "mm", 3: "N", 5: "N", 28: "mm/s", 30: "mm/s2",
    34: PA, 35: "N", 36: PA, 37: "N",
}  # fmt: skip
_AXES = {1: ("",), 2: ("X", "Y"), 3: ("X", "Y", "Z")}


@dataclass(frozen=True, slots=True)
class ElementQuantity:
    """A quantity at integration points: which `columns` of a point's values it is.

    `codes` are Marc's; `unit` holds for all components: "Pa", or "" where the value is
    left as the file has it. `layer` is that of a shell, 0 elsewhere.
    """

    name: str
    components: tuple[str, ...]
    codes: tuple[int, ...]
    columns: tuple[int, ...]
    unit: str
    layer: int

    @property
    def is_tensor(self) -> bool:
        """Whether it has the six components of a symmetric tensor."""
        return len(self.components) == len(TENSOR)

    def __str__(self) -> str:
        first, last = self.codes[0], self.codes[-1]
        codes = f"code {first}" if first == last else f"codes {first} to {last}"
        return f"{self.name} ({codes})"


def element_quantities(codes: Sequence[PostCode]) -> tuple[ElementQuantity, ...]:
    """What `codes` amount to, in the order of the file; no column twice."""
    column_of = {(code.code, code.layer): k for k, code in enumerate(codes)}
    layered = len({code.layer for code in codes}) > 1
    taken: set[int] = set()
    found = []
    for column, code in enumerate(codes):
        if column in taken or column_of[code.code, code.layer] != column:
            continue
        wanted = [(code.code + k, code.layer) for k in range(len(TENSOR))]
        if code.code in _TENSORS and all(key in column_of for key in wanted):
            name, letter = _TENSORS[code.code]
            columns = tuple(column_of[key] for key in wanted)
            components = tuple(f"{letter}{place.upper()}" for place in TENSOR)
            unit = PA if letter == "S" else AS_IS
        else:
            name = code.label.strip() or _SCALARS.get(code.code, f"Code {code.code}")
            columns, components = (column,), (_initials(name),)
            unit = PA if code.code in _PA_CODES else AS_IS
        taken.update(columns)
        name += f" layer {code.layer}" if layered else ""
        held = tuple(codes[k].code for k in columns)
        found.append(ElementQuantity(name, components, held, columns, unit, code.layer))
    return tuple(found)


def stress_tensor(codes: Sequence[PostCode], path: Path) -> ElementQuantity:
    """The stress tensor that traces are made of.

    Raises
    ------
    ResultError
        There is none, or one for each of several layers of a shell.
    """
    found = element_quantities(codes)
    for code in STRESS_CODES:
        same = [one for one in found if one.codes[0] == code and one.is_tensor]
        if len(same) > 1:
            layers = ", ".join(str(one.layer) for one in same)
            raise ResultError(
                f"code {code} is stored for layers {layers}: a shell has no one stress at a node",
                path,
            )
        if same:
            return same[0]
    words = ", ".join(map(str, found)) or "no element values"
    if any(code.code in EQUIVALENT_CODES for code in codes):
        words += "; --von-mises scalar (von_mises='scalar') takes the one it holds"
    raise ResultError(f"no stress tensor (post code 311 or 341) in it, it holds {words}", path)


def equivalent_stress(codes: Sequence[PostCode]) -> ElementQuantity | None:
    """The von Mises stress that Marc stored at the points; None without one."""
    for code in EQUIVALENT_CODES:
        same = [one for one in element_quantities(codes) if one.codes == (code,)]
        if len(same) == 1:
            return same[0]
    return None


def nodal_components(quantity: NodalQuantity) -> tuple[str, ...]:
    """Names of the components of a nodal quantity: ``DX``, ``DY`` of Displacement."""
    numbered = tuple(str(k + 1) for k in range(quantity.components))
    axes = _AXES.get(quantity.components, numbered)
    return tuple(_initials(quantity.name) + axis for axis in axes)


def nodal_unit(quantity: NodalQuantity) -> str:
    """Unit of a nodal quantity in a deck of mm, N and s; "" if unknown."""
    return _NODAL_UNITS.get(quantity.code, AS_IS)


def _initials(name: str) -> str:
    words = name.split()
    if any(word.isdigit() for word in words):  # "Code 23": nothing to shorten
        return name.replace(" ", "_")
    return "".join(word[0] for word in words).upper() or "V"
