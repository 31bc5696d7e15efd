"""An analysis, independent of the solver: the input of every deck writer.

`ContactAnalysis` is made of a mesh, a probe, a motion, and rows of nodes (from 0). From these it
derives the numbers (from 1) that decks use: nodes of the finger first, then those of the
probe; elements in the same order.

If finger, probe and motion are symmetric about ``x = 0``, so is the solution, and the half
with ``x >= 0`` suffices: nodes on the axis do not move along x, and shear is zero there. This
halves the number of unknowns. The symmetry is checked node by node and element by element.
A half keeps the node and element numbers of the full section; numbers of the left half do
not occur.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from decks.finger import LAYERS, NOT_NEGATIVE, POSITIVE, Finger, Material, Ranged
from decks.mesh import Mesh
from decks.motion import Motion, motion_of
from decks.probe import Probe, ProbeMesh, mesh_probe
from decks.section import skin_tangent
from fembridge.errors import DeckError
from fembridge.stimulus import Stimulus
from fembridge.typing import BoolArray, FloatArray, IntArray

# Names are those of Abaqus, which CalculiX shares; `decks.marc` has Marc's numbers.
ELEMENTS = ("CPE4", "CPE4R", "CPE4H", "CPE4RH", "CPE8", "CPE8R")
# Elements of eight nodes; all others have four.
QUADRATIC = ("CPE8", "CPE8R")
FORMULATIONS = ("node-to-surface", "surface-to-surface")

# Layers under large strain, to which `ContactAnalysis.law` applies.
_SOFT = ("stratum_corneum", "epidermis", "dermis", "subcutaneous_tissue")
# A stiff placeholder: the nodes of the probe have no unknowns, but solvers require a
# material.
_PROBE_MATERIAL = Material(2.1e5, 0.3)
# The contact search covers the skin up to this distance beyond the probe's edges; the probe
# never reaches skin farther away.
_CONTACT_MARGIN_MM = 1.5
# Stiffness of stick springs as a share of the normal contact stiffness.
STICK_SHARE = 0.1
# Tolerance for a node's distance from the mirror image of another node, or from the axis.
SAME_MM = 1.0e-9
# Decimals to which coordinates are rounded to pair nodes; nodes of a mesh are farther apart.
_DIGITS = 6
_MIRROR = np.array([-1.0, 1.0])


@dataclass(frozen=True, slots=True)
class Contact(Ranged):
    """Contact of probe and skin: penalty springs and Coulomb friction.

    The skin, with the finer elements, is the slave side.

    Parameters
    ----------
    formulation
        ``"node-to-surface"`` or ``"surface-to-surface"``. Default: ``"node-to-surface"``.
    stiffness_mpa_per_mm
        Stiffness of the penalty springs in MPa/mm: pressure per depth of overlap.
        Default: 200.
    friction
        Coefficient of friction, 0 or more. Default: 0.4, skin on metal (Ishizuka et al., 3.1).
    stick_share
        Stiffness of the stick springs as a share of `stiffness_mpa_per_mm`. Default: 0.1.

    Raises
    ------
    DeckError
        An unknown formulation, or a number outside its range.

    Examples
    --------
    >>> import fembridge as fb
    >>> print(fb.Contact(friction=0.0))
    node-to-surface, 200 MPa/mm, no friction
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
    """Elements of one material: their `number` ``(E,)`` and nodes, `node` ``(E, k)``.

    Four corners counter-clockwise; with eight nodes, the mid-sides 1-2, 2-3, 3-4, 4-1
    follow. `law` is one of `decks.finger.LAWS`. `axes` ``(E, 2)`` is the direction along the
    skin at each element of an anisotropic layer, a unit vector; None for an isotropic one.
    """

    name: str
    number: IntArray
    node: IntArray
    material: Material
    law: str
    axes: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class ContactAnalysis:
    """One run: finger, probe, motion, and the nodes at which results are written.

    `afferent` maps each afferent to its node number. `apex` is the skin node that the probe
    touches first; its displacement shows that the probe pressed. `fixed_row` ``(C,)`` are
    rows of nodes that do not move. `contact_edge` ``(K, 2)`` are the pairs (element row, face
    from 0) of the skin that the probe can reach. `watched_row` ``(W,)`` are rows of further
    nodes at which results are written.

    `law` applies to skin and subcutaneous tissue; bone and nail stay linear, and a material
    with a law or an anisotropy of its own keeps it. With ``linear`` the second Piola–Kirchhoff
    stress is linear in Green's strain, which softens under strong compression;
    ``neo-hookean`` has the same moduli at rest and does not soften. With
    `inertia` the mass of the finger counts. `support` and `section` apply to solvers that
    are faster with them: as `support`, each node of the probe is ``prescribed``, or all of
    them are tied to a prescribed node by a stiff ``spring``; `section` is ``whole``, or
    ``half`` to compute the right half only, if the analysis is symmetric.
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
    """Why the full section is computed; None if only the half with ``x >= 0`` is."""
    is_half: bool = field(init=False)
    thickness_mm: float = field(init=False)
    """Thickness of the section; doubled for a half, so that forces are those of the full one."""

    node_mm: FloatArray = field(init=False)
    """Nodes ``(N, 2)`` of the finger, mid-sides last; node ``n`` is row ``n - 1``."""
    layers: tuple[ElementSet, ...] = field(init=False)
    """Elements of each layer of the finger that has elements."""
    node: IntArray = field(init=False)
    """Numbers of the finger nodes that elements use: fewer than `node_mm` has rows in a half."""
    axis: IntArray = field(init=False)
    """Finger nodes at x = 0 of a half; empty for the full section."""
    first_probe_node: int = field(init=False)
    """Number of the first probe node, row 0 of `probe_mesh`."""
    probe: ElementSet = field(init=False)
    """Elements of the probe."""
    fixed: IntArray = field(init=False)
    """Nodes that do not move; a mid-side node is fixed if both of its corners are."""
    contact_face: IntArray = field(init=False)
    """Skin faces ``(K, 2)`` that the probe can reach: element number, face from 1."""
    contact_node: IntArray = field(init=False)
    """Skin nodes that the probe can reach."""

    watched: IntArray = field(init=False)
    """Nodes at which results are written: afferents, apex and others, each once."""
    watched_on_axis: tuple[int, ...] = field(init=False)
    """Nodes of `watched` on the axis of a half; empty for the full section.

    A solver writes the mean stress of the adjacent elements. The elements of the left half
    are missing; only shear, which has the opposite sign in them, is affected.
    """
    branches: Mapping[int, int] = field(init=False)
    """Number of stress terms (the lasting one included) at watched nodes in relaxing skin."""
    sites: Mapping[str, str] = field(init=False)
    """Position of each afferent, as text for the deck."""

    def __post_init__(self) -> None:
        mesh, probe = self.mesh, self.probe_mesh
        quadratic = self.element in QUADRATIC
        node_mm, element = mesh.with_midsides() if quadratic else (mesh.node_mm, mesh.quad)
        first_probe_node = len(node_mm) + 1
        requested = (*self.afferent.values(), self.apex, *(self.watched_row + 1).tolist())
        watched = np.array(list(dict.fromkeys(requested)), dtype=np.int64)
        full_section_reason = _full_section_reason(self, watched)
        is_half = full_section_reason is None
        included = np.ones(len(mesh.quad), dtype=bool)
        quads = np.arange(len(probe.quad))
        if is_half:
            included = _in_right_half(mesh.node_mm, mesh.quad)
            quads = quads[_in_right_half(probe.node_mm, probe.quad)]
        layers = []
        for index, layer in enumerate(LAYERS):
            rows = np.flatnonzero((mesh.layer == index) & included)
            if rows.size:
                material = self.finger.materials[layer]
                law, axes = material.law or (self.law if layer in _SOFT else "linear"), None
                if material.anisotropy is not None:
                    law, center_mm = "linear", mesh.node_mm[mesh.quad[rows]].mean(axis=1)
                    axes = skin_tangent(self.finger.outline, center_mm)
                layers.append(ElementSet(layer, rows + 1, element[rows] + 1, material, law, axes))
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
        for layer_set in layers:
            for number in np.intersect1d(watched, layer_set.node).tolist():
                terms[number] = max(terms[number], 1 + len(layer_set.material.prony))
        sites = {}
        for name, number in self.afferent.items():
            (x, y), layer = mesh.node_mm[number - 1], self.finger.afferents[name].layer
            sites[name] = f"{layer}, x = {x:.4f} mm, depth = {-y:.4f} mm"
        derived = {
            "why_whole": full_section_reason,
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
            "contact_face": self.contact_edge[included[owner]] + 1,
            "contact_node": np.intersect1d(np.concatenate(touching) + 1, node),
            "watched": watched,
            "watched_on_axis": tuple(watched[np.isin(watched, axis)].tolist()),
            "branches": {number: count for number, count in terms.items() if count > 1},
            "sites": sites,
        }
        for name, value in derived.items():
            object.__setattr__(self, name, value)

    def full_section(self) -> "ContactAnalysis":
        """The analysis of the full section."""
        return replace(self, section="whole") if self.is_half else self


def _full_section_reason(model: ContactAnalysis, watched: IntArray) -> str | None:
    """Why the full section is needed for results at `watched`; None if half of it suffices."""
    mesh, probe = model.mesh, model.probe_mesh
    for applies, reason in (
        (model.section == "whole", "the full section was requested"),
        # the reference model: its decks are complete
        (model.support == "prescribed", "each of the probe's nodes is prescribed"),
        (model.inertia, "inertia counts"),
        (model.contact.formulation != "node-to-surface", "contact is surface to surface"),
        (model.motion.aside_mm is not None, "the probe slides"),
    ):
        if applies:
            return reason
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
    """The model that all stimuli share: finger, mesh, probe and contact.

    With `inertia` the mass of the finger counts. `support` is how CalculiX moves the probe;
    ``calculix.inp.j2`` explains the spring. With a probe on a spring, half of a symmetric
    section is computed; `section` "whole" requests the full section. `law`, one of
    `decks.dialects.LAWS`, applies to skin and subcutaneous tissue.
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
        """The model without relaxation and inertia: its stress depends on depth only."""
        return replace(self, finger=self.finger.at_once(), inertia=False)

    def analysis(self, stimulus: Stimulus, *, watched: IntArray | None = None) -> ContactAnalysis:
        """Apply `stimulus` to this model; results are also written at the rows `watched`.

        Raises
        ------
        DeckError, FingerError
            An afferent has no node, or the probe is or moves beyond the edge of the pad.
        """
        mesh, probe = self.mesh, self.probe
        procedure = "viscous" if self.finger.relaxing_s else "static"
        procedure = "dynamic" if self.inertia else procedure
        motion = motion_of(stimulus, procedure, self.finger.time_constants_s)
        aside_mm = motion.aside_mm
        travel_mm = (
            (0.0, 0.0) if aside_mm is None else (float(aside_mm.min()), float(aside_mm.max()))
        )
        probe_mesh, apex_row = mesh_probe(probe, mesh, travel_mm)
        edge, owner, face = mesh.outline()
        middle = mesh.node_mm[edge].mean(axis=1)
        reach_mm = 0.5 * probe.diameter_mm + _CONTACT_MARGIN_MM
        reached = (
            (middle[:, 0] >= probe.x_mm + travel_mm[0] - reach_mm)
            & (middle[:, 0] <= probe.x_mm + travel_mm[1] + reach_mm)
            & (middle[:, 1] > 0.5 * mesh.node_mm[:, 1].min())
        )
        nail = np.unique(mesh.quad[mesh.in_layer("nail")])
        bone = np.unique(mesh.quad[mesh.in_layer("bone")])
        return ContactAnalysis(
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


def _in_right_half(node_mm: FloatArray, quad: IntArray) -> BoolArray:
    right: BoolArray = (node_mm[quad, 0] >= -SAME_MM).all(axis=1)
    return right


def _is_mirrored(node_mm: FloatArray, quad: IntArray, layer: IntArray) -> bool:
    """Whether each node and quad has a mirror image in the same layer; no quad is its own."""
    image_mm = node_mm * _MIRROR
    rows, image_rows = (
        np.lexsort(np.round(points_mm, _DIGITS).T) for points_mm in (node_mm, image_mm)
    )
    if not np.abs(node_mm[rows] - image_mm[image_rows]).max() <= SAME_MM:
        return False
    image = np.empty_like(rows)
    image[image_rows] = rows
    right, left = (_in_right_half(points_mm, quad) for points_mm in (node_mm, image_mm))
    halves = []
    for nodes, layers in ((quad[right], layer[right]), (image[quad[left]], layer[left])):
        sides = np.column_stack([np.sort(nodes, axis=1), layers])
        halves.append(sides[np.lexsort(sides.T)])  # sorted, so that both halves compare
    return not (right == left).any() and np.array_equal(halves[0], halves[1])
