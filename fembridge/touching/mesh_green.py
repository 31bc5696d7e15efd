"""The pad of any mesh: stiffness by CalculiX, unit forces on the skin, stress of each element.

CalculiX writes the stiffness matrix of the user's model, undeformed or about the state after some
of its steps, and solves three unit forces itself. The matrix is factorised once
(`fembridge.solver.factorisation`); displacements under those three forces must agree with
CalculiX', and then all forces are solved, some at a time. What was solved is kept in the folder of
the run, so that an interrupted pad goes on there.

Stress is that at the points of elements where it is most accurate, by the law of their material
about the state (`decks.material_law`), and between them a fit (`mesh_places`).
"""

import hashlib
import logging
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from decks.assembly import flat_deck, has_parts
from decks.dialects import JOB
from decks.inp import folder_resolver, normalized_name, read_inp
from decks.material_law import STRESS_PAIRS, Law, read_law, stress_change
from decks.perturbation import LinearState, linear_state, stiffness_deck, unit_force_deck
from decks.shape_functions import BEST_POINTS, shape_functions
from decks.solid_model import SolidModel, read_solid_model
from fembridge.errors import DeckError, ResponseError, ResultError
from fembridge.host.process import signals_as_exits
from fembridge.host.progress import advance
from fembridge.host.store import MAX_DECK_BYTES, make_folder, read_bytes, replacing
from fembridge.io.run_folder import SOLVER_FILE, RunFolder
from fembridge.results import read_fields
from fembridge.results.fields import rows_of
from fembridge.solver.ccx import solve_once
from fembridge.solver.factorisation import Factors
from fembridge.solver.settings import Solver
from fembridge.solver.verdict import MATRIX_SUFFIX
from fembridge.touching.mesh_pad import MeshPad, tangents
from fembridge.touching.mesh_places import PadSkin, pad_of_responses, pad_skin, stress_points
from fembridge.touching.pad_request import SiteRequest, SkinMap
from fembridge.typing import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_LOGGER = logging.getLogger(__name__)

# Displacements under unit forces agree with CalculiX' to this share of the largest.
AGREEMENT = 1e-6
# Unit forces that are solved at once.
_FORCES_AT_ONCE = 96
_PROGRESS_S = 10.0
# With less of a task done the rest is not estimated.
_LEAST_SHARE = 0.02
_AXES = 3
# Cards of a material, after which another part of the deck begins.
_OF_A_MATERIAL = (
    "CONDUCTIVITY", "CREEP", "DAMPING", "DENSITY", "DEPVAR", "ELASTIC", "EXPANSION",
    "HYPERELASTIC", "HYPERFOAM", "PLASTIC", "SPECIFICHEAT", "USERMATERIAL", "VISCOELASTIC",
)  # fmt: skip


class _LinearModel:
    """A model about a state: its stiffness, its nodes as they are there, and its sections.

    `position_mm` ``(N, 3)`` in the model's axes; `unknown` ``(N, 3)`` numbers the displacements
    that are free, -1 for others.
    """

    def __init__(self, model: SolidModel, state: LinearState, run: RunFolder) -> None:
        from scipy.sparse import coo_array

        self.model, self.units, self._blocks = model, model.units, state.model
        self.moved = np.zeros_like(model.position)
        if state.steps:
            *_, last = read_fields(run.results, "DISP")
            at = rows_of(model.node, last.nodes)
            self.moved[at >= 0] = last.values[at[at >= 0], :_AXES]
        self.position_mm = (model.position + self.moved) * self.units.length_mm
        freedoms = (run.folder / f"{JOB}.dof").read_text(encoding="ascii").split()
        node, axis = np.array([text.split(".") for text in freedoms], dtype=np.int64).T
        entries = np.fromfile(run.folder / f"{JOB}{MATRIX_SUFFIX}", sep=" ").reshape(-1, 3)
        order = np.argsort(node, kind="stable")  # unknowns of a node in a row
        rank = np.argsort(order)
        row, column = rank[entries[:, :2].astype(np.int64) - 1].T
        upper = coo_array((entries[:, 2], (row, column)), shape=(node.size, node.size)).tocsr()
        diagonal = row == column
        lower = coo_array(
            (entries[~diagonal, 2], (column[~diagonal], row[~diagonal])), shape=upper.shape
        ).tocsr()
        self.matrix: csr_array = upper + lower
        self.node_row = np.searchsorted(model.node, node[order])
        is_of_model = model.node[np.minimum(self.node_row, model.node.size - 1)] == node[order]
        self.unknown = np.full(model.position.shape, -1)
        self.unknown[self.node_row[is_of_model], axis[order][is_of_model] - 1] = np.flatnonzero(
            is_of_model
        )
        # Displacements that are neither free nor held follow those of other nodes.
        dependent = (self.unknown < 0) & ~model.prescribed(state.boundaries)
        self.follows: BoolArray = np.asarray(dependent.any(axis=1))

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.matrix.shape[0])

    def factorise(self) -> Factors:
        """Factors of the stiffness, with a line of progress every ten seconds."""
        own_rows, first = np.unique(self.node_row, return_inverse=True)
        position = self.model.position[np.minimum(own_rows, self.model.node.size - 1)]
        progress = _Progress("factors of the stiffness")
        try:
            return Factors(self.matrix, first, position, progress)
        except np.linalg.LinAlgError as error:
            raise ResponseError(
                "the stiffness is not positive definite: a part of the model is not held, or the "
                "state is not stable"
            ) from error

    def compare(self, factors: Factors, check: RunFolder, node: int) -> float:
        """Largest difference from CalculiX' displacement under unit forces, as a share.

        Raises
        ------
        ResponseError
            It is larger than `AGREEMENT`.
        """
        row = int(np.searchsorted(self.model.node, node))
        free = self.unknown[row] >= 0
        loads = np.zeros((self.size, _AXES))
        loads[self.unknown[row][free], np.flatnonzero(free)] = 1.0
        moved = factors.solve(loads, np.ones(self.size, dtype=bool))
        largest = 0.0
        fields = list(read_fields(check.results, "DISP"))
        for axis, field in enumerate(fields[-_AXES:]):
            at = rows_of(self.model.node, field.nodes)
            available = (at[:, None] >= 0) & (self.unknown >= 0)
            expected_mm = field.values[at, :_AXES][available]
            computed_mm = moved[self.unknown[available], axis]
            scale = max(float(np.abs(expected_mm).max(initial=0.0)), 1e-300)
            largest = max(
                largest, float(np.abs(computed_mm - expected_mm).max(initial=0.0)) / scale
            )
        if not largest <= AGREEMENT:
            raise ResponseError(
                f"displacements under a unit force differ from CalculiX' by {largest:.2g} of the "
                f"largest, expected {AGREEMENT:g}"
            )
        return largest

    def stress_rows(self, elements: IntArray, axes: FloatArray) -> "tuple[FloatArray, csr_array]":
        """The best points of `elements` in mm, ``(P, 3)``, and stress there by displacement.

        The second is ``(6 P, n)`` in the deck's unit of stress by that of length, in the directions
        `axes`.
        """
        from scipy.sparse import coo_array, csr_array, vstack

        parts: list[csr_array] = []
        middles = []
        for block in self.model.elements:
            selected = np.isin(block.number, elements)
            if not selected.any():
                continue
            rows = block.rows[selected]
            start = self.model.position[rows]
            for point in BEST_POINTS[block.kind]:
                share, slope = shape_functions(block.kind, point)
                by_start = np.einsum("ka,eab->ekb", slope, np.linalg.inv(_jacobian(start, slope)))
                gradient = np.eye(3) + np.einsum("eki,ekj->eij", self.moved[rows], by_start)
                by_now = np.einsum("ekb,ebc->ekc", by_start, np.linalg.inv(gradient))
                change = np.empty((len(rows), 6, 3, 3))
                for section, law in self._laws(block.number[selected]):
                    change[section] = stress_change(law, gradient[section])
                tensor = _full(change)  # (E, 3, 3, 3, 3)
                turned = np.einsum("ai,bj,eijkl->eabkl", axes, axes, tensor)
                six = np.stack([turned[:, a, b] for a, b in STRESS_PAIRS], axis=1)
                values = np.einsum("ecij,ekj->ecki", six, by_now)
                unknown = np.broadcast_to(self.unknown[rows][:, None], values.shape)
                line = np.arange(6 * len(rows)).reshape(-1, 6, 1, 1)
                free = unknown >= 0
                entries = values[free], (np.broadcast_to(line, values.shape)[free], unknown[free])
                shape = 6 * len(rows), self.size
                parts.append(coo_array(entries, shape=shape).tocsr())
                middles.append(np.einsum("k,eki->ei", share, self.position_mm[rows]))
            if self.follows[rows].any():
                node = self.model.node[rows[self.follows[rows]]][0]
                raise DeckError(
                    f"node {node} of an element with stress follows other nodes (*TIE, *EQUATION, "
                    "*MPC or a coupling), which is not computed"
                )
        if not parts:
            raise DeckError("no solid element in a layer of the afferents")
        return np.concatenate(middles), csr_array(vstack(parts))

    def _laws(self, numbers: IntArray) -> "Iterator[tuple[BoolArray, Law]]":
        """Elements of each section, ``(E,)``, and their law."""
        blocks = self._blocks
        materials = {
            block.value_of("NAME"): n
            for n, block in enumerate(blocks)
            if block.keyword == "MATERIAL"
        }
        for section in self.model.sections:
            selected = np.isin(numbers, section.elements)
            if not selected.any():
                continue
            if section.oriented:
                raise DeckError(f"section {section.set_name} has an orientation: expected none")
            first = materials.get(section.material)
            if first is None:
                raise DeckError(f"material {section.material} is nowhere in the deck")
            following = []
            for block in blocks[first + 1 :]:
                if block.keyword not in _OF_A_MATERIAL:
                    break
                following.append(block)
            yield selected, read_law(blocks[first], following)


def _jacobian(position: FloatArray, slope: FloatArray) -> FloatArray:
    """Derivatives of position by natural coordinates, ``(E, 3, natural)``."""
    jacobian: FloatArray = np.einsum("eki,ka->eia", position, slope)
    return jacobian


def _full(six: FloatArray) -> FloatArray:
    """Tensors ``(E, 3, 3, ...)`` of their six components ``(E, 6, ...)``."""
    full = np.empty((len(six), 3, 3, *six.shape[2:]))
    for row, (a, b) in enumerate(STRESS_PAIRS):
        full[:, a, b] = full[:, b, a] = six[:, row]
    return full


class _Progress:
    """Reports the share of a task that is done, and logs it every ten seconds with the rest."""

    def __init__(self, task: str) -> None:
        self._task, self._begin_s = task, time.monotonic()
        self._last_s = self._begin_s

    def __call__(self, share: float) -> None:
        """Report `share`, and log it if it is time."""
        advance(self._task, share)
        now_s = time.monotonic()
        if now_s - self._last_s > _PROGRESS_S and share > _LEAST_SHARE:
            left_s = (now_s - self._begin_s) * (1 - share) / share
            _LOGGER.info(f"{self._task}: {share:.0%}, about {left_s:.0f} s left")
            self._last_s = now_s


# ---- Unit forces


def _solve_forces(
    linear: _LinearModel, skin: PadSkin, stress: "csr_array", factors: Factors, folder: Path
) -> tuple[FloatArray, FloatArray]:
    """Displacement into the skin ``(F, n)`` and stress ``(F, 6 P)`` under all unit forces.

    Forces are ordered by node, then along the tangent across, into the skin, along. What was solved
    before in a part of `folder` is not solved again.
    """
    from scipy.sparse import coo_array, csr_array, vstack

    across, along = tangents(skin.normal)
    directions = np.stack([across, -skin.normal, along], axis=1) @ skin.axes
    unknown = linear.unknown[skin.row]
    count = skin.row.size
    node, axis = np.nonzero(unknown >= 0)
    inward = coo_array(
        (directions[node, 1, axis], (node, unknown[node, axis])), shape=(count, linear.size)
    ).tocsr()
    output = csr_array(vstack([inward, stress]))
    required = np.zeros(linear.size, dtype=bool)
    required[np.unique(output.indices)] = True
    responses = np.empty((3 * count, output.shape[0]), dtype=np.float32)
    progress, reported = _Progress("unit forces"), False
    advance("unit forces", 0.0)
    digest = hashlib.sha256(np.ascontiguousarray(linear.matrix.data).data)
    for array in (output.indices, output.data, directions, unknown):
        digest.update(np.ascontiguousarray(array).data)
    parts = folder / f"forces_{digest.hexdigest()[:16]}"
    make_folder(parts)
    solved_before = 0
    # Nodes that are near each other load the same fronts.
    order = np.argsort(unknown.max(axis=1), kind="stable")
    nodes_at_once = _FORCES_AT_ONCE // 3
    for number, first in enumerate(range(0, count, nodes_at_once)):
        nodes = order[first : first + nodes_at_once]
        rows = (3 * nodes[:, None] + np.arange(3)).ravel()
        path = parts / f"part_{number:04d}.npy"
        if path.is_file():
            responses[rows] = np.load(path)
            solved_before += 1
            progress((first + nodes.size) / count)
            continue
        begin_s = time.monotonic()
        loads = np.zeros((linear.size, rows.size))
        for place, index in enumerate(nodes.tolist()):
            free = unknown[index] >= 0
            loads[unknown[index][free], 3 * place : 3 * place + 3] = directions[index][:, free].T
        responses[rows] = (output @ factors.solve(loads, required)).T
        with replacing(path) as draft, draft.open("wb") as file:
            np.save(file, responses[rows])
        if not reported:
            each_s = time.monotonic() - begin_s
            left_s = each_s * (count - first) / nodes_at_once
            _LOGGER.info(
                f"{3 * count} unit forces, {3 * solved_before * nodes_at_once} of them solved "
                f"before: about {left_s:.0f} s"
            )
            reported = True
        progress((first + nodes.size) / count)
    responses[:, :count] *= linear.units.length_mm / linear.units.force_n
    responses[:, count:] *= linear.units.stress_pa / linear.units.force_n
    return responses[:, :count], responses[:, count:]


def solve_mesh_pad(
    folder: Path,
    base_deck: Path,
    skin_name: str,
    afferents: Mapping[str, SiteRequest],
    skin_map: SkinMap,
    settings: Solver,
    *,
    after_step: int = 0,
    length_unit: str | None = None,
) -> MeshPad:
    """The pad of the model of `base_deck`, see `fembridge.touching.make_pad`.

    Raises
    ------
    DeckError
        A deck that is not read, without the skin or a set, or that cannot be linearised.
    SolverError, MissingError
        CalculiX failed, or is not installed.
    ResponseError
        The factors disagree with CalculiX.
    """
    from scipy.sparse import csr_array, kron, vstack
    from threadpoolctl import threadpool_limits

    deck_bytes = read_bytes(base_deck, MAX_DECK_BYTES, DeckError)
    resolver = folder_resolver(base_deck)
    deck = read_inp(deck_bytes, resolver=resolver)
    if has_parts(deck):
        flat = flat_deck(read_inp(deck_bytes, abaqus=True, resolver=resolver))
        for remark in flat.remarks:
            _LOGGER.info(remark)
        deck, skin_name = flat.read(), flat.name(skin_name)
        afferents = {
            name: replace(request, set_name=flat.name(request.set_name))
            for name, request in afferents.items()
        }
    model = read_solid_model(deck, length_unit)
    state = linear_state(deck, after_step)
    for remark in state.remarks:
        _LOGGER.info(remark)
    model_skin = model.skin(skin_name)
    prescribed = model.prescribed(state.boundaries)[model_skin.rows].any(axis=1)
    inner = np.flatnonzero(~(prescribed | model_skin.border))
    row = model_skin.rows[inner[inner.size // 2] if inner.size else 0]
    check_node = int(model.node[row])
    run, version = _run(folder / "stiffness", stiffness_deck(state), settings)
    matrix = run.folder / f"{JOB}{MATRIX_SUFFIX}"
    if not matrix.is_file():
        raise ResultError("CalculiX wrote no stiffness matrix", matrix)
    check, _ = _run(folder / "unit_force", unit_force_deck(state, check_node), settings)
    linear = _LinearModel(model, state, run)
    free: BoolArray = np.asarray((linear.unknown[model_skin.rows] >= 0).any(axis=1))
    follows = linear.follows[model_skin.rows]
    if follows.any():
        _LOGGER.info(
            f"{follows.sum()} nodes of the skin follow others (*TIE, *EQUATION): not touched"
        )
    skin = pad_skin(model, linear.position_mm, free & ~follows, model_skin, skin_map)
    points = stress_points(
        model,
        linear.position_mm,
        skin,
        afferents,
        lambda elements: linear.stress_rows(elements, skin.axes),
    )
    stress = csr_array(
        vstack([csr_array(kron(weights, np.eye(6))) @ rows for weights, rows in points.samples])
    )
    _LOGGER.info(
        f"{skin.row.size} nodes of skin, {len(points.depth_mm)} points with stress, "
        f"{linear.size} unknowns"
    )
    with threadpool_limits(settings.threads or 1, user_api="blas"):
        factors = linear.factorise()
        difference = linear.compare(factors, check, check_node)
        down_mm, stress_pa = _solve_forces(linear, skin, stress, factors, folder)
    del factors
    origin = {
        "solver": f"CalculiX {version}".strip(),
        "deck": base_deck.name,
        "deck_sha256": hashlib.sha256(deck_bytes).hexdigest(),
        "skin": normalized_name(skin_name),
        "after_step": after_step,
        "elements": model.element_count,
        "unknowns": linear.size,
        "difference": difference,
    }
    return pad_of_responses(base_deck.stem, model, skin, points, down_mm, stress_pa, origin)


def _run(folder: Path, text: bytes, settings: Solver) -> tuple[RunFolder, str]:
    """The run of a deck in `folder`, solved unless its results are there, and CalculiX' version."""
    run = RunFolder(
        folder=folder,
        solver="calculix",
        increments=0,
        dt_ms=1.0,
        start_ms=0.0,
        afferents=(),
        deck_sha256=hashlib.sha256(text).hexdigest(),
        inputs={"base_deck": ""},
    )
    make_folder(run.folder)
    if not (run.deck.is_file() and run.deck.read_bytes() == text):
        with replacing(run.deck) as draft:
            draft.write_bytes(text)
        (run.folder / SOLVER_FILE).unlink(missing_ok=True)
    halt = threading.Event()
    advance(f"{folder.name} by CalculiX", 0.0)
    with signals_as_exits():
        try:
            outcome = solve_once(run, replace(settings, cache=False), halt)
        finally:
            halt.set()
            advance(f"{folder.name} by CalculiX", 1.0)
    if not outcome.accepted:
        raise outcome.to_error()
    _LOGGER.info(f"{folder.name} by CalculiX in {outcome.wall_s:.0f} s")
    return run, outcome.version or ""
