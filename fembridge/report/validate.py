"""Everything that a validation page shows: models, rates, thresholds, deflections."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from decks.presets import model_of, read_finger
from decks.stimuli import CATALOGUE
from decks.waveform import make_stimulus
from fembridge.errors import MissingError, UsageError
from fembridge.evidence import Facts, touchsim_rates
from fembridge.fitting.problem import solved_source, stored_source
from fembridge.machine import SOLVER_INSTALL_LINE, find_ccx
from fembridge.observed import ObservedRates
from fembridge.report.rates import (
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
from fembridge.report.recorded import Evidence, ModelOnResponse, gather
from fembridge.response.deflection import Deflection, convergence, stored_deflections
from fembridge.response.indentation import solve_response
from fembridge.response.response_map import ResponseMap
from fembridge.simulation import Simulation, encode_all, unlike_the_fit
from fembridge.store import sha256_of, temporary_folder
from fembridge.tables import AFFERENTS, Rate, SpikeTrain
from fembridge.trace import finger_id
from neural import ParameterSet
from neural.parameter_sets import DEFAULT_SET, SET_NAMES, parameter_set

if TYPE_CHECKING:
    from pandas import DataFrame

ELEMENT = "CPE4"
STORED = ("quick", "paper")
# Largest displacement from the pre-indentation of any stimulus of the paper, noises included.
_STROKE_UM = 300.0
PUBLISHED_NAME, FINGERTIP_SET = "published", "fitted_pad"
# Fig. 3 (a): 35, 130 and 250 um at 20 Hz; Appendix A has 34.74 and 129.49.
RASTER_STIMULI = ("sine_20_34.74", "sine_20_129.49", "sine_20_250")
REPEATS = 5

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
        table = _subtable(response.origin, "finger")
        return unlike_the_fit(self, finger_id(table) if table else {}, {self.preindent_um})


@dataclass(frozen=True, slots=True, eq=False)
class Validation:
    """Inputs and results of a validation.

    `models` and `simulations` have the same order: the judged model first; last `FINGERTIP`,
    the parameters of the whole fingertip, simulated on the stored pad. `observed` is None
    without observed rates; `left_out` are stimuli of the observed table outside the paper's 82.
    `agreement`, `held_out`, `thresholds` and `locking` are tables of `fembridge.report.rates`;
    `evidence` compares the judged model with recorded afferents.
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

    @property
    def judged(self) -> JudgedModel:
        """The judged model: the subject of the report."""
        return self.models[0]

    @property
    def finger(self) -> str:
        """Name of the finger of the response."""
        return str(_subtable(self.response.origin, "finger").get("name", "own"))


def validate(
    response: ResponseMap,
    models: Sequence[JudgedModel],
    observed: ObservedRates | None = None,
    log: Callable[[str], None] = lambda line: None,
    facts: Mapping[str, Facts] | None = None,
    trains: Sequence[SpikeTrain] = (),
) -> Validation:
    """Results of `models` under the paper's 82 stimuli, on the response of a finger.

    Parameters
    ----------
    response
        Response map of the finger; must reach the depth of every stimulus.
    models
        The judged model first.
    observed
        Observed rates of any of the paper's stimuli and classes. Default: none.
    log
        Called with a line for stimuli left out and for parameters fitted on another finger.
        Default: discards the line.
    facts
        Evidence tables by name, instead of the published ones. Default: none.
    trains
        Recorded spikes, instead of the published timing and phases. Default: none.

    Raises
    ------
    UsageError
        `observed` has none of the paper's stimuli.
    ResponseError
        A stimulus goes deeper than the response.
    """
    from fembridge.touching.pad_file import pad_named
    from fembridge.touching.stress import pad_response

    left_out = _left_out(observed, log)
    pad, fitted = pad_response(pad_named("reference")), _model(FINGERTIP_SET)
    source = f"{FINGERTIP_SET}, under a flat 1 mm pin on the stored pad: {fitted.source}"
    fingertip = replace(fitted, name=FINGERTIP, source=source)
    simulations = {model.name: _simulated(model, response) for model in models}
    simulations[FINGERTIP] = _simulated(fingertip, pad)
    sources: dict[str, Sequence[Rate]] = {OBSERVED: observed.rates()} if observed else {}
    sources |= {name: simulation.mean_rates for name, simulation in simulations.items()}
    sources[TOUCHSIM] = touchsim_rates()
    rates = RateTable(sources)
    deflections = stored_deflections()
    judged = models[0]
    if mismatch := judged.fit_mismatch(response):
        log(mismatch)
    return Validation(
        response=response,
        models=(*models, fingertip),
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
        evidence=gather(
            ModelOnResponse(response, judged), ModelOnResponse(pad, fingertip), facts, trains
        ),
    )


def response_of(
    finger: str,
    response: Path | str | None,
    models: Sequence[JudgedModel],
    log: Callable[[str], None] = lambda line: None,
) -> ResponseMap:
    """Response map: read from `response`, stored for a preset, or solved for a finger file.

    Parameters
    ----------
    finger
        ``quick``, ``paper`` or a TOML file; not used with `response`.
    response
        Folder or file of a solved response, None for that of `finger`.
    models
        Their deepest pre-indentation sets the depth to solve.
    log
        Called with each line of the solver. Default: discards the line.

    Raises
    ------
    MissingError
        A finger file, and CalculiX is not installed.
    """
    if response is not None:
        return solved_source(Path(response)).response
    deepest_um = max(model.preindent_um for model in models) + _STROKE_UM
    if finger in STORED:
        return stored_source(finger, deepest_um).response
    pressed = replace(model_of(read_finger(finger)), element=ELEMENT)
    if find_ccx() is None:
        raise MissingError(
            f"finger {finger!r} must be solved, but ccx is not on the PATH; install CalculiX "
            f"({SOLVER_INSTALL_LINE}), or pass --response DIR, an output of `fembridge simulate`"
        )
    with temporary_folder() as folder:
        _, solved = solve_response(folder, pressed, deepest_um, log=log)
    return solved


def _simulated(model: JudgedModel, response: ResponseMap) -> Simulation:
    stimuli = [make_stimulus(entry, model.preindent_um) for entry in CATALOGUE]
    traces = [response.traces(stimulus, model.parameters) for stimulus in stimuli]
    return encode_all(stimuli, traces, model.parameters, {})


def _left_out(observed: ObservedRates | None, log: Callable[[str], None]) -> tuple[str, ...]:
    if observed is None:
        return ()
    unknown = tuple(id_ for id_ in observed.stimuli if id_ not in STIMULI)
    if len(unknown) == len(observed.stimuli):
        raise UsageError(
            f"{observed.path}: none of the paper's {len(STIMULI)} stimuli, "
            f"first stimulus: {unknown[0]}"
        )
    if unknown:
        log(
            f"left out {len(unknown)} stimuli that are not in the paper's appendix: "
            f"{', '.join(unknown)} ({observed.path})"
        )
    return unknown


def judged_models(name_or_file: str = DEFAULT_SET) -> tuple[JudgedModel, ...]:
    """The judged model, then the published one unless that is judged itself.

    Parameters
    ----------
    name_or_file
        Name of a parameter set or path of a TOML file. Default: ``fitted``.

    Raises
    ------
    UsageError
        The model has the name of another source of rates.
    ParameterError
        No parameter set of that name, or a file that is missing or invalid.
    """
    published = _model(PUBLISHED_NAME)
    if name_or_file == PUBLISHED_NAME:
        return (published,)
    judged = _model(name_or_file)
    if judged.name in (OBSERVED, TOUCHSIM, PUBLISHED_NAME, FINGERTIP):
        raise UsageError(
            f"{name_or_file}: the page already has a source named {judged.name!r}; "
            "rename the model (rename the file, or set its key 'name')"
        )
    return (judged, published)


def _subtable(origin: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Table `name` of `origin`, empty if it is missing."""
    table = origin.get(name)
    return table if isinstance(table, Mapping) else {}


def _model(name_or_file: str) -> JudgedModel:
    parameters = parameter_set(name_or_file)
    source = str(
        _subtable(parameters.origin, "fit").get("source")
        or f"parameter set {name_or_file!r} of fembridge"
    )
    if name_or_file not in SET_NAMES:
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
        cells = sorted(of_key, key=lambda train: train.repeat)
        for repeat in range(REPEATS):
            times_ms = cells[repeat * len(cells) // REPEATS].times_ms
            trains.append(SpikeTrain(*key, times_ms, repeat + 1))
    return tuple(trains)


def cells_of(simulation: Simulation) -> int:
    """Number of cells in each class of the model."""
    return len({train.repeat for train in simulation.trains})
