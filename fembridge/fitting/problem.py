"""Observed rates and the stress under each stimulus, made a problem for the search.

A group of stimuli is one objective: sinusoids of one frequency, diharmonics of one
pair of components, noises of one band.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from decks.finger_file import read_finger
from decks.probe import Probe
from decks.stimuli import DT_MS, Diharmonic, Entry, Noise, Sine, number_text, resolve
from decks.waveform import make_stimulus
from fembridge.errors import ResponseError, UsageError
from fembridge.observed import FAMILIES, ObservedRates
from fembridge.response.response_map import FOLDER, MAP_FILE, ResponseMap, read_map, stored_response
from fembridge.store import sha256_of
from fembridge.typing import Table
from neural.fit_problem import FitProblem
from neural.models import Model


def group_of(entry: Entry) -> str:
    """The group that `entry` is in: ``20 Hz``, ``10+50 Hz`` or ``5-25 Hz``."""
    numbers = [number_text(number) for number in entry.numbers().values()]
    match entry:
        case Sine():
            return f"{numbers[0]} Hz"
        case Diharmonic():
            return f"{numbers[0]}+{numbers[1]} Hz"
        case Noise():
            return f"{numbers[0]}-{numbers[1]} Hz"


def observed_entries(
    observed: ObservedRates, afferent: str, families: Sequence[str] = FAMILIES
) -> tuple[Entry, ...]:
    """Stimuli of `families` with an observed rate of `afferent`."""
    stimuli, _ = observed.of(afferent)
    entries = (resolve(stimulus)[0] for stimulus in stimuli)
    return tuple(entry for entry in entries if entry.family in families)


def fit_problem(
    observed: ObservedRates,
    response: ResponseMap,
    model: Model,
    *,
    families: Sequence[str] = FAMILIES[:1],
    preindent_um: float = 0.0,
    cells: int = 0,
) -> FitProblem:
    """What a fit of the class and model of `model` minimises.

    Stimuli are those of `families`, in the order of `observed`; each is counted in its own
    window. `preindent_um` is the depth of the probe before time 0; 0 `cells` are as many
    as the model has.

    Raises
    ------
    UsageError
        No observed rate of this class and these families.
    ResponseError
        No such afferent in `response`, or a stimulus deeper than it reaches.
    """
    entries = observed_entries(observed, model.afferent, families)
    if not entries:
        known = {entry.family for entry in observed_entries(observed, model.afferent)}
        raise UsageError(
            f"no observed rates of {model.afferent} of family "
            f"{' or '.join(families)}, only of {', '.join(sorted(known))}: "
            f"{observed.path}"
        )
    classes = [place.afferent for place in response.places]
    if model.afferent not in classes:
        raise ResponseError(f"no {model.afferent} in the response, only {', '.join(classes)}")
    column = classes.index(model.afferent)
    models = {model.afferent: model}
    stimuli = [make_stimulus(entry, preindent_um=preindent_um) for entry in entries]
    traces = [response.traces(each, models)[column] for each in stimuli]
    names, rate_ips = observed.of(model.afferent)
    by_name = dict(zip(names, rate_ips.tolist(), strict=True))
    return FitProblem(
        model=model,
        stress_pa=np.stack([trace.stress_pa for trace in traces], -1),
        observed_ips=np.array([by_name[entry.id] for entry in entries]),
        groups=tuple(map(group_of, entries)),
        windows_ms=tuple(entry.window_ms for entry in entries),
        dt_ms=DT_MS,
        cells=cells,
    )


# Where ``fembridge simulate`` keeps what it solved, below its output folder.
_SOLVED = "response"


@dataclass(frozen=True, slots=True, eq=False)
class ResponseSource:
    """A response map, the name of its file, and the SHA-256 of that."""

    response: ResponseMap
    name: str
    sha256: str
    stored: bool

    def to_table(self) -> Table:
        """Where the stress comes from, for TOML and without any path."""
        origin = self.response.origin
        finger = origin.get("finger")
        table: Table = {
            "source": "stored response" if self.stored else "solved response",
            "file": self.name,
            "sha256": self.sha256,
        }
        if isinstance(finger, dict) and "name" in finger:
            table["finger"] = str(finger["name"])
        for key in ("solver", "element", "deck_sha256"):
            if key in origin:
                table[key] = origin[key]
        if self.response.closure_percent == self.response.closure_percent:  # no NaN
            table["closure_percent"] = self.response.closure_percent
        return table


def stored_source(finger: str) -> ResponseSource:
    """The stored response of a reference finger, ``quick`` or ``paper``.

    Raises
    ------
    FingerError
        No such finger.
    ResponseError
        No response is stored for it.
    """
    response = stored_response(read_finger(finger), Probe(), "CPE4")
    path = FOLDER / f"{finger}.toml"
    return ResponseSource(response, path.name, sha256_of(path), stored=True)


def solved_source(place: Path) -> ResponseSource:
    """A response that was solved: its file, its folder, or simulate's output.

    Raises
    ------
    ResponseError
        There is none, or it is no whole response map.
    """
    path = place
    if place.is_dir():
        known = (place / MAP_FILE, place / _SOLVED / MAP_FILE)
        path = next(filter(Path.is_file, known), place)
        if path == place:
            raise ResponseError(
                f"{place}: no {MAP_FILE} here nor in {_SOLVED}/, expected what "
                "`fembridge simulate` keeps of a solved response"
            )
    return ResponseSource(read_map(path), path.name, sha256_of(path), stored=False)
