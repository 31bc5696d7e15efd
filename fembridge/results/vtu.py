"""Results as a series of VTU files and a PVD that lists them, for ParaView.

One file for each increment; the PVD has the times in ms. Only one increment is in memory. The
module does not depend on a result format, see `fembridge.results.fields`.

Point data: each quantity of the increment, its components in the file's order (for a symmetric
tensor also VTK's), derived quantities, node numbers, and the number of materials at the node.
Names carry the unit: ``STRESS_pa``, ``DISP_mm``. Cell data: the numbers of element and material,
and for each material an array that marks its cells. A node without a value is NaN, never 0. If
no element has values at all its nodes (the output of some nodes), only the nodes with values are
written, as vertices.

Arrays are appended raw, in full precision: compression took most of the time (decision 0022),
and ``gzip`` can do it later.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import ResultError, UsageError
from fembridge.host.store import filling
from fembridge.io.run_folder import RunFolder
from fembridge.results.fields import TIMES_IN_MS, VERTEX, Scene
from fembridge.results.result import open_result
from fembridge.results.source import Source
from fembridge.results.von_mises import DERIVED
from fembridge.typing import FloatArray

# By kind of element: VTK's number, and the position of its nodes in the order of a .frd.
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
    partial: bool = False,
    stress_unit: str | None = None,
    length_unit: str | None = None,
    extrapolate: str | None = None,
) -> Path:
    """Write the results in `path` as VTU files in `folder`; return the path of the PVD.

    Parameters
    ----------
    path
        A ``.frd``, ``.t16`` or ``.t19`` file, or run folder: its path, or a `RunFolder` of
        `fembridge.build_deck`.
    folder
        Folder of the files, made if it is missing. Files of the same name are replaced when all
        new files are complete; others are kept.
    quantities
        Names in the file ("STRESS", "DISP", ...). Default: None, all of each increment.
    derived
        Names in `fembridge.results.von_mises.DERIVED`, computed in the increments that have
        the quantities they need. Default: ("von_mises",).
    modes
        Write the modes of frequency and buckling steps even if the file has outputs over time.
        Default: False.
    partial
        Read the complete part of a run that did not end normally; omissions are logged.
        Default: False, such a file raises.
    stress_unit
        Unit of stress in the file: "MPa", "kPa", "Pa" or "psi". Default: None, the unit in
        ``run.toml``, else of the unit system in the file's heading, else of `length_unit`,
        else MPa (N and mm).
    length_unit
        Unit of coordinates and displacements in the file: "mm", "m" or "in". Default: None, of
        the heading, else mm.
    extrapolate
        Of a Marc file: extrapolation of stress from integration points to nodes, "linear",
        "translate" or "average". Default: None, "linear".

    Returns
    -------
    Path
        The PVD, which lists the VTU files with their times in ms.

    Raises
    ------
    ResultError
        The file is missing, cut or of an unknown format, or lacks a mesh or a quantity; a
        record is damaged, or a value is not finite.
    OutputError
        A file cannot be written.

    Examples
    --------
    >>> import fembridge as fb
    >>> fb.write_vtu_series(fb.sample("frd"), "paraview").name
    'job.pvd'
    """
    with open_result(
        path,
        partial=partial,
        stress_unit=stress_unit,
        length_unit=length_unit,
        extrapolate=extrapolate,
    ) as result:
        return write_frames(result.source, Path(folder), quantities, derived, modes)[0]


def write_frames(
    source: Source,
    folder: Path,
    quantities: Sequence[str] | None,
    derived: Sequence[str],
    modes: bool = False,
) -> tuple[Path, int]:
    """As `write_vtu_series`, of an open file: path of the PVD, number of increments."""
    unknown = [name for name in derived if name not in DERIVED]
    if unknown:
        raise UsageError(argument="derived", found=unknown[0], expected=", ".join(DERIVED))
    path = source.path
    scene, over_time, frames = source.frames(quantities, tuple(derived), modes)
    if not scene.cells:
        raise ResultError("no element of a kind that VTU supports", path)
    shape = _Shape(scene)
    series = f"{path.stem}.pvd"
    entries: list[tuple[float, str]] = []
    written: set[str] = set()
    with filling(folder, series) as draft:
        for time, values in frames:
            name = f"{path.stem}.{len(entries) + 1:04d}.vtu"
            shape.write(draft / name, values)
            entries.append((time, name))
            written |= values.keys()
        if not entries:
            raise ResultError("no increment with values", path)
        (draft / series).write_text(_pvd(entries, over_time), encoding="utf-8", newline="\n")
    for name in derived:
        if f"{name}_pa" not in written and (quantities is None or name != "von_mises"):
            takes = " and ".join(DERIVED[name][0])
            same_nodes = " at the same nodes" if " and " in takes else ""
            source.options.note(f"no {name}: needs {takes}{same_nodes}")
    return folder / series, len(entries)


class _Shape:
    """A mesh in VTK's form, made once for all increments."""

    def __init__(self, scene: Scene) -> None:
        cells = scene.cells
        rows = [group.rows[:, _VTK[group.kind][1]] for group in cells]
        sizes = np.concatenate([np.full(len(array), array.shape[1]) for array in rows])
        types = [np.full(len(group.ids), _VTK[group.kind][0], np.uint8) for group in cells]
        material = np.concatenate([group.material for group in cells])
        self._size = f'NumberOfPoints="{scene.nodes.size}" NumberOfCells="{sizes.size}"'
        self._points = {"points": scene.points_mm}
        self._cells: dict[str, _Array] = {
            "connectivity": np.concatenate([array.ravel() for array in rows]),
            "offsets": np.cumsum(sizes),
            "types": np.concatenate(types),
        }
        self._point_data = {"node": scene.nodes, "materials": scene.material_count}
        self._cell_data: dict[str, _Array] = {
            "element": np.concatenate([group.ids for group in cells]),
            "material": material,
        }
        for number, name in sorted(scene.materials.items()):
            if (is_material := material == number).any():
                self._cell_data[f"material {_plain(name)}"] = is_material.astype(np.uint8)

    def write(self, path: Path, values: Mapping[str, FloatArray]) -> None:
        """Write one VTU file: XML, then the bytes of the arrays, each after its length.

        The arrays are stored in reverse order: meshio replaces the offsets one by one and picks
        the first array in the XML with an equal offset, replaced or not.
        """
        data = {_plain(name): value for name, value in values.items()}
        parts: dict[str, Mapping[str, _Array]] = {
            "Points": self._points,
            "Cells": self._cells,
            "PointData": {**self._point_data, **data},
            "CellData": self._cell_data,
        }
        all_arrays = [array for arrays in parts.values() for array in arrays.values()]
        offset = sum(8 + array.size * (1 if array.dtype.kind == "u" else 8) for array in all_arrays)
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
    """`name` with the characters that XML and ParaView accept."""
    return re.sub(r"[^A-Za-z0-9_.+%() -]", "_", name)
