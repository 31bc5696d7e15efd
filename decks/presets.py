"""The reference fingers, `quick` and `paper`, and their stored meshes.

``python -m decks.presets`` meshes them again with gmsh and rewrites the stored
files; with the same gmsh the bytes do not change.
"""

from dataclasses import replace
from pathlib import Path

from decks.analysis import Model
from decks.finger import Finger, Resolution
from decks.mesh import Mesh, read_mesh

QUICK = Finger("quick")

# As fine as the mesh of the paper: 17 815 elements (section 2.1), 17 702 here.
PAPER = Finger(
    "paper",
    resolution=Resolution(
        contact_mm=1 / 36,
        contact_half_width_mm=1.0,
        ridge_mm=1 / 32,
        far_mm=0.25,
        stratum_corneum_rows=6,
        epidermis_rows=12,
        dermis_rows=22,
    ),
)

PRESETS = {finger.name: finger for finger in (QUICK, PAPER)}

_MESHES = Path(__file__).parent / "meshes"


def mesh_of(finger: Finger) -> Mesh:
    """Mesh of `finger`: the stored one where only materials differ from a preset.

    Raises
    ------
    MissingError, FingerError
        The finger needs a mesh of its own; see `decks.mesher.mesh_finger`.
    """
    for preset in PRESETS.values():
        if finger == replace(preset, name=finger.name, materials=finger.materials):
            return read_mesh(stored_mesh(preset.name))
    from decks.mesher import mesh_finger

    return mesh_finger(finger)


def model_of(finger: Finger) -> Model:
    """`finger` and its mesh under the usual probe; see `mesh_of` for errors."""
    return Model(finger, mesh_of(finger))


def stored_mesh(name: str) -> Path:
    """Path of a preset's stored mesh."""
    return _MESHES / f"{name}.npz"


def _store() -> None:
    from decks.mesh import write_mesh
    from decks.mesher import mesh_finger

    for name, finger in PRESETS.items():
        mesh = mesh_finger(finger)
        write_mesh(stored_mesh(name), mesh)
        print(f"{stored_mesh(name).name}: {len(mesh.quad)} elements")


if __name__ == "__main__":
    _store()
