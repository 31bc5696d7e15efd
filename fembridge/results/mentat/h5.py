"""The HDF5 result file of Marc, ``.h5``, as far as its layout is described.

No real file was seen: what stands here follows a script of the maker that reads and
extends such files, and quotes their schema. Described are the list of increments and
the arrays of nodal quantities and of element scalars. Not described are which node is
which row of an array, which elements stand at a node, and how tensors are named: so
this reads by row, makes no traces, and says so. For traces there is the ``.t16``.

Time is taken as s and length as mm, as everywhere; stress stays in the file's unit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.mentat.h5_file import H5Array, H5File, opened
from fembridge.results.read_options import ReadOptions
from fembridge.trace import MS_PER_S, StressTrace
from fembridge.typing import FloatArray, Table

UNSEEN = "read by a description of the layout: no real file of this kind was seen"
NO_TRACES = (
    "no traces from a .h5: which node is which row of its arrays, and which elements "
    "stand at a node, is not described; take the .t16 of the same job"
)

_SUMMARY = "Marc/Summary"
_NODE = "Marc/Results/Node"
_SCALAR = "Marc/Results/Element/Scalar"
_END = -1  # INC of a last row that marks the end
_SUMMARY_SUFFIX = "Summary"
_COLUMNS = (
    "CASE", "INC", "SUBINC", "CYCL_INC", "SEPA_INC", "CUT_INC", "CYCL_TOT", "SEPA_TOT",
    "CUT_TOT", "RMESH", "TIME_INC", "TIME_TOT",
)  # fmt: skip
_NODAL_AXES = (
    "node", "component", "increment", "set", "sub-increment", "real or imaginary",
    "iteration",
)  # fmt: skip
_SCALAR_AXES = (
    "element", "value", "increment", "point", "set", "layer", "sub-increment",
    "real or imaginary",
)  # fmt: skip
_SINGLE = ("value", "set", "sub-increment", "iteration")


@dataclass(frozen=True, slots=True)
class H5Increment:
    """A row of the list of increments."""

    load_case: int
    increment: int
    sub_increment: int
    cycles: int
    separations: int
    cut_backs: int
    total_cycles: int
    total_separations: int
    total_cut_backs: int
    mesh: int
    increment_time_ms: float
    total_time_ms: float


@dataclass(frozen=True, slots=True)
class H5Quantity:
    """An array: its `name`, whose it is, how many there are of what.

    `kind` is "node" or "element scalar"; `element_type` the name under which Marc
    keeps an element type, "" at nodes. `rows` counts nodes or elements, `points`
    integration points, `layers` layers through the thickness.
    """

    name: str
    kind: str
    element_type: str
    rows: int
    components: int
    increments: int
    points: int = 1
    layers: int = 1

    @property
    def place(self) -> str:
        """Where it is in the file."""
        if self.kind == "node":
            return f"{_NODE}/{self.name}"
        return f"{_SCALAR}/{self.name}/{self.element_type}"


def read_increments(path: Path) -> list[H5Increment]:
    """Read the list of increments, without the row that marks the end.

    Raises
    ------
    MissingError
        h5py is not installed.
    ResultError
        No such file, no HDF5, or not with that list.
    """
    with opened(path) as file:
        return _increments(file)


def read_nodal(path: Path, name: str, increment: int) -> FloatArray:
    """Read a nodal quantity of all nodes in the `increment`-th increment, from 0.

    Returns
    -------
    ndarray
        ``(row, component)``, in the file's unit. Which node a row is, the described
        part of the layout does not say.

    Raises
    ------
    MissingError
        h5py is not installed.
    ResultError
        No such file, quantity or increment; an array of another shape than described,
        several sets, sub-increments or iterations, or complex values.
    """
    with opened(path) as file:
        place = f"{_NODE}/{name}"
        array = _array(file, place, _NODAL_AXES, increment)
        values = array[:, :, increment, 0, 0, :, 0].astype(np.float64)
        return _real(values, place, path)


def read_element_scalar(
    path: Path, name: str, element_type: str, increment: int, layer: int = 0
) -> FloatArray:
    """Read an element scalar of all elements of a type in one increment, from 0.

    Returns
    -------
    ndarray
        ``(row, point)``, in the file's unit. Which element a row is, the described
        part of the layout does not say.

    Raises
    ------
    MissingError
        h5py is not installed.
    ResultError
        No such file, quantity, element type, increment or layer; an array of another
        shape than described, several sets or sub-increments, or complex values.
    """
    with opened(path) as file:
        place = f"{_SCALAR}/{name}/{element_type}"
        array = _array(file, place, _SCALAR_AXES, increment)
        layers = array.shape[_SCALAR_AXES.index("layer")]
        if not 0 <= layer < layers:
            raise ResultError(f"no layer {layer} of /{place}, it has {layers}", path)
        values = array[:, 0, increment, :, 0, layer, 0, :].astype(np.float64)
        return _real(values, place, path)


def quantities(path: Path) -> list[H5Quantity]:
    """List the arrays whose layout is described.

    Raises
    ------
    MissingError
        h5py is not installed.
    ResultError
        No such file, or no HDF5.
    """
    with opened(path) as file:
        return _quantities(file)


def read(path: Path, nodes: Sequence[int], options: ReadOptions) -> list[StressTrace]:
    """Say why there are no traces; its form is that of every reader.

    Raises
    ------
    ResultError
        Always.
    """
    raise ResultError(NO_TRACES, path)


def describe(path: Path) -> Table:
    """Tell what `path` holds, also what is of no described layout.

    Raises
    ------
    MissingError
        h5py is not installed.
    ResultError
        No such file, no HDF5, or not with the list of increments.
    """
    with opened(path) as file:
        rows, known = _increments(file), _quantities(file)
        places = {_SUMMARY, *(each.place for each in known)}
        precision = file.attribute("Marc", "precision")
        return {
            "format": "marc-h5",
            "bytes": path.stat().st_size,
            "title": str(file.attribute("Marc", "title") or "").strip(),
            "schema": str(file.attribute("Marc", "version") or "").strip(),
            "precision": "double" if precision == 1 else "single",
            "increments": len(rows),
            "end_ms": rows[-1].total_time_ms if rows else None,
            "arrays": [each.place for each in known],
            "not_described": [name for name in file.shapes() if name not in places],
            "problem": UNSEEN,
        }


def _increments(file: H5File) -> list[H5Increment]:
    table = file.array(_SUMMARY)
    names = () if table is None else table.dtype.names or ()
    missing = [name for name in _COLUMNS if name not in names]
    if table is None or missing or len(table.shape) != 1:
        raise ResultError(
            f"no list /{_SUMMARY} with {', '.join(missing or _COLUMNS)}: no result "
            "file of Marc as it is described",
            file.path,
        )
    found = []
    for row in table[()]:
        if int(row["INC"]) == _END:
            break
        cells: list[Any] = [int(row[name]) for name in _COLUMNS[:-2]]
        cells += [float(row[name]) * MS_PER_S for name in _COLUMNS[-2:]]
        found.append(H5Increment(*cells))
    return found


def _quantities(file: H5File) -> list[H5Quantity]:
    found = []
    for place, shape in file.shapes().items():
        head, _, last = place.rpartition("/")
        if head == _NODE and len(shape) == len(_NODAL_AXES):
            if not last.endswith(_SUMMARY_SUFFIX):
                found.append(H5Quantity(last, "node", "", *shape[:3]))
        elif head.startswith(f"{_SCALAR}/") and len(shape) == len(_SCALAR_AXES):
            name = head.removeprefix(f"{_SCALAR}/")
            counts = (*shape[:3], shape[3], shape[5])
            found.append(H5Quantity(name, "element scalar", last, *counts))
    return found


def _array(file: H5File, place: str, axes: tuple[str, ...], increment: int) -> H5Array:
    """Give the array at `place`, after its shape and its increments were looked at."""
    found = file.array(place)
    if found is None:
        there = ", ".join(each.place for each in _quantities(file))
        raise ResultError(f"no array /{place}, there is {there or 'none'}", file.path)
    if len(found.shape) != len(axes):
        raise ResultError(
            f"/{place} has {len(found.shape)} dimensions, described are {len(axes)}", file.path
        )
    for name, count in zip(axes, found.shape, strict=True):
        if name in _SINGLE and count != 1:
            raise ResultError(
                f"/{place} has {count} in its dimension {name!r}: what they are is not described",
                file.path,
            )
    listed, held = len(_increments(file)), found.shape[axes.index("increment")]
    if listed != held:
        raise ResultError(
            f"/{place} has {held} increments and the list of them {listed}: which is "
            "which is not described",
            file.path,
        )
    if not 0 <= increment < held:
        raise ResultError(f"no increment {increment}, there are {held} from 0", file.path)
    return found


def _real(values: FloatArray, place: str, path: Path) -> FloatArray:
    """Give the real parts of ``(..., real or imaginary)``."""
    if values.shape[-1] > 2 or values[..., 1:].any():
        raise ResultError(f"/{place} has complex values", path)
    if not np.isfinite(values[..., 0]).all():
        raise ResultError(f"/{place} is not finite everywhere", path)
    real: FloatArray = values[..., 0]
    return real
