"""Compute everything that a validation shows: models, rates, thresholds, deflections."""

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
from fembridge.report.recorded import Answering, Evidence, gather
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
# Farthest from the pre-indentation that a stimulus of the paper goes; measured, with noises.
_STROKE_UM = 300.0
PUBLISHED_NAME, FINGERTIP_SET = "published", "fitted_pad"
# Fig. 3 (a): 35, 130 and 250 um at 20 Hz; Appendix A has 34.74 and 129.49.
RASTER_STIMULI = ("sine_20_34.74", "sine_20_129.49", "sine_20_250")
REPEATS = 5

_SHORT_DIGEST = 12


@dataclass(frozen=True, slots=True)
class JudgedModel(ParameterSet):
    """A parameter set, and in a line the `source` of its numbers."""

    source: str = ""

    def held_out(self) -> dict[str, dict[str, Any]]:
        """What `fembridge fit --held-out` left of each class: see `held_out_table`."""
        of_class = _table_in(self.origin, "fit")
        found = {name: of_class.get(name, {}).get("held_out") for name in AFFERENTS}
        return {name: table for name, table in found.items() if table}

    def unlike(self, response: ResponseMap) -> str:
        """What was otherwise where the parameters were fitted; "": nothing."""
        table = _table_in(response.origin, "finger")
        return unlike_the_fit(self, finger_id(table) if table else {}, {self.preindent_um})


@dataclass(frozen=True, slots=True, eq=False)
class Validation:
    """What was computed, and of what.

    `models` and `simulations` go together: the model that is judged comes first, the
    parameters of the whole fingertip, `FINGERTIP`, which answer on the stored pad, last.
    `observed` is None where no table was given; `left_out` are stimuli of that
    table that the paper has not. `agreement`, `held_out`, `thresholds` and `locking` are
    tables of `fembridge.report.rates`, `evidence` is the judged model beside recorded afferents.
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
        """The model that the report is about."""
        return self.models[0]

    @property
    def finger(self) -> str:
        """Name of the finger that the response is of."""
        return str(_table_in(self.response.origin, "finger").get("name", "own"))


def validate(
    response: ResponseMap,
    models: Sequence[JudgedModel],
    observed: ObservedRates | None = None,
    log: Callable[[str], None] = lambda line: None,
    facts: Mapping[str, Facts] | None = None,
    trains: Sequence[SpikeTrain] = (),
) -> Validation:
    """Compute the 82 stimuli of the paper on the response of a finger.

    The first of `models` is judged, by `observed` rates of any of the paper's stimuli and
    classes. `log` gets a line for what is left out, or does not belong together. `facts`,
    tables of evidence by name, and recorded `trains` are shown in the place of the published
    ones. Raises UsageError: observed rates of none of the paper's stimuli. ResponseError: a
    model's probe goes deeper than the response.
    """
    from fembridge.touching.pad import pad_named
    from fembridge.touching.stress import pad_response

    left_out = _left_out(observed, log)
    pad, fitted = pad_response(pad_named("reference")), _model(FINGERTIP_SET)
    source = f"{FINGERTIP_SET}, under a flat 1 mm pin on the stored pad: {fitted.source}"
    fingertip = replace(fitted, name=FINGERTIP, source=source)
    simulations = {model.name: _simulated(model, response) for model in models}
    simulations[FINGERTIP] = _simulated(fingertip, pad)
    sources: dict[str, Sequence[Rate]] = {OBSERVED: observed.rates()} if observed else {}
    sources |= {name: one.mean_rates for name, one in simulations.items()}
    sources[TOUCHSIM] = touchsim_rates()
    rates = RateTable(sources)
    deflections = stored_deflections()
    judged = models[0]
    if unlike := judged.unlike(response):
        log(unlike)
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
        locking=locking_table(rates, {name: one.trains for name, one in simulations.items()}),
        deflections=deflections,
        convergence=convergence(deflections),
        evidence=gather(Answering(response, judged), Answering(pad, fingertip), facts, trains),
    )


def response_of(
    finger: str,
    response: Path | str | None,
    models: Sequence[JudgedModel],
    log: Callable[[str], None] = lambda line: None,
) -> ResponseMap:
    """The response at that place, the stored one of a preset, or that of a finger, solved.

    Raises MissingError: a finger of one's own, and no solver.
    """
    if response is not None:
        return solved_source(Path(response)).response
    deepest_um = max(model.preindent_um for model in models) + _STROKE_UM
    if finger in STORED:
        return stored_source(finger, deepest_um).response
    pressed = replace(model_of(read_finger(finger)), element=ELEMENT)
    if find_ccx() is None:
        raise MissingError(
            f"finger {finger!r} takes a solver, and there is no ccx on the PATH; install it "
            f"({SOLVER_INSTALL_LINE}), or give --response DIR of `fembridge simulate`"
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
            f"{observed.path}: no rate of one of the paper's {len(STIMULI)} stimuli, "
            f"the first is of {unknown[0]}"
        )
    if unknown:
        log(f"{observed.path}: left out {', '.join(unknown)}: not in the paper's appendix")
    return unknown


def judged_models(word: str = DEFAULT_SET) -> tuple[JudgedModel, ...]:
    """Model called `word` or in that file, and the published one after it.

    Raises UsageError: a file that calls its model by the name of another source of rates.
    ParameterError: no model of that name, or a file that is not there or holds none.
    """
    published = _model(PUBLISHED_NAME)
    if word == PUBLISHED_NAME:
        return (published,)
    judged = _model(word)
    if judged.name in (OBSERVED, TOUCHSIM, PUBLISHED_NAME, FINGERTIP):
        raise UsageError(
            f"{word}: a model called {judged.name!r} would be beside another of "
            "that name; give it another (the file's name, or its key 'name')"
        )
    return (judged, published)


def _table_in(origin: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """The table of that name, {} where there is none."""
    found = origin.get(name)
    return found if isinstance(found, Mapping) else {}


def _model(word: str) -> JudgedModel:
    found = parameter_set(word)
    source = str(
        _table_in(found.origin, "fit").get("source") or f"parameter set {word!r} of fembridge"
    )
    if word not in SET_NAMES:
        source = f"file {Path(word).name}, SHA-256 {sha256_of(Path(word))[:_SHORT_DIGEST]}"
    known = {each.name: getattr(found, each.name) for each in fields(found)}
    return JudgedModel(**known, source=source)


def repeated_trains(simulation: Simulation) -> tuple[SpikeTrain, ...]:
    """Five trains for each class and stimulus of the raster, repeat 1 to 5.

    Those of a population are those of five cells, the keenest first, evenly apart. A model
    of one cell has no noise, so that each of its repeats is the same.
    """
    found = []
    for place in product(RASTER_STIMULI, AFFERENTS):
        mine = [train for train in simulation.trains if (train.stimulus, train.afferent) == place]
        cells = sorted(mine, key=lambda train: train.repeat)
        for repeat in range(REPEATS):
            times_ms = cells[repeat * len(cells) // REPEATS].times_ms
            found.append(SpikeTrain(*place, times_ms, repeat + 1))
    return tuple(found)


def cells_of(simulation: Simulation) -> int:
    """How many cells each class of the model has."""
    return len({train.repeat for train in simulation.trains})
