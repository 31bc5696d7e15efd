"""Writing of the deck of a round fingertip: an own model for `check` and for pads of any mesh."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fembridge.errors import UsageError
from fembridge.ranges import check_range

if TYPE_CHECKING:
    from decks.fingertip import Fingertip


@dataclass(frozen=True, slots=True)
class FingertipDeck:
    """A written deck of a fingertip, and the size of its mesh.

    Parameters
    ----------
    path
        The deck.
    finger
        Name of the fingertip.
    element
        ``"C3D10"`` or ``"C3D4"``.
    nodes, elements
        Numbers of nodes and elements.
    skin_faces
        Number of faces of the surface SKIN.
    apex_node
        Number of the node at the apex of the pad.
    afferents
        Number of nodes of the set of each class, as AFFERENTS_SA.
    worst_scaled_jacobian
        Quality of the worst element by its corners: 1 if regular, 0 if flat.

    Examples
    --------
    >>> import fembridge as fb
    >>> deck = fb.write_fingertip("tip.inp")  # doctest: +SKIP
    >>> deck.afferents["SA"] > 100  # doctest: +SKIP
    True
    """

    path: Path
    finger: str
    element: str
    nodes: int
    elements: int
    skin_faces: int
    apex_node: int
    afferents: dict[str, int]
    worst_scaled_jacobian: float


def write_fingertip(
    path: str | Path, finger: str | Fingertip = "fingertip", *, plate_mm: float | None = None
) -> FingertipDeck:
    """Write the deck of a round fingertip for CalculiX or Abaqus.

    Element sets have the names of the layers, as DERMIS. Surfaces: SKIN, the outer side without
    the nail, and PAD, its part with small elements. Node sets: HELD (bone and outer side of the
    nail), END (towards the joint), APEX, and AFFERENTS_SA, AFFERENTS_RA, AFFERENTS_PC at the depth
    of each class below SKIN; PAD_AFFERENTS_SA and so on are those below PAD.

    Parameters
    ----------
    path
        The deck, a name in ``.inp``.
    finger
        ``"fingertip"``, ``"fingertip_macaque"``, the path of a TOML file with such a ``base``, or
        a `decks.fingertip.Fingertip`. Default: ``"fingertip"``.
    plate_mm
        Depth in mm to which a flat, rigid plate is pressed into the pad, above 0 to 10.
        Default: None, a deck without a step, for unit loads.

    Returns
    -------
    FingertipDeck
        Size and quality of the mesh.

    Raises
    ------
    UsageError, FingerError
        A number out of range, no such finger, or a fingertip that cannot be meshed.
    MissingError
        gmsh is not installed.

    Examples
    --------
    >>> import fembridge as fb
    >>> deck = fb.write_fingertip("tip.inp")  # doctest: +SKIP
    >>> deck.element, deck.elements  # doctest: +SKIP
    ('C3D10', 20094)
    """
    from decks.fingertip import read_fingertip
    from decks.fingertip_deck import fingertip_deck
    from decks.fingertip_mesh import mesh_fingertip
    from fembridge.host.store import check_output, write_text

    path = Path(path)
    if path.suffix != ".inp":
        raise UsageError(argument="output", found=str(path), expected="a name in .inp")
    if plate_mm is not None:
        check_range("plate_mm", plate_mm)
    check_output(path.parent, path.name)
    tip = read_fingertip(finger) if isinstance(finger, str) else finger
    mesh = mesh_fingertip(tip)
    write_text(path, fingertip_deck(tip, mesh, plate_mm))
    return FingertipDeck(
        path=path,
        finger=tip.name,
        element=f"C3D{mesh.tet.shape[1]}",
        nodes=len(mesh.node_mm),
        elements=len(mesh.tet),
        skin_faces=len(mesh.skin),
        apex_node=mesh.apex + 1,
        afferents={name: len(rows) for name, rows in mesh.afferents.items()},
        worst_scaled_jacobian=float(mesh.scaled_jacobian().min()),
    )
