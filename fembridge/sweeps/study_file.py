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

All keys are in ``docs/how_to/sweeps.md``. File names are relative to the study's folder and below
it. Contact options that are not set follow the ladder of `fembridge.response.indentation`.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from decks.contact_analysis import ELEMENTS, Contact
from decks.probe import Probe
from decks.stimuli import MAX_AMPLITUDE_UM, Entry, resolve
from fembridge.errors import FembridgeError, UsageError
from fembridge.host.store import changed, read_toml, structure
from fembridge.response.indentation import LADDER
from fembridge.response.response_map import reading_energy
from fembridge.simulation import METHODS
from fembridge.sweeps.fingers import (
    FingersTable,
    Value,
    Variant,
    check_below,
    check_points,
    combinations,
    fingers_of,
    located_errors,
    numbered,
)
from fembridge.sweeps.own_decks import DeckModel, DeckTable, decks_of
from neural import ParameterSet, parameter_set
from neural.parameter_sets import SET_NAMES

if TYPE_CHECKING:
    import pandas as pd

ContactOptions = Mapping[str, Value]
"""Options of a contact model, by the names of `decks.contact_analysis.Contact`."""

_MAX_BYTES, _MAX_KEYS = 10_000_000, 200_000
_MAX_NAME_LENGTH = 60
_PROBE_COLUMNS = tuple(f"probe_{name}" for name in ("shape", "diameter_mm", "fillet_mm", "x_mm"))
# Columns of a DataFrame with the values of a list of the study.
_LIST_COLUMNS = {"method": "methods", "preindent_um": "preindent_um"}
# Columns of a DataFrame that are keys of a deck.
_DECK_COLUMNS = tuple(field.name for field in fields(DeckTable))
# Keys whose single value is read as a list of one.
_LIST_KEYS = ("stimuli", "methods", "preindent_um")


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """Every combination of stimuli, fingers, probes, contacts, depths and methods.

    `decks` are own decks instead of fingers. `preindents_um` are depths of the probe before time
    0, by default that of `parameters`, of own decks 0;
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
    decks: tuple[DeckModel, ...] = ()

    def __post_init__(self) -> None:
        if not self.preindents_um:
            default_um = 0.0 if self.decks else self.parameters.preindent_um
            object.__setattr__(self, "preindents_um", (default_um,))
        factors = self._factors()
        for name, values in factors.items():
            if not values:
                raise UsageError(argument=name, found=[], expected="one or more")
        check_points(self.points)
        for name in ("stimuli", "probes", "methods", "preindent_um"):
            [(value, count)] = Counter(factors[name]).most_common(1)
            if count > 1:
                raise UsageError(f"has {value} more than once", argument=name, found=value)
        shared = {name for item in self.contacts for name in item}
        varied = {name for item in self.variants for name in item.contact}
        for options in (*self.contacts, *(item.contact for item in self.variants if item.contact)):
            contact_ladder(options)
        transient = "transient" in self.methods
        energy = reading_energy(self.parameters.parameters)
        for argument, values, expected, accepts in (
            ("methods", self.methods, " or ".join(METHODS), METHODS.__contains__),
            ("element", (self.element,), f"one of {', '.join(ELEMENTS)}", ELEMENTS.__contains__),
            (
                "preindent_um",
                self.preindents_um,
                f"0 to {MAX_AMPLITUDE_UM:g}",
                lambda depth_um: 0 <= depth_um <= MAX_AMPLITUDE_UM,
            ),
            ("seed", (self.seed or 0,), "0 or more", lambda seed: seed >= 0),
        ):
            for value in values:
                if not accepts(value):
                    raise UsageError(argument=argument, found=value, expected=expected)
        has_options = self.probes != (Probe(),) or self.contacts != ({},)
        for is_wrong, argument, problem in (
            (
                self.decks and (self.variants or has_options or self.stored),
                "base_decks",
                "cannot be combined with fingers, probes, contacts or stored",
            ),
            (
                self.decks and transient,
                "methods",
                "has transient, base_decks have maps; solve each waveform of a deck by build-deck "
                "--base-deck and run",
            ),
            (shared & varied, "contacts", f"has {shared & varied}, which fingers has as well"),
            (self.stored and transient, "stored", "cannot be combined with the method transient"),
            (
                self.stored and shared | varied,
                "contacts",
                "cannot be combined with stored, which has its own contact model",
            ),
            (
                energy and transient,
                "methods",
                f"has transient, which gives only von Mises stress; the drive of {energy} reads "
                "strain energy",
            ),
        ):
            if is_wrong:
                raise UsageError(problem, argument=argument)

    @property
    def points(self) -> int:
        """Number of combinations."""
        return math.prod(len(values) for values in self._factors().values())

    def _factors(self) -> dict[str, tuple[Any, ...]]:
        """Values to combine, by the keys of the study file."""
        return {
            "stimuli": self.stimuli,
            **({"base_decks": self.decks} if self.decks else {"fingers": self.variants}),
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
    fingers: list[FingersTable] | None = None
    base_decks: list[DeckTable] = field(default_factory=list)
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
    try:
        return study_from(table, path.parent, path.stem, path.read_text("utf-8-sig"))
    except FembridgeError as error:
        raise UsageError.from_error(error, path, "") from error


def study_from(
    table: Mapping[str, object], folder: Path, name: str = "study", text: str = ""
) -> Study:
    """Study of a parsed TOML table, as `read_study`; file names are relative to `folder`."""
    if "touches" in table:
        raise UsageError("is for fembridge.touch_many", key="touches")
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
    with located_errors(""):
        probe_rows = combinations(numbered("probes", options.probes))
        contacts = tuple(combinations(numbered("contacts", options.contacts)))
    with located_errors("probes"):
        probes = tuple(map(_probe, probe_rows))
    with located_errors(""):
        parameters_name = options.parameters
        if parameters_name not in SET_NAMES:
            check_below("parameters", parameters_name)
            if PurePosixPath(parameters_name).suffix or (folder / parameters_name).exists():
                parameters_name = str(folder / parameters_name)
        parameters = parameter_set(parameters_name)
    name = name if options.name is None else options.name
    if (
        not 0 < len(name) <= _MAX_NAME_LENGTH or not name.isprintable()
    ):  # shown in reports and pictures
        raise UsageError(
            key="name",
            found=name[:_MAX_NAME_LENGTH],
            expected=f"1 to {_MAX_NAME_LENGTH} printable characters",
        )
    decks = decks_of(options.base_decks, folder)
    fingers_tables = options.fingers
    if fingers_tables is None:
        fingers_tables = [] if decks else [FingersTable()]
    factors = (stimuli, options.methods, probes, contacts, options.preindent_um)
    return Study(
        stimuli=stimuli,
        variants=fingers_of(
            fingers_tables, folder, math.prod(max(1, len(entry)) for entry in factors)
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
        decks=decks,
    )


def study_from_frame(frame: "pd.DataFrame") -> Study:
    """Study of a DataFrame with one row per point, see `fembridge.sweep`.

    Raises
    ------
    UsageError
        An unknown column, or rows that are not every combination of stimuli, fingers, probes,
        pre-indentations and methods.
    """
    changes = [name for name in frame.columns if "." in str(name)]
    probe_columns = [name for name in frame.columns if name in _PROBE_COLUMNS]
    deck_columns = [name for name in _DECK_COLUMNS if name in frame.columns]
    accepted = {"stimulus", "finger", *_LIST_COLUMNS, *changes, *probe_columns, *deck_columns}
    for name in frame.columns.difference(list(accepted)):
        raise UsageError(f"has an unknown column {name!r}", argument="study")
    if "stimulus" not in frame.columns:
        raise UsageError("has no column 'stimulus'", argument="study")

    def distinct(columns: Sequence[str]) -> list[dict[str, Any]]:
        present = [name for name in columns if name in frame.columns]
        rows = [
            {str(name): _plain(value) for name, value in row.items() if not _is_blank(value)}
            for row in frame[present].astype(object).to_dict("records")
        ]
        return list({repr(row): row for row in rows}.values()) if present else [{}]

    fingers = [
        {"base": row.pop("finger", "quick"), "rows": [row]}
        for row in distinct(["finger", *changes])
    ]
    probes = [
        {name.removeprefix("probe_"): value for name, value in row.items()}
        for row in distinct(probe_columns)
    ]
    table: dict[str, Any] = {"fingers": fingers, "probes": probes}
    if deck_columns:
        table = {"base_decks": distinct(deck_columns)}
        of_fingers = {"finger", *changes, *probe_columns}
        for name in filter(of_fingers.__contains__, frame.columns):
            raise UsageError(f"has {name!r}, a study of own decks has none", argument="study")
    for column, key in {"stimulus": "stimuli", **_LIST_COLUMNS}.items():
        if column in frame.columns:
            table[key] = [row[column] for row in distinct([column])]
    study = study_from(table, Path.cwd())
    rows = len(distinct(list(frame.columns)))
    if study.points != rows:
        raise UsageError(
            f"has {rows} different rows, expected {study.points}: every combination of stimuli, "
            "fingers or decks, probes, pre-indentations and methods",
            argument="study",
        )
    return study


def _is_blank(value: Any) -> bool:  # noqa: ANN401 - a cell of a DataFrame
    return value is None or (isinstance(value, float) and math.isnan(value))


def _plain(value: Any) -> Any:  # noqa: ANN401 - a cell of a DataFrame
    """Python number of a NumPy one."""
    return value.item() if hasattr(value, "item") else value


def contact_ladder(options: ContactOptions) -> tuple[Contact, ...]:
    """Contact models of the ladder, each with `options` applied."""
    with located_errors("contacts"):
        return tuple(dict.fromkeys(changed(contact, options, UsageError) for contact in LADDER))


def _probe(row: Mapping[str, Value]) -> Probe:
    if "fillet_mm" in row and row.get("shape") != "flat":
        raise UsageError("is for the shape 'flat' only", key="fillet_mm")
    return structure(row, Probe, UsageError)
