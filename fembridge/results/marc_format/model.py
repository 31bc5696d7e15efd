"""The model of a post file: what its blocks 50200 to 51400 say, and where.

A model stands at the beginning of the file, and again in each increment that
begins with a new mesh (the verification integer NEWMO is not 0 there: documented,
not seen). A block that is not repeated is taken from the model before.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.results.marc_format.content import PostCode, PostMesh, PostSet
from fembridge.results.marc_format.numbers import Numbers
from fembridge.results.marc_format.records import PostDamageError, PostRecords, must_end
from fembridge.typing import IntArray

VERIFICATION, CODES, CONNECTIVITY, COORDINATES, SETS = 502, 506, 507, 508, 513
BLOCKS = (VERIFICATION, CODES, CONNECTIVITY, COORDINATES, SETS)
_NAMES = {0: "element", 1: "node", 12: "edge", 13: "face", 18: "edge", 19: "face"}
_WITH_SIDES = (12, 13, 18, 19)
_COUNTED = {
    0: "values a point",
    1: "nodes",
    2: "elements",
    4: "points an element",
    8: "coordinates a node",
    9: "nodes an element",
}
_CODES_OF_A_LAYER = 1000
_FIRST_WORDS, _MORE_WORDS = 18, 12  # verification integers


@dataclass(frozen=True, slots=True, eq=False)
class SetPlace:
    """A set and where its members are."""

    name: str
    kind: int
    members: Numbers | None
    sides: Numbers | None


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """Counts of a model (Marc's names beside them) and where its tables are.

    `extras` are integers that follow the nodes of an element in block 50702.
    """

    values: int = 0  # INUM, at each point
    nodes: int = 0  # LNUM
    elements: int = 0  # MNUM
    points: int = 0  # NSTRES, of each element
    dimensions: int = 0  # NCRD, coordinates of a node
    corners: int = 0  # NNODMX, nodes of an element
    revision: int = 0  # POSTRV
    extras: int = 0
    codes: tuple[PostCode, ...] = ()
    connectivity: Numbers | None = None
    node_ids: Numbers | None = None
    coordinates: Numbers | None = None
    sets: tuple[SetPlace, ...] = field(default_factory=tuple)


def read_model_block(records: PostRecords, base: int, revision: int, model: Model) -> Model:
    """Read the block that `records` stands in; give `model` with what it says.

    Raises
    ------
    PostDamageError
        It does not hold what such a block holds.
    """
    if base == VERIFICATION:
        return _verification(records, model)
    if base == CODES:
        codes = []
        for _ in range(model.values):
            codes.append(_code(*records.label()))
        return replace(model, codes=tuple(codes))
    if base == CONNECTIVITY:
        corners, extras = model.corners, 0
        if revision >= 2:
            _, corners, extras = _counts(records, 3)
        table, _ = records.table(model.elements, 3 + corners + extras, 0)
        must_end(records, f"{model.elements} elements")
        return replace(model, corners=corners, extras=extras, connectivity=table)
    if base == COORDINATES:
        ids, places = records.table(model.nodes, 1, model.dimensions)
        must_end(records, f"{model.nodes} nodes")
        return replace(model, node_ids=ids, coordinates=places)
    (count,) = _counts(records, 1)
    sets: list[SetPlace] = []
    while len(sets) < count:
        sets.append(_set(records, revision))
    return replace(model, sets=tuple(sets))


def read_mesh(file: ByteFile, model: Model) -> PostMesh:
    """Read the mesh of `model`.

    Raises
    ------
    ResultError
        A number of it cannot be read, or an element has more nodes than fit.
    """
    if model.nodes and model.node_ids is None:
        raise ResultError(f"{model.nodes} nodes and no block of them", file.path)
    table = np.empty((0, 3), dtype=np.int64)
    if model.connectivity is not None:
        table = model.connectivity.values(file)
    mm = np.zeros((model.nodes, 3))
    if model.coordinates is not None:
        found = model.coordinates.values(file)[:, :3]
        mm[:, : found.shape[1]] = found
    corners = table[:, 3 : 3 + model.corners].copy()
    used = table[:, 2]
    if used.size and (used.min() < 0 or used.max() > model.corners):
        row = int(np.flatnonzero((used < 0) | (used > model.corners))[0])
        raise ResultError(
            f"element {table[row, 0]} announces {used[row]} nodes, the model has up to "
            f"{model.corners}",
            file.path,
        )
    corners[np.arange(corners.shape[1]) >= used[:, None]] = 0
    return PostMesh(
        node_ids=_column(file, model.node_ids),
        coordinates_mm=mm,
        element_ids=table[:, 0].copy(),
        element_types=table[:, 1].copy(),
        connectivity=corners,
        extras=table[:, 3 + model.corners :].copy(),
        sets=tuple(
            PostSet(
                place.name,
                _NAMES.get(place.kind, f"type {place.kind}"),
                _row(file, place.members),
                _row(file, place.sides),
            )
            for place in model.sets
        ),
    )


def _verification(records: PostRecords, model: Model) -> Model:
    words = records.verification(_FIRST_WORDS, _MORE_WORDS)
    for place, name in _COUNTED.items():
        if not 0 <= words[place] <= records.file.size:
            raise PostDamageError(f"a model of {words[place]} {name}", records.at)
    found = Model(
        values=words[0],
        nodes=words[1],
        elements=words[2],
        points=words[4],
        dimensions=words[8],
        corners=words[9],
        revision=words[13],
        sets=model.sets,
    )
    if found.values == model.values:
        found = replace(found, codes=model.codes)
    if (found.nodes, found.dimensions) == (model.nodes, model.dimensions):
        ids, places = model.node_ids, model.coordinates
        found = replace(found, node_ids=ids, coordinates=places)
    if (found.elements, found.corners) == (model.elements, model.corners):
        table, extras = model.connectivity, model.extras
        found = replace(found, connectivity=table, extras=extras)
    return found


def _code(numbers: list[int], label: str) -> PostCode:
    """Take the layer from the code, where no number of its own names one.

    Marc's Volume C has a code of layer n as the code + 1000 n.
    """
    code, layer = numbers[0], sum(numbers[1:])
    if layer == 0 and code >= _CODES_OF_A_LAYER:
        layer, code = divmod(code, _CODES_OF_A_LAYER)
    return PostCode(code, layer, label)


def _set(records: PostRecords, revision: int) -> SetPlace:
    name = records.text()
    count, kind = _counts(records, 2)
    if revision >= 2:
        records.integers(4)
    if count == 0:
        records.empty()
        return SetPlace(name, kind, None, None)
    members, _ = records.table(1, count, 0)
    sides = None
    if kind in _WITH_SIDES:
        sides, _ = records.table(1, count, 0)
    return SetPlace(name, kind, members, sides)


def _counts(records: PostRecords, number: int) -> list[int]:
    at = records.at
    counts = records.integers(number)
    if min(counts) < 0:
        raise PostDamageError(f"a count of {min(counts)}", at)
    return counts


def _column(file: ByteFile, numbers: Numbers | None) -> IntArray:
    if numbers is None:
        return np.empty(0, dtype=np.int64)
    column: IntArray = numbers.values(file)[:, 0]
    return column


def _row(file: ByteFile, numbers: Numbers | None) -> IntArray:
    if numbers is None:
        return np.empty(0, dtype=np.int64)
    row: IntArray = numbers.values(file)[0]
    return row
