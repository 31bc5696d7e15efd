"""Unit forces on the skin of a model of Abaqus or Marc: decks for the user's solver.

    pad/pad.toml        the request, and which force is in which deck
    pad/base.inp        the model, without parts and with the files that it includes (of Marc .dat)
    pad/forces_01.inp   a deck of forces; its results are forces_01.dat (of Marc forces_01.t16)

A force acts on each node that may be touched, along each axis in which the node is free. Asked for
are the displacement of these nodes and the stress of the elements around the afferents, no more.
`force_results` makes the pad.
"""

import logging
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from decks.assembly import FlatDeck, flat_deck, has_parts
from decks.inp import Resolver, block_text, folder_resolver, read_inp
from decks.marc.contents import read_marc_deck
from decks.marc.solid_model import held_freedoms, marc_solid_model
from decks.own_model.marc_forces import (
    MarcState,
    linear_checks,
    marc_force_deck,
    marc_state,
)
from decks.perturbation import (
    LinearState,
    abaqus_force_deck,
    linear_state,
)
from decks.solid_model import Skin, SolidModel, read_solid_model
from fembridge.errors import DeckError
from fembridge.host.store import (
    MAX_DECK_BYTES,
    filling,
    read_bytes,
    read_toml,
    structure,
    write_toml,
)
from fembridge.results.extrapolation import ELEMENT_TYPES
from fembridge.touching.mesh_places import fit_size, pad_skin, stress_points
from fembridge.touching.pad_request import SkinMap, site_requests
from fembridge.touching.stress_samples import StressSamples
from fembridge.typing import BoolArray, FloatArray, IntArray

_LOGGER = logging.getLogger(__name__)

PAD_FILE = "pad.toml"
_BASE, _FORCES = "base", "forces"
_SUFFIXES = {"abaqus": ".inp", "marc": ".dat"}
_RESULTS = {"abaqus": (".dat",), "marc": (".t16", ".t19")}
COMMANDS = {"abaqus": "abaqus job={}", "marc": "run_marc -jid {}"}
"""How a deck is run, by solver."""
_AXES = 3
# Samples around a point whose elements' stress is asked for, by those that a fit takes: after a
# preload others may be nearest.
_SAMPLED_AROUND = 1.5
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


@dataclass(frozen=True, eq=False)
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

    @cached_property
    def samples(self) -> StressSamples:
        """Points of the elements at which stress is taken."""
        return StressSamples(self.model, self.elements)

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
            coordinates=bool((self.samples.count > 1).any()),
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

    @property
    def results(self) -> list[Path]:
        """Where the results of the decks are expected; none of forces without a folder."""
        if self.folder is None:
            return []
        paths = []
        for name in self.names:
            expected, *others = (self.folder / f"{name}{end}" for end in _RESULTS[self.solver])
            paths.append(next((path for path in (expected, *others) if path.is_file()), expected))
        return paths


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
        is_held = held_freedoms(deck, model, state.active)
    else:
        resolver = None if base_deck is None else folder_resolver(base_deck)
        flat = _flat(data, resolver)
        for remark in flat.remarks:
            _LOGGER.info(remark)
        request, inp = _with_flat_names(request, flat), flat.read(renamed=flat.data != data)
        data = flat.data
        model = read_solid_model(inp, request.length_unit)
        state = linear_state(inp, request.after_step)
        for remark in state.remarks:
            _LOGGER.info(remark)
        is_held = model.prescribed(state.boundaries)
    skin = model.skin(request.skin)
    free_axes: BoolArray = ~is_held[skin.rows]
    position_mm = model.position * model.units.length_mm
    free: BoolArray = np.asarray(free_axes.any(axis=1))
    touched = pad_skin(model, position_mm, free, skin, request.skin_map)
    _refuse_local_axes(state, model, touched.row)
    everywhere = StressSamples(model, np.concatenate([block.number for block in model.elements]))
    sample_mm = everywhere.positions(position_mm)

    def sampled(elements: IntArray) -> tuple[FloatArray, IntArray]:
        samples = everywhere.samples_of(elements)
        return sample_mm[samples], samples

    points = stress_points(model, position_mm, touched, site_requests(request.afferents), sampled)
    around = []
    for _, samples in points.samples:
        count = round(
            _SAMPLED_AROUND * fit_size(model, everywhere.elements[everywhere.owner[samples]])
        )
        nearest = cKDTree(sample_mm[samples]).query(points.position_mm, k=min(count, samples.size))[
            1
        ]
        around.append(everywhere.elements[everywhere.owner[samples[nearest.ravel()]]])
    elements = np.unique(np.concatenate(around))
    _refuse_orientations(model, elements)
    of_skin = np.isin(skin.rows, touched.row)
    node, axis = np.nonzero(free_axes[of_skin])
    forces = np.stack([model.node[skin.rows[of_skin]][node], axis + 1, np.ones_like(node)], axis=1)
    plan = PadForces(
        request, data, model, state, skin, model.node[touched.row],
        elements, (forces,), folder,
    )  # fmt: skip
    return replace(plan, decks=tuple(_split(plan, forces)))


def _flat(data: bytes, resolver: Resolver | None) -> FlatDeck:
    """A deck without parts, with the files that it includes."""
    deck = read_inp(data, abaqus=True, resolver=resolver)
    if deck.unread:
        raise DeckError(f"files of the deck are missing{deck.unread}")
    for block in deck.blocks:
        pieces_elsewhere = any(piece.text is not block.text for piece in block.pieces)
        if block.option("INPUT") is not None and not pieces_elsewhere:
            raise block.error(f"{block.title} has its data in another file: expected them here")
    if has_parts(deck):
        return flat_deck(deck)
    text = b"".join(map(block_text, deck.blocks)) if deck.inclusions else data
    return FlatDeck(text, {}, ())


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
