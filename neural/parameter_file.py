"""Parameters as a table of TOML: a section a class, the names of the fields as keys.

::

    preindent_um = 75.0

    [RA]
    drive = "rising"
    tau_ms = 300.0
    step_pa = 7000.0

A section that is absent is published. ``drive`` is one of `neural.drive_table`;
without it a section is of the published drive, and a key that is absent keeps its
published value. `preindent_um` is the depth at which the probe stood before time 0
when the numbers were fitted. ``name``, and tables ``fit`` and ``study``, tell the
origin: they are kept and not read. All else is refused.
"""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType

from fembridge.errors import ParameterError
from fembridge.typing import Table
from neural.drive_table import drive_named
from neural.parameters import AFFERENTS, PUBLISHED, AfferentParameters, Parameters

ORIGIN_KEYS = ("name", "fit", "study")
_PREINDENT = "preindent_um"


@dataclass(frozen=True, slots=True)
class ParameterSet:
    """Parameters of all classes, and what they hold for.

    `preindent_um`, >= 0, is the depth of the probe before time 0 in the fit;
    `origin` tells how the numbers came about.
    """

    name: str
    parameters: Parameters
    preindent_um: float = 0.0
    origin: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.parameters:
            raise ParameterError(f"{self.name}: parameters of no class")
        object.__setattr__(self, "preindent_um", _preindent_um(self.preindent_um))
        object.__setattr__(self, "origin", MappingProxyType(dict(self.origin)))


def parameters_from_table(table: Mapping[str, object]) -> Parameters:
    """Make parameters of a table as TOML gives it; what is absent is published.

    Raises
    ------
    ParameterError
        An unknown section or key, or a value outside its meaning.
    """
    chosen = dict(PUBLISHED)
    for afferent, section in table.items():
        if afferent in ORIGIN_KEYS or afferent == _PREINDENT:
            continue
        if afferent not in PUBLISHED:
            raise ParameterError(_unknown("section", afferent, AFFERENTS))
        if not isinstance(section, Mapping):
            raise ParameterError(f"{afferent}: expected a section, got {section!r}")
        chosen[afferent] = _from_section(afferent, section)
    return MappingProxyType(chosen)


def parameters_to_table(parameters: Parameters) -> Table:
    """Give a table for TOML: a section for each class, every key."""
    return {name: asdict(one) for name, one in parameters.items()}


def read_parameters(path: Path) -> Parameters:
    """Read a TOML file of parameters; see `read_parameter_set`."""
    return read_parameter_set(path).parameters


def read_parameter_set(path: Path) -> ParameterSet:
    """Read a TOML file of parameters, with what they hold for.

    Raises
    ------
    ParameterError
        No such file, not TOML, or what `parameters_from_table` refuses.
    """
    try:
        with path.open("rb") as file:
            table = tomllib.load(file)
    except OSError as error:
        raise ParameterError(f"{path}: cannot read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:  # TOMLDecodeError is a ValueError
        raise ParameterError(f"{path}: not TOML: {error}") from error
    try:
        return ParameterSet(
            name=_name(table.get("name", path.stem)),
            parameters=parameters_from_table(table),
            preindent_um=_preindent_um(table.get(_PREINDENT, 0.0)),
            origin={key: table[key] for key in ORIGIN_KEYS if key in table},
        )
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from error


def _from_section(afferent: str, section: Mapping[str, object]) -> AfferentParameters:
    name = section.get("drive", "published")
    drive = drive_named(str(name), afferent)
    known = [one.name for one in fields(drive.parameters)]
    for key in section:
        if key not in known:
            raise ParameterError(f"{afferent}: {_unknown('key', key, known)}")
    if drive.parameters is type(PUBLISHED[afferent]):
        return replace(PUBLISHED[afferent], **section)  # type: ignore[arg-type]
    needed = [
        one.name
        for one in fields(drive.parameters)
        if one.default is MISSING and one.name not in section
    ]
    if needed:
        raise ParameterError(f"{afferent}: drive {name!r} also needs {', '.join(needed)}")
    return drive.parameters(**section)  # type: ignore[arg-type]


def _preindent_um(value: object) -> float:
    number = math.nan
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
    if not (math.isfinite(number) and number >= 0):
        told = repr(value) if number != math.inf else "inf"
        raise ParameterError(f"{_PREINDENT} must be a number >= 0, got {told}")
    return number


def _name(value: object) -> str:
    if not isinstance(value, str) or not value:
        raise ParameterError(f"name must be a word, got {value!r}")
    return value


def _unknown(kind: str, word: str, known: list[str] | tuple[str, ...]) -> str:
    from difflib import get_close_matches

    folded = {name.casefold(): name for name in known}
    near = get_close_matches(str(word).casefold(), folded, n=1)
    hint = f"; did you mean {folded[near[0]]!r}?" if near else ""
    return f"unknown {kind} {word!r}, expected {', '.join(known)}{hint}"
