"""Elements of a keyword deck with their sections: types and materials at a node.

    *ELEMENT, TYPE=C3D8, ELSET=SKIN
    *SOLID SECTION, ELSET=SKIN, MATERIAL=DERMIS

A solver averages stress at a node over all elements there, so a node between two materials
has no stress of its own. Shells and beams are expanded to solids by CalculiX, and their nodes
are none of the deck's.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from decks.inp import Block, members
from fembridge.errors import DeckError

# Nodes of an element by type; a line may end before the last one, with a comma or without.
_NODE_COUNTS = {
    **{"C3D4": 4, "C3D6": 6, "C3D8": 8, "C3D10": 10, "C3D15": 15, "C3D20": 20},
    **{"F3D4": 4, "F3D6": 6, "F3D8": 8},
    **{f"{family}{count}": count for family in ("CPE", "CPS", "CAX") for count in (3, 4, 6, 8)},
    **{f"{family}{count}": count for family in ("S", "M3D") for count in (3, 4, 6, 8)},
    **{"B21": 2, "B31": 2, "B32": 3, "T2D2": 2, "T3D2": 2, "T3D3": 3, "D": 3},
    **{"SPRING1": 1, "SPRING2": 2, "SPRINGA": 2, "DASHPOTA": 2, "GAPUNI": 2, "DCOUP3D": 1},
    **{"MASS": 1, "ROTARYI": 1},
}
_PREFIXES = (
    ("solid", ("C3D",)),
    ("plane", ("CPE", "CPS", "CAX", "CGAX", "CPEG")),
    ("fluid", ("F3D",)),
    ("solid shell", ("SC6R", "SC8R", "CSS8")),
    (
        "point",
        (
            *("SPRING", "DASHPOT", "GAP", "MASS", "ROTARYI", "DCOUP", "CONN", "DMASS", "CONTACT"),
            *("ROTARY", "DIST", "ITT", "DASH", "JOINT"),
        ),
    ),
    ("membrane", ("M3D", "MAX", "SFM")),
    ("beam", ("B2", "B3", "PIPE", "ELBOW", "FRAME")),
    ("truss", ("T2", "T3")),
    ("rigid", ("R2D", "R3D", "RAX", "RB")),
    ("shell", ("S3", "S4", "S6", "S8", "S9", "STRI", "SAX", "DS")),
    ("network", ("D",)),
)
_LONG_RUN = 100_000  # members of a range, which may go beyond the elements
WITHOUT_STRESS = ("point", "rigid", "fluid", "network")
"""Families of elements that have no stress of a material."""
EXPANDED = ("shell", "membrane", "beam", "truss")
"""Families that CalculiX makes solids of, with nodes of their own."""


def family_of(kind: str) -> str:
    """Family of an element type: solid, plane, shell, beam, ...; "other" for an unknown one."""
    return next((family for family, prefixes in _PREFIXES if kind.startswith(prefixes)), "other")


@dataclass(frozen=True, slots=True)
class Element:
    """An element: its number, its type in capitals, its nodes in the order of the deck."""

    number: int
    kind: str
    nodes: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ElementSection:
    """A section: the set of elements and the material that it gives them; "" for none."""

    block: Block
    element_set: str
    material: str


@dataclass(frozen=True, slots=True, eq=False)
class ModelScope:
    """Elements, their sets and sections in `blocks` whose numbers count together."""

    blocks: Sequence[Block]
    element_sets: Mapping[str, list[range]] = field(init=False)
    sections: tuple[ElementSection, ...] = field(init=False)
    _section_rows: Mapping[int, int] = field(init=False)  # by element, of sets without long runs

    def __post_init__(self) -> None:
        sets, sections = element_sets(self.blocks), tuple(_sections(self.blocks))
        rows = {
            number: row
            for row, section in enumerate(sections)
            for run in sets.get(section.element_set, ())
            if len(run) <= _LONG_RUN
            for number in run
        }
        for name, value in (
            ("element_sets", sets),
            ("sections", sections),
            ("_section_rows", rows),
        ):
            object.__setattr__(self, name, value)

    @property
    def kinds(self) -> tuple[str, ...]:
        """The types of elements, each once."""
        blocks = (block for block in self.blocks if block.keyword == "ELEMENT")
        return tuple(dict.fromkeys(block.value_of("TYPE") for block in blocks))

    @property
    def families(self) -> frozenset[str]:
        """The families of elements."""
        return frozenset(map(family_of, self.kinds))

    def elements(self) -> Iterator[Element]:
        """All elements that are listed."""
        for block in self.blocks:
            if block.keyword == "ELEMENT":
                yield from elements_in(block)

    def elements_at(self, nodes: Iterable[int]) -> dict[int, list[Element]]:
        """The elements with stress at each of `nodes`."""
        around: dict[int, list[Element]] = {node: [] for node in nodes}
        for block in self.blocks:
            if block.keyword != "ELEMENT" or family_of(block.value_of("TYPE")) in WITHOUT_STRESS:
                continue
            for element in elements_in(block):
                for node in around.keys() & set(element.nodes):
                    around[node].append(element)
        return around

    def section_of(self, element: int) -> ElementSection | None:
        """The section of an element, the last one that has it; None without."""
        last = self._section_rows.get(element, -1)
        for row, section in enumerate(self.sections):
            runs = self.element_sets.get(section.element_set, ())
            if row > last and any(element in run for run in runs if len(run) > _LONG_RUN):
                last = row
        return None if last < 0 else self.sections[last]

    def material_of(self, element: int) -> str:
        """The material of an element; "" if no section gives it one."""
        section = self.section_of(element)
        return "" if section is None else section.material

    def materials_at(self, nodes: Iterable[int]) -> dict[int, tuple[str, ...]]:
        """The materials of the elements at each of `nodes`, in deck order."""
        return {
            node: tuple(dict.fromkeys(self.material_of(element.number) for element in around))
            for node, around in self.elements_at(nodes).items()
        }


def elements_in(block: Block) -> Iterator[Element]:
    """The elements of an ``*ELEMENT``; one may take several lines."""
    kind = block.value_of("TYPE")
    base = kind.rstrip("HIMRT") if kind[:1] != "D" else kind
    count = _NODE_COUNTS.get(kind) or _NODE_COUNTS.get(base, 0)
    fields: list[str] = []
    for row in (*block.rows(), None):
        if row is not None:
            fields += [text for text in row.fields if text]
            if (len(fields) <= count) if count else not row.fields[-1]:
                continue
        # In an assembly a node may be named with its instance; such an element is no skin.
        if fields and all(text.isascii() and text.isdigit() for text in fields):
            number, *nodes = map(int, fields)
            yield Element(number, kind, tuple(nodes[: count or None]))
        fields = []


def element_sets(blocks: Iterable[Block]) -> dict[str, list[range]]:
    """The sets of elements by name, as runs of numbers; unreadable members are left out."""
    sets: dict[str, list[range]] = {}
    for block in blocks:
        name = block.value_of("ELSET")
        if block.keyword not in ("ELSET", "ELEMENT") or not name:
            continue
        runs = sets.setdefault(name, [])
        numbers = _members(block, sets)
        for run in numbers:
            last = runs[-1] if runs else range(0)
            if runs and last.step == run.step == 1 and last.stop == run.start:
                runs[-1] = range(last.start, run.stop)
            else:
                runs.append(run)
    return sets


def _members(block: Block, sets: Mapping[str, list[range]]) -> Iterator[range]:
    if block.keyword == "ELEMENT":  # the second line of an element begins with a node
        for element in elements_in(block):
            yield range(element.number, element.number + 1)
        return
    try:
        yield from members(block, sets)
    except DeckError:
        return


def _sections(blocks: Iterable[Block]) -> Iterator[ElementSection]:
    """The sections: cards that give a set of elements a material."""
    for block in blocks:
        if not block.keyword.endswith("SECTION") or not (name := block.value_of("ELSET")):
            continue
        material = block.value_of("MATERIAL")
        if block.option("COMPOSITE") is not None:  # thickness, -, material of each layer
            layers = [row.fields[2] for row in block.rows() if len(row.fields) > 2]
            material = "+".join(dict.fromkeys(layer.upper() for layer in layers))
        yield ElementSection(block, name, material)
