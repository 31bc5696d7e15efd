"""Parameter sets: the shipped ones, and TOML files of a user.

::

    base = "fitted"

    [RA]
    drive = "rising"
    tau_ms = 300.0
    step_pa = 7000.0

``base`` names a shipped set. A missing section, a missing key of a section and a missing
`preindent_um` come from the base. A section with another ``drive`` (a name of `neural.models`)
than the base needs all keys of that model. A file without a ``base`` needs every class and
every key without a default, so that a cut file is refused. `preindent_um` is the depth of
the probe in um before time 0 in the fit. ``name`` and the tables ``fit`` and ``study``
describe the origin and are kept; of ``fit`` only the mechanics and the equations are read.
Numbers fitted with another equation than this version's, and unknown keys, are refused.
"""

import os
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field, fields
from functools import cache
from pathlib import Path
from types import MappingProxyType

from fembridge.errors import ParameterError, UsageError
from fembridge.host.store import changed, near_hint, read_toml, structure
from fembridge.typing import Table
from neural.models import model_named, model_of
from neural.parameters import AFFERENTS, PUBLISHED, AfferentParameters, Parameters

FITTED_FILE = Path(__file__).parent / "fitted.toml"
# Fitted to the same data with the same rule as `FITTED_FILE`, on the stress of the
# three-dimensional pad.
PAD_FILE = Path(__file__).parent / "fitted_pad.toml"

# Better than the published model on every class, on fitted and on held-out rates:
# ``docs/science/model_study.md``.
DEFAULT_SET = "fitted"

SET_NAMES = ("published", "fitted", "fitted_pad")

_DEEPEST_UM = 10_000.0  # more than the thickness of the pad
_LONGEST_NAME = 255  # as that of a file
_LONGEST_SHOWN = 40  # of a name in a message

_ORIGIN_KEYS = ("name", "fit", "study")
# Names of `ParameterSet.mechanics` by their keys in the table ``fit.response``.
_MECHANICS_KEYS = {
    "finger": "name",
    "finger_sha256": "sha256",
    "pad": "pad",
    "ridges": "ridges",
    "probe": "probe",
}
_NO_SECTIONS = {"base", "preindent_um", *_ORIGIN_KEYS}
_BASE_HINT = '; a file of some classes or keys begins with base = "fitted" or "published"'


@dataclass(frozen=True, slots=True)
class ParameterSet:
    """Parameters of all classes, with the mechanics and pre-indentation of their fit.

    `neural.parameter_set` makes one of a name or a file.

    Parameters
    ----------
    name
        Name in records.
    parameters
        Parameters by the name of the class.
    preindent_um
        Depth of the probe in um before time 0 in the fit, 0 or more. Default: 0.
    origin
        How the numbers were obtained. Default: empty.
    mechanics
        Mechanics of the fit: ``name`` of the model, and ``sha256`` unless it is a preset; of a
        probe on a pad also ``pad``, ``ridges`` and ``probe``. Default: empty, as of Table 2.

    Examples
    --------
    >>> from neural import parameter_set
    >>> parameter_set("fitted").parameters["RA"].drive
    'two_way'
    """

    name: str
    parameters: Parameters
    preindent_um: float = 0.0
    origin: Mapping[str, object] = field(default_factory=dict)
    mechanics: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        drives = ", ".join(f"{name} {part.drive}" for name, part in self.parameters.items())
        return f"ParameterSet({self.name!r}, {drives}, pre-indentation {self.preindent_um:g} um)"

    def __reduce__(self) -> tuple[Callable[..., "ParameterSet"], tuple[object, ...]]:
        if self.to_table() == {"name": self.name}:
            return parameter_set, (self.name,)
        values = dict(self.parameters), self.preindent_um, dict(self.origin), dict(self.mechanics)
        return ParameterSet, (self.name, *values)

    def to_table(self) -> Table:
        """Table for the record of a run: a shipped set by its name, others complete.

        The mechanics and the equations of the fit are included, for checks by later versions.
        """
        if self.name in SET_NAMES and parameter_set(self.name) is self:
            return {"name": self.name}
        response = {
            key: self.mechanics[name]
            for key, name in _MECHANICS_KEYS.items()
            if name in self.mechanics
        }
        fit: Table = {"response": response} if response else {}
        for afferent in AFFERENTS:
            row = _part(_part(self.origin, "fit"), afferent)
            if "equation" in row:
                fit[afferent] = {key: row[key] for key in ("drive", "equation") if key in row}
        table = {"name": self.name, "preindent_um": self.preindent_um}
        return {**table, **parameters_to_table(self.parameters), **({"fit": fit} if fit else {})}

    def to_record(self) -> Table:
        """Keys of this set in the record of a result: what `from_record` needs."""
        return {
            "parameter_set": self.name,
            "parameters": parameters_to_table(self.parameters),
            "fitted_at_um": float(self.preindent_um),
            "fit": self.to_table().get("fit"),
        }

    @classmethod
    def from_record(cls, record: Table, source: str) -> "ParameterSet | None":
        """Parameter set of the record of a result; None where the record names none.

        Parameters
        ----------
        record
            Record with the keys of `to_record`; without a depth that is 0.
        source
            Path that a `ParameterError` names.

        Raises
        ------
        ParameterError
            See `from_table`.
        """
        name, parameters = record.get("parameter_set"), _part(record, "parameters")
        if not isinstance(name, str) or not parameters:
            return None
        if name in SET_NAMES:
            shipped = parameter_set(name)
            if parameters_to_table(shipped.parameters) == parameters:
                return shipped
        table = {"name": name, "preindent_um": record.get("fitted_at_um", 0.0), **parameters}
        return cls.from_table({**table, "fit": record.get("fit", {})}, name, source)

    @classmethod
    def from_table(cls, table: Table, name: str, source: str) -> "ParameterSet":
        """Parameter set from the table of a file or of `to_table`.

        Parameters
        ----------
        table
            Content of the file.
        name
            Name of the set where the table has none.
        source
            Path that a `ParameterError` names.

        Raises
        ------
        ParameterError
            An unknown key, a missing section or key, or a number outside its range.
        """
        if set(table) == {"name"}:
            if table["name"] not in SET_NAMES:
                raise ParameterError(
                    path=Path(source),
                    key="name",
                    found=table["name"],
                    expected=f"one of {', '.join(SET_NAMES)}",
                )
            return _shipped(table["name"])
        try:
            base = table.get("base")
            if base is not None and base not in SET_NAMES:
                raise ParameterError(
                    key="base", found=base, expected=f"one of {', '.join(SET_NAMES)}"
                )
            base_set = parameter_set(base or SET_NAMES[0])
            head = {"name": name, "preindent_um": base_set.preindent_um}
            head |= {key: table[key] for key in head if key in table}
            checked_head = structure(head, _Head, ParameterError)
            sections = {key: section for key, section in table.items() if key not in _NO_SECTIONS}
            parameters = _parameters_of(sections, None if base is None else base_set.parameters)
            fit = _part(table, "fit")
            for afferent in sections:
                _check_equation(_part(fit, afferent), parameters[afferent])
        except ParameterError as error:
            raise ParameterError.from_error(error, Path(source)) from error
        mechanics, response = base_set.mechanics, _part(fit, "response")
        if "finger" in response:
            mechanics = {
                name: str(response[key]) for key, name in _MECHANICS_KEYS.items() if key in response
            }
        origin = {key: table[key] for key in _ORIGIN_KEYS if key in table}
        return cls(checked_head.name, parameters, checked_head.preindent_um, origin, mechanics)


@dataclass(frozen=True, slots=True)
class _Head:
    name: str
    preindent_um: float

    def __post_init__(self) -> None:
        if not 0 <= self.preindent_um <= _DEEPEST_UM:
            raise ParameterError(
                argument="preindent_um",
                found=self.preindent_um,
                expected=f"a number >= 0, at most {_DEEPEST_UM:g}",
            )
        if not 0 < len(self.name) <= _LONGEST_NAME or not self.name.isprintable():
            raise ParameterError(
                argument="name",
                found=self.name[:_LONGEST_SHOWN],
                expected=f"1 to {_LONGEST_NAME} printable characters",
            )


def parameter_set(source: str | Path | ParameterSet) -> ParameterSet:
    """Parameter set of a name or a file; a `ParameterSet` is returned unchanged.

    Names are ``published`` (Table 2), ``fitted`` (the default) and ``fitted_pad`` (for
    `fb.touch`). Any other string, and a path, is a TOML file.

    Raises
    ------
    UsageError
        Neither the name of a set nor a file.
    ParameterError
        The file is missing or not TOML; an unknown section or key, or a value out of range.

    Examples
    --------
    >>> from neural import parameter_set
    >>> parameter_set("published").parameters["SA"].tau_ms
    32.14
    """
    if isinstance(source, ParameterSet):
        return source
    if source in SET_NAMES:
        return _shipped(str(source))
    expected = f"{' or '.join(SET_NAMES)} or a TOML file"
    if not isinstance(source, str | os.PathLike):
        raise UsageError(argument="parameters", found=source, expected=expected)
    path = Path(source)
    if isinstance(source, Path) or (source and (path.suffix or path.exists())):
        return ParameterSet.from_table(
            read_toml(path, ParameterError.at(path)), path.stem, str(path)
        )
    expected = f"{', '.join(SET_NAMES)} or a TOML file"
    raise UsageError(argument="parameters", found=str(source), expected=expected)


@cache
def _shipped(name: str) -> ParameterSet:
    if name == "published":
        return ParameterSet(name, PUBLISHED, origin={"fit": {"source": "Ishizuka et al., Table 2"}})
    return parameter_set({"fitted": FITTED_FILE, "fitted_pad": PAD_FILE}[name])


def _parameters_of(sections: Table, base: Parameters | None) -> Parameters:
    """Parameters of all classes from the `sections`; missing ones come from `base`."""
    parameters = dict(base or PUBLISHED)
    for afferent, section in sections.items():
        if afferent not in PUBLISHED:
            hint = near_hint(afferent, AFFERENTS)
            expected = ", ".join(AFFERENTS)
            raise ParameterError(
                f"is an unknown section, expected {expected}{hint}",
                key=afferent,
                found=afferent,
                expected=expected,
            )
        previous = parameters[afferent]
        drive = section.get("drive") if isinstance(section, dict) else None
        hint = ""
        try:
            kind = model_named(str(drive or previous.drive), afferent).parameters
            if base and kind is type(previous):
                parameters[afferent] = changed(previous, section, ParameterError)
            else:
                hint = _BASE_HINT if not base and _lacks_keys(section, kind) else ""
                parameters[afferent] = structure(section, kind, ParameterError)
        except ParameterError as error:
            failure = ParameterError.from_error(error, section=afferent)
            failure.problem += hint
            raise failure from error
    if not base and (absent := [name for name in AFFERENTS if name not in sections]):
        verb = "is" if len(absent) == 1 else "are"
        raise ParameterError(f"{verb} absent{_BASE_HINT}", key=", ".join(absent))
    return MappingProxyType(parameters)


def _check_equation(row: Table, parameters: AfferentParameters) -> None:
    """Raise ParameterError where `row`, a class of ``fit``, has another equation than the model."""
    model = model_of(parameters)
    if row.get("drive", model.name) != model.name:
        return
    if row.get("equation", model.equation) != model.equation:
        raise ParameterError(
            f"is not that of {model.name} in this version: fit it again",
            key=f"fit.{model.afferent}.equation",
            found=row["equation"],
        )


def _part(table: object, key: str) -> Table:
    """Table under `key`; empty where there is none."""
    part = table.get(key) if isinstance(table, Mapping) else None
    return dict(part) if isinstance(part, Mapping) else {}


def _lacks_keys(section: object, kind: type[AfferentParameters]) -> bool:
    """Whether a section with known keys alone lacks one without a default."""
    if not isinstance(section, Mapping):
        return False
    keys = {key.name for key in fields(kind)}
    required = {key.name for key in fields(kind) if key.default is MISSING}
    return section.keys() <= keys and not required <= section.keys()


def parameters_to_table(parameters: Parameters) -> Table:
    """Table for TOML: one section per class, with every key."""
    return {name: values.by_name() for name, values in parameters.items()}
