"""A study: which stimuli on which fingers, with which probes, contacts and methods.

Every combination is a point. It is a TOML file, read strictly, so that a slip of the
pen is no week of computing::

    stimuli = ["noise_25_250", "sine_20_250"]
    methods = ["map"]                 # or "transient", or both
    parameters = "fitted"             # or "published", or a file

    [[fingers]]
    base = "quick"                    # or "paper", or a file
    [fingers.grid]                    # every combination
    skin.epidermis_mm = [0.3, 0.4, 0.5]
    materials.dermis.young_mpa = [0.04, 0.05]

    [[probes]]
    diameter_mm = [0.5, 1.0]

All keys are in ``docs/sweeps.md``. File names are counted from the study's folder and
stay below it. What contacts leave open follows the ladder of `fembridge.response.indentation`.
"""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from decks.analysis import ELEMENTS, Contact
from decks.probe import Probe
from decks.stimuli import MAX_AMPLITUDE_UM, Entry, resolve
from fembridge.errors import UsageError
from fembridge.response.indentation import LADDER
from fembridge.response.response_map import reading_energy
from fembridge.simulation import METHODS
from fembridge.store import changed, read_toml, structure
from fembridge.sweeps.fingers import (
    FingersTable,
    Value,
    Variant,
    check_below,
    check_points,
    combinations,
    fingers_of,
    naming,
)
from neural import ParameterSet, parameter_set
from neural.parameter_sets import SET_NAMES

Asked = Mapping[str, Value]
"""What is asked of a contact model, by the names of `decks.analysis.Contact`."""

_MAX_BYTES, _MAX_KEYS = 10_000_000, 200_000
_MAX_NAME = 60
# Keys of which a single value stands for a list of one.
_LISTS = ("stimuli", "methods", "preindent_um")


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """Every combination of stimuli, fingers, probes, contacts, depths and methods.

    `preindents_um` are depths of the probe before time 0; `seed` draws other noise
    than the catalogue's. `stored` takes the stored responses of the reference
    fingers. `text` is that of the study's file, for the copy beside the results.

    Raises
    ------
    UsageError
        Nothing to do, too many points, or values that do not go together.
    """

    stimuli: tuple[Entry, ...]
    variants: tuple[Variant, ...]
    probes: tuple[Probe, ...] = (Probe(),)
    contacts: tuple[Asked, ...] = ({},)
    methods: tuple[str, ...] = ("map",)
    parameters: ParameterSet = field(default_factory=lambda: parameter_set("fitted"))
    preindents_um: tuple[float, ...] = ()
    seed: int | None = None
    element: str = "CPE4"
    stored: bool = False
    name: str = "study"
    text: str = ""

    def __post_init__(self) -> None:
        if not self.preindents_um:
            object.__setattr__(self, "preindents_um", (self.parameters.preindent_um,))
        factors = self._factors()
        for name, values in factors.items():
            if not values:
                raise UsageError(f"{name}: none, expected one or more")
        check_points(self.points)
        for name in ("stimuli", "probes", "methods", "preindent_um"):
            [(value, count)] = Counter(factors[name]).most_common(1)
            if count > 1:
                raise UsageError(f"{name}: {value}: a duplicate")
        of_all = {name for each in self.contacts for name in each}
        of_fingers = {name for each in self.variants for name in each.contact}
        for asked in (*self.contacts, *(each.contact for each in self.variants if each.contact)):
            ladder_of(asked)
        transient = "transient" in self.methods
        energy = reading_energy(self.parameters.parameters)
        for wrong, problem in (
            (set(self.methods) - {*METHODS}, f"methods: {self.methods}, expected of {METHODS}"),
            (self.element not in ELEMENTS, f"element: {self.element!r}, expected of {ELEMENTS}"),
            (
                not all(0 <= each <= MAX_AMPLITUDE_UM for each in self.preindents_um),
                f"preindent_um: {self.preindents_um}, expected 0 to {MAX_AMPLITUDE_UM:g}",
            ),
            ((self.seed or 0) < 0, f"seed: {self.seed}, expected 0 or more"),
            (of_all & of_fingers, f"contacts: {of_all & of_fingers} is asked of the fingers too"),
            (self.stored and transient, "stored: a stored response answers no transient"),
            (
                self.stored and of_all | of_fingers,
                "contacts: a stored response has its own",
            ),
            (
                energy and transient,
                f"methods: the drive of {energy} reads strain energy, a transient gives von "
                "Mises stress alone",
            ),
        ):
            if wrong:
                raise UsageError(problem)

    @property
    def points(self) -> int:
        """How many combinations there are."""
        return math.prod(len(values) for values in self._factors().values())

    def _factors(self) -> dict[str, tuple[Any, ...]]:
        """What is combined, by the names of the study's file."""
        return {
            "stimuli": self.stimuli,
            "fingers": self.variants,
            "probes": self.probes,
            "contacts": self.contacts,
            "methods": self.methods,
            "preindent_um": self.preindents_um,
        }


@dataclass(frozen=True, slots=True)
class _StudyTable:
    """The keys of a study's file."""

    stimuli: list[str]
    name: str | None = None
    fingers: list[FingersTable] = field(default_factory=lambda: [FingersTable()])
    probes: list[dict[str, Any]] = field(default_factory=lambda: [{}])
    contacts: list[dict[str, Any]] = field(default_factory=lambda: [{}])
    methods: list[str] = field(default_factory=lambda: ["map"])
    parameters: str = "fitted"
    preindent_um: list[float] = field(default_factory=list)
    seed: int | None = None
    element: str = "CPE4"
    stored: bool = False


def read_study(path: Path) -> Study:
    """Study that a TOML file describes.

    Raises
    ------
    UsageError
        No such file, not TOML, an unknown key (near ones are named), a value that
        cannot be, or more points than a study may have: one line that names the
        file and the key.
    """
    table = read_toml(path, UsageError, _MAX_BYTES, _MAX_KEYS)
    with naming(str(path)):
        return study_from(table, path.parent, path.stem, path.read_text("utf-8-sig"))


def study_from(
    table: Mapping[str, object], folder: Path, name: str = "study", text: str = ""
) -> Study:
    """Study of a table as TOML gives it, as `read_study`; files are counted from `folder`."""
    listed = dict(table)
    for key in _LISTS:
        if key in table and not isinstance(table[key], list):
            listed[key] = [table[key]]
    fingers = table.get("fingers")
    if isinstance(fingers, list):
        listed["fingers"] = [{"base": e} if isinstance(e, str) else e for e in fingers]
    asked = structure(listed, _StudyTable, UsageError)
    with naming("stimuli"):
        stimuli = resolve(asked.stimuli)
    with naming("probes"):
        probes = tuple(map(_probe, combinations(asked.probes)))
    with naming("contacts"):
        contacts = tuple(combinations(asked.contacts))
    with naming("parameters"):
        word = asked.parameters
        if word not in SET_NAMES:
            check_below(word)
            if PurePosixPath(word).suffix or (folder / word).exists():
                word = str(folder / word)
        parameters = parameter_set(word)
    name = name if asked.name is None else asked.name
    if not 0 < len(name) <= _MAX_NAME or not name.isprintable():  # in reports and pictures
        raise UsageError(f"name: {name!r}, expected 1 to {_MAX_NAME} characters")
    others = (stimuli, asked.methods, probes, contacts, asked.preindent_um)
    return Study(
        stimuli=stimuli,
        variants=fingers_of(asked.fingers, folder, math.prod(max(1, len(e)) for e in others)),
        probes=probes,
        contacts=contacts,
        methods=tuple(asked.methods),
        parameters=parameters,
        preindents_um=tuple(asked.preindent_um),
        seed=asked.seed,
        element=asked.element,
        stored=asked.stored,
        name=name,
        text=text,
    )


def ladder_of(asked: Asked) -> tuple[Contact, ...]:
    """Contact models to try: the ladder's, with what is asked put in."""
    with naming("contacts"):
        return tuple(dict.fromkeys(changed(each, asked, UsageError) for each in LADDER))


def _probe(row: Mapping[str, Value]) -> Probe:
    if "fillet_mm" in row and row.get("shape") != "flat":
        raise UsageError("fillet_mm is for shape 'flat'")
    return structure(row, Probe, UsageError)
