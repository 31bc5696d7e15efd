"""Results as a series of VTU files and a PVD that lists them, for ParaView.

One file an increment, compressed; the PVD has the times, in ms. Only one
increment is in memory. This is the one module that knows meshio; of result formats
it knows none, see `fembridge.results.fields`.

Point data: each quantity of the increment, its components in the file's order
(that of a symmetric tensor is VTK's too), what is derived from it, the numbers of
the nodes, and how many materials meet there. Cell data: the numbers of element and
material, and for each material by name whether a cell is of it. A node that has no
value (an output restricted to a set) is NaN, never 0. Units are ours: mm, Pa.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from fembridge.errors import MissingError, ResultError, UsageError
from fembridge.results.fields import Scene, open_source
from fembridge.results.read_options import ReadOptions
from fembridge.results.stress import DERIVED
from fembridge.store import filling
from fembridge.typing import FloatArray

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
    extrapolate: str | None = None,
    log: Callable[[str], None] | None = None,
) -> Path:
    """Write the results in `path` as VTU files in `folder`; the PVD's path.

    Parameters
    ----------
    path
        A ``.frd``, ``.t16`` or ``.t19`` file, or a run folder.
    folder
        Made where it is absent. Files of the same name are replaced, all when
        all are written; others are not touched.
    quantities
        Names in the file ("STRESS", "DISP", ...). None takes what each increment
        holds.
    derived
        Names of `fembridge.results.stress.DERIVED`: computed in the increments
        that have what they take.
    partial, stress_unit, log
        As for `read_fields`. `log` also gets how many nodes have no value.
    extrapolate
        As for `fembridge.read`, of a Marc file.

    Raises
    ------
    ResultError
        The file is absent, foreign, cut, has no mesh or no such quantity; a record
        or a number is none, or is not finite.
    OutputError
        A file cannot be written.
    """
    unknown = [name for name in derived if name not in DERIVED]
    if unknown:
        raise UsageError(f"no quantity {unknown[0]!r}; there are {', '.join(DERIVED)}")
    options = ReadOptions(
        partial=partial, stress_unit=stress_unit, log=log, extrapolate=extrapolate
    )
    with open_source(path, options) as source:
        path, folder = source.path, Path(folder)
        frames = source.frames(quantities, tuple(derived))
        series = f"{path.stem}.pvd"
        entries: list[tuple[float, str]] = []
        shapes: dict[int, _Shape] = {}
        with filling(folder, series) as draft:
            for frame in frames:
                name = f"{path.stem}.{len(entries) + 1:04d}.vtu"
                if not frame.scene.cells:
                    raise ResultError("no element of a kind that VTU has", path)
                # A new mesh takes the place of the one before.
                if id(frame.scene) not in shapes:
                    shapes = {id(frame.scene): _Shape(frame.scene)}
                shapes[id(frame.scene)].write(draft / name, frame.values)
                entries.append((frame.time_ms, name))
            if not entries:
                raise ResultError("no increment with a value is left", path)
            (draft / series).write_text(_pvd(entries), encoding="utf-8", newline="\n")
    return folder / series


class _Shape:
    """A mesh as meshio has it, made once for all its increments."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._cells = [
            (_VTK[cells.kind][0], cells.rows[:, _VTK[cells.kind][1]]) for cells in scene.cells
        ]
        self._cell_data = {
            "element": [cells.ids for cells in scene.cells],
            "material": [cells.material for cells in scene.cells],
        }
        present = {number for cells in scene.cells for number in np.unique(cells.material)}
        for number, name in sorted(scene.materials.items()):
            if number in present:
                self._cell_data[f"material {_plain(name)}"] = [
                    (cells.material == number).astype(np.uint8) for cells in scene.cells
                ]

    def write(self, path: Path, values: Mapping[str, FloatArray]) -> None:
        """Write one VTU file."""
        meshio = _meshio()
        mesh = meshio.Mesh(
            self._scene.points_mm,
            self._cells,
            point_data={
                "node": self._scene.nodes,
                "materials": self._scene.met,
                **{_plain(name): value for name, value in values.items()},
            },
            cell_data=self._cell_data,
        )
        meshio.write(path, mesh, file_format="vtu", binary=True, compression="zlib")


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
    """`name` in letters that XML and ParaView can hold."""
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
