"""Fit problem from observed rates and the stress under each stimulus.

A group of stimuli is one objective: sinusoids of one frequency, diharmonics of one
pair of components, or noises of one band.
"""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from decks.presets import read_finger
from decks.probe import Probe
from decks.stimuli import Diharmonic, Entry, Noise, Ramp, Sine, number_text, resolve
from decks.synthesis import make_stimulus
from fembridge.errors import ParameterError, UsageError
from fembridge.evidence import CRITERIA
from fembridge.fitting.thresholds import vibration
from fembridge.host.store import sha256_of
from fembridge.io.observed_rates import FAMILIES, ObservedRates
from fembridge.io.spike_table import SpikeTrain
from fembridge.response.response_map import (
    FOLDER,
    ResponseLike,
    ResponseMap,
    load_response,
    map_file,
    read_map,
    stored_response,
)
from fembridge.stimulus import Stimulus
from fembridge.trace import model_id
from fembridge.typing import Table
from neural.fit_problem import (
    DISTANCES,
    FitProblem,
    PhaseTarget,
    Target,
    ThresholdTarget,
    TimingTarget,
)
from neural.models import DEFAULT_MODELS, MODELS, AfferentModel, model_named
from neural.parameter_sets import parameter_set

if TYPE_CHECKING:
    import pandas

    from decks.finger import Finger
    from fembridge.touching.pad import Pad
    from fembridge.touching.pad_probe import PadProbe

_LOGGER = logging.getLogger(__name__)

# Time constant of spike distances: the assumed temporal precision of a spike.
SPIKE_TAU_MS = 5.0

ALL = "all"
"""All classes, all families, all groups."""


def group_of(entry: Entry) -> str:
    """Group of `entry`: ``20 Hz``, ``10+50 Hz`` or ``5-25 Hz``."""
    numbers = [number_text(number) for number in entry.numbers().values()]
    match entry:
        case Sine():
            return f"{numbers[0]} Hz"
        case Diharmonic():
            return f"{numbers[0]}+{numbers[1]} Hz"
        case Noise():
            return f"{numbers[0]}-{numbers[1]} Hz"
        case Ramp():
            return entry.family


def observed_entries(
    observed: ObservedRates, afferent: str, families: Sequence[str] = FAMILIES
) -> tuple[Entry, ...]:
    """Stimuli of `families` with an observed rate of `afferent`."""
    stimuli, _ = observed.rates_of(afferent)
    entries = (resolve(stimulus)[0] for stimulus in stimuli)
    return tuple(entry for entry in entries if entry.family in families)


def checked_model(name: str) -> str:
    """`name`, after a check that it is an afferent model; raises UsageError otherwise."""
    if name not in MODELS:
        raise UsageError(
            argument="drive",
            found=name,
            expected=f"one of {', '.join(MODELS)}; `fembridge fit --drive list` describes them",
        )
    return name


def models_to_fit(
    observed: ObservedRates,
    afferents: Sequence[str] | None,
    drive: str | None,
    families: Sequence[str],
) -> dict[str, AfferentModel]:
    """Model of each class of `afferents`; for all classes, those with rates and the model."""
    drive_models = MODELS[checked_model(drive)] if drive else DEFAULT_MODELS
    is_all = afferents is None or ALL in afferents
    classes = list(dict.fromkeys(observed.afferents if is_all else afferents or ()))
    for name in classes:
        observed.rates_of(name)  # raises where the class was not observed
    if is_all:
        with_rates = [name for name in classes if observed_entries(observed, name, families)]
        for selected, reason in (
            (with_rates, f"no observed rates of family {' or '.join(families)}"),
            (drive_models, f"model {drive!r} exists for {', '.join(drive_models)}"),
        ):
            if selected and (left_out := [name for name in classes if name not in selected]):
                _LOGGER.info(f"{', '.join(left_out)} left out: {reason}")
                classes = [name for name in classes if name in selected]
    try:
        return {name: model_named(drive or DEFAULT_MODELS[name], name) for name in classes}
    except ParameterError as error:
        raise UsageError.from_error(error) from error


def fit_problem(
    observed: ObservedRates,
    response: ResponseMap,
    model: AfferentModel,
    *,
    families: Sequence[str] = FAMILIES[:1],
    preindent_um: float = 0.0,
    cells: int = 0,
    targets: Sequence[Target] = (),
) -> FitProblem:
    """Fit problem of `model` and the observed rates of its class.

    Parameters
    ----------
    observed
        Observed rates.
    response
        Response map with the stress of the class.
    model
        Afferent model.
    families
        Families of stimuli, in the order of `observed`. Default: sinusoids. Spikes are
        counted in the window of each stimulus.
    preindent_um
        Depth of the probe before time 0, in um. Default: 0.
    cells
        Cells of a candidate. Default: the number of the model.
    targets
        Objectives other than rates. Default: none.

    Raises
    ------
    UsageError
        No observed rates of the class and these families.
    ResponseError
        `response` lacks the class or is too shallow.
    """
    entries = observed_entries(observed, model.afferent, families)
    if not entries:
        families_with_rates = {entry.family for entry in observed_entries(observed, model.afferent)}
        raise UsageError(
            f"no observed rates of {model.afferent} of family "
            f"{' or '.join(families)}, only of {', '.join(sorted(families_with_rates))}",
            observed.path,
        )
    stimuli = [make_stimulus(entry, preindent_um, dt_ms=model.step_ms) for entry in entries]
    names, rate_ips = observed.rates_of(model.afferent)
    rate_by_stimulus = dict(zip(names, rate_ips.tolist(), strict=True))
    return FitProblem(
        model=model,
        stress_pa=response.stress_pa(model, stimuli),
        observed_ips=np.array([rate_by_stimulus[entry.id] for entry in entries]),
        groups=tuple(map(group_of, entries)),
        windows_ms=tuple(entry.window_ms for entry in entries),
        dt_ms=model.step_ms,
        cells=cells,
        targets=tuple(targets),
    )


# Amplitudes per observed threshold: nine, from a quarter of it to four times it.
_LEVELS, _AROUND = 9, 4.0

# Cycles of its vibrations; the first is not counted for one impulse per cycle.
_CYCLES = 3.0


def threshold_target(
    observed: "pandas.DataFrame",
    response: ResponseMap,
    model: AfferentModel,
    preindent_um: float = 0.0,
) -> ThresholdTarget | None:
    """Objective of the thresholds of a class; None where `response` reaches none."""
    deepest_um = response.deepest_um - preindent_um
    rows = observed[
        (observed["afferent"] == model.afferent) & (observed["amplitude_um"] < deepest_um)
    ]
    if rows.empty:
        return None
    waves: list[Stimulus] = []
    levels, needed, windows = [], [], []
    for criterion, frequency_hz, amplitude_um in zip(
        rows["criterion"], rows["frequency_hz"], rows["amplitude_um"], strict=True
    ):
        most_um = min(amplitude_um * _AROUND, deepest_um)
        levels.append(np.geomspace(amplitude_um / _AROUND, most_um, _LEVELS))
        waves += [
            vibration(frequency_hz, level_um, preindent_um, model.step_ms, _CYCLES)
            for level_um in levels[-1]
        ]
        cycle_ms, end_ms = 1000.0 / frequency_hz, waves[-1].window_ms[1]
        cycles = math.floor(end_ms / cycle_ms + 1e-9) - 1
        is_first_impulse = criterion == CRITERIA[0]
        needed.append(1 if is_first_impulse else cycles)
        windows.append((0.0, end_ms) if is_first_impulse else (cycle_ms, (cycles + 1) * cycle_ms))
    stress_pa = response.stress_pa(model, waves)
    return ThresholdTarget(
        stress_pa=stress_pa.reshape(len(stress_pa), -1, _LEVELS, stress_pa.shape[2]),
        amplitudes_um=np.array(levels),
        observed_um=rows["amplitude_um"].to_numpy(np.float64),
        needed=np.array(needed),
        windows_ms=tuple(windows),
    )


def phase_target(
    observed: "pandas.DataFrame",
    response: ResponseMap,
    model: AfferentModel,
    preindent_um: float = 0.0,
) -> PhaseTarget | None:
    """Objective of the vector strengths of a class; None where none was observed.

    `observed` has ``afferent, frequency_hz, amplitude_um, strength_f, strength_2f``.
    """
    rows = observed[observed["afferent"] == model.afferent]
    if rows.empty:
        return None
    waves = [
        vibration(frequency_hz, amplitude_um, preindent_um, model.step_ms)
        for frequency_hz, amplitude_um in zip(
            rows["frequency_hz"], rows["amplitude_um"], strict=True
        )
    ]
    return PhaseTarget(
        stress_pa=response.stress_pa(model, waves),
        frequencies_hz=rows["frequency_hz"].to_numpy(np.float64),
        strengths=rows[["strength_f", "strength_2f"]].to_numpy(np.float64),
    )


def timing_target(
    trains: Sequence[SpikeTrain],
    response: ResponseMap,
    model: AfferentModel,
    preindent_um: float = 0.0,
    distance: str = DISTANCES[0],
) -> TimingTarget | None:
    """Objective of the spike times of a class; None where none was recorded."""
    recorded = [train for train in trains if train.afferent == model.afferent]
    if not recorded:
        return None
    ids = list(dict.fromkeys(train.stimulus for train in recorded))
    stimuli = [make_stimulus(resolve(name)[0], preindent_um, dt_ms=model.step_ms) for name in ids]
    if len({stimulus.displacement_um.size for stimulus in stimuli}) > 1:
        raise UsageError(
            f"stimuli of the spikes have unequal lengths, expected equal: {', '.join(ids)}"
        )
    return TimingTarget(
        stress_pa=response.stress_pa(model, stimuli),
        trains_ms=tuple(
            tuple(train.times_ms for train in recorded if train.stimulus == name) for name in ids
        ),
        tau_ms=SPIKE_TAU_MS,
        distance=distance,
    )


@dataclass(frozen=True, slots=True, eq=False)
class ResponseSource:
    """Response map and its file, if any; `stored` where it is shipped with fembridge.

    `units` are those that a user chose, ``SA=12``; of other classes that with the largest stress
    is taken.
    """

    response: ResponseMap
    path: Path | None = None
    stored: bool = False
    units: tuple[str, ...] = ()

    @property
    def parameters(self) -> str:
        """Shipped parameter set that was fitted on such mechanics."""
        return "fitted_pad" if "mechanics" in self.response.origin else "fitted"

    @property
    def preindent_um(self) -> float:
        """Depth of the probe before time 0 by default, in um."""
        return 0.0 if self.response.is_of_deck else parameter_set(self.parameters).preindent_um

    def to_table(self) -> Table:
        """Description of the response map for TOML, without paths."""
        origin, closure_percent = self.response.origin, self.response.closure_percent
        identity = model_id(origin)
        is_of_pad = "mechanics" in origin
        source = "probe on a pad" if is_of_pad else "solved response"
        table = {
            "source": "stored response" if self.stored else source,
            "file": None if self.path is None else self.path.name,
            "sha256": None if self.path is None else sha256_of(self.path),
            "finger": identity.get("name"),
            "finger_sha256": identity.get("sha256"),
            **{key: origin.get(key) for key in ("solver", "element", "deck_sha256")},
            "closure_percent": None if math.isnan(closure_percent) else closure_percent,
            "units": list(self.units) or None,
            **{key: identity.get(key) for key in ("pad", "ridges", "probe")},
            "pad_sha256": origin["pad"].get("sha256") if is_of_pad else None,
            "at_mm": [origin["probe"][key] for key in ("x_mm", "z_mm")] if is_of_pad else None,
            "positions": len(origin["positions_mm"]) if is_of_pad else None,
        }
        return {key: value for key, value in table.items() if value is not None}


def response_source(
    finger: "str | Finger | None" = None,
    response: "ResponseLike | None" = None,
    units: Sequence[str] = (),
    pad: "str | Path | Pad | PadProbe | None" = None,
) -> ResponseSource:
    """Response of a map or file, of a probe on a pad, or the stored one of a finger (``quick``).

    `units` are those of `ResponseMap.with_units`.

    Raises
    ------
    UsageError
        Two of the arguments, a unit that the map lacks, or no such pad.
    ResponseError
        No response is stored for this finger, or a file that is not a response.
    """
    if units:
        source = response_source(finger, response, (), pad)
        return replace(source, response=source.response.with_units(units), units=tuple(units))
    if pad is not None:
        for argument, value in (("finger", finger), ("response", response)):
            if value is not None:
                raise UsageError("cannot be combined with a pad", argument=argument)
        from fembridge.touching.pad_probe import pad_probe

        return ResponseSource(pad_probe(pad).response)
    if response is None:
        return stored_source(finger or "quick")
    if finger is not None:
        raise UsageError("cannot be combined with a response", argument="finger")
    if isinstance(response, str | PathLike):
        return solved_source(Path(response))
    return ResponseSource(load_response(response))


def stored_source(finger: "str | Finger", depth_um: float = 0.0) -> ResponseSource:
    """Stored response of a reference finger, ``quick`` or ``paper``, down to `depth_um`."""
    loaded_finger = read_finger(finger) if isinstance(finger, str) else finger
    response = stored_response(loaded_finger, Probe(), "CPE4", depth_um=depth_um)
    return ResponseSource(response, FOLDER / f"{loaded_finger.name}.toml", stored=True)


def solved_source(path: Path) -> ResponseSource:
    """Solved response from its file, or the output folder of ``map`` or ``simulate``."""
    path = map_file(path)
    return ResponseSource(read_map(path), path, stored=False)
