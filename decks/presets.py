"""The fingers to choose from: `quick` and `paper` with their stored meshes, and files.

``python -m decks.presets`` meshes the presets again with gmsh and rewrites the stored
files; with the same gmsh the bytes do not change. A few lines of TOML define another
finger as a preset with changes::

    base = "quick"

    [skin]
    epidermis_mm = 0.5

    [materials.dermis]
    young_mpa = 0.08
    prony = "skin-wang-2015"

    [afferents.SA]
    depth_mm = 0.70
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from decks.contact_analysis import Model
from decks.finger import LAYERS, SITES, TABLE_1, Finger, Material, Resolution
from decks.finger_file import preset_or_file, with_changes
from decks.fingertip import TIPS
from decks.mesh import Mesh, read_mesh, write_mesh
from decks.prony import prony_set
from fembridge.errors import FingerError
from fembridge.host.store import unstructure

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
_LEAST_MPA, _MOST_MPA = 1e-9, 1e9  # of a constant of a law


def mesh_of(finger: Finger) -> Mesh:
    """Mesh of `finger`: the stored one if only the materials differ from a preset.

    Raises
    ------
    MissingError, FingerError
        The finger needs a new mesh; see `decks.mesher.mesh_finger`.

    Examples
    --------
    >>> import decks
    >>> len(decks.mesh_of(decks.PRESETS["quick"]).quad)
    3100
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

    Examples
    --------
    >>> import decks
    >>> decks.read_finger("paper").name
    'paper'
    """
    return preset_or_file(preset_or_path, PRESETS, finger_from)


def finger_from(table: Mapping[str, Any], name: str) -> Finger:
    """The finger of a TOML table; `name` is used where the table has none."""
    base = table.get("base", "quick")
    if isinstance(base, str) and base in TIPS:
        raise FingerError(
            f"is {base}, a fingertip in three dimensions, expected one of {', '.join(PRESETS)}; "
            "fembridge fingertip writes its deck",
            key="base",
            found=base,
            expected=f"one of {', '.join(PRESETS)}",
        )
    if not isinstance(base, str) or base not in PRESETS:
        raise FingerError(key="base", found=base, expected=f"one of {', '.join(PRESETS)}")
    overrides = {key: value for key, value in table.items() if key != "base"}
    return finger_with(replace(PRESETS[base], name=name), overrides)


def finger_with(finger: Finger, table: Mapping[str, Any]) -> Finger:
    """`finger` with the values of a TOML table."""
    entries = {"materials": LAYERS, "afferents": tuple(SITES)}
    return with_changes(finger, _with_moduli(finger, table), entries)


def finger_table(finger: Finger) -> dict[str, Any]:
    """`finger` as a TOML table, with all sizes and materials.

    Keys of a material beside its moduli are included only if they differ from the preset, so
    that tables stored before these keys existed stay valid.
    """
    table = unstructure(finger)
    for layer, material in table["materials"].items():
        defaults = unstructure(replace(TABLE_1[layer], young_mpa=1.0, poisson=0.0))
        for key in set(material) - {"young_mpa", "poisson"}:
            if material[key] == defaults.get(key):
                del material[key]
    return dict(table)


# ---- Constants of a material as they are published: a table's ``prony`` by name, and the law's
# constants in MPa, from which the shear modulus follows.


def _with_moduli(finger: Finger, table: Mapping[str, Any]) -> Mapping[str, Any]:
    """`table` with Prony terms for names, and moduli and shares for constants in MPa."""
    materials = table.get("materials")
    if not isinstance(materials, Mapping):
        return table
    resolved = {}
    for layer, entries in materials.items():
        if not isinstance(entries, Mapping) or layer not in finger.materials:
            return table  # refused by its key
        try:
            resolved[layer] = _material_entries(entries, finger.materials[layer])
        except FingerError as error:
            raise FingerError.from_error(error, section=f"materials.{layer}") from error
    return {**table, "materials": resolved}


def _material_entries(entries: Mapping[str, Any], base: Material) -> dict[str, Any]:
    changes = dict(entries)
    if isinstance(changes.get("prony"), str):
        changes["prony"] = unstructure(prony_set(changes["prony"]))["prony"]
    constants: list[str] = [key for key in ("c10_mpa", "c01_mpa") if key in changes]
    terms = changes.get("ogden")
    terms = terms if isinstance(terms, list | tuple) else ()
    if any(isinstance(term, Mapping) and "mu_mpa" in term for term in terms):
        constants.append("ogden")
    if not constants:
        return changes
    if "young_mpa" in changes:
        raise FingerError(
            f"follows from {' and '.join(constants)}: expected one of the two",
            argument="young_mpa",
            found=changes["young_mpa"],
        )
    if "ogden" in constants:
        terms = [term for term in terms if isinstance(term, Mapping)]
        law, moduli = "ogden", [_constant(term, "mu_mpa", "ogden.mu_mpa") for term in terms]
        shear_mpa = sum(moduli)
        changes["ogden"] = [
            {
                **{key: value for key, value in term.items() if key != "mu_mpa"},
                "share": mu / shear_mpa,
            }
            for term, mu in zip(terms, moduli, strict=True)
        ]
    else:
        law = "mooney-rivlin"
        c10_mpa, c01_mpa = (_constant(changes, key, key) for key in ("c10_mpa", "c01_mpa"))
        shear_mpa = 2 * (c10_mpa + c01_mpa)
        changes = {key: value for key, value in changes.items() if key not in constants}
        changes["c01_share"] = 2 * c01_mpa / shear_mpa
    poisson = changes.get("poisson", base.poisson)
    if isinstance(poisson, float | int):
        changes["young_mpa"] = 2 * shear_mpa * (1 + poisson)
    return {"law": law, **changes}


def _constant(table: Mapping[str, Any], key: str, argument: str) -> float:
    """A constant in MPa, more than 0; C01 may be 0."""
    value = table.get(key)
    lowest, expected = (0.0, "0 or more") if key == "c01_mpa" else (_LEAST_MPA, "more than 0")
    is_number = isinstance(value, float | int) and not isinstance(value, bool)
    if value is None or not is_number or not lowest <= value < _MOST_MPA:
        raise FingerError(argument=argument, found=value, expected=f"a number in MPa, {expected}")
    return float(value)


if __name__ == "__main__":
    from decks.mesher import mesh_finger

    for preset in PRESETS.values():
        write_mesh(stored_mesh(preset.name), mesh_finger(preset))
