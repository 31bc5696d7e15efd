"""Deflection of the skin around a thin probe on several meshes: `deflect` and its result."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from decks.presets import read_finger
from fembridge.errors import ResultError, UsageError
from fembridge.host.store import (
    check_output,
    filling,
    make_folder,
    read_toml,
    temporary_folder,
    write_toml,
)
from fembridge.io.text_table import read_table, write_table
from fembridge.plots.shown import Shown
from fembridge.response.deflection import (
    DEPTH_MM,
    FINGERS,
    Deflection,
    convergence,
    press_of,
    solve_deflection,
    stored_deflection,
    stored_deflections,
)
from fembridge.solver.settings import Solver
from fembridge.typing import Table
from fembridge.version import __version__

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from decks.finger import Finger
    from fembridge.plots.style import Panels

_LOGGER = logging.getLogger(__name__)

PathLike: TypeAlias = str | Path

TABLE_FILE, PICTURE_FILE, RECORD_FILE = "deflection.csv", "deflection.png", "deflection.toml"
_COLUMNS = ("mesh", "distance_mm", "deflection_mm")
_LOADING = ("loading_mm", "loading_n_per_mm")


class Deflections(Shown):
    """Deflection of the skin around a thin probe, on one mesh or several; result of `deflect`.

    Parameters
    ----------
    meshes
        Profile of each mesh by its name, the coarsest first.

    Examples
    --------
    >>> import fembridge as fb
    >>> deflections = fb.deflect()
    >>> deflections.write("deflection")
    >>> sorted(fb.Deflections.read("deflection").meshes) == sorted(deflections.meshes)
    True
    """

    def __init__(self, meshes: Mapping[str, Deflection]) -> None:
        self.meshes = dict(meshes)

    @property
    def table(self) -> pandas.DataFrame:
        """Profiles: ``mesh, distance_mm, deflection_mm``."""
        import pandas

        return pandas.DataFrame(self._rows(), columns=list(_COLUMNS))

    @property
    def convergence(self) -> list[dict[str, Any]]:
        """Convergence with the mesh, see `fembridge.response.deflection.convergence`."""
        profiles = list(self.meshes.values())
        return convergence(profiles) if len(profiles) > 1 else []

    @property
    def provenance(self) -> Table:
        """Version, and the inputs of each mesh."""
        return {
            "fembridge": __version__,
            "meshes": {name: dict(mesh.origin) for name, mesh in self.meshes.items()},
        }

    def _lines(self) -> list[str]:
        lines = [
            f"  {name}: {mesh.elements} elements, {float(mesh.at(0.0)):.4f} mm under the probe, "
            f"{mesh.force_n_per_mm:.4f} N/mm"
            for name, mesh in self.meshes.items()
        ]
        return ["Deflections of the skin, by mesh", *lines]

    def plot(self, kind: str | None = None, ax: Panels | None = None) -> Figure:
        """Profile of each mesh and force against depth.

        Parameters
        ----------
        kind
            ``profiles``, the only kind. Default: ``profiles``.
        ax
            Axes to draw into: the profiles, with several meshes their differences from the
            finest, and the force. Default: a new figure.

        Raises
        ------
        UsageError
            Another kind, or another number of axes.
        """
        from fembridge.plots.response import deflection_figure

        if kind not in (None, "profiles"):
            raise UsageError(argument="kind", found=kind, expected="profiles")
        return deflection_figure(list(self.meshes.values()), ax)

    def write(self, folder: PathLike) -> None:
        """Write profiles (CSV), inputs (TOML) and the picture into `folder`.

        Parameters
        ----------
        folder
            Folder of the files, which is made.

        Raises
        ------
        OutputError
            The folder cannot be written.
        """
        from fembridge.plots.style import save_figure

        record = {
            name: {
                "elements": mesh.elements,
                "depth_mm": mesh.depth_mm,
                **{key: getattr(mesh, key).tolist() for key in _LOADING},
                "origin": dict(mesh.origin),
            }
            for name, mesh in self.meshes.items()
        }
        with filling(Path(folder), last=TABLE_FILE) as draft:
            save_figure(self.plot(), draft / PICTURE_FILE)
            write_toml(draft / RECORD_FILE, {"fembridge": __version__, "meshes": record})
            write_table(draft / TABLE_FILE, _COLUMNS, self._rows())

    @classmethod
    def read(cls, folder: PathLike) -> Deflections:
        """Deflections from the files of `write`.

        Parameters
        ----------
        folder
            Folder that `write` or ``fembridge deflect`` wrote.

        Raises
        ------
        ResultError, TableError
            A file is missing or is not one of `write`.
        """
        path = Path(folder) / RECORD_FILE
        record = read_toml(path, ResultError.at(path))
        table = read_table(Path(folder) / TABLE_FILE, _COLUMNS, ())
        names = np.array(table.words("mesh"))
        columns = {name: np.array(table.numbers(name)) for name in _COLUMNS[1:]}
        try:
            return cls(
                {
                    name: Deflection(
                        name=name,
                        **{key: values[names == name] for key, values in columns.items()},
                        **fields,
                    )
                    for name, fields in record["meshes"].items()
                }
            )
        except (KeyError, TypeError) as error:
            raise ResultError("was not written by `fembridge deflect`", path) from error

    def _rows(self) -> list[tuple[str, float, float]]:
        return [
            (name, distance_mm, deflection_mm)
            for name, mesh in self.meshes.items()
            for distance_mm, deflection_mm in zip(
                mesh.distance_mm.tolist(), mesh.deflection_mm.tolist(), strict=True
            )
        ]


def deflect(
    finger: str | Finger | None = None,
    *,
    stored: bool = True,
    depth_mm: float = DEPTH_MM,
    solver: Solver | None = None,
    output: PathLike | None = None,
) -> Deflections:
    """Deflection of the skin around a 50 um probe that is pressed 1 mm deep (Fig. 2c).

    Parameters
    ----------
    finger
        ``quick``, ``medium``, ``paper`` or ``fine``; with ``stored=False`` also a TOML file or
        a `Finger`. Default: None, all stored meshes, or ``quick`` with ``stored=False``.
    stored
        Return the stored profiles; False solves them, which requires CalculiX and one to ten
        minutes. Default: True.
    depth_mm
        Depth of the probe in mm, 0.05 to 2, where it is solved. Default: 1.
    solver
        How the solver runs. Default: None, the settings of `fembridge.Solver`.
    output
        Folder for the result, see `Deflections.write`, and for the run of the solver.
        Default: None, nothing is written.

    Returns
    -------
    Deflections
        ``table`` has the profile of each mesh.

    Raises
    ------
    UsageError
        No profile is stored for `finger`, or a depth out of range.
    SolverError, ResponseError
        The run failed, or the probe slipped between the nodes.

    Examples
    --------
    >>> import fembridge as fb
    >>> list(fb.deflect().meshes)
    ['quick', 'medium', 'paper', 'fine']
    """
    if output is not None:
        check_output(Path(output), TABLE_FILE, PICTURE_FILE, RECORD_FILE)
    if stored:
        profiles = list(stored_deflections()) if finger is None else [stored_deflection(finger)]
    else:
        profiles = [_solved(finger or "quick", depth_mm, solver or Solver(), output)]
    result = Deflections({profile.name: profile for profile in profiles})
    if output is not None:
        result.write(output)
    return result


def _solved(
    finger: str | Finger, depth_mm: float, solver: Solver, output: PathLike | None
) -> Deflection:
    """Solved profile; logs its difference from the stored profile of the same mesh."""
    if isinstance(finger, str):
        finger = FINGERS.get(finger) or read_finger(finger)
    press = press_of(finger)
    if output is None:
        with temporary_folder() as folder:
            solved = solve_deflection(folder, press, depth_mm, solver)
    else:
        run_folder = make_folder(Path(output)) / "run"
        solved = solve_deflection(run_folder, press, depth_mm, solver)
    for profile in stored_deflections():
        same_mesh = profile.origin.get("mesh_sha256") == solved.origin["mesh_sha256"]
        if same_mesh and profile.depth_mm == solved.depth_mm:
            difference_um = 1000.0 * abs(solved.deflection_mm - profile.deflection_mm).max()
            _LOGGER.info(
                f"compared with the stored profile of {profile.name}: largest difference "
                f"{difference_um:.2g} um"
            )
    return solved
