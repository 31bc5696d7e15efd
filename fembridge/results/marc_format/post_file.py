"""A post file of Marc, opened: what it holds, and values at chosen places.

>>> with PostFile(Path("job.t16")) as post:  # doctest: +SKIP
...     for increment in post.increments:
...         print(increment.time_s, post.nodal_values(increment.row, "Displacement"))

Opening walks from block to block; values are read when they are asked for, and
only those. Numbers are the file's: a file names no units.
"""

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import overload

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.results.marc_format.content import PostCode, PostIncrement, PostMesh
from fembridge.results.marc_format.increment import read_global_values
from fembridge.results.marc_format.model import Model, read_mesh
from fembridge.results.marc_format.open_records import open_records
from fembridge.results.marc_format.records import PostDamageError
from fembridge.results.marc_format.walk import PostWalk
from fembridge.typing import FloatArray, IntArray


class PostMeshes(Sequence[PostMesh]):
    """The models of a file, each read when it is asked for; the last is kept."""

    def __init__(self, file: ByteFile, models: Sequence[Model]) -> None:
        self._file, self._models = file, models
        self._kept: tuple[int, PostMesh] | None = None

    def __len__(self) -> int:
        return len(self._models)

    @overload
    def __getitem__(self, place: int) -> PostMesh: ...

    @overload
    def __getitem__(self, place: slice) -> tuple[PostMesh, ...]: ...

    def __getitem__(self, place: int | slice) -> PostMesh | tuple[PostMesh, ...]:
        if isinstance(place, slice):
            return tuple(self[row] for row in range(len(self))[place])
        row = range(len(self))[place]
        if self._kept is None or self._kept[0] != row:
            self._kept = row, read_mesh(self._file, self._models[row])
        return self._kept[1]


class PostFile:
    """A ``.t16`` or ``.t19``; a context manager that closes it.

    `kind` is "t16" or "t19", `byte_order` "little" or "big" ("little" for text),
    `precision` "single" or "double". `codes` and `points` (NSTRES, integration
    points an element) are those of the first model. `problem` says where the file
    is cut or damaged; None when it is whole. `unread_bytes` counts what no block
    accounts for.

    Raises
    ------
    ResultError
        No file, no post file, one of before revision 9, or none with a whole
        model.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = ByteFile(path)
        try:
            self._records = open_records(self._file)
            self._walk = PostWalk(self._records)
            try:
                self._walk.run()
            except PostDamageError as damage:
                words = self._walk.words(damage)
                raise ResultError(f"no whole model: {words}", path) from damage
        except BaseException:
            self._file.__exit__(None, None, None)
            raise
        first = self._walk.models[0]
        self.kind = self._records.kind
        self.byte_order = self._records.byte_order
        self.precision = "double" if self._records.real_bytes == 8 else "single"
        self.revision = first.revision
        self.title = self._walk.title
        self.codes: tuple[PostCode, ...] = first.codes
        self.points = first.points
        self.meshes = PostMeshes(self._file, self._walk.models)
        self.increments: tuple[PostIncrement, ...] = tuple(self._walk.increments)
        self.remarks = tuple(self._walk.remarks)
        self.problem = self._walk.problem
        self.unread_bytes = self._file.size - self._walk.whole_bytes

    def __enter__(self) -> "PostFile":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.__exit__(kind, error, trace)

    @property
    def change(self) -> str | None:
        """How the file has changed since it was opened; None if it has not."""
        return self._file.change

    def codes_of(self, row: int) -> tuple[PostCode, ...]:
        """Give the post codes of increment `row`: a new mesh may have others."""
        return self._model(row).codes

    def points_of(self, row: int) -> int:
        """Give the integration points an element of increment `row`."""
        return self._model(row).points

    def element_values(self, row: int, element_rows: IntArray) -> FloatArray:
        """Read the values of increment `row` at all points of some elements.

        `element_rows` count elements as the mesh of the increment has them.

        Returns
        -------
        ndarray
            ``(K, points, codes)``, in the order of `element_rows`.

        Raises
        ------
        ResultError
            The increment has no element values, or they cannot be read.
        """
        model, place = self._model(row), self._walk.places[row]
        if place.layout.element_values is None:
            raise ResultError(f"{self._name(row)} has no element values", self.path)
        elements = np.asarray(element_rows, dtype=np.int64)
        if elements.size and (elements.min() < 0 or elements.max() >= model.elements):
            raise IndexError(f"no such element row among {model.elements}")
        numbers = place.layout.element_values
        records = (elements[:, None] * model.points + np.arange(model.points)).ravel()
        found: FloatArray = numbers.values(self._file, records, place.further)
        return found.reshape(elements.size, model.points, model.values)

    def nodal_values(self, row: int, name: str, node_rows: IntArray | None = None) -> FloatArray:
        """Read a nodal quantity of increment `row`, ``(K, components)``.

        `node_rows` count nodes as the mesh of the increment has them; None is all
        of them. Where the file says that there is no data all is zero.

        Raises
        ------
        ResultError
            The increment has no such quantity, or it cannot be read.
        """
        model, place = self._model(row), self._walk.places[row]
        nodes = None if node_rows is None else np.asarray(node_rows, dtype=np.int64)
        for quantity, numbers in zip(place.layout.nodal, place.layout.nodal_values, strict=True):
            if quantity.name != name:
                continue
            if numbers is None:
                count = model.nodes if nodes is None else nodes.size
                return np.zeros((count, quantity.components))
            found: FloatArray = numbers.values(self._file, nodes, place.further)
            return found
        held = ", ".join(quantity.name for quantity in place.layout.nodal) or "none"
        raise ResultError(
            f"{self._name(row)} has no nodal quantity {name!r}; it has {held}", self.path
        )

    def global_values(self, row: int) -> dict[str, FloatArray]:
        """Read the global variables of increment `row`, by name."""
        place = self._walk.places[row]
        if place.layout.global_at is None:
            return {}
        self._records.at = place.layout.global_at + place.further
        try:
            return read_global_values(self._records)
        except PostDamageError as damage:
            raise ResultError(
                f"global variables of {self._name(row)}: {damage.problem} (byte {damage.at})",
                self.path,
            ) from damage

    def energies(self, row: int) -> FloatArray:
        """Read the verification reals of increment `row`, ``(24,)``.

        0 time, 1 frequency, 6 volume, 7 mass, 8 strain energy, 9 plastic strain
        energy, 13 external work, 15 elastic strain energy, 20 work of loads.
        """
        place = self._walk.places[row]
        reals = place.layout.reals
        if reals is None:
            raise ResultError(f"{self._name(row)} has no verification", self.path)
        found: FloatArray = reals.values(self._file, None, place.further)[0]
        return found

    def _model(self, row: int) -> Model:
        return self._walk.models[self.increments[row].mesh]

    def _name(self, row: int) -> str:
        increment = self.increments[row]
        return f"increment {increment.increment} (time {increment.time_s:g} s)"
