"""A finger by the name of a preset or by its TOML file, whatever kind of finger it is."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar

from decks.finger import Material
from decks.unit_system import modulus_doubt
from fembridge.errors import FingerError, UsageError, warn
from fembridge.host.store import changed, near_hint, read_toml

_NAME_LENGTH = 60


class _WithMaterials(Protocol):
    @property
    def name(self) -> str: ...
    @property
    def materials(self) -> Mapping[str, Material]: ...


FingerKind = TypeVar("FingerKind", bound=_WithMaterials)


def preset_or_file(
    preset_or_path: str,
    presets: Mapping[str, FingerKind],
    make: Callable[[Mapping[str, Any], str], FingerKind],
) -> FingerKind:
    """One of `presets` by its name, or what `make` makes of a TOML table and the file's name.

    Raises
    ------
    UsageError
        No such preset or file.
    FingerError
        Not TOML, or an error of `make`, with the path of the file.
    """
    if preset_or_path in presets:
        return presets[preset_or_path]
    path = Path(preset_or_path)
    if not is_file(path):
        expected = f"{', '.join(presets)} or a TOML file"
        raise UsageError(argument="finger", found=str(preset_or_path), expected=expected)
    table = read_toml(path, FingerError)
    try:
        finger = make(table, path.stem)
    except FingerError as error:
        raise FingerError.from_error(error, path, "") from error
    softest = min(finger.materials, key=lambda layer: finger.materials[layer].young_mpa)
    if doubt := modulus_doubt(softest, finger.materials[softest].young_mpa, "MPa", 1.0):
        warn(f"{doubt}; young_mpa is in MPa", path)
    return finger


def with_changes(
    finger: FingerKind, table: Mapping[str, Any], entries: Mapping[str, Sequence[str]]
) -> FingerKind:
    """`finger` with the values of a TOML table; `entries` has the keys of its mappings.

    Raises
    ------
    FingerError
        An unknown key, a value that cannot be, or a name that is no file name.
    """
    for part, names in entries.items():
        section = table.get(part)
        for key in section if isinstance(section, Mapping) else ():
            if key not in names:
                expected = ", ".join(names)
                raise FingerError(
                    f"is an unknown key, expected {expected}{near_hint(str(key), names)}",
                    key=f"{part}.{key}",
                    found=key,
                    expected=expected,
                )
    finger = changed(finger, table, FingerError)
    # The name is used in decks and reports and as a file name.
    printable = 0 < len(finger.name) <= _NAME_LENGTH and finger.name.isprintable()
    if not printable or finger.name.startswith((".", " ")) or set(finger.name) & set("/\\"):
        raise FingerError(
            key="name",
            found=finger.name[:_NAME_LENGTH],
            expected=f"1 to {_NAME_LENGTH} printable characters, none of them a slash, the first "
            "no dot or space",
        )
    return finger


def is_file(path: Path) -> bool:
    """Whether `path` is a file; a name that is too long is none."""
    try:
        return path.is_file()
    except OSError:
        return False
