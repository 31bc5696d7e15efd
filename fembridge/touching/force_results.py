"""The pad from results of unit forces that Abaqus or Marc solved (`force_runs`).

Abaqus prints a table of displacements and one of stress for each force, in their order; Marc
writes an increment for each, which its time shows. Stress of an element is the mean of its
integration points, and of the pad a fit to the middles of elements.

What was brought is checked by what any linear solid obeys: a force here moves there what a force
there moves here. Results of another deck, or of other forces, do not.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from decks.inp import normalized_name
from decks.own_model.marc_forces import MarcState, pulse_times_s
from decks.perturbation import LAYER_SET, SKIN_SET, STATE_SET
from fembridge.errors import ResponseError, ResultError, UsageError, warn
from fembridge.results.abaqus_dat import printed_tables
from fembridge.results.byte_file import ByteFile
from fembridge.results.extrapolation import ELEMENT_TYPES, point_positions
from fembridge.results.marc import STRESS_CODES, element_quantities
from fembridge.results.marc_post import PostFile
from fembridge.touching.force_runs import PadForces
from fembridge.touching.mesh_pad import MeshPad, tangents
from fembridge.touching.mesh_places import PadSkin, pad_of_responses, pad_skin, stress_points
from fembridge.touching.pad_request import site_requests
from fembridge.typing import BoolArray, FloatArray, IntArray, SingleArray

_LOGGER = logging.getLogger(__name__)

_AXES = 3
# Displacements that are not linear in the force, and that change after all forces, as a share of
# the largest; above it there is a warning.
_MOST_NONLINEAR = 0.01
# Difference of reciprocal displacements as a share of all, root of the mean square.
_MOST_NOT_RECIPROCAL = 0.05
# An increment is found within this time.
_NEAR_S = 0.2


def read_pad(forces: PadForces, results: Sequence[Path] | None = None) -> MeshPad:
    """The pad of forces from the results of their decks.

    Parameters
    ----------
    forces
        The forces.
    results
        Result file of each deck, in their order. Default: None, those in the folder.

    Raises
    ------
    UsageError
        Another number of files than decks.
    ResultError
        A file that is missing, cut, or of another deck.
    ResponseError
        Displacements that are not reciprocal.
    """
    results = forces.results if results is None else results
    if len(results) != len(forces.decks):
        expected = f"{len(forces.decks)}, one for each of {', '.join(forces.names)}"
        raise UsageError(argument="results", found=len(results), expected=expected)
    for path in results:
        if not path.is_file():
            raise ResultError("no such file", path)
    reader = _MarcResults(forces) if forces.solver == "marc" else _AbaqusResults(forces)
    for of_deck, path in zip(forces.decks, results, strict=True):
        _LOGGER.info(f"{path.name}: {len(of_deck)} forces")
        reader.read(path, of_deck)
    reader.warn()
    return _pad(forces, reader)


class _Results:
    """Responses to 1 N: `moved` of the skin ``(n, 3, n, 3)`` in mm, by node, axis, node and axis.

    `stress` ``(n, 3, S, 6)`` in Pa at the samples; `state` ``(N, 3)`` are the
    displacements of all nodes in mm before the forces.
    """

    def __init__(self, plan: PadForces) -> None:
        self.plan, units = plan, plan.model.units
        count = plan.nodes.size
        self.moved = np.zeros((count, _AXES, count, _AXES), dtype=np.float32)
        self.stress = np.zeros((count, _AXES, plan.samples.size, 6), dtype=np.float32)
        self.state = np.zeros((plan.model.node.size, _AXES))
        per_n = 1.0 / (plan.force * units.force_n)
        self.mm_per_n, self.pa_per_n = units.length_mm * per_n, units.stress_pa * per_n

    @property
    def origin(self) -> dict[str, Any]:
        """What the results say of their quality."""
        return {}

    def read(self, path: Path, forces: IntArray) -> None:
        """Read the results of a deck."""
        raise NotImplementedError

    def warn(self) -> None:
        """Warn of doubtful results."""

    def rows_of(self, forces: IntArray) -> IntArray:
        """Rows of the loaded nodes."""
        rows: IntArray = np.searchsorted(self.plan.nodes, forces[:, 0])
        return rows


class _AbaqusResults(_Results):
    """Printed tables of load cases, or of a step each, in the order of the forces."""

    def read(self, path: Path, forces: IntArray) -> None:
        """Read a ``.dat``: the k-th table of a set is of the k-th force."""
        plan, rows, samples = self.plan, self.rows_of(forces), self.plan.samples
        count: dict[str, int] = {}
        # Integration points of each element: the largest number that is printed for its type.
        points = np.ones(samples.elements.size, dtype=np.int64)
        self._order = np.full((samples.elements.size, samples.count.max()), -1)
        for table in printed_tables(path):
            if table.set_name == STATE_SET:
                at = self._rows(table.labels[:, 0], plan.model.node, path, table.line)
                self.state[at] = table.values[:, :_AXES] * plan.model.units.length_mm
            if table.set_name not in (SKIN_SET, LAYER_SET):
                continue
            numbers = plan.nodes if table.set_name == SKIN_SET else plan.elements
            at = self._rows(table.labels[:, 0], numbers, path, table.line)
            if table.columns[0].startswith("COOR"):
                self._read_order(at, table.labels[:, 1], table.values[:, :_AXES])
                continue
            number = count[table.kind] = count.get(table.kind, 0) + 1
            if number > len(forces):
                continue
            row, axis = rows[number - 1], forces[number - 1, 1] - 1
            if table.set_name == SKIN_SET:
                self.moved[row, axis, at] = table.values[:, :_AXES] * self.mm_per_n
            elif len(table.labels):
                points[at] = np.maximum(points[at], table.labels[:, 1].max())
                # xx, yy, zz, xy, xz, yz are printed.
                values = table.values[:, [0, 1, 2, 3, 5, 4]]
                self._add_stress(self.stress[row, axis], at, table.labels[:, 1], values)
        self._check_counts(count, len(forces), path)
        # Of a sample that is no integration point all of them were added.
        added = np.where((samples.count > 1) & (self._order >= 0).any(axis=1), 1, points)
        factor = self.pa_per_n / added[samples.owner]
        self.stress[rows, forces[:, 1] - 1] *= factor[:, None].astype(np.float32)

    def _read_order(self, element: IntArray, point: IntArray, position: FloatArray) -> None:
        """Which sample each integration point is: the nearest of its element."""
        samples, units = self.plan.samples, self.plan.model.units
        state = self.plan.model.position * units.length_mm + self.state
        sample_mm = samples.positions(state)
        for row, number, at in zip(element.tolist(), point.tolist(), position, strict=True):
            if 1 < samples.count[row] >= number:
                first = samples.first[row]
                of_element_mm = sample_mm[first : first + samples.count[row]]
                away = np.linalg.norm(of_element_mm - at * units.length_mm, axis=1)
                self._order[row, number - 1] = away.argmin()

    def _add_stress(
        self, stress: SingleArray, element: IntArray, point: IntArray, values: FloatArray
    ) -> None:
        """Add stress at integration points to its sample, or to all of its element."""
        samples = self.plan.samples
        within = np.minimum(point, self._order.shape[1]) - 1
        order = self._order[element, within]
        is_sample = (samples.count[element] > 1) & (order >= 0)
        np.add.at(stress, samples.first[element[is_sample]] + order[is_sample], values[is_sample])
        others = np.flatnonzero(~is_sample)
        for number in range(samples.count[element[others]].max(initial=0)):
            has = others[samples.count[element[others]] > number]
            np.add.at(stress, samples.first[element[has]] + number, values[has])

    def _rows(self, labels: IntArray, numbers: IntArray, path: Path, line: int) -> IntArray:
        at = np.minimum(np.searchsorted(numbers, labels), numbers.size - 1)
        if (numbers[at] != labels).any():
            label = labels[numbers[at] != labels][0]
            raise ResultError(f"{label} is not in the deck of these forces", path, line)
        rows: IntArray = at
        return rows

    def _check_counts(self, count: Mapping[str, int], expected: int, path: Path) -> None:
        if not any(SKIN_SET in kind for kind in count):
            hint = (
                ""
                if self.plan.request.step_per_force
                else ("; if your Abaqus prints none for load cases, --step-per-force writes steps")
            )
            raise ResultError(f"no table of the set {SKIN_SET}{hint}", path)
        for kind, number in count.items():
            if number != expected:
                raise ResultError(
                    f"{number} tables, expected {expected}, one a force: {kind[:80]}",
                    path,
                    found=number,
                    expected=str(expected),
                )


class _MarcResults(_Results):
    """Increments of a post file, found by their times."""

    def __init__(self, plan: PadForces) -> None:
        super().__init__(plan)
        self._nonlinear = self._drift = 0.0

    def read(self, path: Path, forces: IntArray) -> None:
        """Read a ``.t16`` or ``.t19``: differences from the increment before the forces."""
        plan = self.plan
        assert isinstance(plan.state, MarcState)
        with ByteFile(path) as file:
            post = PostFile(file)
            if post.problem is not None:
                raise ResultError(post.problem, path)
            numbers = self._rows_at(post, pulse_times_s(plan.state, len(forces)), path)
            columns = self._stress_columns(post, path)
            mesh = post.mesh
            node_rows = _rows_in(mesh.node_ids, plan.model.node, "node", path)
            element_rows = _rows_in(mesh.element_ids, plan.elements, "element", path)
            used = self._weights(post, mesh.element_types[element_rows])
            skin = np.searchsorted(plan.model.node, plan.nodes)

            def values(number: int) -> tuple[FloatArray, FloatArray]:
                moved = post.nodal_values(number, "Displacement")[node_rows][:, :_AXES]
                stress = post.element_values(number, element_rows)[..., columns]
                return moved, np.einsum("spc,sp->sc", stress[plan.samples.owner], used)

            first, *of_forces, last = numbers
            start, start_stress = values(first)
            self.state = start * plan.model.units.length_mm
            rows, axes = self.rows_of(forces), forces[:, 1] - 1
            for number, row, axis, sign in zip(
                of_forces, rows.tolist(), axes.tolist(), forces[:, 2].tolist(), strict=True
            ):
                moved, stress = values(number)
                change = (moved - start)[skin] * self.mm_per_n
                if sign < 0:
                    forward = self.moved[row, axis]
                    share = np.abs(forward + change).max() / max(2 * np.abs(forward).max(), 1e-300)
                    self._nonlinear = max(self._nonlinear, float(share))
                    continue
                self.moved[row, axis] = change
                self.stress[row, axis] = (stress - start_stress) * self.pa_per_n
            left = np.abs((values(last)[0] - start)[skin]).max() * self.mm_per_n
            self._drift = max(self._drift, float(left / max(np.abs(self.moved).max(), 1e-300)))

    @property
    def origin(self) -> dict[str, Any]:
        """Shares of the displacement that are not linear, and that stay after the forces."""
        return {"nonlinear": self._nonlinear, "drift": self._drift}

    def warn(self) -> None:
        """Warn of responses that are not small or do not go back."""
        most = f"at most {_MOST_NONLINEAR:.0%}"
        if self._nonlinear > _MOST_NONLINEAR:
            warn(
                f"{self._nonlinear:.1%} of the displacement is not linear in the force, expected "
                f"{most}: a smaller --force-n (force_n)"
            )
        if self._drift > _MOST_NONLINEAR:
            warn(
                f"{self._drift:.1%} of the displacement stays after the forces, expected {most}: "
                "friction, contact, or a state that had not settled"
            )

    def _rows_at(self, post: PostFile, times_s: FloatArray, path: Path) -> list[int]:
        """Rows of the increments at times; Marc may have cut others in between."""
        found_s = np.array([increment.time_s for increment in post.increments])
        if not found_s.size:
            raise ResultError("no increments", path)
        rows = np.abs(found_s - times_s[:, None]).argmin(axis=1)
        away_s = np.abs(found_s[rows] - times_s)
        if (away_s > _NEAR_S).any():
            missing_s = times_s[away_s > _NEAR_S][0]
            raise ResultError(
                f"no increment at {missing_s:g} s, expected one a force up to {times_s[-1]:g} s",
                path,
                found=float(found_s[-1]),
                expected=f"{times_s[-1]:g} s",
            )
        numbers: list[int] = rows.tolist()
        return numbers

    def _stress_columns(self, post: PostFile, path: Path) -> list[int]:
        quantities = {q.codes[0]: q for q in element_quantities(post.codes) if len(q.columns) == 6}
        for code in STRESS_CODES:
            if code in quantities:
                return list(quantities[code].columns)
        raise ResultError("no stress tensor (post code 311 or 341)", path)

    def _weights(self, post: PostFile, types: IntArray) -> FloatArray:
        """Weights of the stored points of its element for each sample, ``(S, point)``."""
        samples = self.plan.samples
        weights = np.zeros((samples.size, post.points))
        for sample, row in enumerate(samples.owner.tolist()):
            kind = ELEMENT_TYPES.get(int(types[row]))
            count = post.points if kind is None else min(kind.points, post.points)
            if kind is None or count != samples.count[row]:
                weights[sample, :count] = 1.0 / count
                continue
            local = point_positions(kind.family, count)
            natural = local[:, 1:4] if kind.family == "tet" else local
            away = np.linalg.norm(natural - samples.natural[sample], axis=1)
            weights[sample, away.argmin()] = 1.0
        return weights


def _rows_in(available: IntArray, numbers: IntArray, item: str, path: Path) -> IntArray:
    """Rows of `numbers` in a file."""
    order = np.argsort(available)
    at = np.minimum(np.searchsorted(available, numbers, sorter=order), available.size - 1)
    rows: IntArray = order[at]
    absent = available[rows] != numbers
    if absent.any():
        raise ResultError(f"no {item} {numbers[absent][0]}: the file of another deck", path)
    return rows


def _pad(plan: PadForces, results: _Results) -> MeshPad:
    """The pad of the responses."""
    model, request = plan.model, plan.request
    difference = _reciprocal_difference(results.moved)
    if not difference <= _MOST_NOT_RECIPROCAL:
        raise ResponseError(
            f"displacements are not reciprocal by {difference:.1%}, expected at most "
            f"{_MOST_NOT_RECIPROCAL:.0%}: results of other forces, or friction",
            found=difference,
        )
    moved = results.moved
    flat = moved.reshape(3 * plan.nodes.size, -1)
    flat += flat.T.copy()
    flat *= 0.5
    position_mm = model.position * model.units.length_mm + results.state
    free: BoolArray = np.isin(model.node[plan.skin.rows], plan.nodes)
    skin_map = replace(request.skin_map, reach_mm=None)
    skin = pad_skin(model, position_mm, free, plan.skin, skin_map)
    sample_mm = plan.samples.positions(position_mm)

    def sampled(elements: IntArray) -> tuple[FloatArray, IntArray]:
        samples = plan.samples.samples_of(elements)
        return sample_mm[samples], samples

    points = stress_points(model, position_mm, skin, site_requests(request.afferents), sampled)
    directions = _directions(skin)
    inward = -skin.normal @ skin.axes
    down_mm = np.einsum("jda,jaib,ib->jdi", directions, moved, inward, optimize=True)
    stress_pa = np.empty((plan.nodes.size, _AXES, len(points.depth_mm), 6), dtype=np.float32)
    at = 0
    turn = _turn_of_six(skin.axes)
    for weights, columns in points.samples:
        stop = at + weights.shape[0]
        for node in range(plan.nodes.size):
            samples = results.stress[node][:, columns] @ turn.T  # (axis, M, 6)
            turned = np.einsum("da,amc->dmc", directions[node], samples)
            stress_pa[node, :, at:stop] = [weights @ table for table in turned]
        at = stop
    origin = {
        "solver": plan.solver.capitalize(),
        "deck": request.deck,
        "deck_sha256": request.deck_sha256,
        "skin": normalized_name(request.skin),
        "after_step": request.after_step,
        "elements": model.element_count,
        "difference": difference,
        **results.origin,
    }
    name = Path(request.deck).stem
    return pad_of_responses(
        name,
        model,
        skin,
        points,
        down_mm.reshape(-1, plan.nodes.size),
        stress_pa.reshape(3 * plan.nodes.size, -1),
        origin,
    )


def _directions(skin: PadSkin) -> FloatArray:
    """Directions across, into the skin and along, in the axes of the model, ``(n, 3, 3)``."""
    across, along = tangents(skin.normal)
    directions: FloatArray = np.stack([across, -skin.normal, along], axis=1) @ skin.axes
    return directions


def _turn_of_six(axes: FloatArray) -> FloatArray:
    """Matrix ``(6, 6)`` from xx, yy, zz, xy, yz, zx in the model to those along `axes`."""
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
    turn = np.empty((6, 6))
    for column, (k, m) in enumerate(pairs):
        unit = np.zeros((3, 3))
        unit[k, m] = unit[m, k] = 1.0
        turned = axes @ unit @ axes.T
        turn[:, column] = [turned[a, b] for a, b in pairs]
    return turn


def _reciprocal_difference(moved: SingleArray) -> float:
    """Difference between a response and its reciprocal, root of the mean square, as a share."""
    flat = moved.reshape(moved.shape[0] * _AXES, -1)
    scale = max(float(np.linalg.norm(flat)), 1e-300)
    return float(np.linalg.norm(flat - flat.T)) / scale
