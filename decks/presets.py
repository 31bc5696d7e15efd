"""The fingers to choose from: `quick` and `paper` with their stored meshes, and files.

``python -m decks.presets`` meshes the presets again with gmsh and rewrites the stored
files; with the same gmsh the bytes do not change. A few lines of TOML define another
finger as a preset with changes::

    base = "quick"

    [skin]
    epidermis_mm = 0.5

    [materials.dermis]
    young_mpa = 0.08

    [afferents.SA]
    depth_mm = 0.70
"""

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from decks.analysis import Model
from decks.finger import LAYERS, SITES, TABLE_1, Finger, Resolution
from decks.mesh import Mesh, read_mesh, write_mesh
from fembridge.errors import FingerError, UsageError
from fembridge.store import changed, near_hint, read_toml

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
_NAME_LENGTH = 60


def mesh_of(finger: Finger) -> Mesh:
    """Mesh of `finger`: the stored one if only the materials differ from a preset.

    Raises
    ------
    MissingError, FingerError
        The finger needs a new mesh; see `decks.mesher.mesh_finger`.
    """
    for preset in PRESETS.values():
        if finger == replace(preset, name=finger.name, materials=finger.materials):
            return read_mesh(stored_mesh(preset.name))
    from decks.mesher import mesh_finger

    return mesh_finger(finger)


def model_of(finger: Finger) -> Model:
    """`finger` and its mesh under the default probe; see `mesh_of` for errors."""
    return Model(finger, mesh_of(finger))


def stored_mesh(name: str) -> Path:
    """Path of a preset's stored mesh."""
    return _MESHES / f"{name}.npz"


def read_finger(preset_or_path: str) -> Finger:
    """A preset by its name, or the finger that a TOML file describes.

    Raises
    ------
    UsageError
        No such preset or file.
    FingerError
        Not TOML, an unknown key (near ones are named), or a value that cannot be.
    """
    if preset_or_path in PRESETS:
        return PRESETS[preset_or_path]
    path = Path(preset_or_path)
    try:
        is_file = path.is_file()
    except OSError:  # a name that is too long
        is_file = False
    if not is_file:
        raise UsageError(
            f"finger {preset_or_path!r}: neither a preset ({', '.join(PRESETS)}) nor a file"
        )
    table = read_toml(path, FingerError)
    try:
        return finger_from(table, name=path.stem)
    except FingerError as error:
        raise FingerError(f"{path}: {error}") from error


def finger_from(table: Mapping[str, Any], name: str) -> Finger:
    """The finger of a TOML table; `name` is used where the table has none."""
    base = table.get("base", "quick")
    if not isinstance(base, str) or base not in PRESETS:
        raise FingerError(f"base {base!r}, expected one of {', '.join(PRESETS)}")
    overrides = {key: value for key, value in table.items() if key != "base"}
    return finger_with(replace(PRESETS[base], name=name), overrides)


def finger_with(finger: Finger, table: Mapping[str, Any]) -> Finger:
    """`finger` with the values of a TOML table."""
    for part, names in (("materials", LAYERS), ("afferents", SITES)):
        section = table.get(part)
        for key in section if isinstance(section, Mapping) else ():
            if key not in names:
                raise FingerError(
                    f"{part}: unknown key {key!r}, expected {', '.join(names)}"
                    + near_hint(str(key), names)
                )
    finger = changed(finger, table, FingerError)
    # The name is used in decks and reports and as a file name.
    printable = 0 < len(finger.name) <= _NAME_LENGTH and finger.name.isprintable()
    if not printable or finger.name.startswith((".", " ")) or set(finger.name) & set("/\\"):
        raise FingerError(
            f"name must be 1 to {_NAME_LENGTH} printable characters, none of them "
            f"a slash, the first no dot or space, got {finger.name!r}"
        )
    return finger


def finger_table(finger: Finger) -> dict[str, Any]:
    """`finger` as a TOML table, with all sizes and materials.

    Prony terms and densities are included only if they differ from the preset, so that tables
    stored before these keys existed stay valid.
    """
    table = asdict(finger)
    for layer, material in table["materials"].items():
        material["prony"] = list(material["prony"])
        for key, default in (("prony", []), ("density_kg_m3", TABLE_1[layer].density_kg_m3)):
            if material[key] == default:
                del material[key]
    return table


if __name__ == "__main__":
    from decks.mesher import mesh_finger

    for preset in PRESETS.values():
        write_mesh(stored_mesh(preset.name), mesh_finger(preset))
