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
stay below it. What contacts leave open follows the ladder of `fembridge.response.solve`.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from decks.analysis import ELEMENTS, Contact
from decks.probe import Probe
from decks.stimuli import MAX_AMPLITUDE_UM, Entry, resolve
from fembridge.errors import FembridgeError, UsageError
from fembridge.response.response_map import reading_energy
from fembridge.response.solve import LADDER
from fembridge.simulation import METHODS
from fembridge.store import changed, read_toml, structure
from fembridge.sweeps.fingers import (
    CONTACT_KEYS,
    FingersTable,
    Value,
    Variant,
    check_below,
    check_keys,
    check_points,
    combinations,
    fingers_of,
)
from neural import ParameterSet, parameter_set, parameter_set_or_file
from neural.parameter_sets import SET_NAMES

Asked = Mapping[str, Value]
"""What is asked of a contact model, by the names of `decks.analysis.Contact`."""

PROBE_KEYS = ("shape", "diameter_mm", "fillet_mm", "x_mm")

_MAX_BYTES = 10_000_000
_MAX_NAME = 60
# A flat probe's edges, where the study says nothing: as in the other verbs.
_FILLET_SHARE = 0.25
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
        for name, values in self._factors().items():
            if not values:
                raise UsageError(f"{name}: none, expected one or more")
        check_points(self.points)
        for name in ("stimuli", "probes", "methods", "preindent_um"):
            [(value, count)] = Counter(self._factors()[name]).most_common(1)
            if count > 1:
                raise UsageError(f"{name}: {value}: a duplicate")
        for method in self.methods:
            if method not in METHODS:
                raise UsageError(f"methods: {method!r}, expected {' or '.join(METHODS)}")
        if self.element not in ELEMENTS:
            raise UsageError(f"element: {self.element!r}, expected one of {', '.join(ELEMENTS)}")
        for depth_um in self.preindents_um:
            if not 0 <= depth_um <= MAX_AMPLITUDE_UM:
                raise UsageError(f"preindent_um: {depth_um}, expected 0 to {MAX_AMPLITUDE_UM:g}")
        if self.seed is not None and self.seed < 0:
            raise UsageError(f"seed: {self.seed}, expected 0 or more")
        self._check_contacts()
        energy = reading_energy(self.parameters.parameters)
        if energy and "transient" in self.methods:
            raise UsageError(
                f"methods: the drive of {energy} reads strain energy, a transient "
                "gives von Mises stress alone"
            )

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

    def _check_contacts(self) -> None:
        shared = {name for each in self.contacts for name in each}
        for asked in (*self.contacts, *(each.contact for each in self.variants if each.contact)):
            ladder_of(asked)
        for variant in self.variants:
            if both := sorted(shared.intersection(variant.contact)):
                raise UsageError(f"contacts: {both[0]} is asked of the fingers too")
        if self.stored and "transient" in self.methods:
            raise UsageError("stored: a stored response answers no transient")
        if self.stored and (shared or any(each.contact for each in self.variants)):
            raise UsageError("contacts: a stored response has its own")


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
    table = read_toml(path, UsageError, _MAX_BYTES)
    try:
        return study_from(table, path.parent, path.stem, path.read_text("utf-8-sig"))
    except FembridgeError as error:
        raise UsageError(f"{path}: {error}") from error


def study_from(
    table: Mapping[str, object], folder: Path, name: str = "study", text: str = ""
) -> Study:
    """Study of a table as TOML gives it; files are counted from `folder`.

    Raises
    ------
    UsageError
        What `read_study` refuses.
    """
    listed = dict(table)
    for key in _LISTS:
        if key in table and not isinstance(table[key], list):
            listed[key] = [table[key]]
    fingers = table.get("fingers")
    if isinstance(fingers, list):
        listed["fingers"] = [{"base": e} if isinstance(e, str) else e for e in fingers]
    asked = structure(listed, _StudyTable, UsageError)
    try:
        stimuli = resolve(asked.stimuli)
    except FembridgeError as error:
        raise UsageError(f"stimuli: {error}") from error
    probes = _rows(asked.probes, "probes", PROBE_KEYS)
    contacts = _rows(asked.contacts, "contacts", CONTACT_KEYS)
    counts = (stimuli, asked.methods, probes, contacts, asked.preindent_um)
    rest = math.prod(max(1, len(values)) for values in counts)
    return Study(
        stimuli=stimuli,
        variants=fingers_of(asked.fingers, folder, rest),
        probes=tuple(_probe(row, f"probes {k}") for k, row in enumerate(probes, 1)),
        contacts=tuple(contacts),
        methods=tuple(asked.methods),
        parameters=_parameters(asked.parameters, folder),
        preindents_um=tuple(asked.preindent_um),
        seed=asked.seed,
        element=asked.element,
        stored=asked.stored,
        name=_checked_name(name if asked.name is None else asked.name),
        text=text,
    )


def ladder_of(asked: Asked) -> tuple[Contact, ...]:
    """Contact models to try: the ladder's, with what is asked put in.

    Raises
    ------
    UsageError
        A name or a value that no contact model has.
    """
    try:
        return tuple(dict.fromkeys(changed(rung, asked, UsageError) for rung in LADDER))
    except UsageError as error:
        raise UsageError(f"contacts: {error}") from error


def _rows(
    entries: Sequence[Mapping[str, Any]], where: str, keys: Sequence[str]
) -> list[dict[str, Value]]:
    """Every combination of the values of each entry."""
    rows: list[dict[str, Value]] = []
    for k, entry in enumerate(entries, start=1):
        check_keys(entry, keys, f"{where} {k}")
        count, found = combinations(entry, f"{where} {k}")
        check_points(count)
        rows += found
    if not rows:
        raise UsageError(f"{where}: none, expected one or more")
    return rows


def _probe(row: Mapping[str, Value], where: str) -> Probe:
    entries = dict(row)
    flat = entries.get("shape") == "flat"
    if "fillet_mm" in entries and not flat:
        raise UsageError(f"{where}: fillet_mm is for shape 'flat'")
    diameter_mm = entries.get("diameter_mm", Probe().diameter_mm)
    if flat and isinstance(diameter_mm, float | int):
        widest_mm = _FILLET_SHARE * abs(diameter_mm)
        entries.setdefault("fillet_mm", min(Probe().fillet_mm, widest_mm))
    try:
        structure(entries, Probe, UsageError)
    except UsageError as error:
        raise UsageError(f"{where}: {error}") from error
    return Probe(**entries)  # type: ignore[arg-type] # as it is written: 1 stays 1


def _parameters(word: str, folder: Path) -> ParameterSet:
    try:
        if word not in SET_NAMES and PurePosixPath(word).suffix:
            check_below(word)
            word = str(folder / word)
        return parameter_set_or_file(word)
    except FembridgeError as error:
        raise UsageError(f"parameters: {error}") from error


def _checked_name(name: str) -> str:
    """A name that can be printed in reports and pictures."""
    if not 0 < len(name) <= _MAX_NAME or not name.isprintable():
        raise UsageError(f"name: {name!r}, expected 1 to {_MAX_NAME} characters")
    return name
