"""Legacy ``.vtk`` files, as FEBio exports them, read by meshio.

meshio allocates memory by the counts in a header and reads the whole file. Therefore the size of
files is limited, and every count is first compared with the size of the file: a number takes a
byte or more.
"""

import re
import warnings
from pathlib import Path

import numpy as np

from fembridge.errors import FembridgeError, MissingError, ResultError
from fembridge.host.memory import check_memory
from fembridge.results.byte_file import ByteFile
from fembridge.results.series import Frame
from fembridge.typing import FloatArray

MAX_FILE_BYTES = 1 << 28
COPIES = 12
"""Memory that meshio needs, in file sizes: a number of two characters becomes eight bytes."""

_DATASET = re.compile(rb"^DATASET[ \t]+(\w+)", re.MULTILINE)
# Lines of a keyword or name and counts: POINTS 8 float; CELLS 3 12; S 1 8 double.
_COUNTS = re.compile(rb"^([A-Za-z]\S*(?:[ \t]+[A-Za-z]\w*)*)((?:[ \t]+\d+)+)", re.MULTILINE)
_FIRST = b"# vtk DataFile Version"


class LegacyVtkFile(Frame):
    """The points of a legacy VTK file of an unstructured grid, and the arrays there."""

    def __init__(self, path: Path) -> None:
        with ByteFile(path) as file:
            if file.size > MAX_FILE_BYTES:
                raise ResultError(f"larger than the limit of {MAX_FILE_BYTES} bytes", path)
            check_memory(COPIES * file.size, path.name, ResultError.at(path))
            _check_header(file.take(0, file.size), path)
        try:
            import meshio
        except ImportError as error:
            raise MissingError("no meshio to read .vtk with: pip install meshio") from error
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # NumPy warns about text that is not a number
                mesh = meshio.vtk.read(path)
        except (FembridgeError, MemoryError):
            raise
        except (Exception, SystemExit) as error:  # any error of meshio about damage
            problem = f"{type(error).__name__} {error}".strip()[:120]
            raise ResultError(f"invalid VTK: {problem}", path) from error
        self.path, self._points = path, np.asarray(mesh.points, dtype=np.float64)
        self._arrays = {
            str(name): np.asarray(array)
            for name, array in mesh.point_data.items()
            if np.asarray(array).dtype.kind in "iuf"
        }
        super().__init__({name: array.shape for name, array in self._arrays.items()})

    def count(self) -> int:
        """Number of points."""
        return len(self._points)

    def points(self) -> FloatArray:
        """Coordinates ``(P, 3)``."""
        if self._points.ndim != 2 or not np.isfinite(self._points).all():
            raise ResultError("a coordinate is not finite", self.path)
        return self._points

    def read(self, name: str) -> FloatArray:
        """The array `name` at the points."""
        return self._arrays[name].astype(np.float64)


def _check_header(content: bytes, path: Path) -> None:
    kinds = _DATASET.findall(content)
    if not content.startswith(_FIRST) or kinds[:1] != [b"UNSTRUCTURED_GRID"]:
        raise ResultError("expected a legacy VTK file of an UNSTRUCTURED_GRID", path)
    for match in _COUNTS.finditer(content):
        if max(float(count) for count in match[2].split()) > len(content):
            line = content.count(b"\n", 0, match.start()) + 1
            name = match[1].decode("ascii", "replace")[:40]
            raise ResultError(f"{name} announces more numbers than the file has bytes", path, line)
