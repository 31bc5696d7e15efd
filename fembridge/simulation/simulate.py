"""From stimuli to spikes: the stress, spikes and rates of each stimulus.

``map``        one indentation is solved, or a stored response read; each stimulus is
               interpolated in it
``transient``  the indentation selects the contact model; then the solver follows each whole
               waveform
``auto``       the map, unless stress depends on more than the depth of the probe: see
               `fembridge.response.indentation.map_obstacle`

A command reads the signature for its options: the function imports what it needs when it is
called, so that ``--help`` costs nothing.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from fembridge.errors import MissingError, UsageError, check_type
from fembridge.simulation import AUTO, METHODS
from fembridge.solver.analysis import DEFAULT_ANALYSIS, Analysis, load_finger
from fembridge.solver.settings import DEFAULTS, Solver
from fembridge.version import __version__

if TYPE_CHECKING:
    from decks.finger import Finger
    from decks.probe import Probe
    from fembridge.io.waveform import Stimuli
    from fembridge.response.response_map import ResponseLike, ResponseMap
    from fembridge.simulation.simulation import Simulation
    from fembridge.typing import Table
    from neural.parameter_sets import ParameterSet


def simulate(
    stimulus: Stimuli,
    *,
    parameters: str | ParameterSet = "fitted",
    finger: str | Finger = "quick",
    probe: Probe | None = None,
    preindent_um: float | None = None,
    method: str = AUTO,
    stored: bool = False,
    response: ResponseLike | None = None,
    newton_per_um: float | None = None,
    mpa_per_um: float | None = None,
    analysis: Analysis = DEFAULT_ANALYSIS,
    solver: Solver = DEFAULTS,
    yes: bool = True,
) -> Simulation:
    """Stress, spikes and firing rates of each stimulus.

    With CalculiX (ccx) one indentation is solved and answers every stimulus, or the solver
    follows each waveform. Without it the stored response of the finger is read.

    Parameters
    ----------
    stimulus
        Waveform of the probe: an id or a set of the catalogue, as ``"sine_20_250"``, a
        `Stimulus`, a `Waveform`, the path of a file, a DataFrame
        ``time_ms,displacement_um``, or a list of these.
    parameters
        Neural parameters: ``"fitted"``, ``"published"`` (Table 2 of the paper), the path of a
        TOML file, or a `ParameterSet`. Default: ``"fitted"``.
    finger
        ``"quick"``, ``"paper"``, the path of a TOML file, or a `Finger`.
        Default: ``"quick"``.
    probe
        Shape and position of the probe. Default: None, a cylinder of 1 mm.
    preindent_um
        Depth of the probe in um before time 0. Default: None, the depth at which `parameters`
        were fitted; a waveform that begins deeper than 0 keeps its own depth.
    method
        ``"map"``: interpolation in one indentation; ``"transient"``: the solver follows each
        waveform; ``"auto"``: the map where stress depends on depth alone.
        Default: ``"auto"``.
    stored
        Whether to read the stored response of the finger even with CalculiX installed.
        Default: False.
    response
        Response map, a `DeckResponse`, or the folder or file of one: nothing is solved, and
        `finger`, `probe` and `analysis` are those of the map. Of a deck of yours the default of
        `preindent_um` is 0. Default: None.
    newton_per_um, mpa_per_um
        Force in N or pressure in MPa of each um of `stimulus`, where a load drives the deck of
        `response`. Default: None, as the map was made.
    analysis
        Element, inertia, section and material law. Default: ``Analysis()``.
    solver
        Threads, simultaneous runs, limits, cache, folder of the runs and progress.
        Default: ``Solver()``.
    yes
        Whether to solve transients that take more than ten minutes. Default: True.

    Returns
    -------
    Simulation
        ``rates`` and ``spikes`` are DataFrames, ``traces`` stress histories, one row a
        stimulus, one column a class; ``plot()`` draws the raster, ``write(folder)`` the files
        of ``fembridge simulate``.

    Raises
    ------
    UsageError, StimulusError
        An unknown id, or options that exclude each other.
    MissingError
        The simulation needs a solver, and none is installed.
    SolverError, ResponseError
        The solver failed, no response is stored for `finger`, or no contact model was
        accepted.

    Warns
    -----
    FembridgeWarning
        The parameters were fitted on another finger or at another pre-indentation.

    Examples
    --------
    >>> import fembridge as fb
    >>> result = fb.simulate("sine_20_250", stored=True)
    >>> list(result.rates.columns)
    ['stimulus', 'afferent', 'rate_ips']
    """
    from contextlib import ExitStack
    from dataclasses import replace
    from operator import attrgetter

    from decks.presets import finger_table
    from decks.probe import Probe
    from decks.synthesis import at_step
    from fembridge.host.machine import SOLVER_INSTALL_LINE, find_ccx
    from fembridge.host.store import temporary_folder
    from fembridge.io.waveform import check_preindentation, resolve_stimuli
    from fembridge.response.indentation import (
        FrictionSlipError,
        map_obstacle,
        solve_response,
    )
    from fembridge.response.response_map import RESPONSE_FOLDER
    from fembridge.simulation.simulation import encode_all
    from fembridge.simulation.transients import (
        check_cost,
        read_stored_response,
        select_method,
        solve_transients,
    )
    from fembridge.solver.mechanics import report_mechanics
    from fembridge.trace import finger_id
    from neural.parameter_sets import parameter_set
    from neural.parameters import finest_step_ms

    if response is not None:
        for argument, value, default in (
            ("finger", finger, "quick"),
            ("probe", probe, None),
            ("method", method, AUTO),
            ("stored", stored, False),
            ("analysis", analysis, DEFAULT_ANALYSIS),
        ):
            if value != default and not (argument == "method" and value == "map"):
                problem = "cannot be combined with a response, which has its own"
                raise UsageError(problem, argument=argument, found=value)
        return _from_response(
            stimulus, response, parameters, preindent_um, (newton_per_um, mpa_per_um)
        )
    for argument, per_um in (("newton_per_um", newton_per_um), ("mpa_per_um", mpa_per_um)):
        if per_um is not None:
            raise UsageError("is for a response that a load drives", argument=argument)
    skin, indentor = load_finger(finger), probe or Probe()
    check_type("probe", indentor, Probe)
    check_type("analysis", analysis, Analysis)
    check_type("solver", solver, Solver)
    if method not in (AUTO, *METHODS):
        raise UsageError(
            argument="method", found=method, expected=f"{AUTO}, {' or '.join(METHODS)}"
        )
    neural_set = parameter_set(parameters)
    depth_um = neural_set.preindent_um if preindent_um is None else preindent_um
    stimuli = resolve_stimuli(stimulus, depth_um)
    check_preindentation(stimuli, preindent_um)
    reason = map_obstacle(skin, stimuli, inertia=analysis.inertia)
    if stored and (reason or method == "transient"):
        raise UsageError(
            f"is for a response map, not for a transient: {reason or 'omit one of both'}",
            argument="stored",
            found=stored,
            expected="False",
        )
    method = select_method(method, reason, neural_set.parameters)
    parameter_table = neural_set.to_table()
    deepest = max(stimuli, key=attrgetter("deepest_um"))
    solved: ResponseMap | None = None
    slip_percent: float | None = None  # difference of unloading where the skin slips
    origin: Table = {"source": "CalculiX"}
    with ExitStack() as stack:
        if stored or find_ccx() is None:
            if method == "transient":
                raise MissingError(
                    f"{reason or 'method transient'}: needs a solver, no ccx on the PATH; "
                    f"install it: {SOLVER_INSTALL_LINE}"
                )
            solved = read_stored_response(skin, indentor, analysis, deepest, stored)
            origin["source"] = "stored response"
        else:
            runs_folder = solver.runs_folder or stack.enter_context(temporary_folder())
            folder = Path(runs_folder)
            model = analysis.model(skin, indentor)
            if method == "transient":
                check_cost(stimuli, model, solver, yes=yes)
            try:
                model, solved = solve_response(
                    folder / RESPONSE_FOLDER, model, deepest.deepest_um, solver
                )
            except FrictionSlipError as slip:
                reason = "; ".join(text for text in (reason, str(slip)) if text)
                if method != "transient":
                    method = select_method(method, reason, neural_set.parameters)
                    check_cost(stimuli, model, solver, yes=yes)
                model, slip_percent = replace(model, contact=slip.contact), slip.closure_percent
        if solved is None or method == "transient":
            slips = slip_percent is not None
            traces, origin["contacts"] = solve_transients(
                stimuli, model, folder, solver, slips=slips, parameters=parameter_table
            )
        else:
            method = "map"
            stimuli = [at_step(item, finest_step_ms(neural_set.parameters)) for item in stimuli]
            traces = [solved.traces(item, neural_set.parameters) for item in stimuli]
    if solved is not None:
        origin["response"] = dict(solved.origin)
    record = {
        "fembridge": __version__,
        "method": method,
        **origin,
        "no_map": reason,
        "closure_percent": slip_percent if solved is None else solved.closure_percent,
        **neural_set.to_record(),
    }
    record = {key: value for key, value in record.items() if value is not None}
    simulation = encode_all(stimuli, traces, neural_set.parameters, record)
    depths_um = {item.preindent_um for item in stimuli}
    report_mechanics(neural_set, finger_id(finger_table(skin)), depths_um)
    return simulation


def _from_response(
    stimulus: Stimuli,
    response: ResponseLike,
    parameters: str | ParameterSet,
    preindent_um: float | None,
    per_um: tuple[float | None, float | None],
) -> Simulation:
    """The simulation of `stimulus` by a response map; arguments as of `simulate`.

    `per_um` has the load of each um: N and MPa.
    """
    from dataclasses import asdict

    from decks.synthesis import at_step
    from fembridge.io.waveform import check_preindentation, resolve_stimuli
    from fembridge.response.response_map import load_response
    from fembridge.simulation.simulation import encode_all
    from fembridge.solver.loads import in_scale, load_scale
    from fembridge.solver.mechanics import report_mechanics
    from fembridge.trace import model_id
    from neural.parameter_sets import parameter_set
    from neural.parameters import finest_step_ms

    loaded = load_response(response)
    neural_set = parameter_set(parameters)
    depth_um = 0.0 if loaded.is_of_deck else neural_set.preindent_um
    depth_um = depth_um if preindent_um is None else preindent_um
    coarse = resolve_stimuli(stimulus, depth_um, loads=True)
    check_preindentation(coarse, preindent_um)
    stimuli = [at_step(item, finest_step_ms(neural_set.parameters)) for item in coarse]
    requested = load_scale(*per_um)
    driven = [in_scale(item, loaded.load, requested) for item in stimuli]
    for item in stimuli:
        if item.aside_um is not None:
            problem = f"of {item.id}: a response map has no sliding probe"
            raise UsageError(problem, argument="slide_mm_per_s")
    traces = [loaded.traces(item, neural_set.parameters) for item in driven]
    record = {
        "fembridge": __version__,
        "method": "map",
        "source": "response",
        "closure_percent": loaded.closure_percent,
        "response": dict(loaded.origin),
        "load": None if loaded.load is None else asdict(requested or loaded.load),
        **neural_set.to_record(),
    }
    record = {key: value for key, value in record.items() if value is not None}
    simulation = encode_all(stimuli, traces, neural_set.parameters, record)
    report_mechanics(neural_set, model_id(loaded.origin), {item.preindent_um for item in stimuli})
    return simulation
