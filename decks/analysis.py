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
from decks.probe import Probe, ProbeMesh, mesh_probe, touched_node
from fembridge.errors import DeckError
from fembridge.stimulus import Stimulus
from fembridge.typing import FloatArray, IntArray

# Names are those of Abaqus, which CalculiX shares; `decks.marc` has Marc's numbers.
ELEMENTS = ("CPE4", "CPE4R", "CPE4H", "CPE4RH", "CPE8", "CPE8R")
FORMULATIONS = ("node-to-surface", "surface-to-surface")
# How stress follows from large strain; for small ones both are Hooke's law.
LAWS = ("linear", "neo-hookean")

# Skin beyond this is never reached by the probe; the search for contact is
# limited to what is within it, beyond the probe's own half width.
_CONTACT_MARGIN_MM = 1.5
# A pre-indentation is reached in this many increments before the stimulus.
RAMP_INCREMENTS = 20
# Stiffness of sticking springs, as a share of the normal ones.
STICK_SHARE = 0.1
_MM_PER_UM = 1.0e-3
# Depths are written to a picometre.
_SAME_UM = 1.0e-6
_S_PER_MS = 1.0e-3


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
class Motion:
    """The probe's way into the skin: `depth_mm` ``(T,)`` at `time_s` ``(T,)``.

    The solver takes equal increments of `dt_s`, one a sample; `ramp` of them lie
    before the stimulus and lead to its pre-indentation.
    """

    time_s: FloatArray
    depth_mm: FloatArray
    dt_s: float
    ramp: int

    @property
    def increments(self) -> int:
        """Number of increments the solver takes."""
        return len(self.time_s) - 1


def motion_of(stimulus: Stimulus) -> Motion:
    """Put the ramp to the pre-indentation in front of `stimulus`.

    Raises
    ------
    DeckError
        The first sample is not the pre-indentation: the probe would jump.
    """
    start_um = float(stimulus.displacement_um[0])
    if abs(start_um - stimulus.preindent_um) > _SAME_UM:
        raise DeckError(
            f"{stimulus.id}: starts at {start_um:g} um, expected "
            f"{stimulus.preindent_um:g} um, where the probe stands before time 0"
        )
    depth_mm = stimulus.displacement_um * _MM_PER_UM
    ramp = RAMP_INCREMENTS if stimulus.preindent_um > 0 else 0
    way_mm = np.linspace(0.0, depth_mm[0], ramp + 1)[:-1]
    depth_mm = np.concatenate([way_mm, depth_mm])
    dt_s = stimulus.dt_ms * _S_PER_MS
    time_s: FloatArray = np.arange(len(depth_mm), dtype=np.float64) * dt_s
    return Motion(time_s, depth_mm, dt_s, ramp)


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
) -> Analysis:
    """Put a finger, its mesh and a stimulus together.

    Raises
    ------
    DeckError, FingerError
        An unknown element or law, a node to be watched that the mesh has not, an
        afferent without a node, a probe beside the pad.
    """
    if element not in ELEMENTS:
        raise DeckError(f"element {element!r}, expected one of {', '.join(ELEMENTS)}")
    if law not in LAWS:
        raise DeckError(f"law {law!r}, expected one of {', '.join(LAWS)}")
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
    reach_mm = 0.5 * probe.diameter_mm + _CONTACT_MARGIN_MM
    reached = (np.abs(middle[:, 0] - probe.x_mm) <= reach_mm) & (
        middle[:, 1] > 0.5 * mesh.node_mm[:, 1].min()
    )
    surface = np.unique(edge)
    nail = np.unique(mesh.quad[mesh.in_layer("nail")])
    bone = np.unique(mesh.quad[mesh.in_layer("bone")])
    return Analysis(
        title=f"{stimulus.id} on finger {finger.name}",
        finger=finger,
        mesh=mesh,
        probe=probe_mesh,
        motion=motion_of(stimulus),
        contact=contact or Contact(),
        element=element,
        afferent={name: mesh.node_at(site) for name, site in finger.afferents.items()},
        apex=touched_node(probe_mesh, mesh),
        held=np.union1d(bone, np.intersect1d(nail, surface)),
        contact_edge=np.stack([owner[reached], face[reached]], -1),
        notes=(
            f"finger {finger.name}: {len(mesh.quad)} elements, "
            f"{len(mesh.node_mm)} corner nodes",
            f"probe: {probe.shape}, {probe.diameter_mm:g} mm",
        ),
        law=law,
        watched=rows,
    )
