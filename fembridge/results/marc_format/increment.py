"""One increment of a post file: which blocks it has and where their values are.

Increments of a run are alike to the byte, but for their values. What one of them
looks like, a `Layout`, therefore serves for all that look the same.
"""

from dataclasses import dataclass, field, replace

from fembridge.results.marc_format.content import NodalQuantity
from fembridge.results.marc_format.model import Model
from fembridge.results.marc_format.numbers import Numbers
from fembridge.results.marc_format.records import PostDamageError, PostRecords, must_end
from fembridge.typing import FloatArray

TITLE, INTEGERS, REALS = 516, 517, 518
ELEMENT_VALUES, NODAL, GLOBAL = 523, 524, 529
BLOCKS = (TITLE, INTEGERS, REALS, ELEMENT_VALUES, NODAL, GLOBAL)
# Without these two an increment has no number and no time.
NEEDED = (INTEGERS, REALS)
INTEGER_WORDS = 12
_QUANTITY_WORDS = 12
_GLOBAL_WORDS = 6
_ALL_NODES, _NO_NODES = -1, 0
_COMPLEX = (4, 5)
_MOST_COMPONENTS = 1000  # of a nodal quantity; real ones have up to six


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Where the parts of an increment are that begins at byte `start`.

    `title` is (first byte, last + 1); `integers` and `reals` are its verification
    data. `nodal_values` has one entry for each of `nodal`, None where the file has
    no data; `global_at` is where the global variables begin.
    """

    start: int
    title: tuple[int, int] | None = None
    integers: Numbers | None = None
    reals: Numbers | None = None
    element_values: Numbers | None = None
    nodal: tuple[NodalQuantity, ...] = field(default_factory=tuple)
    nodal_values: tuple[Numbers | None, ...] = field(default_factory=tuple)
    global_at: int | None = None


def read_increment_block(records: PostRecords, base: int, model: Model, layout: Layout) -> Layout:
    """Pass the block that `records` stands in; give `layout` with where it is.

    Raises
    ------
    PostDamageError
        It does not hold what such a block holds.
    """
    if base == TITLE:
        start = records.at
        records.text(free=True)
        return replace(layout, title=(start, records.at))
    if base == INTEGERS:
        integers, _ = records.table(1, INTEGER_WORDS, 0)
        return replace(layout, integers=integers)
    if base == REALS:
        (count,) = records.integers(1)
        if count < 2:
            raise PostDamageError(f"{count} reals, which leaves no time", records.at)
        return replace(layout, reals=records.flow(1, count))
    if base == ELEMENT_VALUES:
        _, values = records.table(model.elements * model.points, 0, model.values)
        must_end(records, f"{model.elements} elements of {model.points} points")
        return replace(layout, element_values=values)
    if base == NODAL:
        return _nodal(records, model, layout)
    start = records.at
    records.pass_block()
    return replace(layout, global_at=start)


def read_global_values(records: PostRecords) -> dict[str, FloatArray]:
    """Read the global variables that begin where `records` stands.

    Raises
    ------
    PostDamageError
        They are no global variables.
    """
    found: dict[str, FloatArray] = {}
    quantities, _ = records.integers(2)
    for _ in range(quantities):
        name = records.text()
        at = records.at
        count = records.integers(_GLOBAL_WORDS)[3]
        if count < 0:
            raise PostDamageError(f"{name!r} of {count} values", at)
        values = records.flow(1, count).values(records.file)[0]
        while name in found:  # two tables of one name are two variables
            name += "'"
        found[name] = values
    return found


def _nodal(records: PostRecords, model: Model, layout: Layout) -> Layout:
    quantities: list[NodalQuantity] = []
    places: list[Numbers | None] = []
    count, _ = records.integers(2)
    for _ in range(count):
        name = records.text()
        at = records.at
        words = records.integers(_QUANTITY_WORDS)
        components, flag = words[3], words[6]
        known = flag in (_ALL_NODES, _NO_NODES)
        if not known or not 0 <= components <= _MOST_COMPONENTS:
            raise PostDamageError(f"{name!r} of {components} components with flag {flag}", at)
        with_imaginary = words[5] in _COMPLEX
        place = None
        if flag == _ALL_NODES:
            place = records.flow(model.nodes, components)
            if with_imaginary:
                records.flow(model.nodes, components)
        places.append(place)
        quantities.append(
            NodalQuantity(name, words[0], components, place is not None, with_imaginary)
        )
    return replace(layout, nodal=tuple(quantities), nodal_values=tuple(places))
