"""What is computed, in no solver's words: a deck writer puts it into its own.

Mesh and materials come from the finger, then the probe's mesh, who is held, how
they touch, how the probe moves, and where stress is wanted.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from decks.checks import not_negative, positive
from decks.finger import Finger
from decks.meshing.mesh import Mesh
from decks.motion import Motion, motion_of
from decks.probe import Probe, ProbeMesh, check_on_pad, mesh_probe, touched_node
from fembridge.errors import DeckError
from fembridge.stimulus import Stimulus
from fembridge.typing import IntArray

# Names are those of Abaqus, which CalculiX shares; `decks.marc` has Marc's numbers.
ELEMENTS = ("CPE4", "CPE4R", "CPE4H", "CPE4RH", "CPE8", "CPE8R")
FORMULATIONS = ("node-to-surface", "surface-to-surface")
# How stress follows from large strain; for small ones both are Hooke's law.
LAWS = ("linear", "neo-hookean")
# Each of the probe's nodes is prescribed, or all hang on a stiff spring that is.
DRIVES = ("prescribed", "spring")
# All of the section is computed, or the right half of it where that tells all.
SECTIONS = ("whole", "half")

# Skin beyond this is never reached by the probe; the search for contact is
# limited to what is within it, beyond the probe's own half width.
_CONTACT_MARGIN_MM = 1.5
# Stiffness of sticking springs, as a share of the normal ones.
STICK_SHARE = 0.1


@dataclass(frozen=True, slots=True)
class Contact:
    """How probe and skin touch: penalty springs and Coulomb friction.

    `friction` 0.4 is that of skin on metal (Ishizuka et al., 3.1). The springs'
    stiffness is a pressure per depth of overlap; sticking springs are softer by
    `stick_share`. The slave side is the skin, whose elements are finer.
    """

    formulation: str = "node-to-surface"
    stiffness_mpa_per_mm: float = 200.0
    friction: float = 0.4
    stick_share: float = STICK_SHARE

    def __post_init__(self) -> None:
        if self.formulation not in FORMULATIONS:
            raise DeckError(
                f"contact formulation {self.formulation!r}, expected one of "
                f"{', '.join(FORMULATIONS)}"
            )
        positive(self, "stiffness_mpa_per_mm", "stick_share", error=DeckError)
        not_negative(self, "friction", error=DeckError)

    def __str__(self) -> str:
        rub = f"friction {self.friction:g}" if self.friction else "no friction"
        if self.friction and self.stick_share != STICK_SHARE:
            rub += f", stick springs {self.stick_share:g}"
        return f"{self.formulation}, {self.stiffness_mpa_per_mm:g} MPa/mm, {rub}"


@dataclass(frozen=True, slots=True, eq=False)
class Analysis:
    """One run: a finger, a probe, a motion, and the nodes to be watched.

    `afferent` gives the row of each afferent's node in `mesh`; `apex` the row of
    the skin's node that the probe touches first, which shows that it pushed.
    `held` ``(C,)`` are nodes that do not move. `contact_edge` ``(K, 2)`` are
    (element row, face from 0) of the skin that the probe can reach.

    `law` is that of skin and tissue, bone and nail stay linear: ``linear`` takes the
    second Piola–Kirchhoff stress to be linear in Green's strain, which gives way
    under strong compression; ``neo-hookean`` has the same moduli at rest and does
    not. `watched` ``(W,)`` are rows of further nodes whose results are written.
    With `inertia` the skin's mass counts while the probe follows its waveform. `drive`
    is how a solver that is the faster for it moves the probe: one of `DRIVES`.
    `section`, one of `SECTIONS`, is what such a solver computes; see
    `decks.half_section` for where half of it will do.
    """

    title: str
    finger: Finger
    mesh: Mesh
    probe: ProbeMesh
    motion: Motion
    contact: Contact
    element: str
    afferent: Mapping[str, int]
    apex: int
    held: IntArray
    contact_edge: IntArray
    large_strain: bool = True
    notes: tuple[str, ...] = field(default_factory=tuple)
    law: str = "linear"
    watched: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    inertia: bool = False
    drive: str = DRIVES[0]
    section: str = SECTIONS[0]


def analyse(
    finger: Finger,
    mesh: Mesh,
    stimulus: Stimulus,
    *,
    probe: Probe | None = None,
    contact: Contact | None = None,
    element: str = "CPE4",
    law: str = "linear",
    watched: IntArray | None = None,
    inertia: bool = False,
    drive: str = DRIVES[0],
    section: str = SECTIONS[0],
) -> Analysis:
    """Put a finger, its mesh and a stimulus together.

    Raises
    ------
    DeckError, FingerError
        An unknown element, law, drive or section, a node to be watched that the mesh
        has not, an afferent without a node, a probe that is or comes beside the pad.
    """
    for name, word, known in (
        ("element", element, ELEMENTS),
        ("law", law, LAWS),
        ("drive", drive, DRIVES),
        ("section", section, SECTIONS),
    ):
        if word not in known:
            raise DeckError(f"{name} {word!r}, expected one of {', '.join(known)}")
    rows = np.array([] if watched is None else watched, dtype=np.int64)
    if rows.size and not 0 <= rows.min() <= rows.max() < len(mesh.node_mm):
        raise DeckError(
            f"nodes to be watched from row {rows.min()} to {rows.max()}, expected "
            f"within 0 to {len(mesh.node_mm) - 1}"
        )
    probe = probe or Probe()
    probe_mesh = mesh_probe(probe, mesh)
    edge, owner, face = mesh.outline()
    middle = mesh.node_mm[edge].mean(axis=1)
    motion = motion_of(stimulus, _procedure(finger, inertia), finger.relaxing_s)
    reach_mm = 0.5 * probe.diameter_mm + _CONTACT_MARGIN_MM
    left_mm, right_mm = _span_mm(probe, motion)
    check_on_pad(mesh, left_mm, right_mm, 0.5 * probe.diameter_mm)
    reached = (
        (middle[:, 0] >= left_mm - reach_mm)
        & (middle[:, 0] <= right_mm + reach_mm)
        & (middle[:, 1] > 0.5 * mesh.node_mm[:, 1].min())
    )
    surface = np.unique(edge)
    nail = np.unique(mesh.quad[mesh.in_layer("nail")])
    bone = np.unique(mesh.quad[mesh.in_layer("bone")])
    return Analysis(
        title=f"{stimulus.id} on finger {finger.name}",
        finger=finger,
        mesh=mesh,
        probe=probe_mesh,
        motion=motion,
        contact=contact or Contact(),
        element=element,
        afferent={name: mesh.node_at(site) for name, site in finger.afferents.items()},
        apex=touched_node(probe_mesh, mesh),
        held=np.union1d(bone, np.intersect1d(nail, surface)),
        contact_edge=np.stack([owner[reached], face[reached]], -1),
        notes=(
            f"finger {finger.name}: {len(mesh.quad)} elements, {len(mesh.node_mm)} corner nodes",
            f"probe: {probe.shape}, {probe.diameter_mm:g} mm",
        ),
        law=law,
        watched=rows,
        inertia=inertia,
        drive=drive,
        section=section,
    )


def _procedure(finger: Finger, inertia: bool) -> str:
    if inertia:
        return "dynamic"
    return "viscous" if finger.relaxing_s else "static"


def _span_mm(probe: Probe, motion: Motion) -> tuple[float, float]:
    """Leftmost and rightmost place of the probe's middle."""
    if motion.aside_mm is None:
        return probe.x_mm, probe.x_mm
    return (probe.x_mm + float(motion.aside_mm.min()), probe.x_mm + float(motion.aside_mm.max()))
