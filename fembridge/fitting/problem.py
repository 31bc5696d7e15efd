"""Fit problem from observed rates and the stress under each stimulus.

A group of stimuli is one objective: sinusoids of one frequency, diharmonics of one
pair of components, or noises of one band.
"""

import logging
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from decks.stimuli import Diharmonic, Entry, Noise, Ramp, Sine, number_text, resolve
from decks.synthesis import make_stimulus
from fembridge.errors import ParameterError, UsageError
from fembridge.evidence import CRITERIA
from fembridge.fitting.thresholds import vibration
from fembridge.io.observed_rates import FAMILIES, ObservedRates
from fembridge.io.spike_table import SpikeTrain
from fembridge.response.response_map import (
    ResponseMap,
)
from fembridge.stimulus import Stimulus
from neural.fit_problem import (
    DISTANCES,
    FitProblem,
    PhaseTarget,
    Target,
    ThresholdTarget,
    TimingTarget,
)
from neural.models import DEFAULT_MODELS, MODELS, AfferentModel, model_named

if TYPE_CHECKING:
    import pandas


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
