"""A ``.frd`` as a series of VTU files and a PVD that lists them, for ParaView.

One file an increment, compressed; the PVD has the times, in ms. Only one
increment is in memory. This is the one module that knows meshio.

Point data: each quantity of the increment, its components in the file's order
(that of a symmetric tensor is VTK's too), what is derived from it, the numbers of
the nodes, and how many materials meet there. Cell data: the numbers of element and
material, and for each material by name whether a cell is of it. A node that has no
value (an output restricted to a set) is NaN, never 0. Units are ours: mm, Pa.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from fembridge.errors import MissingError, ResultError, UsageError
from fembridge.outputs import filling
from fembridge.results import result_file
from fembridge.results.byte_file import ByteFile
from fembridge.results.derived import DERIVED, derived_of
from fembridge.results.frd_format.field import Field, FieldReader
from fembridge.results.frd_format.grid import Grid, read_grid_of
from fembridge.results.frd_format.index import index_frd
from fembridge.results.frd_format.output import Output, having, outputs_of
from fembridge.results.frd_format.table import NotFiniteError
from fembridge.results.read_options import ReadOptions
from fembridge.typing import FloatArray, IntArray

# Kind of element: meshio's name, and its nodes in the order of VTK. A wedge is
# turned over for meshio, which turns it back: VTK's has a positive volume as it is.
_VTK = {
    "he8": ("hexahedron", range(8)),
    "pe6": ("wedge", [0, 2, 1, 3, 5, 4]),
    "te4": ("tetra", range(4)),
    "he20": ("hexahedron20", [*range(12), *range(16, 20), *range(12, 16)]),
    "pe15": ("wedge15", [*range(9), *range(12, 15), *range(9, 12)]),
    "te10": ("tetra10", range(10)),
    "tr3": ("triangle", range(3)),
    "tr6": ("triangle6", range(6)),
    "qu4": ("quad", range(4)),
    "qu8": ("quad8", range(8)),
    "be2": ("line", range(2)),
    "be3": ("line3", range(3)),
}


def write_vtu_series(
    path: Path | str,
    folder: Path | str,
    *,
    quantities: Sequence[str] | None = None,
    derived: Sequence[str] = ("von_mises",),
    partial: bool = False,
    stress_unit: str = "MPa",
    tell: Callable[[str], None] | None = None,
) -> Path:
    """Write the results in `path` as VTU files in `folder`; give the PVD's path.

    Parameters
    ----------
    path
        A ``.frd`` file, or a run folder.
    folder
        Made where it is not there. Files of the same name are replaced, all when
        all are written; others are not touched.
    quantities
        Names in the file ("STRESS", "DISP", ...). None takes what each increment
        holds.
    derived
        Names of `fembridge.results.derived.DERIVED`: computed in the increments
        that have what they take.
    partial, stress_unit, tell
        As for `read_fields`. `tell` also hears how many nodes have no value.

    Raises
    ------
    ResultError
        The file is absent, foreign, cut, has no mesh or no such quantity; a record
        or a number is none, or is not finite.
    OutputError
        A file cannot be written.
    """
    path, folder = result_file(path), Path(folder)
    unknown = [name for name in derived if name not in DERIVED]
    if unknown:
        raise UsageError(f"no quantity {unknown[0]!r}; there are {', '.join(DERIVED)}")
    options = ReadOptions(partial=partial, stress_unit=stress_unit, tell=tell)
    with ByteFile(path) as file:
        index = index_frd(file)
        outputs: Sequence[Output] = outputs_of(file, index, options)
        if quantities is not None:
            outputs = having(file, outputs, quantities, options)
        shape = _Shape(read_grid_of(file, index))
        if shape.between:
            options.note(
                f"{shape.between} nodes lie between materials ('materials' is 2 or "
                "more there): nodal stress and strain are a mean over them and belong "
                "to none"
            )
        series = f"{path.stem}.pvd"
        entries: list[tuple[float, str]] = []
        with filling(folder, series) as draft:
            for fields in _fields(FieldReader(file, options), outputs, options):
                name = f"{path.stem}.{len(entries) + 1:04d}.vtu"
                shape.write(draft / name, _point_data(fields, shape, derived, options))
                first = next(iter(fields.values()))
                time = first.axis_value if np.isnan(first.time_ms) else first.time_ms
                entries.append((time, name))
            if not entries:
                raise ResultError("no increment with a value is left", path)
            (draft / series).write_text(_pvd(entries), encoding="utf-8", newline="\n")
    return folder / series


class _Shape:
    """The mesh as meshio has it, made once for all increments."""

    def __init__(self, grid: Grid) -> None:
        self.nodes: IntArray = grid.nodes
        self._points = grid.coordinates_mm
        self._cells = [
            (_VTK[cells.kind][0], grid.rows_of(cells.corners[:, _VTK[cells.kind][1]]))
            for cells in grid.cells
        ]
        self._cell_data = {
            "element": [cells.ids for cells in grid.cells],
            "material": [cells.material for cells in grid.cells],
        }
        present = {
            number for cells in grid.cells for number in np.unique(cells.material)
        }
        for number, name in sorted(grid.materials.items()):
            if number in present:
                self._cell_data[f"material {_plain(name)}"] = [
                    (cells.material == number).astype(np.uint8) for cells in grid.cells
                ]
        self._met = grid.materials_met()
        self.between: int = int((self._met > 1).sum())
        self._grid = grid

    def rows_of(self, nodes: IntArray) -> IntArray:
        """Row of each of `nodes` in the mesh."""
        if np.array_equal(nodes, self.nodes):
            return np.arange(nodes.size)
        return self._grid.rows_of(nodes)

    def write(self, path: Path, points: Mapping[str, FloatArray | IntArray]) -> None:
        """Write one VTU file."""
        meshio = _meshio()
        mesh = meshio.Mesh(
            self._points,
            self._cells,
            point_data={"node": self.nodes, "materials": self._met, **points},
            cell_data=self._cell_data,
        )
        meshio.write(path, mesh, file_format="vtu", binary=True, compression="zlib")


def _fields(
    reader: FieldReader, outputs: Sequence[Output], options: ReadOptions
) -> Iterator[dict[str, Field]]:
    """Yield the fields of each output; blocks without a record are told of."""
    for output in outputs:
        empty = [block for block in output.values() if block.records == 0]
        for block in empty:
            options.note(f"left out: {block} has 0 records")
        full = {n: block for n, block in output.items() if block.records}
        if not full:
            continue
        try:
            yield {name: reader.read(block) for name, block in full.items()}
        except NotFiniteError as error:
            if not options.partial:
                raise
            step, increment = next(iter(full.values())).key
            options.note(f"dropped step {step}, increment {increment}: {error.problem}")


def _point_data(
    fields: Mapping[str, Field],
    shape: _Shape,
    derived: Sequence[str],
    options: ReadOptions,
) -> dict[str, FloatArray]:
    """Give all values of an increment at the nodes of the mesh."""
    points = {}
    for name, field in fields.items():
        rows = shape.rows_of(field.nodes)
        points[_plain(name)] = _spread(field.values, rows, shape.nodes.size)
        held = np.unique(rows[rows >= 0]).size
        where = f"{name} of step {field.step}, increment {field.increment}"
        if held < shape.nodes.size:
            options.note(
                f"{where} has {held} of {shape.nodes.size} nodes; the others are NaN"
            )
        strange = field.nodes[rows < 0]
        if strange.size:
            options.note(
                f"left out: {where} has {strange.size} nodes that the mesh has not, "
                f"{strange[0]} among them"
            )
    for name in derived:
        takes = DERIVED[name][0]
        if all(quantity in fields for quantity in takes):
            with np.errstate(over="ignore", invalid="ignore"):  # of 1e200, no warning
                values = derived_of(name, fields)
            rows = shape.rows_of(fields[takes[0]].nodes)
            points[name] = _spread(values, rows, shape.nodes.size)
    return points


def _spread(values: FloatArray, rows: IntArray, size: int) -> FloatArray:
    """Put each value in its row, NaN in the others; one component as ``(size,)``."""
    flat = values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values
    spread = np.full((size, *flat.shape[1:]), np.nan)
    fine = rows >= 0
    spread[rows[fine]] = flat[fine]
    return spread


def _pvd(entries: Sequence[tuple[float, str]]) -> str:
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="Collection" version="0.1">',
        "  <Collection>",
        *(
            f'    <DataSet timestep="{time!r}" part="0" file={quoteattr(name)}/>'
            for time, name in entries
        ),
        "  </Collection>",
        "</VTKFile>",
    ]
    return "\n".join(lines) + "\n"


def _plain(name: str) -> str:
    """Give a name that XML and ParaView can hold."""
    return re.sub(r"[^A-Za-z0-9_.+%() -]", "_", name)


def _meshio() -> Any:  # noqa: ANN401 - a module without types
    try:
        import meshio
    except ImportError as error:
        raise MissingError("no meshio to write VTU with: pip install meshio") from error
    # meshio 5.3.5 knows how to write this one and has left it out of a table.
    from meshio._mesh import topological_dimension

    topological_dimension.setdefault("wedge15", 3)
    return meshio
