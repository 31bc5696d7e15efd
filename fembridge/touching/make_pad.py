"""Compute a pad with CalculiX, of a finger or of any mesh: what a touch superposes."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from fembridge.errors import UsageError, check_type
from fembridge.ranges import check_range
from fembridge.solver.analysis import load_finger
from fembridge.solver.settings import DEFAULTS, Solver
from fembridge.touching.pad_request import SkinMap, site_requests

if TYPE_CHECKING:
    from decks.finger import Finger
    from fembridge.touching.pad import Pad

REACH_MM = 4.5
"""Default reach of the pad of a finger."""
_OF_A_FINGER = {"finger": "quick", "spacing_mm": None, "ridges": False, "plane": False}
_OF_A_MESH = {"skin": None, "afferents": None, "skin_map": None, "after_step": 0}


def make_pad(
    finger: str | Finger = "quick",
    *,
    spacing_mm: float | None = None,
    reach_mm: float | None = None,
    ridges: bool = False,
    plane: bool = False,
    base_deck: str | os.PathLike[str] | None = None,
    skin: str | None = None,
    afferents: str | Mapping[str, str] | None = None,
    skin_map: SkinMap | None = None,
    after_step: int = 0,
    solver: Solver = DEFAULTS,
) -> Pad:
    """Compute a pad for `touch`: the responses of skin and afferents to unit forces on the skin.

    Without `base_deck` the section of `finger` is swept along it; CalculiX solves unit forces on
    one slice of the skin, in four runs for the mirror images about x = 0 and z = 0. Two minutes
    and 0.3 GB at a spacing of 0.25 mm; the cost grows with about the fifth power of 1 / spacing.

    With `base_deck` it is the pad of your own model. CalculiX writes its stiffness; it is
    factorised once, and unit forces along three directions are solved on each node of `skin`:
    4 500 of them on 100 000 unknowns take six minutes of one core and 2 to 3 GB.

    Parameters
    ----------
    finger
        ``"quick"``, ``"paper"``, the path of a TOML file, or a `Finger`. Default: ``"quick"``.
    spacing_mm
        Distance of two nodes that may touch in mm, 0.05 to 1. Default: None, 0.25, of a plane
        pad 0.0625.
    reach_mm
        Distance in mm from the apex up to which skin may be touched. Of a finger along the skin
        to both sides, 1 to 20. Default: None, of a finger 4.5, of a mesh all of `skin`.
    ridges
        Whether to model the ridges and papillae of the finger, along its axis.
        Default: False, smooth skin.
    plane
        Whether to model the section alone, in plane strain: shapes are endless along the
        finger. Default: False.
    base_deck
        Path of a deck (``.inp``) of CalculiX with solid elements. Default: None, a finger.
    skin
        Surface, or set of nodes, of `base_deck` that may be touched. Default: None, of a finger.
    afferents
        Where stress is computed, for all classes or by class: ``"EPIDERMIS:0.6"``, 0.6 mm below
        the skin in the elements of this set; ``"0.6"``, in the material at that depth; or
        ``"NODES"``, at the nodes of this set. Default: None, the depths of SA, RA and PC in the
        reference finger: 0.5875, 0.52 and 2 mm.
    skin_map
        Middle and directions of the map of the skin. Default: None, a `SkinMap` that is computed
        from the skin.
    after_step
        Step of `base_deck` after which the model is linearised, such as a preload. Default: 0,
        the undeformed model.
    solver
        Threads, simultaneous runs, limits, and folder of the runs, in which an interrupted pad
        goes on. Default: ``Solver()``.

    Returns
    -------
    Pad
        ``write(path)`` writes the file that ``touch(pad=...)`` reads.

    Raises
    ------
    UsageError, FingerError
        A number out of range, an argument of the other kind of pad, or a finger that cannot be
        meshed so.
    DeckError
        A deck without this skin or layer, or that cannot be linearised, with its line.
    SolverError, MissingError
        A run failed, or CalculiX is not installed.
    ResponseError
        The computed displacements differ from CalculiX'.

    Examples
    --------
    >>> import fembridge as fb
    >>> pad = fb.make_pad("quick", spacing_mm=0.5, reach_mm=2)  # doctest: +SKIP
    >>> pad.write("pad.npz")  # doctest: +SKIP
    >>> pad = fb.make_pad(base_deck="mine.inp", skin="SKIN")  # doctest: +SKIP
    >>> fb.touch("braille", press_n=0.3, pad=pad)  # doctest: +SKIP
    """
    given = {
        "finger": finger, "spacing_mm": spacing_mm, "ridges": ridges, "plane": plane, "skin": skin,
        "afferents": afferents, "skin_map": skin_map, "after_step": after_step,
    }  # fmt: skip
    other, kind = (_OF_A_MESH, "a base_deck") if base_deck is None else (_OF_A_FINGER, "a finger")
    for argument, default in other.items():
        if given[argument] != default:
            raise UsageError(f"is for {kind}", argument=argument, found=given[argument])
    if base_deck is not None:
        return _make_mesh_pad(
            Path(base_deck), skin, afferents, skin_map, reach_mm, after_step, solver
        )
    from decks.unit_loads import PLANE_ROWS, PadMesh, smooth
    from fembridge.touching.green import solve_pad

    if spacing_mm is None:
        spacing_mm = 0.0625 if plane else 0.25
    reach_mm = REACH_MM if reach_mm is None else reach_mm
    check_range("spacing_mm", spacing_mm)
    check_range("reach_mm", reach_mm)
    mesh = PadMesh(spacing_mm, reach_mm, plane=plane, rows=PLANE_ROWS if plane else 1)
    body = load_finger(finger)
    with _runs_folder(solver) as folder:
        return solve_pad(folder, body if ridges else smooth(body), mesh, solver)


def _make_mesh_pad(
    base_deck: Path,
    skin: str | None,
    afferents: str | Mapping[str, str] | None,
    skin_map: SkinMap | None,
    reach_mm: float | None,
    after_step: int,
    solver: Solver,
) -> Pad:
    from fembridge.touching.mesh_green import solve_mesh_pad

    if skin is None:
        raise UsageError("is missing: the surface or node set of the skin", argument="skin")
    skin_map = SkinMap() if skin_map is None else skin_map
    check_type("skin_map", skin_map, SkinMap)
    if reach_mm is not None:
        check_range("reach_mm", reach_mm)
        skin_map = replace(skin_map, reach_mm=reach_mm)
    requests = site_requests(afferents)
    with _runs_folder(solver) as folder:
        return solve_mesh_pad(
            folder, base_deck, skin, requests, skin_map, solver, after_step=after_step
        )


@contextmanager
def _runs_folder(solver: Solver) -> Iterator[Path]:
    """The folder of the runs: that of `solver`, or a temporary one."""
    from fembridge.host.store import temporary_folder

    with ExitStack() as stack:
        yield Path(solver.runs_folder or stack.enter_context(temporary_folder()))
