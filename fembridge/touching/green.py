"""A pad by CalculiX: four ``*GREEN`` decks, run, read, and put together.

A unit force at x' is half of an even pair at x' and -x' and half of an odd one; the
quarter prisms of `decks.unit_loads` answer both, and their sum is the response at x > 0,
their difference that at x < 0.
"""

import hashlib
import logging
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

import numpy as np

from decks.finger import Finger
from decks.section import section_of
from decks.unit_loads import (
    CASES,
    SHARE,
    GreenCase,
    PadMesh,
    Prism,
    green_deck,
    prism_of,
)
from fembridge.errors import ResultError
from fembridge.host.process import signals_as_exits
from fembridge.host.progress import advance
from fembridge.host.store import make_folder, write_text
from fembridge.io.run_folder import RunFolder
from fembridge.results import read_fields
from fembridge.results.fields import Field, rows_of
from fembridge.solver.ccx import solve_once
from fembridge.solver.settings import DEFAULTS, Solver
from fembridge.touching.prism_pad import STRESS_FLIP, PrismPad, StressRow
from fembridge.trace import PA_PER_MPA
from fembridge.typing import FloatArray

_LOGGER = logging.getLogger(__name__)
_TASK = "unit forces"


def solve_pad(
    folder: Path,
    finger: Finger,
    mesh: PadMesh = PadMesh(),  # noqa: B008 - frozen
    settings: Solver = DEFAULTS,
) -> PrismPad:
    """Have CalculiX make the pad of `finger` in `folder`, a run folder a deck.

    Ridges and papillae are modelled where `finger` has them; see `decks.unit_loads.smooth`.
    Runs of the same decks that are there already are read again.

    Raises
    ------
    FingerError
        No grid for this finger.
    SolverError, MissingError
        A run failed, or there is no solver.
    """
    prism = prism_of(finger, mesh)
    make_folder(folder)

    halt = threading.Event()

    def solved(case: GreenCase) -> tuple[FloatArray, float, str | None]:
        run = _run_folder(folder / case.name, prism, case)
        outcome = solve_once(run, settings.shared_by(settings.jobs), halt)
        if not outcome.accepted:
            raise outcome.to_error()
        response_mm = _read(run, prism, case)
        _LOGGER.info(f"{case.name}: {len(case.loads(prism))} unit forces in {outcome.wall_s:.0f} s")
        return response_mm, outcome.wall_s, outcome.version

    cases = CASES[:2] if mesh.plane else CASES  # nothing moves along z
    with signals_as_exits(), ThreadPoolExecutor(settings.jobs) as pool:
        try:
            advance(_TASK, 0.0)
            answers = []
            for answer in pool.map(solved, cases):
                answers.append(answer)
                advance(_TASK, len(answers) / len(cases))
        finally:  # after Ctrl-C the pool waits until each solver is stopped
            halt.set()
    even, odd = (_joined(*(answer[0] for answer in answers[parity::2])) for parity in (0, 1))
    origin = {
        "solver": f"CalculiX {answers[0][2] or ''}".strip(),
        "mesh": asdict(mesh),
        "elements": (2 if mesh.plane else 4) * prism.elements,
        "unit_forces": sum(len(case.loads(prism)) for case in cases),
    }
    return _pad(prism, even, odd, origin)


def _run_folder(folder: Path, prism: Prism, case: GreenCase) -> RunFolder:
    text = green_deck(prism, case)
    run = RunFolder(
        folder=folder,
        solver="calculix",
        increments=0,  # its steps have no time
        dt_ms=1.0,
        start_ms=0.0,
        afferents=(),
        deck_sha256=hashlib.sha256(text.encode()).hexdigest(),
    )
    make_folder(folder)
    if not (run.deck.is_file() and run.deck.read_text(encoding="utf-8") == text):
        write_text(run.deck, text)
    return run


def _read(run: RunFolder, prism: Prism, case: GreenCase) -> FloatArray:
    """Displacements ``(3, N', 3, W, C, K)`` in mm under 1/4 N: force, column; NaN: no force.

    W counts the prism's `node_rows`, C its watched columns of nodes.
    """
    loads = case.loads(prism)
    response_mm: FloatArray | None = None
    count = 0
    for load, field in zip(loads, read_fields(run.results, "DISP"), strict=False):
        moved = SHARE * displacements(field, prism)
        if response_mm is None:
            response_mm = np.full((3, prism.contact_columns, *moved.shape), np.nan)
        number, axis = load
        response_mm["xyz".index(axis), number] = moved
        count += 1
    if response_mm is None or count != len(loads):
        raise ResultError(f"{count} modes, expected {len(loads)}", run.results)
    return response_mm


def displacements(field: Field, prism: Prism) -> FloatArray:
    """Displacements ``(3, W, C, K)`` in mm of the prism's watched nodes.

    Raises
    ------
    ResultError
        The field lacks one of them.
    """
    columns, slices = prism.watched_columns + 1, len(prism.z_mm)
    grid = np.meshgrid(prism.node_rows, np.arange(columns), np.arange(slices), indexing="ij")
    numbers = prism.node(*grid)
    rows = rows_of(numbers, field.nodes)
    if (rows < 0).any():
        raise ResultError(f"no node {numbers[rows < 0][0]}", Path("DISP"))
    values: FloatArray = np.moveaxis(field.values[rows, :3], -1, 0)
    return values


def _joined(in_plane: FloatArray, axial: FloatArray | None = None) -> FloatArray:
    """Forces along x and y of one run, along z of the other; 0 where there is no force."""
    responses = np.nan_to_num(in_plane)
    if axial is not None:
        responses[2] = np.nan_to_num(axial[2])
    return responses


def _pad(prism: Prism, even: FloatArray, odd: FloatArray, origin: dict[str, object]) -> PrismPad:
    """Put the responses of both parities together; forces on the right half."""
    plane = prism.mesh.plane
    if plane:  # both faces move as one; 1 N on each mm of the slice
        thick_mm = 2 * prism.z_mm[1]
        even, odd = (
            thick_mm * np.repeat(response.mean(axis=-1, keepdims=True), 2, -1)
            for response in (even, odd)
        )
    right, left = even + odd, even - odd  # at x > 0, and the mirror image of that at x < 0
    touching = prism.contact_columns
    # Into the skin is -y, of forces and of displacements.
    into = np.array([1.0, -1.0, 1.0])[:, None, None, None]
    down_mm = [-into * response[:, :, 1, 0, :touching] for response in (right, left)]
    surface_mm = prism.point_mm[0, :touching]
    rows, stress_pa = [], []
    for layer in prism.watched_layers:
        for row in prism.layer_rows(layer).tolist():
            rows.append(stress_row(prism, layer, row))
            direct, image = (stress_mpa(prism, layer, row, response) for response in (right, left))
            image *= STRESS_FLIP["x"][:, None, None, None]
            both = np.concatenate([image[..., ::-1, :], direct], axis=-2)
            stress_pa.append(both * into[..., None] * PA_PER_MPA)
    return PrismPad(
        finger=prism.finger,
        spacing_mm=prism.mesh.spacing_mm,
        x_mm=np.concatenate([-surface_mm[:0:-1, 0], surface_mm[:, 0]]),
        y_mm=np.concatenate([surface_mm[:0:-1, 1], surface_mm[:, 1]]),
        z_mm=np.zeros(1) if plane else prism.z_mm,
        stress_z_mm=np.zeros(1) if plane else 0.5 * (prism.z_mm[1:] + prism.z_mm[:-1]),
        down_mm=np.concatenate([down_mm[1][:, :, :0:-1], down_mm[0]], axis=2)[
            ..., : 1 if plane else None
        ],
        stress_pa=np.stack(stress_pa),
        rows=tuple(rows),
        origin=origin,
    )


def stress_mpa(prism: Prism, layer: str, row: int, moved_mm: FloatArray) -> FloatArray:
    """Stress ``(3, 6, N', C, K - 1)`` in the middle of a row of elements of one layer."""
    (above,) = np.flatnonzero(prism.node_rows == row)
    corner = moved_mm[:, :, :, above : above + 2]  # (force, N', 3, 2 rows, C + 1, K)
    # In the order of a quad: below left, below right, above right, above left.
    quad = np.stack(
        [
            corner[:, :, :, 1, :-1],
            corner[:, :, :, 1, 1:],
            corner[:, :, :, 0, 1:],
            corner[:, :, :, 0, :-1],
        ],
        axis=3,
    )
    point_mm = prism.point_mm[:, : prism.watched_columns + 1]
    quad_mm = np.stack(
        [point_mm[row + 1, :-1], point_mm[row + 1, 1:], point_mm[row, 1:], point_mm[row, :-1]], 1
    )
    shape = 0.25 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])  # derivatives in the middle
    jacobian = np.einsum("ka,ckb->cab", shape, quad_mm)
    slope = np.einsum("cba,ka->ckb", np.linalg.inv(jacobian), shape)
    middle = 0.5 * (quad[..., 1:] + quad[..., :-1])
    # gradient (direction, force, N', component, C, K - 1)
    across = np.einsum("fniqck,cqb->bfnick", middle, slope)
    mean = quad.mean(axis=3)
    along = (mean[..., 1:] - mean[..., :-1]) / np.diff(prism.z_mm)
    gradient = np.concatenate([across, along[None]])
    strain = 0.5 * (gradient + np.moveaxis(gradient, (0, 3), (3, 0)))
    material = prism.finger.materials[layer]
    shear = material.shear_mpa
    lame = material.bulk_mpa - 2 / 3 * shear
    volume = strain[0, :, :, 0] + strain[1, :, :, 1] + strain[2, :, :, 2]
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))  # as pad.COMPONENTS
    parts = [2 * shear * strain[i, :, :, j] + (lame * volume if i == j else 0) for i, j in pairs]
    return np.stack(parts, axis=1)


def stress_row(prism: Prism, layer: str, row: int) -> StressRow:
    """Where the middles of a row's elements are, by the nearest point of the smooth skin."""
    point_mm = prism.point_mm[:, : prism.watched_columns + 1]
    corners = (point_mm[row, :-1], point_mm[row, 1:], point_mm[row + 1, :-1], point_mm[row + 1, 1:])
    middle_mm = np.mean(corners, axis=0)
    section = section_of(prism.finger)
    surface_mm = section.point_mm[::8]
    away_mm = np.linalg.norm(middle_mm[:, None] - surface_mm, axis=2)
    nearest = away_mm.argmin(axis=1)
    return StressRow(layer, section.arc_mm[::8][nearest], away_mm[np.arange(len(nearest)), nearest])
