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

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
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

_HEAD_KEYS = ("name", "base", "preindent_um")
_ORIGIN_KEYS = ("name", "fit", "study")


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
        """As a run keeps it: a shipped set by its name, another one whole."""
        if self.name in SET_NAMES and parameter_set(self.name) is self:
            return {"name": self.name}
        return {
            "name": self.name,
            "preindent_um": self.preindent_um,
            **parameters_to_table(self.parameters),
            **({"fit": {"response": _response_table(self.finger)}} if self.finger else {}),
        }


@dataclass(frozen=True, slots=True)
class _Head:
    name: str
    preindent_um: float
    base: str = ""


@cache
def parameter_set(name: str) -> ParameterSet:
    """A shipped set: ``published``, Table 2, ``fitted``, or ``fitted_pad`` for `fb.touch`.

    Raises
    ------
    UsageError
        No set of that name.
    """
    if name == "published":
        return ParameterSet(name, PUBLISHED, origin={"fit": {"source": "Ishizuka et al., Table 2"}})
    if name == "fitted":
        return read_parameter_set(FITTED_FILE)
    if name == "fitted_pad":
        return read_parameter_set(PAD_FILE)
    raise UsageError(f"no parameter set {name!r}, expected {' or '.join(SET_NAMES)} or a TOML file")


def fitted_preindent_um() -> float:
    """Depth of the probe before time 0 in the fit of the shipped parameters."""
    return parameter_set("fitted").preindent_um


def parameter_set_or_file(word: str) -> ParameterSet:
    """A shipped set by its name, or that of the file `word`.

    Raises
    ------
    ParameterError
        Neither is there, or the file is none of parameters.
    """
    path = Path(word)
    if word and word not in SET_NAMES and (path.suffix or path.exists()):
        return read_parameter_set(path)
    return parameter_set(word)


def read_parameter_set(path: Path) -> ParameterSet:
    """A TOML file of parameters, with what they hold for.

    Raises
    ------
    ParameterError
        No such file, not TOML, an unknown section or key, or a value outside its meaning.
    """
    return parameter_set_of(read_toml(path, ParameterError), path.stem, str(path))


def parameter_set_of(table: Table, name: str, source: str) -> ParameterSet:
    """The set of a table as a file has it, or `ParameterSet.to_table` gives it.

    `name` is for one without; errors, as of `read_parameter_set`, begin with `source`.
    """
    if set(table) == {"name"}:
        return parameter_set(str(table["name"]))
    place = ""
    try:
        base = table.get("base")
        if base is not None and base not in SET_NAMES:
            raise ParameterError(f"base is {base!r}, expected {' or '.join(SET_NAMES)}")
        whole = base is None
        start = parameter_set(base or SET_NAMES[0])
        head = {key: table[key] for key in _HEAD_KEYS if key in table}
        known = changed(_Head(name, start.preindent_um), head, ParameterError)
        chosen = dict(start.parameters)
        if not (math.isfinite(known.preindent_um) and known.preindent_um >= 0):
            raise ParameterError(f"preindent_um is {known.preindent_um}, expected a number >= 0")
        for afferent, section in table.items():
            if afferent in (*_ORIGIN_KEYS, *_HEAD_KEYS):
                continue
            if afferent not in PUBLISHED:
                hint = near_hint(afferent, AFFERENTS)
                expected = ", ".join(AFFERENTS)
                raise ParameterError(f"unknown section {afferent!r}, expected {expected}{hint}")
            place = f"{afferent}: "
            based = chosen[afferent]
            drive = section.get("drive", based.drive) if isinstance(section, dict) else based.drive
            kind = model_named(str(drive), afferent).parameters
            if not whole and kind is type(based):
                chosen[afferent] = changed(based, section, ParameterError)
            else:
                chosen[afferent] = structure(
                    section, kind, _incomplete if whole else ParameterError
                )
            _check_equation(table.get("fit"), chosen[afferent])
        place = ""
        if whole and (absent := [f"section {one}" for one in AFFERENTS if one not in table]):
            raise _incomplete(f"{' and '.join(absent)}: absent")
    except ParameterError as error:
        raise ParameterError(f"{source}: {place}{str(error).removeprefix(place)}") from error
    origin = {key: table[key] for key in _ORIGIN_KEYS if key in table}
    fit = table.get("fit")
    response = fit.get("response") if isinstance(fit, dict) else None
    finger = start.finger
    if isinstance(response, dict) and "finger" in response:
        there = {"name": response["finger"], "sha256": response.get("finger_sha256")}
        finger = {key: str(value) for key, value in there.items() if value is not None}
    parameters = MappingProxyType(chosen)
    return ParameterSet(known.name, parameters, known.preindent_um, origin, finger)


def _check_equation(fit: object, parameters: AfferentParameters) -> None:
    """Refuse parameters whose `fit` was with another equation than their model now has."""
    model = model_of(parameters)
    row = fit.get(model.afferent) if isinstance(fit, dict) else None
    if not isinstance(row, dict) or row.get("drive", parameters.drive) != parameters.drive:
        return
    if row.get("equation", model.equation) != model.equation:
        words = f"fitted with another equation of {parameters.drive} than this version's"
        raise ParameterError(f"{words}: fit it again")


def _incomplete(problem: str) -> ParameterError:
    """What is wrong with a file without a base, which perhaps lacks one."""
    if problem.endswith(": absent"):
        problem += '; a file of some classes or keys begins with base = "fitted" or "published"'
    return ParameterError(problem)


def _response_table(finger: Mapping[str, str]) -> Table:
    return {"finger" if key == "name" else f"finger_{key}": word for key, word in finger.items()}


def parameters_to_table(parameters: Parameters) -> Table:
    """A table for TOML: a section for each class, every key."""
    return {name: asdict(one) for name, one in parameters.items()}
