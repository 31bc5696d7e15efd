"""Everything that a validation page shows: models, rates, thresholds, deflections."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from decks.presets import model_of, read_finger
from decks.stimuli import CATALOGUE, Entry
from decks.synthesis import make_stimulus
from fembridge.errors import MissingError, UsageError, warn
from fembridge.evidence import Facts, touchsim_rates
from fembridge.fitting.response_source import stored_source
from fembridge.host.machine import SOLVER_INSTALL_LINE, find_ccx
from fembridge.host.progress import advance
from fembridge.host.store import sha256_of, temporary_folder
from fembridge.io.observed_rates import ObservedRates
from fembridge.io.spike_table import Rate, SpikeTrain
from fembridge.reporting.fingertip_responses import Fingertip
from fembridge.reporting.rate_tables import (
    FINGERTIP,
    OBSERVED,
    STIMULI,
    TOUCHSIM,
    RateTable,
    agreement_table,
    held_out_table,
    locking_table,
    threshold_table,
)
from fembridge.reporting.recorded import Evidence, ModelOnResponse, gather
from fembridge.reporting.recorded_sets import (
    JUDGED,
    further_stimuli,
    recorded_points,
    recorded_rows,
)
from fembridge.response.deflection import Deflection, convergence, stored_deflections
from fembridge.response.indentation import solve_response
from fembridge.response.response_map import ResponseLike, ResponseMap, load_response
from fembridge.simulation.simulation import Simulation, encode_all
from fembridge.solver.mechanics import SMOOTH, check_mechanics, fit_mismatch
from fembridge.stimulus import Stimulus
from fembridge.touching.pad_probe import PadProbe, pad_probe
from fembridge.trace import AFFERENTS, model_id
from neural import ParameterSet
from neural.parameter_sets import DEFAULT_SET, SET_NAMES, parameter_set
from neural.parameters import finest_step_ms

if TYPE_CHECKING:
    from pandas import DataFrame

    from decks.finger import Finger
    from fembridge.touching.pad import Pad
_LOGGER = logging.getLogger(__name__)

ELEMENT = "CPE4"
STORED = ("quick", "paper")
# Largest displacement from the pre-indentation of any stimulus of the paper, noises included.
_STROKE_UM = 300.0
PUBLISHED_NAME, FINGERTIP_SET = "published", "fitted_pad"
# Fig. 3 (a): 35, 130 and 250 um at 20 Hz; Appendix A has 34.74 and 129.49.
RASTER_STIMULI = ("sine_20_34.74", "sine_20_129.49", "sine_20_250")
TRIALS = 5

_SHORT_DIGEST = 12


@dataclass(frozen=True, slots=True)
class JudgedModel(ParameterSet):
    """A parameter set, with the `source` of its numbers in one line."""

    source: str = ""

    def held_out(self) -> dict[str, dict[str, Any]]:
        """Results of `fembridge fit --held-out` by class, see `held_out_table`."""
        fit = _subtable(self.origin, "fit")
        tables = {name: fit.get(name, {}).get("held_out") for name in AFFERENTS}
        return {name: table for name, table in tables.items() if table}

    def fit_mismatch(self, response: ResponseMap) -> str:
        """Difference between `response` and the conditions of the fit; "" for none."""
        return fit_mismatch(self, model_id(response.origin), {self.preindent_um})


@dataclass(frozen=True, slots=True, eq=False)
class ValidationData:
    """Inputs and results of a validation.

    `models` and `simulations` have the same order: the judged model first; last `FINGERTIP`,
    the parameters of the whole fingertip, simulated on the stored pad, unless the judged model is
    on a pad itself. `observed` is None without observed rates; `left_out` are stimuli of the
    observed table outside the paper's 82, which are only among the recorded sets.
    `agreement`, `held_out`, `thresholds` and `locking` are tables of
    `fembridge.reporting.rate_tables`; `evidence` compares the judged model with recorded afferents;
    `points` and `recorded_sets` are tables of `fembridge.reporting.recorded_sets`.
    """

    response: ResponseMap
    models: tuple[JudgedModel, ...]
    simulations: Mapping[str, Simulation]
    observed: ObservedRates | None
    left_out: tuple[str, ...]
    rates: RateTable
    agreement: "DataFrame"
    held_out: "DataFrame"
    thresholds: "DataFrame"
    locking: "DataFrame"
    deflections: tuple[Deflection, ...]
    convergence: Sequence[Mapping[str, Any]]
    evidence: Evidence
    points: "DataFrame"
    recorded_sets: "DataFrame"

    @property
    def judged(self) -> JudgedModel:
        """The judged model: the subject of the report."""
        return self.models[0]

    @property
    def finger(self) -> str:
        """Name of the finger of the response."""
        return str(_subtable(self.response.origin, "finger").get("name", "own"))

    @property
    def on_pad(self) -> bool:
        """Whether the response is that of a probe on a pad."""
        return FINGERTIP not in self.simulations

    @property
    def skin(self) -> str:
        """The finger of the response, or the probe on a pad, as the subject of a sentence."""
        if not self.on_pad:
            return f"Finger “{self.finger}”"
        mechanics = self.response.origin["mechanics"]
        ridges = mechanics.get("ridges", SMOOTH)
        skin = "smooth skin" if ridges == SMOOTH else f"ridges {ridges}"
        positions = len(self.response.origin["positions_mm"])
        means = f", mean of {positions} positions across a ridge" if positions > 1 else ""
        return f"Pad “{mechanics['pad']}” of “{self.finger}”, {skin}, {mechanics['probe']}{means}"


_TASK = "comparisons"


def compute_validation(
    response: ResponseMap,
    models: Sequence[JudgedModel],
    observed: ObservedRates | None = None,
    facts: Mapping[str, Facts] | None = None,
    trains: Sequence[SpikeTrain] = (),
    skin: "Pad | None" = None,
    tables: "Mapping[str, DataFrame] | None" = None,
) -> ValidationData:
    """Results of `models` under the paper's 82 stimuli, on the response of a finger.

    Parameters
    ----------
    response
        Response map of the finger; must reach the depth of every stimulus.
    models
        The judged model first.
    observed
        Observed rates of any of the paper's stimuli and classes. Default: none.
    facts
        Evidence tables by name, instead of the published ones. Default: none.
    trains
        Recorded spikes, instead of the published timing and phases. Default: none.
    skin
        Pad of the response, for touches. Default: None, the reference pad.
    tables
        Recorded responses to touches by name, see `fembridge.evidence.recorded_folder`.
        Default: none.

    Raises
    ------
    UsageError
        `observed` has none of the paper's stimuli.
    ResponseError
        A stimulus goes deeper than the response.
    """
    left_out = _left_out(observed)
    judged = models[0]
    check_mechanics(judged, model_id(response.origin), {judged.preindent_um})
    simulations = {}
    for model in models:
        simulations[model.name] = _simulated(model, response)
        advance(_TASK, 0.1)
    fingertip = None
    if "mechanics" not in response.origin:
        pad, fitted = PadProbe().response, _model(FINGERTIP_SET)
        source = f"{FINGERTIP_SET}, under a flat 1 mm pin on the stored pad: {fitted.source}"
        whole = replace(fitted, name=FINGERTIP, source=source)
        fingertip = ModelOnResponse(pad, whole)
        simulations[FINGERTIP] = _simulated(whole, pad)
        advance(_TASK, 0.2)
        models = (*models, whole)
    sources: dict[str, Sequence[Rate]] = {OBSERVED: observed.rates()} if observed else {}
    sources |= {name: simulation.mean_rates for name, simulation in simulations.items()}
    sources[TOUCHSIM] = touchsim_rates()
    rates = RateTable(sources)
    deflections = stored_deflections()
    evidence = gather(ModelOnResponse(response, judged), fingertip, facts, trains, skin)
    advance(_TASK, 0.4)
    points = _points(
        observed,
        simulations,
        ModelOnResponse(response, judged),
        fingertip,
        evidence,
        tables or {},
        skin,
    )
    advance(_TASK, 1.0)
    return ValidationData(
        response=response,
        models=tuple(models),
        simulations=simulations,
        observed=observed,
        left_out=left_out,
        rates=rates,
        agreement=agreement_table(rates),
        held_out=held_out_table(judged.held_out(), rates, judged.name),
        thresholds=threshold_table(rates),
        locking=locking_table(
            rates, {name: simulation.trains for name, simulation in simulations.items()}
        ),
        deflections=deflections,
        convergence=convergence(deflections),
        evidence=evidence,
        points=points,
        recorded_sets=recorded_rows(points, judged.name),
    )


def response_of(
    finger: "str | Finger",
    response: "ResponseLike | None",
    models: Sequence[JudgedModel],
    pad: "str | Path | Pad | PadProbe | None" = None,
) -> ResponseMap:
    """Response map: of a probe on a pad, read, stored for a preset, or solved for a finger file.

    Parameters
    ----------
    finger
        ``quick``, ``paper``, a TOML file or a `Finger`; not used with `response`.
    response
        Response map, or its folder or file; None for that of `finger`.
    models
        Their deepest pre-indentation sets the depth to solve.
    pad
        Pad, or a probe on a pad, instead of both. Default: None.

    Raises
    ------
    MissingError
        A finger file, and CalculiX is not installed.
    """
    if pad is not None:
        if response is not None:
            raise UsageError("cannot be combined with a pad", argument="response")
        return pad_probe(pad).response
    if response is not None:
        return load_response(response)
    deepest_um = max(model.preindent_um for model in models) + _STROKE_UM
    if isinstance(finger, str) and finger in STORED:
        return stored_source(finger, deepest_um).response
    loaded_finger = read_finger(finger) if isinstance(finger, str) else finger
    pressed = replace(model_of(loaded_finger), element=ELEMENT)
    if find_ccx() is None:
        raise MissingError(
            f"finger {loaded_finger.name!r} requires a solver, but ccx is not on the PATH; install "
            f"CalculiX ({SOLVER_INSTALL_LINE}), or pass --response DIR, an output of "
            "`fembridge simulate`"
        )
    with temporary_folder() as folder:
        _, solved = solve_response(folder, pressed, deepest_um)
    return solved


def _points(
    observed: ObservedRates | None,
    simulations: Mapping[str, Simulation],
    judged: ModelOnResponse,
    fingertip: ModelOnResponse | None,
    evidence: Evidence,
    tables: "Mapping[str, DataFrame]",
    skin: "Pad | None",
) -> "DataFrame":
    """Every recorded number with that of each source; touches are those of the model on a pad."""
    from fembridge.touching.pad_file import resolve_pad
    from fembridge.touching.ridged_pad import RidgedPad, with_ridges

    observed_rates = observed.rates() if observed else []
    further = further_stimuli(observed_rates)
    models = {JUDGED: judged} | ({FINGERTIP: fingertip} if fingertip else {})
    rates = {
        name: [
            *simulations[on_response.model.name].mean_rates,
            *_further_rates(on_response.model, on_response.response, further),
        ]
        for name, on_response in models.items()
    }
    touched = (fingertip or judged).model
    pad = skin or resolve_pad("reference")
    smooth = pad.smooth_pad if isinstance(pad, RidgedPad) else pad
    # The recorded textures were scanned over fingers of macaques.
    textured = skin or with_ridges(resolve_pad("macaque"), None)
    tips = (Fingertip(smooth, touched), Fingertip(textured, touched))
    on = FINGERTIP if fingertip else JUDGED
    return recorded_points(observed_rates, rates, evidence, tables, *tips, touches_of=on)


def _further_rates(
    model: ParameterSet, response: ResponseMap, entries: Sequence[Entry]
) -> list[Rate]:
    """Rates under vibrations outside the catalogue, up to the depth of the response."""
    deepest_um = response.deepest_um
    dt_ms = finest_step_ms(model.parameters)
    stimuli = [make_stimulus(entry, model.preindent_um, dt_ms=dt_ms) for entry in entries]
    reached = [wave for wave in stimuli if wave.displacement_um.max() <= deepest_um]
    if len(reached) < len(stimuli):
        omitted = [wave.id for wave in stimuli if wave not in reached]
        warn(f"deeper than the response of {deepest_um:g} um, left out: {', '.join(omitted)}")
    return list(_encoded(model, response, reached).mean_rates) if reached else []


def _simulated(model: ParameterSet, response: ResponseMap) -> Simulation:
    """Spikes and rates under all stimuli, one unit of a class with the cells at all positions."""
    dt_ms = finest_step_ms(model.parameters)
    stimuli = [make_stimulus(entry, model.preindent_um, dt_ms=dt_ms) for entry in CATALOGUE]
    return _encoded(model, response, stimuli)


def _encoded(model: ParameterSet, response: ResponseMap, stimuli: Sequence[Stimulus]) -> Simulation:
    traces = [response.traces(stimulus, model.parameters) for stimulus in stimuli]
    simulation = encode_all(stimuli, traces, model.parameters, {})
    return _pooled(simulation) if response.is_mean else simulation


def _pooled(simulation: Simulation) -> Simulation:
    """The units of a class as one: mean rates, and the cells of all, the most sensitive first."""
    rates: dict[tuple[str, str], list[float]] = {}
    for rate in simulation.mean_rates:
        rates.setdefault((rate.stimulus, rate.afferent), []).append(rate.rate_ips)
    units = {unit: k for k, unit in enumerate(sorted({train.unit for train in simulation.trains}))}
    trains = tuple(
        replace(train, unit="", cell=(max(train.cell, 1) - 1) * len(units) + units[train.unit] + 1)
        for train in simulation.trains
    )
    means = tuple(Rate(*key, float(np.mean(values))) for key, values in rates.items())
    return replace(simulation, trains=trains, mean_rates=means)


def _left_out(
    observed: ObservedRates | None,
) -> tuple[str, ...]:
    if observed is None:
        return ()
    unknown = tuple(id_ for id_ in observed.stimuli if id_ not in STIMULI)
    if len(unknown) == len(observed.stimuli):
        raise UsageError(
            f"none of the paper's {len(STIMULI)} stimuli, first stimulus: {unknown[0]}",
            observed.path,
        )
    if unknown:
        _LOGGER.info(
            f"{len(unknown)} stimuli are not in the paper's appendix and only in the table of "
            f"recorded sets: {', '.join(unknown)} ({observed.path})"
        )
    return unknown


def judged_models(
    source: "str | Path | ParameterSet" = DEFAULT_SET,
) -> tuple[JudgedModel, ...]:
    """The judged model, then the published one unless that is judged itself.

    Parameters
    ----------
    source
        Name of a parameter set, path of a TOML file, or a `ParameterSet`. Default: ``fitted``.

    Raises
    ------
    UsageError
        The model has the name of another source of rates.
    ParameterError
        No parameter set of that name, or a file that is missing or invalid.
    """
    published = _model(PUBLISHED_NAME)
    if isinstance(source, str) and source == PUBLISHED_NAME:
        return (published,)
    judged = _model(source)
    if judged.name in (OBSERVED, TOUCHSIM, PUBLISHED_NAME, FINGERTIP):
        raise UsageError(
            f"have the name {judged.name!r} of another source on the page; "
            "rename the file, or set its key 'name'",
            argument="parameters",
        )
    return (judged, published)


def _subtable(origin: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Table `name` of `origin`, empty if it is missing."""
    table = origin.get(name)
    return table if isinstance(table, Mapping) else {}


def _model(name_or_file: str | Path | ParameterSet) -> JudgedModel:
    parameters = parameter_set(name_or_file)
    source = str(
        _subtable(parameters.origin, "fit").get("source")
        or f"parameter set {parameters.name!r} of fembridge"
    )
    if not isinstance(name_or_file, ParameterSet) and name_or_file not in SET_NAMES:
        path = Path(name_or_file)
        source = f"file {path.name}, SHA-256 {sha256_of(path)[:_SHORT_DIGEST]}"
    values = {field.name: getattr(parameters, field.name) for field in fields(parameters)}
    return JudgedModel(**values, source=source)


def repeated_trains(simulation: Simulation) -> tuple[SpikeTrain, ...]:
    """Five trains for each class and stimulus of the raster, numbered 1 to 5.

    A population gives the trains of five cells, the most sensitive first, at equal distances
    in rank. A model with one cell has no noise: its five trains are equal.
    """
    trains = []
    for key in product(RASTER_STIMULI, AFFERENTS):
        of_key = [train for train in simulation.trains if (train.stimulus, train.afferent) == key]
        cells = sorted(of_key, key=lambda train: train.cell)
        for trial in range(TRIALS):
            times_ms = cells[trial * len(cells) // TRIALS].times_ms
            trains.append(SpikeTrain(*key, times_ms, trial=trial + 1))
    return tuple(trains)


def cells_of(simulation: Simulation) -> int:
    """Number of cells in each class of the model."""
    return len({train.cell for train in simulation.trains})
