"""Results as a series of VTU files and a PVD that lists them, for ParaView.

One file an increment; the PVD has the times, in ms. Only one increment is in memory. Of
result formats this module knows none, see `fembridge.results.fields`.

Point data: each quantity of the increment, its components in the file's order (that of a
symmetric tensor is VTK's too), what is derived from it, the numbers of the nodes, and how
many materials meet there. Names carry the unit: ``STRESS_pa``, ``DISP_mm``. Cell data: the
numbers of element and material, and for each material by name whether a cell is of it. A
node that has no value is NaN, never 0; where no element has values at all its nodes (an
output of some nodes), those nodes are written alone, as vertices.

Arrays are appended raw, in full precision: compression took most of the time (decision
0022), and ``gzip`` does it as well.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import ResultError, UsageError
from fembridge.results.fields import TIMES_IN_MS, VERTEX, Scene
from fembridge.results.result import open_result
from fembridge.results.source import Source
from fembridge.results.stress import DERIVED
from fembridge.run_folder import RunFolder
from fembridge.store import filling
from fembridge.typing import FloatArray

# Kind of element: VTK's number, and where its nodes stand in the order of a .frd.
_VTK: Mapping[str, tuple[int, Sequence[int]]] = {
    "hex8": (12, range(8)),
    "wedge6": (13, range(6)),
    "tet4": (10, range(4)),
    "hex20": (25, [*range(12), *range(16, 20), *range(12, 16)]),
    "wedge15": (26, [*range(9), *range(12, 15), *range(9, 12)]),
    "tet10": (24, range(10)),
    "tri3": (5, range(3)),
    "tri6": (22, range(6)),
    "quad4": (9, range(4)),
    "quad8": (23, range(8)),
    "line2": (3, range(2)),
    "line3": (21, range(3)),
    VERTEX: (1, range(1)),
}
_TYPES = {"<f8": "Float64", "<i8": "Int64", "|u1": "UInt8"}
_Array = NDArray[np.float64] | NDArray[np.int64] | NDArray[np.uint8]


def write_vtu_series(
    path: Path | str | RunFolder,
    folder: Path | str,
    *,
    quantities: Sequence[str] | None = None,
    derived: Sequence[str] = ("von_mises",),
    modes: bool = False,
    **options: Any,  # noqa: ANN401 - those of `fembridge.read`
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
    modes
        The modes of frequency and buckling steps, of a file that has times too.
    **options
        `partial`, `stress_unit`, `length_unit`, `log` and, of a Marc file, `extrapolate` of
        `fembridge.read`. `log` also gets how many nodes have no value.

    Raises
    ------
    ResultError
        The file is absent, foreign, cut, has no mesh or no such quantity; a record
        or a number is none, or is not finite.
    OutputError
        A file cannot be written.
    """
    with open_result(path, **options) as result:
        return write_frames(result.source, Path(folder), quantities, derived, modes)[0]


def write_frames(
    source: Source,
    folder: Path,
    quantities: Sequence[str] | None,
    derived: Sequence[str],
    modes: bool = False,
) -> tuple[Path, int]:
    """The same of an open file; and how many increments were written."""
    unknown = [name for name in derived if name not in DERIVED]
    if unknown:
        raise UsageError(f"no quantity {unknown[0]!r}; there are {', '.join(DERIVED)}")
    path = source.path
    scene, over_time, frames = source.frames(quantities, tuple(derived), modes)
    if not scene.cells:
        raise ResultError("no element of a kind that VTU has", path)
    shape = _Shape(scene)
    series = f"{path.stem}.pvd"
    entries: list[tuple[float, str]] = []
    seen: set[str] = set()
    with filling(folder, series) as draft:
        for time, values in frames:
            name = f"{path.stem}.{len(entries) + 1:04d}.vtu"
            shape.write(draft / name, values)
            entries.append((time, name))
            seen |= values.keys()
        if not entries:
            raise ResultError("no increment with a value is left", path)
        (draft / series).write_text(_pvd(entries, over_time), encoding="utf-8", newline="\n")
    for name in derived:
        if f"{name}_pa" not in seen and (quantities is None or name != "von_mises"):
            takes = " and ".join(DERIVED[name][0])
            same = " at the same nodes" if " and " in takes else ""
            source.options.note(f"no {name}: it takes {takes}{same}")
    return folder / series, len(entries)


class _Shape:
    """A mesh as VTK has it, made once for all its increments."""

    def __init__(self, scene: Scene) -> None:
        cells = scene.cells
        rows = [one.rows[:, _VTK[one.kind][1]] for one in cells]
        sizes = np.concatenate([np.full(len(one), one.shape[1]) for one in rows])
        types = [np.full(len(one.ids), _VTK[one.kind][0], np.uint8) for one in cells]
        material = np.concatenate([one.material for one in cells])
        self._size = f'NumberOfPoints="{scene.nodes.size}" NumberOfCells="{sizes.size}"'
        self._points = {"points": scene.points_mm}
        self._cells: dict[str, _Array] = {
            "connectivity": np.concatenate([one.ravel() for one in rows]),
            "offsets": np.cumsum(sizes),
            "types": np.concatenate(types),
        }
        self._point_data = {"node": scene.nodes, "materials": scene.met}
        self._cell_data: dict[str, _Array] = {
            "element": np.concatenate([one.ids for one in cells]),
            "material": material,
        }
        for number, name in sorted(scene.materials.items()):
            if (here := material == number).any():
                self._cell_data[f"material {_plain(name)}"] = here.astype(np.uint8)

    def write(self, path: Path, values: Mapping[str, FloatArray]) -> None:
        """Write one VTU file: XML, and behind it the bytes of the arrays, each after its length.

        Their bytes come in reverse: meshio moves the offsets, first to last, to where text
        would be, and takes the first array in the XML that has an offset, moved or not.
        """
        data = {_plain(name): value for name, value in values.items()}
        parts: dict[str, Mapping[str, _Array]] = {
            "Points": self._points,
            "Cells": self._cells,
            "PointData": {**self._point_data, **data},
            "CellData": self._cell_data,
        }
        every = [array for arrays in parts.values() for array in arrays.values()]
        offset = sum(8 + one.size * (1 if one.dtype.kind == "u" else 8) for one in every)
        text = f"<Piece {self._size}>\n"
        blocks: list[tuple[bytes, bytes]] = []
        for part, arrays in parts.items():
            text += f"<{part}>\n"
            for name, array in arrays.items():
                kind = {"f": "<f8", "i": "<i8", "u": "|u1"}[array.dtype.kind]
                packed = np.ascontiguousarray(array, kind)
                offset -= 8 + packed.nbytes
                count = "" if array.ndim == 1 else f'NumberOfComponents="{array.shape[1]}" '
                text += (
                    f'<DataArray type="{_TYPES[kind]}" Name={quoteattr(name)} '
                    f'{count}format="appended" offset="{offset}"/>\n'
                )
                blocks.append((packed.nbytes.to_bytes(8, "little"), packed.tobytes()))
            text += f"</{part}>\n"
        with path.open("wb") as out:
            out.write(_HEAD + text.encode() + b"</Piece>\n</UnstructuredGrid>\n" + _APPENDED)
            for block in reversed(blocks):
                out.writelines(block)
            out.write(b"\n</AppendedData>\n</VTKFile>\n")


_HEAD = (
    b'<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" '
    b'byte_order="LittleEndian" header_type="UInt64">\n<UnstructuredGrid>\n'
)
_APPENDED = b'<AppendedData encoding="raw">\n_'


def _pvd(entries: Sequence[tuple[float, str]], over_time: bool) -> str:
    lines = [
        '<?xml version="1.0"?>',
        *[TIMES_IN_MS] * over_time,
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
