"""A finger from TOML: a preset, and what is different about this one.

Ten lines make another finger::

    base = "quick"

    [skin]
    epidermis_mm = 0.5

    [materials.dermis]
    young_mpa = 0.08

    [afferents.SA]
    depth_mm = 0.70
"""

import difflib
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, TypeVar

from decks.finger import LAYERS, AfferentSite, Finger
from decks.material import TABLE_1, PronyTerm
from decks.presets import PRESETS
from fembridge.errors import FingerError

_PARTS = ("outline", "skin", "ridges", "papillae", "bone", "nail", "resolution")
_AFFERENTS = ("SA", "RA", "PC")
_MAX_BYTES = 1_000_000
_NAME_LENGTH = 60
_Part = TypeVar("_Part")


def read_finger(preset_or_path: str) -> Finger:
    """Give a preset by its name, or the finger that a TOML file describes.

    Raises
    ------
    FingerError
        No such preset or file, not TOML, an unknown key (near ones are named),
        or a value that cannot be.
    """
    if preset_or_path in PRESETS:
        return PRESETS[preset_or_path]
    path = Path(preset_or_path)
    text = _text(path)
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # its own error is a ValueError
        raise FingerError(f"{path}: not readable as TOML: {error}") from error
    try:
        return finger_from(table, name=path.stem)
    except FingerError as error:
        raise FingerError(f"{path}: {error}") from error


def finger_from(table: Mapping[str, Any], name: str) -> Finger:
    """Make a finger of a TOML table; `name` is used where the table has none."""
    _known(table, ("name", "base", *_PARTS, "materials", "afferents"), "finger")
    base = table.get("base", "quick")
    if not isinstance(base, str) or base not in PRESETS:
        raise FingerError(f"base {base!r}, expected one of {', '.join(PRESETS)}")
    finger = PRESETS[base]
    changes: dict[str, Any] = {"name": _name(table.get("name", name))}
    for part in _PARTS:
        if part in table:
            changes[part] = _changed(getattr(finger, part), table[part], part)
    materials = dict(finger.materials)
    for layer, entries in _table(table, "materials").items():
        _known({layer: 0}, LAYERS, "materials")
        here = f"materials.{layer}"
        materials[layer] = _changed(materials[layer], _with_terms(entries, here), here)
    sites = dict(finger.afferents)
    for afferent, entries in _table(table, "afferents").items():
        _known({afferent: 0}, _AFFERENTS, "afferents")
        here = f"afferents.{afferent}"
        start = sites.get(afferent, AfferentSite("dermis", 0.0, 1.0))
        sites[afferent] = _changed(start, entries, here)
    return replace(finger, materials=materials, afferents=sites, **changes)


def finger_table(finger: Finger) -> dict[str, Any]:
    """Give `finger` as TOML has it, sizes and materials in full.

    What only makes stress depend on time stands there where it differs from a
    preset's: what was stored before it could be told stays what it is.
    """
    table = asdict(finger)
    for layer, material in table["materials"].items():
        material["prony"] = list(material["prony"])
        for key, usual in (("prony", []), ("density_kg_m3", TABLE_1[layer].density_kg_m3)):
            if material[key] == usual:
                del material[key]
    return table


def _with_terms(entries: object, where: str) -> object:
    """Make Prony terms of the tables of ``prony``; all else stays as it is."""
    if not isinstance(entries, Mapping) or "prony" not in entries:
        return entries
    rows = entries["prony"]
    if not isinstance(rows, list):
        raise FingerError(f"[{where}] prony must be a list of tables, got {rows!r}")
    terms = []
    for number, row in enumerate(rows, start=1):
        here = f"{where}.prony {number}"
        if not isinstance(row, Mapping):
            raise FingerError(f"[{here}] must be a table of g and tau_s, got {row!r}")
        _known(row, [field.name for field in fields(PronyTerm)], here)
        try:
            terms.append(PronyTerm(**row))
        except TypeError as error:
            raise FingerError(f"[{here}] expected g and tau_s, got {row!r}") from error
        except FingerError as error:
            raise FingerError(f"[{here}] {error}") from error
    return {**entries, "prony": tuple(terms)}


def _text(path: Path) -> str:
    """Give what stands in a file; never more than a finger file may hold."""
    try:
        with path.open("rb") as file:
            content = file.read(_MAX_BYTES + 1)
    except FileNotFoundError as error:
        raise FingerError(
            f"finger {str(path)!r}: neither a preset ({', '.join(PRESETS)}) nor a file"
        ) from error
    except OSError as error:
        raise FingerError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:  # a zero byte in the name
        raise FingerError(f"finger {str(path)!r}: no name of a file") from error
    if len(content) > _MAX_BYTES:
        raise FingerError(f"{path}: over {_MAX_BYTES} bytes, not a finger file")
    try:
        return content.decode("utf-8-sig")  # Windows editors begin with a mark
    except UnicodeDecodeError as error:
        raise FingerError(f"{path}: not UTF-8: {error}") from error


def _changed(part: _Part, entries: object, where: str) -> _Part:
    if not isinstance(entries, Mapping):
        raise FingerError(f"[{where}] must be a table, got {entries!r}")
    _known(entries, [field.name for field in fields(part)], where)  # type: ignore[arg-type]
    try:
        return replace(part, **entries)  # type: ignore[type-var]
    except FingerError as error:
        raise FingerError(f"[{where}] {error}") from error


def _known(entries: Mapping[str, Any], names: Any, where: str) -> None:  # noqa: ANN401 - any collection of names
    for key in entries:
        if key not in names:
            near = difflib.get_close_matches(str(key), list(names), n=2)
            hint = f"; did you mean {' or '.join(near)}?" if near else ""
            raise FingerError(f"[{where}] unknown key {key!r}, expected {', '.join(names)}{hint}")


def _table(table: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    entries = table.get(key, {})
    if not isinstance(entries, Mapping):
        raise FingerError(f"[{key}] must hold tables, got {entries!r}")
    return entries


def _name(name: object) -> str:
    """Check a name: it stands in decks and reports, and may become a file's."""
    if (
        not isinstance(name, str)
        or not 0 < len(name) <= _NAME_LENGTH
        or not name.isprintable()
        or name.startswith((".", " "))
        or set(name) & set("/\\")
    ):
        raise FingerError(
            f"name must be 1 to {_NAME_LENGTH} printable characters, none of them "
            f"a slash, the first no dot or space, got {name!r}"
        )
    return name
