"""Parameter sets: the two that are shipped, and a user's own as a TOML file.

::

    base = "fitted"

    [RA]
    drive = "rising"
    tau_ms = 300.0
    step_pa = 7000.0

``base`` names the set that a file starts from. What such a file leaves out, a section, a
key of one, `preindent_um`, is as there. A section with another ``drive``, a name of
`neural.models`, than its base takes all of that model's keys. A file without a ``base``
has every class and every key, but for those that the paper has for all: one that was cut
is refused. `preindent_um` is the depth of the probe before time 0 when the numbers were
fitted. ``name``, and tables ``fit`` and ``study``, describe the origin: they are kept, and
of the fit only the finger and the equations are read: numbers that were fitted with another
equation than this version's are refused. So is all else.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import MappingProxyType

from fembridge.errors import ParameterError, UsageError
from fembridge.store import changed, near_hint, read_toml, structure
from fembridge.typing import Table
from neural.models import model_named, model_of
from neural.parameters import AFFERENTS, PUBLISHED, AfferentParameters, Parameters

FITTED_FILE = Path(__file__).parent / "fitted.toml"
# The same data and rule as `FITTED_FILE`, on the stress of the three-dimensional pad.
PAD_FILE = Path(__file__).parent / "fitted_pad.toml"

# Fitted and held out it is better than the published model on every class:
# ``docs/model_study.md``.
DEFAULT_SET = "fitted"

SET_NAMES = ("published", "fitted", "fitted_pad")

_DEEPEST_UM = 10_000.0  # more than the thickness of the pad
_LONGEST_NAME = 255  # as that of a file

_ORIGIN_KEYS = ("name", "fit", "study")
_NO_SECTIONS = {"base", "preindent_um", *_ORIGIN_KEYS}


@dataclass(frozen=True, slots=True)
class ParameterSet:
    """Parameters of all classes, and what they hold for.

    `preindent_um`, >= 0, is the depth of the probe before time 0 in the fit, `finger` on
    whose stress that was: ``name``, and ``sha256`` of what is no preset; empty of Table 2.
    `origin` says how the numbers came about.
    """

    name: str
    parameters: Parameters
    preindent_um: float = 0.0
    origin: Mapping[str, object] = field(default_factory=dict)
    finger: Mapping[str, str] = field(default_factory=dict)

    def to_table(self) -> Table:
        """As a run keeps it: a shipped set by its name, another one whole.

        Of its fit the finger and the equations are kept, which a later version may not have.
        """
        if self.name in SET_NAMES and parameter_set(self.name) is self:
            return {"name": self.name}
        response = {"finger" if k == "name" else f"finger_{k}": v for k, v in self.finger.items()}
        fit: Table = {"response": response} if response else {}
        for afferent in AFFERENTS:
            row = _part(_part(self.origin, "fit"), afferent)
            if "equation" in row:
                fit[afferent] = {key: row[key] for key in ("drive", "equation") if key in row}
        table = {"name": self.name, "preindent_um": self.preindent_um}
        return {**table, **parameters_to_table(self.parameters), **({"fit": fit} if fit else {})}

    @classmethod
    def from_table(cls, table: Table, name: str, source: str) -> "ParameterSet":
        """The set of a table as a file has it, or `to_table` gives it.

        `name` is for one without; the message of a `ParameterError` begins with `source`.
        """
        if set(table) == {"name"}:
            if table["name"] not in SET_NAMES:
                words = f"no parameter set {table['name']!r}, expected {' or '.join(SET_NAMES)}"
                raise ParameterError(f"{source}: {words}")
            return _shipped(table["name"])
        try:
            base = table.get("base")
            if base is not None and base not in SET_NAMES:
                raise ParameterError(f"base is {base!r}, expected {' or '.join(SET_NAMES)}")
            start = parameter_set(base or SET_NAMES[0])
            head = {"name": name, "preindent_um": start.preindent_um}
            head |= {key: table[key] for key in head if key in table}
            known = structure(head, _Head, ParameterError)
            sections = {key: one for key, one in table.items() if key not in _NO_SECTIONS}
            parameters = _parameters_of(sections, None if base is None else start.parameters)
            fit = _part(table, "fit")
            for afferent in sections:
                _check_equation(_part(fit, afferent), parameters[afferent])
        except ParameterError as error:
            raise ParameterError(f"{source}: {error}") from error
        finger, response = start.finger, _part(fit, "response")
        if "finger" in response:
            there = {"name": response["finger"], "sha256": response.get("finger_sha256")}
            finger = {key: str(value) for key, value in there.items() if value is not None}
        origin = {key: table[key] for key in _ORIGIN_KEYS if key in table}
        return cls(known.name, parameters, known.preindent_um, origin, finger)


@dataclass(frozen=True, slots=True)
class _Head:
    name: str
    preindent_um: float

    def __post_init__(self) -> None:
        if not 0 <= self.preindent_um <= _DEEPEST_UM:
            raise ParameterError(
                f"preindent_um is {self.preindent_um}, expected a number >= 0, at most "
                f"{_DEEPEST_UM:g}"
            )
        if not 0 < len(self.name) <= _LONGEST_NAME or not self.name.isprintable():
            raise ParameterError(
                f"name is {self.name[:40]!r}, expected 1 to {_LONGEST_NAME} printable characters"
            )


def parameter_set(wanted: str | Path | ParameterSet) -> ParameterSet:
    """A set by its name or of its file, or a set as it is.

    ``published`` is Table 2, ``fitted`` the default, ``fitted_pad`` for `fb.touch`. A path
    is a file's, and so is a word that is none of these.

    Raises
    ------
    UsageError
        A word that is neither a set's nor a file's.
    ParameterError
        No such file, not TOML, an unknown section or key, or a value outside its meaning.
    """
    if isinstance(wanted, ParameterSet):
        return wanted
    if wanted in SET_NAMES:
        return _shipped(str(wanted))
    path = Path(wanted)
    if isinstance(wanted, Path) or (wanted and (path.suffix or path.exists())):
        return ParameterSet.from_table(read_toml(path, ParameterError), path.stem, str(path))
    known = " or ".join(SET_NAMES)
    raise UsageError(f"no parameter set {wanted!r}, expected {known} or a TOML file")


@cache
def _shipped(name: str) -> ParameterSet:
    if name == "published":
        return ParameterSet(name, PUBLISHED, origin={"fit": {"source": "Ishizuka et al., Table 2"}})
    return parameter_set({"fitted": FITTED_FILE, "fitted_pad": PAD_FILE}[name])


def _parameters_of(sections: Table, base: Parameters | None) -> Parameters:
    """Parameters of all classes: of the `sections`, and what these leave out as in `base`."""
    chosen = dict(base or PUBLISHED)
    for afferent, section in sections.items():
        if afferent not in PUBLISHED:
            hint = near_hint(afferent, AFFERENTS)
            expected = ", ".join(AFFERENTS)
            raise ParameterError(f"unknown section {afferent!r}, expected {expected}{hint}")
        based = chosen[afferent]
        try:
            drive = section.get("drive", based.drive) if isinstance(section, dict) else based.drive
            kind = model_named(str(drive), afferent).parameters
            if base and kind is type(based):
                chosen[afferent] = changed(based, section, ParameterError)
            else:
                chosen[afferent] = structure(section, kind, ParameterError if base else _incomplete)
        except ParameterError as error:
            place = f"{afferent}: "
            raise ParameterError(f"{place}{str(error).removeprefix(place)}") from error
    if not base and (absent := [f"section {one}" for one in AFFERENTS if one not in sections]):
        raise _incomplete(f"{' and '.join(absent)}: absent")
    return MappingProxyType(chosen)


def _check_equation(row: Table, parameters: AfferentParameters) -> None:
    """Refuse parameters whose fit, of `row`, was with another equation than their model now has."""
    model = model_of(parameters)
    if row.get("drive", model.name) != model.name:
        return
    if row.get("equation", model.equation) != model.equation:
        raise ParameterError(
            f"{model.afferent}: fitted with another equation of {model.name} than this "
            "version's: fit it again"
        )


def _part(table: object, key: str) -> Table:
    """The table under `key`; an empty one where there is none."""
    part = table.get(key) if isinstance(table, Mapping) else None
    return dict(part) if isinstance(part, Mapping) else {}


def _incomplete(problem: str) -> ParameterError:
    """What is wrong with a file without a base, which perhaps lacks one."""
    if problem.endswith(": absent"):
        problem += '; a file of some classes or keys begins with base = "fitted" or "published"'
    return ParameterError(problem)


def parameters_to_table(parameters: Parameters) -> Table:
    """A table for TOML: a section for each class, every key."""
    return {name: one.by_name() for name, one in parameters.items()}
