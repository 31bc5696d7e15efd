"""gmsh, through pygmsh: opened for one mesh, and its failures turned into ours.

gmsh's own files of options are not read and its handler of Ctrl-C is not put in
place: the mesh depends on the finger alone, and the caller keeps its signals.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from fembridge.errors import FingerError, MissingError

SYSTEM_PACKAGES = "libglu1-mesa libgl1 libxcursor1 libxft2 libxinerama1 libgomp1"

_OPTIONS = {
    "General.Verbosity": 1,
    "General.NumThreads": 1,
    "Mesh.RecombineAll": 1,
    "Mesh.Smoothing": 10,
    "Mesh.RecombinationAlgorithm": 2,
    "Mesh.MeshSizeExtendFromBoundary": 1,
    "Mesh.MeshSizeFromPoints": 0,
}


@contextmanager
def gmsh_session() -> Iterator[tuple[Any, Any]]:
    """Give pygmsh's geometry and the gmsh module; close gmsh at the end.

    Raises
    ------
    MissingError
        gmsh or one of the system's libraries that it opens is not installed.
    FingerError
        gmsh failed while it was open, or the caller has a session of its own.
    """
    gmsh, pygmsh = _libraries()
    if gmsh.isInitialized():
        raise FingerError("gmsh is already at work here: call gmsh.finalize() first")
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        for option, value in _OPTIONS.items():
            gmsh.option.setNumber(option, value)
        gmsh.model.add("finger")
        yield pygmsh.geo.Geometry(), gmsh
    except FingerError:
        raise
    except Exception as error:
        if type(error) is not Exception:  # gmsh raises the bare class, bugs do not
            raise
        raise FingerError(f"gmsh cannot mesh this finger: {error}") from error
    finally:
        gmsh.model.mesh.removeSizeCallback()
        gmsh.finalize()


def _libraries() -> tuple[Any, Any]:
    try:
        import gmsh
        import pygmsh
    except OSError as error:
        raise MissingError(
            f"gmsh cannot load a system library ({error}); apt-get install -y {SYSTEM_PACKAGES}"
        ) from error
    except ImportError as error:
        raise MissingError(f"{error}; pip install pygmsh") from error
    return gmsh, pygmsh
