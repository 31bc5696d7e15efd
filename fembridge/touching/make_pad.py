"""Compute a pad, of a finger or of any mesh: what a touch superposes.

CalculiX solves the unit forces. Of a model of Abaqus or Marc `pad_decks` writes the decks of the
forces, and `make_pad` reads the results that the user's solver wrote (`force_results`).
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from fembridge.errors import DeckError, UsageError, check_type
from fembridge.ranges import check_range
from fembridge.solver.analysis import load_finger
from fembridge.solver.build import BaseDeck, read_base_deck
from fembridge.solver.settings import DEFAULTS, Solver
from fembridge.touching.pad_request import SkinMap, site_requests

if TYPE_CHECKING:
    from decks.finger import Finger
    from decks.fingertip import Fingertip
    from fembridge.touching.force_runs import PadForces
    from fembridge.touching.pad import Pad

REACH_MM = 4.5
"""Default reach of the pad of a finger."""
_OF_A_FINGER = {"finger": "quick", "spacing_mm": None, "ridges": False, "plane": False}
_OF_A_MESH = {
    "skin": None, "afferents": None, "skin_map": None, "after_step": 0, "target": None,
    "length_unit": None, "results": None, "force_n": None, "forces_per_deck": None,
    "step_per_force": False,
}  # fmt: skip
# Of forces that are solved elsewhere; in a folder of `pad_decks` they stand in pad.toml.
_OF_FORCES = ("force_n", "forces_per_deck", "step_per_force")


def make_pad(
    finger: str | Finger | Fingertip = "quick",
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
    target: str | None = None,
    length_unit: str | None = None,
    results: Sequence[str | os.PathLike[str]] | None = None,
    force_n: float | None = None,
    forces_per_deck: int | None = None,
    step_per_force: bool = False,
    solver: Solver = DEFAULTS,
) -> Pad:
    """Compute a pad for `touch`: the responses of skin and afferents to unit forces on the skin.

    Without `base_deck` the section of `finger` is swept along it; CalculiX solves unit forces on
    one slice of the skin, in four runs for the mirror images about x = 0 and z = 0. Two minutes
    and 0.3 GB at a spacing of 0.25 mm; the cost grows with about the fifth power of 1 / spacing.
    A round fingertip (``"fingertip"``) is meshed and solved as a model of your own.

    With `base_deck` it is the pad of your own model. CalculiX writes its stiffness; it is
    factorised once, and unit forces along three directions are solved on each node of `skin`:
    4 500 of them on 100 000 unknowns take four minutes of one core and 1.5 GB. Of a model of
    Abaqus or Marc `pad_decks` writes the unit forces, and this function reads their results.

    Parameters
    ----------
    finger
        ``"quick"``, ``"paper"``, the path of a TOML file, or a `Finger`; or a round fingertip,
        ``"fingertip"``, ``"fingertip_macaque"``, a TOML file with such a base, or a `Fingertip`
        of `decks.fingertip`. Default: ``"quick"``.
    spacing_mm
        Distance of two nodes that may touch in mm, 0.05 to 1. Default: None, 0.25, of a plane
        pad 0.0625.
    reach_mm
        Distance in mm from the apex up to which skin may be touched. Of a finger along the skin
        to both sides, 1 to 20. Default: None, of a finger 4.5, of a fingertip or a mesh all skin.
    ridges
        Whether to model the ridges and papillae of the finger, along its axis.
        Default: False, smooth skin.
    plane
        Whether to model the section alone, in plane strain: shapes are endless along the
        finger. Default: False.
    base_deck
        Path of a deck with solid elements, ``.inp`` of CalculiX or Abaqus or ``.dat`` of Marc; or
        the folder of `pad_decks`, whose results are read. Default: None, a finger.
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
    target
        ``"calculix"`` or ``"abaqus"`` for a .inp. Default: None, as the deck shows.
    length_unit
        ``"mm"``, ``"m"`` or ``"in"``. Default: None, as the heading states, else mm.
    results
        Result file of each deck of forces, in their order. Default: None, those in the folder of
        `pad_decks`; of a deck CalculiX solves it.
    force_n, forces_per_deck, step_per_force
        Of results with a deck instead of a folder: as in `pad_decks`. Default: None, None, False.
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
        The computed displacements differ from CalculiX', or those of results are not reciprocal.
    ResultError
        A result file that is missing, cut, or of another deck.

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
        "afferents": afferents, "skin_map": skin_map, "after_step": after_step, "target": target,
        "length_unit": length_unit, "results": results, "force_n": force_n,
        "forces_per_deck": forces_per_deck, "step_per_force": step_per_force,
    }  # fmt: skip
    other, kind = (_OF_A_MESH, "a base_deck") if base_deck is None else (_OF_A_FINGER, "a finger")
    for argument, default in other.items():
        if given[argument] != default:
            raise UsageError(f"is for {kind}", argument=argument, found=given[argument])
    if base_deck is not None:
        path = Path(base_deck)
        if path.is_dir():
            return _pad_of_folder(path, given, reach_mm, results)
        base = read_base_deck(path, target)
        if base.solver == "calculix":
            for argument in ("results", *_OF_FORCES):
                if given[argument] != _OF_A_MESH[argument]:
                    found = given[argument]
                    raise UsageError("is for Abaqus and Marc", argument=argument, found=found)
            return _make_mesh_pad(
                path, skin, afferents, skin_map, reach_mm, after_step, length_unit, solver
            )
        if results is None:
            raise UsageError(
                f"is missing: a deck for {base.solver.capitalize()}, whose unit forces pad_decks "
                "writes; target='calculix' solves a .inp here",
                argument="results",
            )
        from fembridge.touching.force_results import read_pad

        forces = _plan(
            base, skin, afferents, skin_map, reach_mm, after_step, length_unit, force_n,
            forces_per_deck, step_per_force,
        )  # fmt: skip
        return read_pad(forces, [Path(file) for file in results])
    from decks.fingertip import Fingertip, is_fingertip, read_fingertip
    from decks.unit_loads import PLANE_ROWS, PadMesh, smooth
    from fembridge.touching.green import solve_pad

    if isinstance(finger, Fingertip) or (isinstance(finger, str) and is_fingertip(finger)):
        from fembridge.touching.fingertip_pad import solve_fingertip_pad

        for argument in ("spacing_mm", "ridges", "plane"):
            if given[argument] != _OF_A_FINGER[argument]:
                problem = "is for a cross-section, not for a round fingertip"
                raise UsageError(problem, argument=argument, found=given[argument])
        if reach_mm is not None:
            check_range("reach_mm", reach_mm)
        tip = read_fingertip(finger) if isinstance(finger, str) else finger
        with _runs_folder(solver) as folder:
            return solve_fingertip_pad(folder, tip, reach_mm, solver)
    if spacing_mm is None:
        spacing_mm = 0.0625 if plane else 0.25
    reach_mm = REACH_MM if reach_mm is None else reach_mm
    check_range("spacing_mm", spacing_mm)
    check_range("reach_mm", reach_mm)
    mesh = PadMesh(spacing_mm, reach_mm, plane=plane, rows=PLANE_ROWS if plane else 1)
    body = load_finger(finger)
    with _runs_folder(solver) as folder:
        return solve_pad(folder, body if ridges else smooth(body), mesh, solver)


def pad_decks(
    base_deck: str | os.PathLike[str],
    output: str | os.PathLike[str] = "pad",
    *,
    skin: str | None = None,
    afferents: str | Mapping[str, str] | None = None,
    skin_map: SkinMap | None = None,
    reach_mm: float | None = None,
    after_step: int = 0,
    target: str | None = None,
    length_unit: str | None = None,
    force_n: float | None = None,
    forces_per_deck: int | None = None,
    step_per_force: bool = False,
) -> PadForces:
    """Decks of unit forces on the skin of a model of yours, for Abaqus or Marc.

    The model and the steps before stay. In Abaqus the forces are load cases of one linear
    perturbation step, and displacement and stress are printed. In Marc each is an increment.
    ``make_pad(base_deck=output)`` reads the results.

    Parameters
    ----------
    base_deck
        Path of a .inp of Abaqus, with or without parts, or of a .dat of Marc.
    output
        Folder of the decks. Default: ``"pad"``.
    skin
        Surface, or set of nodes, that may be touched; of Marc a set of nodes. ``INSTANCE.NAME``
        names one of an instance. Default: None, which is refused.
    afferents, skin_map, reach_mm
        Where stress is computed, and the map of the skin with its reach in mm, as in `make_pad`.
        Default: None.
    after_step
        Step, or load case of Marc, after which the model is linearised. Default: 0, undeformed.
    target
        ``"calculix"`` or ``"abaqus"`` for a .inp. Default: None, as the deck shows.
    length_unit
        ``"mm"``, ``"m"`` or ``"in"``. Default: None, as the heading states, else mm.
    force_n
        Force of each increment of Marc in N. Default: None, 0.0001.
    forces_per_deck
        Most forces of a deck. Default: None, as many as make results of 1 GB.
    step_per_force
        Whether each force is a step of Abaqus, which costs a factorisation of the stiffness each.
        Default: False, load cases.

    Returns
    -------
    PadForces
        ``folder``, ``names`` of the decks, and the size of their results, ``expected_bytes``.

    Raises
    ------
    UsageError
        An argument out of range, or a deck for CalculiX, which `make_pad` solves.
    DeckError
        A deck without this skin or layer, or that cannot be linearised, with its line.
    OutputError
        The folder cannot be written.

    Examples
    --------
    >>> import fembridge as fb
    >>> forces = fb.pad_decks("mine.inp", skin="SKIN", target="abaqus")  # doctest: +SKIP
    >>> forces.expected_bytes  # doctest: +SKIP
    >>> pad = fb.make_pad(base_deck="pad")  # doctest: +SKIP
    """
    base = read_base_deck(Path(base_deck), target)
    if base.solver == "calculix":
        problem = "is a deck for CalculiX, which make_pad solves; target='abaqus' is for Abaqus"
        raise UsageError(problem, argument="base_deck", found=base.path.name)
    forces = _plan(
        base, skin, afferents, skin_map, reach_mm, after_step, length_unit, force_n,
        forces_per_deck, step_per_force,
    )  # fmt: skip
    return forces.write(Path(output))


def _plan(
    base: BaseDeck,
    skin: str | None,
    afferents: str | Mapping[str, str] | None,
    skin_map: SkinMap | None,
    reach_mm: float | None,
    after_step: int,
    length_unit: str | None,
    force_n: float | None,
    forces_per_deck: int | None,
    step_per_force: bool,
) -> PadForces:
    from hashlib import sha256

    from decks.finger import SITES
    from fembridge.touching.force_runs import ForceRequest, plan_forces

    if skin is None:
        raise UsageError("is missing: the surface or node set of the skin", argument="skin")
    for argument, value, solver in (
        ("force_n", force_n, "marc"),
        ("step_per_force", step_per_force or None, "abaqus"),
    ):
        if value is not None and base.solver != solver:
            raise UsageError(f"is for {solver.capitalize()}", argument=argument, found=value)
    if force_n is not None:
        check_range("force_n", force_n)
    if forces_per_deck is not None:
        check_range("forces_per_deck", forces_per_deck)
    skin_map = _skin_map(skin_map, reach_mm)
    if isinstance(afferents, str):
        afferents = dict.fromkeys(SITES, afferents)
    request = ForceRequest(
        solver=base.solver,
        deck=base.path.name,
        deck_sha256=sha256(base.data).hexdigest(),
        skin=skin,
        afferents=None if afferents is None else dict(afferents),
        after_step=after_step,
        apex=skin_map.apex,
        outward=skin_map.outward,
        along=skin_map.along,
        reach_mm=skin_map.reach_mm,
        forces_per_deck=forces_per_deck,
        step_per_force=step_per_force,
        length_unit=length_unit,
    )
    if force_n is not None:
        request = replace(request, force_n=force_n)
    try:
        return plan_forces(base.data, request, base.path)
    except DeckError as error:
        raise DeckError.from_error(error, base.path) from error


def _pad_of_folder(
    folder: Path,
    given: Mapping[str, object],
    reach_mm: float | None,
    results: Sequence[str | os.PathLike[str]] | None,
) -> Pad:
    from fembridge.touching.force_results import read_pad
    from fembridge.touching.force_runs import read_forces

    for argument, default in {**_OF_A_MESH, "reach_mm": None}.items():
        value = reach_mm if argument == "reach_mm" else given[argument]
        if argument != "results" and value != default:
            problem = "is in pad.toml of the folder of pad_decks"
            raise UsageError(problem, argument=argument, found=value)
    files = None if results is None else [Path(file) for file in results]
    return read_pad(read_forces(folder), files)


def _skin_map(skin_map: SkinMap | None, reach_mm: float | None) -> SkinMap:
    skin_map = SkinMap() if skin_map is None else skin_map
    check_type("skin_map", skin_map, SkinMap)
    if reach_mm is not None:
        check_range("reach_mm", reach_mm)
        skin_map = replace(skin_map, reach_mm=reach_mm)
    return skin_map


def _make_mesh_pad(
    base_deck: Path,
    skin: str | None,
    afferents: str | Mapping[str, str] | None,
    skin_map: SkinMap | None,
    reach_mm: float | None,
    after_step: int,
    length_unit: str | None,
    solver: Solver,
) -> Pad:
    from fembridge.touching.mesh_green import solve_mesh_pad

    if skin is None:
        raise UsageError("is missing: the surface or node set of the skin", argument="skin")
    skin_map = _skin_map(skin_map, reach_mm)
    requests = site_requests(afferents)
    with _runs_folder(solver) as folder:
        return solve_mesh_pad(
            folder,
            base_deck,
            skin,
            requests,
            skin_map,
            solver,
            after_step=after_step,
            length_unit=length_unit,
        )


@contextmanager
def _runs_folder(solver: Solver) -> Iterator[Path]:
    """The folder of the runs: that of `solver`, or a temporary one."""
    from fembridge.host.store import temporary_folder

    with ExitStack() as stack:
        yield Path(solver.runs_folder or stack.enter_context(temporary_folder()))
