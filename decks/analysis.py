"""What is computed, in no solver's words: the one value that every deck writer takes.

`Analysis` is made of a mesh, a probe, a motion, and rows of nodes (from 0); what it says
to a deck are numbers, from 1. The finger's nodes come first, then the probe's; elements
likewise.

Where finger, probe and motion are mirror images about ``x = 0``, so is what happens, and
the half with ``x >= 0`` shows all of it: on the axis nothing moves aside, and there is no
shear. That is half of the unknowns. Whether it is so is checked node by node and element
by element. A half keeps the numbers of the whole; those of what is left out do not occur.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from decks.checks import NOT_NEGATIVE, POSITIVE, Ranged
from decks.finger import LAYERS, Finger
from decks.material import Material
from decks.mesh import Mesh
from decks.motion import Motion, motion_of
from decks.probe import Probe, ProbeMesh, mesh_probe, touched_node
from fembridge.errors import DeckError
from fembridge.stimulus import Stimulus
from fembridge.typing import BoolArray, FloatArray, IntArray

# Names are those of Abaqus, which CalculiX shares; `decks.marc` has Marc's numbers.
ELEMENTS = ("CPE4", "CPE4R", "CPE4H", "CPE4RH", "CPE8", "CPE8R")
# Elements of eight nodes; all others have four.
QUADRATIC = ("CPE8", "CPE8R")
FORMULATIONS = ("node-to-surface", "surface-to-surface")
# How stress follows from large strain; for small ones both are Hooke's law.
LAWS = ("linear", "neo-hookean")
# Each of the probe's nodes is prescribed, or all hang on a stiff spring that is.
PROBE_SUPPORTS = ("prescribed", "spring")
# All of the section is computed, or the right half of it where that shows all.
SECTIONS = ("whole", "half")

# Layers that are strained strongly: what `Analysis.law` is about.
_SOFT = ("stratum_corneum", "epidermis", "dermis", "subcutaneous_tissue")
# A stiff placeholder: the probe's nodes carry no unknown of their own; a solver still
# wants a material.
_PROBE_MATERIAL = Material(2.1e5, 0.3)
# Skin beyond this is never reached by the probe; the search for contact is
# limited to what is within it, beyond the probe's own half width.
_CONTACT_MARGIN_MM = 1.5
# Stiffness of sticking springs, as a share of the normal ones.
STICK_SHARE = 0.1
# How far a node may be from the mirror image of another, or from the axis.
SAME_MM = 1.0e-9
# Nodes are paired by places rounded so; no two nodes of a mesh are as near.
_DIGITS = 6
_MIRROR = np.array([-1.0, 1.0])


@dataclass(frozen=True, slots=True)
class Contact(Ranged):
    """How probe and skin touch: penalty springs and Coulomb friction.

    `friction` 0.4 is that of skin on metal (Ishizuka et al., 3.1). The springs'
    stiffness is a pressure per depth of overlap; sticking springs are softer by
    `stick_share`. The slave side is the skin, whose elements are finer.
    """

    formulation: str = "node-to-surface"
    stiffness_mpa_per_mm: float = 200.0
    friction: float = 0.4
    stick_share: float = STICK_SHARE

    RANGES: ClassVar = {
        "stiffness_mpa_per_mm": POSITIVE,
        "stick_share": POSITIVE,
        "friction": NOT_NEGATIVE,
    }
    ERROR: ClassVar = DeckError

    def __post_init__(self) -> None:
        if self.formulation not in FORMULATIONS:
            raise DeckError(
                f"contact formulation {self.formulation!r}, expected one of "
                f"{', '.join(FORMULATIONS)}"
            )
        Ranged.__post_init__(self)

    def __str__(self) -> str:
        rub = f"friction {self.friction:g}" if self.friction else "no friction"
        if self.friction and self.stick_share != STICK_SHARE:
            rub += f", stick springs {self.stick_share:g}"
        return f"{self.formulation}, {self.stiffness_mpa_per_mm:g} MPa/mm, {rub}"


@dataclass(frozen=True, slots=True, eq=False)
class ElementSet:
    """Elements of one material: `number` ``(E,)``, and their nodes, `node` ``(E, k)``.

    Four corners counter-clockwise; of eight nodes the mid-sides 1-2, 2-3, 3-4, 4-1
    follow. `law` is one of `LAWS`.
    """

    name: str
    number: IntArray
    node: IntArray
    material: Material
    law: str


@dataclass(frozen=True, eq=False)
class Analysis:
    """One run: a finger, a probe, a motion, and the nodes whose results are wanted.

    `afferent_row` gives the row of each afferent's node in `mesh`; `apex_row` the row of
    the skin's node that the probe touches first, which shows that it pushed.
    `fixed_row` ``(C,)`` are nodes that do not move. `contact_edge` ``(K, 2)`` are
    (element row, face from 0) of the skin that the probe can reach. `watched_row`
    ``(W,)`` are further nodes whose results are written.

    `law` is that of skin and tissue, bone and nail stay linear: ``linear`` takes the
    second Piola–Kirchhoff stress to be linear in Green's strain, which gives way
    under strong compression; ``neo-hookean`` has the same moduli at rest and does
    not. With `inertia` the skin's mass counts while the probe follows its waveform.
    `support`, one of `PROBE_SUPPORTS`, is how a solver that is the faster for it moves the
    probe; `section`, one of `SECTIONS`, what such a solver computes.
    """

    title: str
    finger: Finger
    mesh: Mesh
    probe_mesh: ProbeMesh
    motion: Motion
    contact: Contact
    element: str
    afferent_row: Mapping[str, int]
    apex_row: int
    fixed_row: IntArray
    contact_edge: IntArray
    large_strain: bool = True
    notes: tuple[str, ...] = ()
    law: str = "linear"
    watched_row: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    inertia: bool = False
    support: str = "prescribed"
    section: str = "whole"

    def whole(self) -> "Analysis":
        """The analysis of both halves of the section."""
        return replace(self, section="whole")

    # ---- The half

    @cached_property
    def why_whole(self) -> str | None:
        """Why all of the section must be computed; None where half of it will do."""
        if self.section == "whole":
            return "the whole section was asked for"
        if self.support == "prescribed":  # the reference: nothing in its decks is left out
            return "each of the probe's nodes is prescribed"
        if self.inertia:
            return "inertia counts"
        if self.contact.formulation != "node-to-surface":
            return "contact is surface to surface"
        if self.motion.aside_mm is not None:
            return "the probe slides"
        mesh, probe = self.mesh, self.probe_mesh
        for row in self._result_rows:
            if mesh.node_mm[row, 0] < -SAME_MM:
                return f"{self._name_of(row)} is at x = {mesh.node_mm[row, 0]:g} mm"
        if not _is_mirrored(probe.node_mm, probe.quad, np.zeros_like(probe.quad[:, 0])):
            return "the probe is no mirror image of itself"
        if not _is_mirrored(mesh.node_mm, mesh.quad, mesh.layer):
            return "the mesh is no mirror image of itself"
        if not _are_mirrored(mesh.node_mm, self.fixed_row):
            return "the fixed nodes are no mirror image of themselves"
        element, face = self.contact_edge.T
        ends = mesh.quad[element, face], mesh.quad[element, (face + 1) % 4]
        if not _are_mirrored(mesh.node_mm, np.unique(ends)):
            return "the skin that may touch is no mirror image of itself"
        return None

    @property
    def is_half(self) -> bool:
        """Whether the left half is left out."""
        return self.why_whole is None

    @property
    def thickness_mm(self) -> float:
        """Of the section: a half stands for both, so that forces are the whole's."""
        return 2.0 if self.is_half else 1.0

    # ---- Numbers, from 1, as decks have them

    @cached_property
    def node_mm(self) -> FloatArray:
        """Nodes ``(N, 2)`` of the finger, mid-sides last; node ``n`` is row ``n - 1``."""
        return self._nodes_and_quads[0]

    @cached_property
    def node(self) -> IntArray:
        """Numbers of the finger's nodes that elements use: of a half fewer than rows."""
        return np.unique(np.concatenate([np.unique(layer.node) for layer in self.layers]))

    @cached_property
    def layers(self) -> tuple[ElementSet, ...]:
        """Elements of each layer of the finger, none empty."""
        _, quad = self._nodes_and_quads
        sets = []
        for index, layer in enumerate(LAYERS):
            rows = np.flatnonzero((self.mesh.layer == index) & self._computed)
            if rows.size:
                law = self.law if layer in _SOFT else "linear"
                material = self.finger.materials[layer]
                sets.append(ElementSet(layer, rows + 1, quad[rows] + 1, material, law))
        return tuple(sets)

    @property
    def first_probe_node(self) -> int:
        """Number of the first of `probe_node_mm`."""
        return len(self.node_mm) + 1

    @property
    def probe_node_mm(self) -> FloatArray:
        """Nodes ``(P, 2)`` of the whole probe: first its lower side, from left to right."""
        return self.probe_mesh.node_mm

    @cached_property
    def probe_node(self) -> IntArray:
        """Numbers of the probe's nodes that elements use."""
        return np.unique(self.probe.node)

    @cached_property
    def probe(self) -> ElementSet:
        """Elements of the probe."""
        mesh = self.probe_mesh
        rows = np.arange(len(mesh.quad))
        if self.is_half:
            rows = rows[_on_the_right(mesh.node_mm, mesh.quad)]
        number, node = len(self.mesh.quad) + 1 + rows, mesh.quad[rows] + self.first_probe_node
        return ElementSet("probe_body", number, node, _PROBE_MATERIAL, "linear")

    @property
    def lower_side_mm(self) -> FloatArray:
        """The probe's lower side ``(Q + 1, 2)``, from left to right."""
        side: FloatArray = self.probe_mesh.node_mm[self.probe_mesh.lower_node]
        return side

    @cached_property
    def fixed(self) -> IntArray:
        """Nodes that do not move; a mid-side node where both its ends do not."""
        _, element = self._nodes_and_quads
        fixed = np.isin(element, self.fixed_row)
        if self.element in QUADRATIC:
            fixed[:, 4:] = fixed[:, :4] & np.roll(fixed[:, :4], -1, axis=1)
            bone = self.mesh.in_layer("bone")
            fixed[~bone, 4:] &= self._faces_outside[~bone]
        return np.intersect1d(element[fixed] + 1, self.node)

    @property
    def afferent(self) -> dict[str, int]:
        """Node of each afferent."""
        return {name: row + 1 for name, row in self.afferent_row.items()}

    @property
    def apex(self) -> int:
        """Node of the skin that the probe touches first."""
        return self.apex_row + 1

    @property
    def watched(self) -> IntArray:
        """Nodes whose results are wanted: afferents, apex and others, no node twice."""
        return np.array(self._result_rows, dtype=np.int64) + 1

    @property
    def watched_on_axis(self) -> tuple[int, ...]:
        """Those of `watched` on the axis of a half; none of a whole.

        A solver writes the mean of the stress of the elements there. Those of the left
        half are missing, which matters to shear alone: its sign is the other one there.
        """
        return tuple(node for node in self.watched.tolist() if node in self.axis)

    @cached_property
    def contact_node(self) -> IntArray:
        """Nodes of the skin that the probe can reach."""
        _, element = self._nodes_and_quads
        owner, face = self.contact_edge.T
        nodes = [element[owner, face], element[owner, (face + 1) % 4]]
        if self.element in QUADRATIC:
            nodes.append(element[owner, face + 4])
        return np.intersect1d(np.concatenate(nodes) + 1, self.node)

    @property
    def contact_face(self) -> IntArray:
        """Faces ``(K, 2)`` of the skin that the probe can reach: element, face from 1."""
        return self.contact_edge[self._computed[self.contact_edge[:, 0]]] + 1

    @cached_property
    def axis(self) -> IntArray:
        """The finger's nodes at x = 0 of a half; none of a whole."""
        if not self.is_half:
            return np.zeros(0, dtype=np.int64)
        on_axis: IntArray = self.node[np.abs(self.node_mm[self.node - 1, 0]) <= SAME_MM]
        return on_axis

    @property
    def sites(self) -> dict[str, str]:
        """Where each afferent sits, in words."""
        words = {}
        for name, row in self.afferent_row.items():
            x, y = self.mesh.node_mm[row]
            layer = self.finger.afferents[name].layer
            words[name] = f"{layer}, x = {x:.4f} mm, depth = {-y:.4f} mm"
        return words

    @cached_property
    def _nodes_and_quads(self) -> tuple[FloatArray, IntArray]:
        if self.element in QUADRATIC:
            return self.mesh.with_midsides()
        return self.mesh.node_mm, self.mesh.quad

    @cached_property
    def _computed(self) -> BoolArray:
        """Which elements ``(E,)`` of the mesh are in the deck."""
        if self.is_half:
            return _on_the_right(self.mesh.node_mm, self.mesh.quad)
        return np.ones(len(self.mesh.quad), dtype=bool)

    @property
    def _result_rows(self) -> list[int]:
        rows = (*self.afferent_row.values(), self.apex_row, *self.watched_row.tolist())
        return list(dict.fromkeys(rows))

    def _name_of(self, row: int) -> str:
        for name, other in self.afferent_row.items():
            if row == other:
                return f"afferent {name}"
        return "the skin under the probe" if row == self.apex_row else f"watched node {row + 1}"

    @property
    def _faces_outside(self) -> BoolArray:
        """Which faces ``(E, 4)`` of the elements belong to one element alone."""
        _, owner, face = self.mesh.outline()
        alone = np.zeros(self.mesh.quad.shape, dtype=bool)
        alone[owner, face] = True
        return alone


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """What stays the same from stimulus to stimulus: finger, mesh, probe, contact.

    With `inertia` the skin's mass counts. `support` is how CalculiX moves the probe, one
    of `PROBE_SUPPORTS`: see `decks.calculix` for what a spring does. Of a section that is
    a mirror image of itself half is enough for a probe on a spring; `section` "whole"
    asks for all of it.
    """

    finger: Finger
    mesh: Mesh
    probe: Probe = field(default_factory=Probe)
    contact: Contact = field(default_factory=Contact)
    element: str = "CPE4"
    inertia: bool = False
    support: str = "spring"
    section: str = "half"

    @property
    def depends_on_time(self) -> bool:
        """Whether stress follows from more than the place of the probe."""
        return self.inertia or self.finger.relaxing_s > 0

    def at_once(self) -> "Model":
        """The model whose stress does not depend on time, for its contact."""
        if not self.depends_on_time:
            return self
        return replace(self, finger=self.finger.at_once(), inertia=False)

    def analysis(
        self, stimulus: Stimulus, *, law: str = "linear", watched: IntArray | None = None
    ) -> Analysis:
        """Put `stimulus` on this model; the nodes of rows `watched` are written too.

        Raises
        ------
        DeckError, FingerError
            An afferent without a node, a probe that is or comes beside the pad.
        """
        mesh, probe = self.mesh, self.probe
        still = "viscous" if self.finger.relaxing_s else "static"
        procedure = "dynamic" if self.inertia else still
        motion = motion_of(stimulus, procedure, self.finger.relaxing_s)
        way = motion.aside_mm
        way_mm = (0.0, 0.0) if way is None else (float(way.min()), float(way.max()))
        probe_mesh = mesh_probe(probe, mesh, way_mm)
        edge, owner, face = mesh.outline()
        middle = mesh.node_mm[edge].mean(axis=1)
        reach_mm = 0.5 * probe.diameter_mm + _CONTACT_MARGIN_MM
        reached = (
            (middle[:, 0] >= probe.x_mm + way_mm[0] - reach_mm)
            & (middle[:, 0] <= probe.x_mm + way_mm[1] + reach_mm)
            & (middle[:, 1] > 0.5 * mesh.node_mm[:, 1].min())
        )
        nail = np.unique(mesh.quad[mesh.in_layer("nail")])
        bone = np.unique(mesh.quad[mesh.in_layer("bone")])
        return Analysis(
            title=f"{stimulus.id} on finger {self.finger.name}",
            finger=self.finger,
            mesh=mesh,
            probe_mesh=probe_mesh,
            motion=motion,
            contact=self.contact,
            element=self.element,
            afferent_row={name: mesh.node_at(site) for name, site in self.finger.afferents.items()},
            apex_row=touched_node(probe_mesh, mesh),
            fixed_row=np.union1d(bone, np.intersect1d(nail, edge)),
            contact_edge=np.stack([owner[reached], face[reached]], -1),
            notes=(
                f"finger {self.finger.name}: {len(mesh.quad)} elements, "
                f"{len(mesh.node_mm)} corner nodes",
                f"probe: {probe.shape}, {probe.diameter_mm:g} mm",
            ),
            law=law,
            watched_row=np.array([] if watched is None else watched, dtype=np.int64),
            inertia=self.inertia,
            support="prescribed" if self.inertia else self.support,
            section=self.section,
        )


def _on_the_right(node_mm: FloatArray, quad: IntArray) -> BoolArray:
    right: BoolArray = (node_mm[quad, 0] >= -SAME_MM).all(axis=1)
    return right


def _is_mirrored(node_mm: FloatArray, quad: IntArray, layer: IntArray) -> bool:
    """Whether each quad has its image, of the same layer, and none is its own."""
    image = _images(node_mm)
    if image is None:
        return False
    right, left = (_on_the_right(at, quad) for at in (node_mm, node_mm * _MIRROR))
    return not (right == left).any() and np.array_equal(
        _sorted(quad[right], layer[right]), _sorted(image[quad[left]], layer[left])
    )


def _are_mirrored(node_mm: FloatArray, rows: IntArray) -> bool:
    """Whether the image of each of these nodes, of a mirrored mesh, is among them."""
    image = _images(node_mm)
    return image is not None and np.array_equal(np.unique(rows), np.unique(image[rows]))


def _images(node_mm: FloatArray) -> IntArray | None:
    """Row of each node's mirror image; None where one has none."""
    image_mm = node_mm * _MIRROR
    rows, image_rows = (np.lexsort(np.round(at, _DIGITS).T) for at in (node_mm, image_mm))
    if not np.abs(node_mm[rows] - image_mm[image_rows]).max() <= SAME_MM:
        return None
    image = np.empty_like(rows)
    image[image_rows] = rows
    return image


def _sorted(quad: IntArray, layer: IntArray) -> IntArray:
    """Quads ``(E, 4)`` and layers as rows that do not depend on any order."""
    rows = np.column_stack([np.sort(quad, axis=1), layer])
    ordered: IntArray = rows[np.lexsort(rows.T)]
    return ordered
