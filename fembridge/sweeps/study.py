"""A study: all combinations of stimuli, fingers, probes, contacts and methods.

Each combination is a point. A study is a TOML file; unknown keys are errors::

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

All keys are in ``docs/sweeps.md``. File names are relative to the study's folder and below
it. Contact options that are not set follow the ladder of `fembridge.response.indentation`.
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
    located_errors,
)
from neural import ParameterSet, parameter_set
from neural.parameter_sets import SET_NAMES

ContactOptions = Mapping[str, Value]
"""Options of a contact model, by the names of `decks.analysis.Contact`."""

_MAX_BYTES, _MAX_KEYS = 10_000_000, 200_000
_MAX_NAME_LENGTH = 60
# Keys whose single value is read as a list of one.
_LIST_KEYS = ("stimuli", "methods", "preindent_um")


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """Every combination of stimuli, fingers, probes, contacts, depths and methods.

    `preindents_um` are depths of the probe before time 0, by default that of `parameters`;
    `seed` draws the noise, by default the catalogue's. `stored` selects the stored responses of
    the presets. `text` is the study file, copied into the sweep's folder.

    Raises
    ------
    UsageError
        No points, too many points, or values that exclude each other.
    """

    stimuli: tuple[Entry, ...]
    variants: tuple[Variant, ...]
    probes: tuple[Probe, ...] = (Probe(),)
    contacts: tuple[ContactOptions, ...] = ({},)
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
        shared = {name for item in self.contacts for name in item}
        varied = {name for item in self.variants for name in item.contact}
        for options in (*self.contacts, *(item.contact for item in self.variants if item.contact)):
            contact_ladder(options)
        transient = "transient" in self.methods
        energy = reading_energy(self.parameters.parameters)
        for is_wrong, problem in (
            (set(self.methods) - {*METHODS}, f"methods: {self.methods}, expected of {METHODS}"),
            (self.element not in ELEMENTS, f"element: {self.element!r}, expected of {ELEMENTS}"),
            (
                not all(0 <= item <= MAX_AMPLITUDE_UM for item in self.preindents_um),
                f"preindent_um: {self.preindents_um}, expected 0 to {MAX_AMPLITUDE_UM:g}",
            ),
            ((self.seed or 0) < 0, f"seed: {self.seed}, expected 0 or more"),
            (shared & varied, f"contacts: {shared & varied} is also set in fingers"),
            (self.stored and transient, "stored: not with the method transient"),
            (
                self.stored and shared | varied,
                "contacts: not with stored, which has its own contact model",
            ),
            (
                energy and transient,
                f"methods: the drive of {energy} reads strain energy, a transient gives only "
                "von Mises stress",
            ),
        ):
            if is_wrong:
                raise UsageError(problem)

    @property
    def points(self) -> int:
        """Number of combinations."""
        return math.prod(len(values) for values in self._factors().values())

    def _factors(self) -> dict[str, tuple[Any, ...]]:
        """Values to combine, by the keys of the study file."""
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
    """The keys of a study file."""

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
    """Study of a TOML file.

    Raises
    ------
    UsageError
        A missing file, no TOML, an unknown key (with suggestions), an invalid value,
        or too many points: one line with the file and the key.
    """
    table = read_toml(path, UsageError, _MAX_BYTES, _MAX_KEYS)
    with located_errors(str(path)):
        return study_from(table, path.parent, path.stem, path.read_text("utf-8-sig"))


def study_from(
    table: Mapping[str, object], folder: Path, name: str = "study", text: str = ""
) -> Study:
    """Study of a parsed TOML table, as `read_study`; file names are relative to `folder`."""
    listed = dict(table)
    for key in _LIST_KEYS:
        if key in table and not isinstance(table[key], list):
            listed[key] = [table[key]]
    fingers = table.get("fingers")
    if isinstance(fingers, list):
        listed["fingers"] = [
            {"base": entry} if isinstance(entry, str) else entry for entry in fingers
        ]
    options = structure(listed, _StudyTable, UsageError)
    with located_errors("stimuli"):
        stimuli = resolve(options.stimuli)
    with located_errors("probes"):
        probes = tuple(map(_probe, combinations(options.probes)))
    with located_errors("contacts"):
        contacts = tuple(combinations(options.contacts))
    with located_errors("parameters"):
        parameters_name = options.parameters
        if parameters_name not in SET_NAMES:
            check_below(parameters_name)
            if PurePosixPath(parameters_name).suffix or (folder / parameters_name).exists():
                parameters_name = str(folder / parameters_name)
        parameters = parameter_set(parameters_name)
    name = name if options.name is None else options.name
    if (
        not 0 < len(name) <= _MAX_NAME_LENGTH or not name.isprintable()
    ):  # shown in reports and pictures
        raise UsageError(f"name: {name!r}, expected 1 to {_MAX_NAME_LENGTH} characters")
    factors = (stimuli, options.methods, probes, contacts, options.preindent_um)
    return Study(
        stimuli=stimuli,
        variants=fingers_of(
            options.fingers, folder, math.prod(max(1, len(entry)) for entry in factors)
        ),
        probes=probes,
        contacts=contacts,
        methods=tuple(options.methods),
        parameters=parameters,
        preindents_um=tuple(options.preindent_um),
        seed=options.seed,
        element=options.element,
        stored=options.stored,
        name=name,
        text=text,
    )


def contact_ladder(options: ContactOptions) -> tuple[Contact, ...]:
    """Contact models of the ladder, each with `options` applied."""
    with located_errors("contacts"):
        return tuple(dict.fromkeys(changed(contact, options, UsageError) for contact in LADDER))


def _probe(row: Mapping[str, Value]) -> Probe:
    if "fillet_mm" in row and row.get("shape") != "flat":
        raise UsageError("fillet_mm: only with shape 'flat'")
    return structure(row, Probe, UsageError)
