"""Everything that a validation computes, before any of it becomes a page."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from decks.finger import Finger
from decks.probe import Probe
from decks.stimuli import CATALOGUE
from decks.waveform import make_stimulus
from fembridge.build import Model, model_of
from fembridge.deflection.profile import ConvergenceRow, Deflection, convergence, stored_deflections
from fembridge.errors import UsageError
from fembridge.observed import ObservedRates
from fembridge.response.response_map import ResponseMap, stored_response
from fembridge.simulation import Simulation, simulate
from fembridge.tables import Rate
from fembridge.touchsim import touchsim_rates
from fembridge.validation.agreement_cell import AgreementCell, agreement_cells, references_of
from fembridge.validation.compared_rates import OBSERVED, TOUCHSIM, ComparedRates, compare_rates
from fembridge.validation.judged_model import JudgedModel
from fembridge.validation.locking_row import LockingRow, locking_rows
from fembridge.validation.threshold_row import ThresholdRow, threshold_rows

ELEMENT = "CPE4"
STIMULI = tuple(entry.id for entry in CATALOGUE)

Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """What was computed, and of what.

    `models` and `simulations` go together: the model that is judged comes first.
    `observed` is None where no table was given; `left_out` are stimuli of that
    table that the paper has not.
    """

    finger: str
    response: ResponseMap
    models: tuple[JudgedModel, ...]
    simulations: Mapping[str, Simulation]
    observed: ObservedRates | None
    left_out: tuple[str, ...]
    compared: ComparedRates
    cells: tuple[AgreementCell, ...]
    thresholds: tuple[ThresholdRow, ...]
    locking: tuple[LockingRow, ...]
    deflections: tuple[Deflection, ...]
    convergence: tuple[ConvergenceRow, ...]

    @property
    def judged(self) -> JudgedModel:
        """The model that the report is about."""
        return self.models[0]

    @property
    def reference(self) -> str:
        """What it is held against: observed rates, or else TouchSim's."""
        return self.compared.reference(STIMULI)


def validate(
    finger: Finger,
    models: Sequence[JudgedModel],
    observed: ObservedRates | None = None,
    tell: Tell = lambda line: None,
) -> Study:
    """Compute the 82 stimuli of the paper on the stored response of `finger`.

    Parameters
    ----------
    models
        The model to judge, then those that are shown beside it.
    observed
        Rates to judge it by; any of the paper's stimuli and classes will do.
    tell
        Hears in one line each what was left out.

    Raises
    ------
    UsageError
        No model, or observed rates of none of the paper's stimuli.
    ResponseError
        No response is stored for this finger, or a model's probe goes deeper.
    """
    if not models:
        raise UsageError("no model to judge")
    left_out = _left_out(observed, tell)
    response = stored_response(finger, Probe(), ELEMENT)
    pressed = model_of(finger, element=ELEMENT)
    simulations = {model.name: _simulated(model, pressed) for model in models}
    sources: dict[str, Sequence[Rate]] = {}
    if observed is not None:
        sources[OBSERVED] = observed.rates()
    sources |= {name: one.mean_rates for name, one in simulations.items()}
    sources[TOUCHSIM] = touchsim_rates()
    compared = compare_rates(STIMULI, sources)
    deflections = stored_deflections()
    return Study(
        finger=finger.name,
        response=response,
        models=tuple(models),
        simulations=simulations,
        observed=observed,
        left_out=left_out,
        compared=compared,
        cells=tuple(
            cell
            for reference in references_of(compared)
            for cell in agreement_cells(compared, reference)
        ),
        thresholds=threshold_rows(compared),
        locking=locking_rows(compared, {name: one.trains for name, one in simulations.items()}),
        deflections=deflections,
        convergence=convergence(deflections) if len(deflections) > 1 else (),
    )


def _simulated(model: JudgedModel, pressed: Model) -> Simulation:
    stimuli = [make_stimulus(entry, model.preindent_um) for entry in CATALOGUE]
    return simulate(stimuli, pressed, Path(), stored=True, parameters=model.parameters)


def _left_out(observed: ObservedRates | None, tell: Tell) -> tuple[str, ...]:
    if observed is None:
        return ()
    strange = tuple(id_ for id_ in observed.stimuli if id_ not in STIMULI)
    if len(strange) == len(observed.stimuli):
        raise UsageError(
            f"{observed.path}: no rate of one of the paper's {len(STIMULI)} stimuli, "
            f"the first is of {strange[0]}"
        )
    if strange:
        tell(f"{observed.path}: left out {', '.join(strange)}: not in the paper's appendix")
    return strange
