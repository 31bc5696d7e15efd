"""A pad whose unit forces Abaqus or Marc solves: decks for the user's solver, then their results.

    pad/pad.toml        the request, and which force is in which deck
    pad/base.inp        the model, without parts and with the files that it includes (of Marc .dat)
    pad/forces_01.inp   a deck of forces; its results are forces_01.dat (of Marc forces_01.t16)

A force acts on each node that may be touched, along each axis in which the node is free; from
their responses follow those along the inward normal and the tangents. Stress is sampled in the
middle of elements, as the mean of the integration points, and fitted as in a pad of CalculiX
(`mesh_places`).

What was brought is checked by what any linear solid obeys: a force here moves there what a force
there moves here. A file of another deck, or of other forces, does not.
"""

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from decks.assembly import FlatDeck, flat_deck, has_parts
from decks.inp import block_text, folder_resolver, normalized_name, read_inp
from decks.marc.contents import read_marc_deck
from decks.marc.solid_model import held_freedoms, marc_solid_model
from decks.own_model.marc_forces import (
    MarcState,
    linear_checks,
    marc_force_deck,
    marc_state,
    pulse_times_s,
)
from decks.perturbation import (
    LAYER_SET,
    SKIN_SET,
    STATE_SET,
    LinearState,
    abaqus_force_deck,
    linear_state,
)
from decks.solid_model import Skin, SolidModel, read_solid_model
from fembridge.errors import DeckError, ResponseError, ResultError, UsageError, warn
from fembridge.host.store import (
    MAX_DECK_BYTES,
    filling,
    read_bytes,
    read_toml,
    structure,
    write_toml,
)
from fembridge.results.abaqus_dat import printed_tables
from fembridge.results.byte_file import ByteFile
from fembridge.results.extrapolation import ELEMENT_TYPES
from fembridge.results.marc import STRESS_CODES, element_quantities
from fembridge.results.marc_post import PostFile
from fembridge.touching.mesh_pad import MeshPad, tangents
from fembridge.touching.mesh_places import PadSkin, pad_of_responses, pad_skin, stress_points
from fembridge.touching.pad_request import SkinMap, site_requests
from fembridge.typing import BoolArray, FloatArray, IntArray, SingleArray

_LOGGER = logging.getLogger(__name__)

PAD_FILE = "pad.toml"
_BASE, _FORCES = "base", "forces"
_SUFFIXES = {"abaqus": ".inp", "marc": ".dat"}
_RESULTS = {"abaqus": ".dat", "marc": ".t16"}
COMMANDS = {"abaqus": "abaqus job={}", "marc": "run_marc -jid {}"}
"""How a deck is run, by solver."""
_AXES = 3
# Elements around a point whose stress is asked for; the fit takes the nearest 32 of them.
_SAMPLED_AROUND = 48
# Results of a deck are at most so large, else there are several decks.
_LARGEST_RESULTS_BYTES = 1e9
# Characters of a printed row of displacement and of stress; of the lines around a load case.
_NODE_ROW_BYTES, _STRESS_ROW_BYTES, _CASE_BYTES = 54, 96, 1500
# Bytes of a post file: of a number, of the marks of a record, and of the rest of an increment.
_REAL_BYTES, _MARK_BYTES, _INCREMENT_BYTES = 4, 8, 2500
# Integration points by element, of Abaqus; others have one.
_POINTS = {"tet10": 4, "wedge6": 2, "wedge15": 9, "hex8": 8, "hex20": 27}
_REDUCED_POINTS = {"hex8": 1, "hex20": 8}
# Forces that come again with the other sign in each deck of Marc.
_CHECKED_FORCES = 3
_DEFAULT_FORCE_N = 1e-4
# Displacements that are not linear in the force, and that change after all forces, as a share of
# the largest; above it there is a warning.
_MOST_NONLINEAR = 0.01
# Difference of reciprocal displacements as a share of all, root of the mean square.
_MOST_NOT_RECIPROCAL = 0.05
_TIME_SHARE = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceRequest:
    """What a pad of forces is made of, as ``pad.toml`` has it.

    `afferents` are texts by class, `skin` a surface or node set; directions are those of `SkinMap`.
    """

    solver: str
    deck: str
    deck_sha256: str
    skin: str
    afferents: dict[str, str] | None = None
    after_step: int = 0
    apex: int | None = None
    outward: tuple[float, float, float] | None = None
    along: tuple[float, float, float] | None = None
    reach_mm: float | None = None
    force_n: float = _DEFAULT_FORCE_N
    forces_per_deck: int | None = None
    step_per_force: bool = False
    length_unit: str | None = None

    @property
    def skin_map(self) -> SkinMap:
        """How the map lies on the skin."""
        return SkinMap(self.apex, self.outward, self.along, self.reach_mm)


@dataclass(frozen=True, slots=True, eq=False)
class PadForces:
    """Forces on the nodes of the skin, for Abaqus or Marc; `pad_decks` writes their decks.

    Parameters
    ----------
    request
        The request.
    base
        The deck without parts, with the files that it includes.
    model
        Its solid model.
    state
        The state about which it is linearised.
    skin
        The surface.
    nodes
        Numbers of the nodes that may be touched, ``(n,)``.
    elements
        Numbers of the elements whose stress is needed.
    decks
        Node, axis (1 to 3) and sign of the forces of each deck, ``(K, 3)``.
    folder
        Where decks are or results are expected. Default: None, not written.
    """

    request: ForceRequest
    base: bytes
    model: SolidModel
    state: LinearState | MarcState
    skin: Skin
    nodes: IntArray
    elements: IntArray
    decks: tuple[IntArray, ...]
    folder: Path | None = None

    @property
    def solver(self) -> str:
        """``"abaqus"`` or ``"marc"``."""
        return self.request.solver

    @property
    def suffix(self) -> str:
        """Suffix of the decks."""
        return _SUFFIXES[self.solver]

    @property
    def count(self) -> int:
        """Number of unit forces."""
        return sum(int((deck[:, 2] > 0).sum()) for deck in self.decks)

    @property
    def names(self) -> list[str]:
        """Names of the decks without suffix."""
        return [f"{_FORCES}_{number:02d}" for number in range(1, len(self.decks) + 1)]

    @property
    def expected_bytes(self) -> list[int]:
        """Size of the results of each deck, within about a tenth."""
        return [round(len(deck) * _bytes_per_force(self)) for deck in self.decks]

    @property
    def force(self) -> float:
        """Size of a force in the deck's unit; 1 of Abaqus, whose steps are linear."""
        if self.solver == "abaqus":
            return 1.0
        return self.request.force_n / self.model.units.force_n

    def text(self, forces: IntArray) -> bytes:
        """The deck of some forces."""
        if isinstance(self.state, MarcState):
            return marc_force_deck(
                self.base, self.state, forces[:, :2], self.force * forces[:, 2].astype(np.float64)
            )
        return abaqus_force_deck(
            self.state,
            forces[:, :2],
            self.nodes,
            self.elements,
            self._nodes_of_state(),
            step_per_force=self.request.step_per_force,
        )

    def _nodes_of_state(self) -> IntArray:
        """Nodes of the skin and of the elements with stress."""
        rows = [self.skin.rows]
        for block in self.model.elements:
            rows.append(np.unique(block.rows[np.isin(block.number, self.elements)]))
        nodes: IntArray = self.model.node[np.unique(np.concatenate(rows))]
        return nodes

    def write(self, folder: Path) -> "PadForces":
        """Write the decks and ``pad.toml``; the same forces, with their folder."""
        suffix = _SUFFIXES[self.solver]
        with filling(folder, last=PAD_FILE) as draft:
            (draft / f"{_BASE}{suffix}").write_bytes(self.base)
            for name, forces in zip(self.names, self.decks, strict=True):
                (draft / f"{name}{suffix}").write_bytes(self.text(forces))
            table = {key: value for key, value in asdict(self.request).items() if value is not None}
            write_toml(draft / PAD_FILE, table)
        return replace(self, folder=folder)

    def pad(self, results: Sequence[Path] | None = None) -> MeshPad:
        """The pad from results of the decks, in their order; default: those in the folder."""
        if results is None:
            if self.folder is None:
                raise UsageError("is missing: a file for each deck", argument="results")
            results = [self.folder / f"{name}{_RESULTS[self.solver]}" for name in self.names]
        if len(results) != len(self.decks):
            expected = f"{len(self.decks)}, one for each of {', '.join(self.names)}"
            raise UsageError(argument="results", found=len(results), expected=expected)
        for path in results:
            if not path.is_file():
                raise ResultError("no such file", path)
        reader = _MarcResults(self) if self.solver == "marc" else _AbaqusResults(self)
        for forces, path in zip(self.decks, results, strict=True):
            _LOGGER.info(f"{path.name}: {len(forces)} forces")
            reader.read(path, forces)
        reader.warn()
        return _pad(self, reader)


# ---- The forces


def plan_forces(
    data: bytes, request: ForceRequest, base_deck: Path | None = None, folder: Path | None = None
) -> PadForces:
    """Forces, nodes and elements of a request.

    Parameters
    ----------
    data
        The user's deck, or ``base.inp`` of a folder.
    request
        The request.
    base_deck
        Path of the deck, beside which are the files that it includes. Default: None, no files.
    folder
        Folder of the decks. Default: None, not written.

    Raises
    ------
    DeckError, UsageError
        A deck without this skin or layer, or that cannot be linearised.
    """
    state: LinearState | MarcState
    if request.solver == "marc":
        deck = read_marc_deck(data)
        state = marc_state(deck, request.after_step)
        model = marc_solid_model(deck, request.length_unit)
        held = held_freedoms(deck, model, state.active)
    else:
        resolver = None if base_deck is None else folder_resolver(base_deck)
        flat, data = _flat_text(data, resolver)
        for remark in flat.remarks:
            _LOGGER.info(remark)
        request = _with_flat_names(request, flat)
        inp = read_inp(data, abaqus=True)
        model = read_solid_model(inp, request.length_unit)
        state = linear_state(inp, request.after_step)
        for remark in state.remarks:
            _LOGGER.info(remark)
        held = model.prescribed(state.boundaries)
    skin = model.skin(request.skin)
    free_axes: BoolArray = ~held[skin.rows]
    position_mm = model.position * model.units.length_mm
    free: BoolArray = np.asarray(free_axes.any(axis=1))
    touched = pad_skin(model, position_mm, free, skin, request.skin_map)
    _refuse_local_axes(state, model, touched.row)
    points = stress_points(
        model,
        position_mm,
        touched,
        site_requests(request.afferents),
        lambda elements: model.middles(position_mm, elements)[::-1],
    )
    elements = [
        numbers[cKDTree(model.middles(position_mm, numbers)[1]).query(
            points.position_mm, k=min(_SAMPLED_AROUND, numbers.size)
        )[1]].ravel()
        for _, numbers in points.samples
    ]  # fmt: skip
    _refuse_orientations(model, np.unique(np.concatenate(elements)))
    of_skin = np.isin(skin.rows, touched.row)
    node, axis = np.nonzero(free_axes[of_skin])
    forces = np.stack([model.node[skin.rows[of_skin]][node], axis + 1, np.ones_like(node)], axis=1)
    plan = PadForces(
        request, data, model, state, skin, model.node[touched.row],
        np.unique(np.concatenate(elements)), (forces,), folder,
    )  # fmt: skip
    return replace(plan, decks=tuple(_split(plan, forces)))


def _flat_text(data: bytes, resolver: Any) -> tuple[FlatDeck, bytes]:  # noqa: ANN401 - a Resolver
    """A deck without parts, and its text with the files that it includes."""
    deck = read_inp(data, abaqus=True, resolver=resolver)
    if has_parts(deck):
        flat = flat_deck(deck)
        return flat, flat.data
    if deck.unread:
        raise DeckError(f"the deck includes files{deck.unread}")
    return FlatDeck(b"", {}, ()), b"".join(map(block_text, deck.blocks))


def _with_flat_names(request: ForceRequest, flat: FlatDeck) -> ForceRequest:
    """The request with the names of sets in the flat deck."""
    afferents = request.afferents
    if afferents is not None:
        parts = {name: text.rpartition(":") for name, text in afferents.items()}
        afferents = {
            name: f"{flat.name(first)}{colon}{last}" if colon else flat.name(last)
            for name, (first, colon, last) in parts.items()
        }
    return replace(request, skin=flat.name(request.skin), afferents=afferents)


def _refuse_local_axes(state: LinearState | MarcState, model: SolidModel, rows: IntArray) -> None:
    """Refuse nodes of the skin whose forces would act along axes of their own."""
    if isinstance(state, MarcState):
        for option in state.deck.find("transformation"):
            raise option.head.error("`transformation`: nodes with axes of their own are not read")
        return
    for block in state.model:
        if block.keyword == "TRANSFORM":
            nodes = model.node_sets.get(block.value_of("NSET"), np.empty(0, dtype=np.int64))
            if np.isin(model.rows_of(nodes), rows).any():
                raise block.error("*TRANSFORM of nodes of the skin: expected global axes")


def _refuse_orientations(model: SolidModel, elements: IntArray) -> None:
    for section in model.sections:
        if section.oriented and np.isin(elements, section.elements).any():
            raise DeckError(f"section {section.set_name} has an orientation: expected none")


def _split(plan: PadForces, forces: IntArray) -> Iterator[IntArray]:
    """Forces of each deck; those of a node are in one."""
    most = plan.request.forces_per_deck
    if most is None:
        most = max(_AXES, int(_LARGEST_RESULTS_BYTES / _bytes_per_force(plan)))
    starts = np.flatnonzero(np.diff(forces[:, 0], prepend=-1))
    begin, last = 0, 0
    for start in [*starts[1:].tolist(), len(forces)]:
        if start - begin > most and last > begin:
            yield _with_checks(plan, forces[begin:last])
            begin = last
        last = start
    yield _with_checks(plan, forces[begin:])


def _with_checks(plan: PadForces, forces: IntArray) -> IntArray:
    """Forces of a deck; of Marc some of them again with the other sign."""
    if plan.solver != "marc":
        return forces
    again = forces[linear_checks(len(forces), _CHECKED_FORCES)] * [1, 1, -1]
    return np.concatenate([forces, again])


def _bytes_per_force(plan: PadForces) -> float:
    if plan.solver == "marc":
        elements = np.concatenate(
            [[int(block.name)] * len(block.number) for block in plan.model.elements]
        )
        points = max(ELEMENT_TYPES[kind].points if kind in ELEMENT_TYPES else 1
                     for kind in np.unique(elements).tolist())  # fmt: skip
        deck = plan.state.deck if isinstance(plan.state, MarcState) else None
        if deck is not None and not any(option.keyword == "all points" for option in deck.options):
            points = 1
        record = 6 * _REAL_BYTES + _MARK_BYTES
        nodes = plan.model.node.size * _AXES * _REAL_BYTES
        return float(elements.size * points * record + nodes + _INCREMENT_BYTES)
    rows = 0
    for block in plan.model.elements:
        reduced = "R" in block.name.removeprefix("C3D")
        points = (_REDUCED_POINTS if reduced else _POINTS).get(block.kind, 1)
        rows += points * int(np.isin(block.number, plan.elements).sum())
    return float(plan.nodes.size * _NODE_ROW_BYTES + rows * _STRESS_ROW_BYTES + _CASE_BYTES)


def read_forces(folder: Path) -> PadForces:
    """The forces whose decks are in a folder.

    Raises
    ------
    DeckError
        No such folder, or a ``pad.toml`` that was altered.
    """
    path = folder / PAD_FILE
    error = DeckError.at(path)
    request = structure(read_toml(path, error), ForceRequest, error)
    if request.solver not in _SUFFIXES:
        raise error(f"solver {request.solver!r}, expected {' or '.join(_SUFFIXES)}")
    data = read_bytes(folder / f"{_BASE}{_SUFFIXES[request.solver]}", MAX_DECK_BYTES, DeckError)
    return plan_forces(data, request, folder=folder)


# ---- Results


class _Results:
    """Responses to 1 N: `moved` of the skin ``(n, 3, n, 3)`` in mm, by node, axis, node and axis.

    `stress` ``(n, 3, E, 6)`` in Pa at the middles of the elements; `state` ``(N, 3)`` are the
    displacements of all nodes in mm before the forces.
    """

    def __init__(self, plan: PadForces) -> None:
        self.plan, units = plan, plan.model.units
        count = plan.nodes.size
        self.moved = np.zeros((count, _AXES, count, _AXES), dtype=np.float32)
        self.stress = np.zeros((count, _AXES, plan.elements.size, 6), dtype=np.float32)
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
        plan, rows = self.plan, self.rows_of(forces)
        count: dict[str, int] = {}
        # Integration points of each element: the largest number that is printed for its type.
        points: dict[str, int] = {}
        printed: dict[str, BoolArray] = {}
        for table in printed_tables(path):
            if table.set_name == STATE_SET:
                at = self._rows(table.labels[:, 0], plan.model.node, path, table.line)
                self.state[at] = table.values[:, :_AXES] * plan.model.units.length_mm
            if table.set_name not in (SKIN_SET, LAYER_SET):
                continue
            number = count[table.kind] = count.get(table.kind, 0) + 1
            if number > len(forces):
                continue
            row, axis = rows[number - 1], forces[number - 1, 1] - 1
            if table.set_name == SKIN_SET:
                at = self._rows(table.labels[:, 0], plan.nodes, path, table.line)
                self.moved[row, axis, at] = table.values[:, :_AXES] * self.mm_per_n
            elif len(table.labels):
                at = self._rows(table.labels[:, 0], plan.elements, path, table.line)
                # xx, yy, zz, xy, xz, yz are printed.
                np.add.at(self.stress[row, axis], at, table.values[:, [0, 1, 2, 3, 5, 4]])
                largest = int(table.labels[:, 1].max())
                points[table.kind] = max(points.get(table.kind, 1), largest)
                printed.setdefault(table.kind, np.zeros(plan.elements.size, dtype=bool))[at] = True
        self._check_counts(count, len(forces), path)
        factor = np.full(plan.elements.size, self.pa_per_n)
        for kind, is_printed in printed.items():
            factor[is_printed] /= points[kind]
        self.stress[rows, forces[:, 1] - 1] *= factor[:, None]

    def _rows(self, labels: IntArray, known: IntArray, path: Path, line: int) -> IntArray:
        at = np.minimum(np.searchsorted(known, labels), known.size - 1)
        if (known[at] != labels).any():
            label = labels[known[at] != labels][0]
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
            used = self._used_points(post, mesh.element_types[element_rows])
            skin = np.searchsorted(plan.model.node, plan.nodes)

            def values(number: int) -> tuple[FloatArray, FloatArray]:
                moved = post.nodal_values(number, "Displacement")[node_rows][:, :_AXES]
                stress = post.element_values(number, element_rows)[..., columns]
                return moved, np.einsum("kpc,kp->kc", stress, used)

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
                    own = self.moved[row, axis]
                    share = np.abs(own + change).max() / max(2 * np.abs(own).max(), 1e-300)
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
        if (away_s > _TIME_SHARE).any():
            missing_s = times_s[away_s > _TIME_SHARE][0]
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

    def _used_points(self, post: PostFile, types: IntArray) -> FloatArray:
        """Weights of the stored points of each element, for their mean."""
        used = np.zeros((types.size, post.points))
        for row, kind in enumerate(types.tolist()):
            points = ELEMENT_TYPES[kind].points if kind in ELEMENT_TYPES else post.points
            count = min(points, post.points)
            used[row, :count] = 1.0 / count
        return used


def _rows_in(available: IntArray, numbers: IntArray, what: str, path: Path) -> IntArray:
    """Rows of `numbers` in a file."""
    order = np.argsort(available)
    at = np.minimum(np.searchsorted(available, numbers, sorter=order), available.size - 1)
    rows: IntArray = order[at]
    absent = available[rows] != numbers
    if absent.any():
        raise ResultError(f"no {what} {numbers[absent][0]}: the file of another deck", path)
    return rows


# ---- The pad


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
    points = stress_points(
        model, position_mm, skin, site_requests(request.afferents),
        lambda elements: model.middles(position_mm, np.intersect1d(elements, plan.elements))[::-1],
    )  # fmt: skip
    directions = _directions(skin)
    inward = -skin.normal @ skin.axes
    down_mm = np.einsum("jda,jaib,ib->jdi", directions, moved, inward, optimize=True)
    stress_pa = np.empty((plan.nodes.size, _AXES, len(points.depth_mm), 6), dtype=np.float32)
    at = 0
    turn = _turn_of_six(skin.axes)
    for weights, numbers in points.samples:
        columns = np.searchsorted(plan.elements, numbers)
        stop = at + weights.shape[0]
        for node in range(plan.nodes.size):
            samples = results.stress[node][:, columns] @ turn.T  # (axis, M, 6)
            own = np.einsum("da,amc->dmc", directions[node], samples)
            stress_pa[node, :, at:stop] = [weights @ table for table in own]
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
