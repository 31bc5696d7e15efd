"""A study from TOML: strict, so that a slip of the pen is no week of computing.

::

    stimuli = ["noise_25_250", "sine_20_250"]
    methods = ["map"]                 # or "transient", or both
    parameters = "fitted"             # or "published", or a file

    [[fingers]]
    base = "quick"                    # or "paper", or a file
    [fingers.grid]                    # every combination
    skin.epidermis_mm = [0.3, 0.4, 0.5]
    materials.dermis.young_mpa = [0.04, 0.05]

    [[fingers]]
    design = "latin-hypercube"        # or "one-at-a-time"
    samples = 50
    [fingers.ranges]
    skin.dermis_mm = [0.9, 1.3]

    [[probes]]
    diameter_mm = [0.5, 1.0]

All keys are in ``docs/sweeps.md``. File names are counted from the study's folder
and stay below it.
"""

import math
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath

from decks.probe import Probe
from decks.stimuli import Entry, resolve
from fembridge.errors import FembridgeError, UsageError
from fembridge.sweep.study import Study, check_points
from fembridge.sweep.study_fingers import CONTACT_KEYS, fingers_of
from fembridge.sweep.toml_value import (
    below,
    check_keys,
    list_of,
    number_of,
    table_of,
    truth_of,
    values_of,
    word_of,
    words_of,
)
from fembridge.sweep.variant import Value, grid_rows, grid_size
from neural import SET_NAMES, ParameterSet, parameter_set_or_file

KEYS = (
    "name",
    "stimuli",
    "fingers",
    "probes",
    "contacts",
    "methods",
    "parameters",
    "preindent_um",
    "seed",
    "element",
    "stored",
)
PROBE_KEYS = ("shape", "diameter_mm", "fillet_mm", "x_mm")

_MAX_BYTES = 10_000_000
_MAX_NAME = 60
# A flat probe's edges, where the study does not tell: as in the other verbs.
_FILLET_SHARE = 0.25


def read_study(path: Path) -> Study:
    """Read the study that a TOML file describes.

    Raises
    ------
    UsageError
        No such file, not TOML, an unknown key (near ones are named), a value that
        cannot be, or more points than a study may have: one line that names the
        file and the key.
    """
    text = _text(path)
    try:
        return study_from(tomllib.loads(text), path.parent, path.stem, text)
    except (ValueError, RecursionError) as error:  # its own error is a ValueError
        raise UsageError(f"{path}: not readable as TOML: {error}") from error
    except FembridgeError as error:
        raise UsageError(f"{path}: {error}") from error


def study_from(
    table: Mapping[str, object], folder: Path, name: str = "study", text: str = ""
) -> Study:
    """Make a study of a table as TOML gives it; files are counted from `folder`.

    Raises
    ------
    UsageError
        What `read_study` refuses.
    """
    check_keys(table, KEYS, "the study")
    if "stimuli" not in table:
        raise UsageError("stimuli: absent, expected a list of ids or sets")
    stimuli = _stimuli(words_of(table["stimuli"], "stimuli"))
    methods = words_of(table.get("methods", ["map"]), "methods")
    fingers = list_of(table.get("fingers", ["quick"]), "fingers")
    probes = _combinations(table.get("probes", [{}]), "probes", PROBE_KEYS)
    contacts = _combinations(table.get("contacts", [{}]), "contacts", CONTACT_KEYS)
    depths = table.get("preindent_um", [])
    depths_um = [
        number_of(each, "preindent_um")
        for each in (depths if isinstance(depths, list) else [depths])
    ]
    rest = math.prod(max(1, len(values)) for values in (stimuli, methods, contacts, depths_um))
    rest *= len(probes)
    return Study(
        stimuli=stimuli,
        variants=tuple(fingers_of(fingers, folder, rest)),
        probes=tuple(_probe(row, f"probes {k}") for k, row in enumerate(probes, 1)),
        contacts=tuple(contacts),
        methods=tuple(methods),
        parameters=_parameters(table.get("parameters", "fitted"), folder),
        preindents_um=tuple(depths_um),
        seed=_seed(table.get("seed")),
        element=word_of(table.get("element", "CPE4"), "element"),
        stored=truth_of(table.get("stored", False), "stored"),
        name=_name(table.get("name", name)),
        text=text,
    )


def _stimuli(words: Sequence[str]) -> tuple[Entry, ...]:
    try:
        return resolve(words)
    except FembridgeError as error:
        raise UsageError(f"stimuli: {error}") from error


def _combinations(entries: object, where: str, keys: Sequence[str]) -> list[dict[str, Value]]:
    """Give every combination of the values of each entry, each once."""
    found: list[dict[str, Value]] = []
    for k, entry in enumerate(list_of(entries, where), start=1):
        table = table_of(entry, f"{where} {k}")
        check_keys(table, keys, f"{where} {k}")
        grid = {name: values_of(v, f"{where} {k}: {name}") for name, v in table.items()}
        check_points(grid_size(grid))
        found += grid_rows(grid)
    if not found:
        raise UsageError(f"{where}: none, expected one or more")
    return found


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
        return Probe(**entries)  # type: ignore[arg-type]
    except FembridgeError as error:
        raise UsageError(f"{where}: {error}") from error


def _parameters(word: object, folder: Path) -> ParameterSet:
    word = word_of(word, "parameters")
    if word not in SET_NAMES and PurePosixPath(word).suffix:
        word = str(folder / below(word, "parameters"))
    try:
        return parameter_set_or_file(word)
    except FembridgeError as error:
        raise UsageError(f"parameters: {error}") from error


def _text(path: Path) -> str:
    try:
        with path.open("rb") as file:
            content = file.read(_MAX_BYTES + 1)
        if len(content) > _MAX_BYTES:
            raise UsageError(f"{path}: over {_MAX_BYTES} bytes, not a study")
        return content.decode("utf-8-sig")  # Windows editors begin with a mark
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise UsageError(f"{path}: not UTF-8: {error}") from error
    except ValueError as error:  # a zero byte in the name
        raise UsageError(f"study {str(path)!r}: no name of a file") from error


def _seed(value: object) -> int | None:
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int):
        raise UsageError(f"seed: {value!r}, expected a whole number")
    return value


def _name(value: object) -> str:
    """Check a name: it stands in reports and pictures."""
    word = word_of(value, "name")
    if not 0 < len(word) <= _MAX_NAME or not word.isprintable():
        raise UsageError(f"name: {word!r}, expected 1 to {_MAX_NAME} characters")
    return word
