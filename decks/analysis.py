"""What is computed, in no solver's words: the one value that every deck writer takes.

`Analysis` is made of a mesh, a probe, a motion, and rows of nodes (from 0). What it says
to a deck are numbers, from 1, made with it: the finger's nodes come first, then the
probe's; elements likewise.

Where finger, probe and motion are mirror images about ``x = 0``, so is what happens, and
the half with ``x >= 0`` shows all of it: on the axis nothing moves aside, and there is no
shear. That is half of the unknowns. Whether it is so is checked node by node and element
by element. A half keeps the numbers of the whole; those of what is left out do not occur.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from decks.finger import LAYERS, NOT_NEGATIVE, POSITIVE, Finger, Material, Ranged
from decks.mesh import Mesh
from decks.motion import Motion, motion_of
from decks.probe import Probe, ProbeMesh, mesh_probe
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
        "formulation": FORMULATIONS,
        "stiffness_mpa_per_mm": POSITIVE,
        "stick_share": POSITIVE,
        "friction": NOT_NEGATIVE,
    }
    ERROR: ClassVar = DeckError

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

    `afferent` gives the node of each afferent; `apex` is the skin's node that the probe
    touches first, which shows that it pushed. `fixed_row` ``(C,)`` are nodes that do not
    move. `contact_edge` ``(K, 2)`` are (element row, face from 0) of the skin that the probe
    can reach. `watched_row` ``(W,)`` are further nodes whose results are written.

    `law` is that of skin and tissue, bone and nail stay linear: ``linear`` takes the
    second Piola–Kirchhoff stress to be linear in Green's strain, which gives way
    under strong compression; ``neo-hookean`` has the same moduli at rest and does
    not. With `inertia` the skin's mass counts while the probe follows its waveform.
    `support` is how a solver that is the faster for it moves the probe: each of its nodes is
    ``prescribed``, or all hang on a stiff ``spring`` that is; `section` what such a solver
    computes, ``whole`` or the right ``half`` where that shows all.
    """

    title: str
    finger: Finger
    mesh: Mesh
    probe_mesh: ProbeMesh
    motion: Motion
    contact: Contact
    element: str
    afferent: Mapping[str, int]
    apex: int
    fixed_row: IntArray
    contact_edge: IntArray
    large_strain: bool = True
    notes: tuple[str, ...] = ()
    law: str = "linear"
    watched_row: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    inertia: bool = False
    support: str = "prescribed"
    section: str = "whole"

    why_whole: str | None = field(init=False)
    """Why all of the section is computed; None of the half with ``x >= 0``."""
    is_half: bool = field(init=False)
    thickness_mm: float = field(init=False)
    """Of the section: a half stands for both, so that forces are the whole's."""

    node_mm: FloatArray = field(init=False)
    """Nodes ``(N, 2)`` of the finger, mid-sides last; node ``n`` is row ``n - 1``."""
    layers: tuple[ElementSet, ...] = field(init=False)
    """Elements of each layer of the finger, none empty."""
    node: IntArray = field(init=False)
    """Numbers of the finger's nodes that elements use: of a half fewer than rows."""
    axis: IntArray = field(init=False)
    """The finger's nodes at x = 0 of a half; none of a whole."""
    first_probe_node: int = field(init=False)
    """Number of the probe's first node, row 0 of `probe_mesh`."""
    probe: ElementSet = field(init=False)
    """Elements of the probe."""
    fixed: IntArray = field(init=False)
    """Nodes that do not move; a mid-side node where both its ends do not."""
    contact_face: IntArray = field(init=False)
    """Faces ``(K, 2)`` of the skin that the probe can reach: element, face from 1."""
    contact_node: IntArray = field(init=False)
    """Nodes of the skin that the probe can reach."""

    watched: IntArray = field(init=False)
    """Nodes whose results are wanted: afferents, apex and others, no node twice."""
    watched_on_axis: tuple[int, ...] = field(init=False)
    """Those of `watched` on the axis of a half; none of a whole.

    A solver writes the mean of the stress of the elements there. Those of the left half
    are missing, which matters to shear alone: its sign is the other one there.
    """
    branches: Mapping[int, int] = field(init=False)
    """How many terms, the lasting one too, stress has at watched nodes in relaxing skin."""
    sites: Mapping[str, str] = field(init=False)
    """Where each afferent sits, in words."""

    def __post_init__(self) -> None:
        mesh, probe = self.mesh, self.probe_mesh
        quadratic = self.element in QUADRATIC
        node_mm, element = mesh.with_midsides() if quadratic else (mesh.node_mm, mesh.quad)
        first_probe_node = len(node_mm) + 1
        wanted = (*self.afferent.values(), self.apex, *(self.watched_row + 1).tolist())
        watched = np.array(list(dict.fromkeys(wanted)), dtype=np.int64)
        why_whole = _why_whole(self, watched)
        is_half = why_whole is None
        there = np.ones(len(mesh.quad), dtype=bool)
        quads = np.arange(len(probe.quad))
        if is_half:
            there = _on_the_right(mesh.node_mm, mesh.quad)
            quads = quads[_on_the_right(probe.node_mm, probe.quad)]
        layers = []
        for index, layer in enumerate(LAYERS):
            mine = np.flatnonzero((mesh.layer == index) & there)
            if mine.size:
                law = self.law if layer in _SOFT else "linear"
                material = self.finger.materials[layer]
                layers.append(ElementSet(layer, mine + 1, element[mine] + 1, material, law))
        node = np.unique(np.concatenate([np.unique(layer.node) for layer in layers]))
        axis = node[is_half & (np.abs(node_mm[node - 1, 0]) <= SAME_MM)]
        fixed = np.isin(element, self.fixed_row)
        owner, face = self.contact_edge.T
        touching = [element[owner, face], element[owner, (face + 1) % 4]]
        if quadratic:
            fixed[:, 4:] = fixed[:, :4] & np.roll(fixed[:, :4], -1, axis=1)
            _, outer, side = mesh.outline()
            alone = np.zeros(mesh.quad.shape, dtype=bool)
            alone[outer, side] = True
            fixed[:, 4:] &= alone | mesh.in_layer("bone")[:, None]
            touching.append(element[owner, face + 4])
        terms = dict.fromkeys(watched.tolist(), 1)
        for one in layers:
            for number in np.intersect1d(watched, one.node).tolist():
                terms[number] = max(terms[number], 1 + len(one.material.prony))
        sites = {}
        for name, number in self.afferent.items():
            (x, y), layer = mesh.node_mm[number - 1], self.finger.afferents[name].layer
            sites[name] = f"{layer}, x = {x:.4f} mm, depth = {-y:.4f} mm"
        made = {
            "why_whole": why_whole,
            "is_half": is_half,
            "thickness_mm": 2.0 if is_half else 1.0,
            "node_mm": node_mm,
            "layers": tuple(layers),
            "node": node,
            "axis": axis,
            "first_probe_node": first_probe_node,
            "probe": ElementSet(
                "probe_body",
                len(mesh.quad) + 1 + quads,
                probe.quad[quads] + first_probe_node,
                _PROBE_MATERIAL,
                "linear",
            ),
            "fixed": np.intersect1d(element[fixed] + 1, node),
            "contact_face": self.contact_edge[there[owner]] + 1,
            "contact_node": np.intersect1d(np.concatenate(touching) + 1, node),
            "watched": watched,
            "watched_on_axis": tuple(watched[np.isin(watched, axis)].tolist()),
            "branches": {number: count for number, count in terms.items() if count > 1},
            "sites": sites,
        }
        for name, value in made.items():
            object.__setattr__(self, name, value)

    def whole(self) -> "Analysis":
        """The analysis of both halves of the section."""
        return replace(self, section="whole") if self.is_half else self


def _why_whole(model: Analysis, watched: IntArray) -> str | None:
    """Why half of the section will not do for results at nodes; None where it will."""
    mesh, probe = model.mesh, model.probe_mesh
    for so, words in (
        (model.section == "whole", "the whole section was asked for"),
        # the reference: nothing in its decks is left out
        (model.support == "prescribed", "each of the probe's nodes is prescribed"),
        (model.inertia, "inertia counts"),
        (model.contact.formulation != "node-to-surface", "contact is surface to surface"),
        (model.motion.aside_mm is not None, "the probe slides"),
    ):
        if so:
            return words
    for number in watched[mesh.node_mm[watched - 1, 0] < -SAME_MM].tolist():
        names = {model.apex: "the skin under the probe"}
        names |= {other: f"afferent {name}" for name, other in model.afferent.items()}
        x_mm = mesh.node_mm[number - 1, 0]
        return f"{names.get(number, f'watched node {number}')} is at x = {x_mm:g} mm"
    if not _is_mirrored(probe.node_mm, probe.quad, np.zeros_like(probe.quad[:, 0])):
        return "the probe is no mirror image of itself"
    if not _is_mirrored(mesh.node_mm, mesh.quad, mesh.layer):
        return "the mesh is no mirror image of itself"
    return None


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """What stays the same from stimulus to stimulus: finger, mesh, probe, contact.

    With `inertia` the skin's mass counts. `support` is how CalculiX moves the probe: see
    ``calculix.inp.j2`` for what a spring does. Of a section that is
    a mirror image of itself half is enough for a probe on a spring; `section` "whole"
    asks for all of it. `law`, one of `LAWS`, is that of skin and tissue.
    """

    finger: Finger
    mesh: Mesh
    probe: Probe = field(default_factory=Probe)
    contact: Contact = field(default_factory=Contact)
    element: str = "CPE4"
    inertia: bool = False
    support: str = "spring"
    section: str = "half"
    law: str = "linear"

    def at_once(self) -> "Model":
        """The model whose stress does not depend on time, for its contact."""
        return replace(self, finger=self.finger.at_once(), inertia=False)

    def analysis(self, stimulus: Stimulus, *, watched: IntArray | None = None) -> Analysis:
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
        probe_mesh, apex_row = mesh_probe(probe, mesh, way_mm)
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
            afferent={name: mesh.node_at(site) + 1 for name, site in self.finger.afferents.items()},
            apex=apex_row + 1,
            fixed_row=np.union1d(bone, np.intersect1d(nail, edge)),
            contact_edge=np.stack([owner[reached], face[reached]], -1),
            notes=(
                f"finger {self.finger.name}: {len(mesh.quad)} elements, "
                f"{len(mesh.node_mm)} corner nodes",
                f"probe: {probe.shape}, {probe.diameter_mm:g} mm",
            ),
            law=self.law,
            watched_row=np.array([] if watched is None else watched, dtype=np.int64),
            inertia=self.inertia,
            support="prescribed" if self.inertia else self.support,
            section=self.section,
        )


# ---- Mirror images


def _on_the_right(node_mm: FloatArray, quad: IntArray) -> BoolArray:
    right: BoolArray = (node_mm[quad, 0] >= -SAME_MM).all(axis=1)
    return right


def _is_mirrored(node_mm: FloatArray, quad: IntArray, layer: IntArray) -> bool:
    """Whether each node and each quad, of the same layer, has its image; no quad is its own."""
    image_mm = node_mm * _MIRROR
    rows, image_rows = (np.lexsort(np.round(at, _DIGITS).T) for at in (node_mm, image_mm))
    if not np.abs(node_mm[rows] - image_mm[image_rows]).max() <= SAME_MM:
        return False
    image = np.empty_like(rows)
    image[image_rows] = rows
    right, left = (_on_the_right(at, quad) for at in (node_mm, image_mm))
    halves = []
    for nodes, layers in ((quad[right], layer[right]), (image[quad[left]], layer[left])):
        sides = np.column_stack([np.sort(nodes, axis=1), layers])
        halves.append(sides[np.lexsort(sides.T)])  # in an order that is no one's own
    return not (right == left).any() and np.array_equal(halves[0], halves[1])
