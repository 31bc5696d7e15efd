"""What the commands do, as functions: ``import fembridge as fb``, then ``fb.simulate(...)``.

Arguments have the words of the command's options. Times are in ms, depths in um,
stress in Pa, rates in impulses per second. Errors are `FembridgeError`. `log` is called
with a line about what was done, `on_progress` with how far it is.

A command asks these signatures for its options (decision 0033): what a function needs is
imported when it is called, so that ``--help`` costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from fembridge.errors import DeckError, UsageError
from fembridge.solver.settings import ITERATION_LIMIT, STALL_LIMIT_S, OnProgress, SolverSettings

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from decks.analysis import Contact, Model
    from decks.finger import Finger
    from decks.probe import Probe
    from fembridge.fitting.fit import FitRun
    from fembridge.report.validate import Validation
    from fembridge.run_folder import RunFolder
    from fembridge.simulation import Simulation
    from fembridge.solver.verdict import Outcome
    from fembridge.stimulus_file import Stimuli
    from fembridge.touching.field import ReceptiveField
    from fembridge.touching.touch import Touch
    from fembridge.trace import StressTrace
    from neural import ParameterSet
    from neural.fit_problem import Target
    from neural.models import Model as AfferentModel

PathLike: TypeAlias = str | Path

# What `build_deck` takes of one of the two alone.
_OF_OUR_FINGER = (
    *("finger", "probe", "element", "inertia", "whole_section", "law"),
    *("contact", "stiffness_mpa_per_mm", "friction", "probe_body"),
)
_OF_A_BASE_DECK = ("amplitude", "step", "afferents", "length_unit", "move", "increments")


def simulate(
    stimulus: Stimuli,
    *,
    method: str = "auto",
    stored: bool = False,
    parameters: str | ParameterSet = "fitted",
    preindent_um: float | None = None,
    seed: int | None = None,
    slide_mm_per_s: float | None = None,
    dt_ms: float | None = None,
    full_scale_um: float | None = None,
    window_ms: tuple[float, float] | None = None,
    finger: str | Finger = "quick",
    probe: Probe | None = None,
    element: str = "CPE4",
    inertia: bool = False,
    whole_section: bool = False,
    law: str = "linear",
    output: PathLike | None = None,
    threads: int | None = None,
    jobs: int = 1,
    time_limit_s: float | None = None,
    cache: bool = True,
    yes: bool = True,
    log: Callable[[str], None] = lambda line: None,
    on_progress: OnProgress | None = None,
) -> Simulation:
    """Stress, spikes and rates of each stimulus, as ``fembridge simulate``.

    With ccx one indentation is solved and answers every stimulus, or the solver follows
    each waveform; without it the stored response of the reference finger is taken.

    Parameters
    ----------
    stimulus
        An id as ``ramp_300_100_200_100``, a set, a `Stimulus`, or a waveform's path: .csv
        with ``time_ms,displacement_um``, .wav or .npy, in any step.
    dt_ms, full_scale_um
        Of an .npy the time step; of a .wav without its scale what full scale is in um.
    window_ms
        Where spikes are counted, in the place of each stimulus's own window.
    method
        ``map``, ``transient``, or ``auto``: the map where stress depends on depth alone.
    stored
        Take the stored response also where ccx is.
    parameters
        ``fitted``, ``published`` (Table 2 of the paper), a TOML file or a set.
    preindent_um
        Depth of the probe before time 0. None: as in the fit of the parameters.
    finger
        ``quick``, ``paper``, a TOML file or a `Finger`.
    law
        Of skin and tissue under large strain: ``linear``, as in the paper, or
        ``neo-hookean``, the same at rest and stiffer when strongly compressed.
    cache
        Take what was solved before on this machine.
    yes
        Solve transients also where that takes more than ten minutes.
    output
        Where the solver's runs are kept. None: in a temporary folder.

    Returns
    -------
    Simulation
        ``rates`` and ``spikes`` are DataFrames, ``traces`` ``(S, A)`` stress histories;
        ``plot()`` is the raster, ``write(folder)`` the files of the command.

    Raises
    ------
    UsageError, StimulusError
        Options or an id that mean nothing.
    MissingError, SolverError, ResponseError
        It takes a solver that is not there, that failed, or no contact model of which
        is to be trusted.

    Examples
    --------
    >>> import fembridge as fb
    >>> result = fb.simulate("sine_20_250", stored=True)
    >>> list(result.rates.columns)
    ['stimulus', 'afferent', 'rate_ips']
    """
    from contextlib import ExitStack

    from decks.analysis import Contact
    from decks.presets import finger_table
    from fembridge import simulation
    from fembridge.stimulus_file import check_depth_is_used, stimuli_of
    from fembridge.store import temporary_folder
    from fembridge.trace import finger_id
    from neural import parameter_set

    encoding_parameters = parameter_set(parameters)
    depth_um = encoding_parameters.preindent_um if preindent_um is None else preindent_um
    settings = SolverSettings(
        threads=threads,
        jobs=jobs,
        time_limit_s=time_limit_s,
        on_progress=on_progress,
        cache=cache,
    )
    stimuli = stimuli_of(
        stimulus, depth_um, seed, slide_mm_per_s,
        dt_ms=dt_ms, full_scale_um=full_scale_um, window_ms=window_ms, log=log,
    )  # fmt: skip
    check_depth_is_used(stimuli, preindent_um)
    model = _model(finger, probe, Contact(), element, inertia, whole_section, law)
    with ExitStack() as stack:
        if output is None:
            output = stack.enter_context(temporary_folder())
        result = simulation.simulate(
            stimuli,
            model,
            Path(output),
            method=method,
            stored=stored,
            parameters=encoding_parameters,
            settings=settings,
            yes=yes,
            log=log,
        )
    depths_um = {item.preindent_um for item in stimuli}
    finger_identity = finger_id(finger_table(model.finger))
    if difference := simulation.unlike_the_fit(encoding_parameters, finger_identity, depths_um):
        log(difference)
    elif preindent_um is None and depth_um:
        depth = f"{depth_um:g} um deep before time 0"
        log(f"parameters {encoding_parameters.name}: the probe is {depth}, as in their fit")
    return result


def build_deck(
    stimulus: Stimuli,
    output: PathLike = "runs",
    *,
    solver: str | None = None,
    parameters: str | ParameterSet = "fitted",
    preindent_um: float | None = None,
    seed: int | None = None,
    slide_mm_per_s: float | None = None,
    dt_ms: float | None = None,
    full_scale_um: float | None = None,
    window_ms: tuple[float, float] | None = None,
    finger: str | Finger = "quick",
    probe: Probe | None = None,
    element: str | None = None,
    inertia: bool = False,
    whole_section: bool = False,
    law: str = "linear",
    contact: str | None = None,
    stiffness_mpa_per_mm: float | None = None,
    friction: float | None = None,
    results: str | None = None,
    frames: int = 0,
    probe_body: str | None = None,
    base_deck: PathLike | None = None,
    amplitude: str | None = None,
    step: str | None = None,
    afferents: Mapping[str, int] | None = None,
    length_unit: str | None = None,
    move: str | None = None,
    increments: str = "fixed",
    log: Callable[[str], None] = lambda line: None,
) -> list[RunFolder]:
    """One run folder a stimulus below `output`: deck, waveform and ``run.toml``.

    Parameters
    ----------
    stimulus, dt_ms, full_scale_um, window_ms
        As of `simulate`.
    solver
        ``calculix`` (None too), ``marc`` or ``abaqus``. Of a `base_deck`: whose it is,
        where its text leaves that open.
    parameters
        By which its stress is to be encoded: ``run.toml`` names them, `encode` takes them.
    preindent_um
        Depth of the probe before time 0. None: as in the fit of `parameters`, and 0 of a
        `base_deck`, which has a way of its own to where it stands.
    contact, stiffness_mpa_per_mm, friction, results
        As the options of the command; None: what the solver's decks have.
    frames
        The whole field, all nodes, at every so many samples (of a `base_deck` 1 alone).
    base_deck
        A deck of one's own, kept to the byte but for waveform, increments and output;
        `amplitude` or `move`, `step`, `afferents` (node by class), `length_unit` and
        `increments` are for it.
    log
        Called with each change that was made to `base_deck`.

    Raises
    ------
    UsageError, StimulusError
        Options or an id that mean nothing.
    DeckError, FingerError, OutputError
        The model cannot be put into a deck, with file and line of a `base_deck`; a
        folder cannot be written.

    Examples
    --------
    >>> import fembridge as fb
    >>> [run] = fb.build_deck("sine_20_250", "runs", solver="marc")
    >>> run.folder.name, run.increments
    ('sine_20_250', 520)
    """
    arguments = locals()
    defaults = {
        name: parameter.default for name, parameter in signature(build_deck).parameters.items()
    }
    unused = _OF_A_BASE_DECK if base_deck is None else _OF_OUR_FINGER
    scope = "for base_deck alone" if base_deck is None else "for our finger, not for base_deck"
    for name in unused:
        if arguments[name] != defaults[name]:
            raise UsageError(f"{name} is {scope}")

    from decks.analysis import Contact
    from decks.dialects import DeckOptions, dialect_named
    from fembridge.build import build_own_folder, build_run_folder, read_base_deck
    from fembridge.stimulus_file import check_depth_is_used, stimuli_of
    from neural import parameter_set

    encoding_parameters = parameter_set(parameters)
    depth_um = preindent_um
    if depth_um is None:
        depth_um = encoding_parameters.preindent_um if base_deck is None else 0.0
    stimuli = stimuli_of(
        stimulus, depth_um, seed, slide_mm_per_s,
        dt_ms=dt_ms, full_scale_um=full_scale_um, window_ms=window_ms, log=log,
    )  # fmt: skip
    check_depth_is_used(stimuli, preindent_um)
    if base_deck is not None:
        from decks.own_model import Request

        base = read_base_deck(Path(base_deck), solver)
        if frames not in (0, 1):
            raise UsageError("frames: of an own deck 1 alone, all nodes at every sample")
        request = Request(
            amplitude,
            step,
            dict(afferents or {}),
            length_unit,
            results,
            move,
            increments,
            all_nodes=frames == 1,
        )
        changed = [
            build_own_folder(
                Path(output) / item.id, base, item, request, encoding_parameters.to_table()
            )
            for item in stimuli
        ]
        for remark in changed[-1][1]:
            log(remark)
        if base.solver == "calculix":
            from fembridge.solver.ccx import warnings_of

            for remark in warnings_of(changed[0][0], base.path):
                log(remark)
        return [run for run, _ in changed]
    solver = solver or "calculix"
    dialect = dialect_named(solver)
    requested = {"formulation": contact, "friction": friction}
    contact_options = _without_none(requested | {"stiffness_mpa_per_mm": stiffness_mpa_per_mm})
    for name in contact_options:
        if name not in dialect.contact:
            raise UsageError(f"contact: a deck for {solver} has no {name}")
    try:
        contact_settings = Contact(**contact_options)
        element = dialect.element_named(element or dialect.element)
    except DeckError as error:
        raise UsageError(str(error)) from error
    model = _model(finger, probe, contact_settings, element, inertia, whole_section, law)
    options = DeckOptions(results, probe_body, frames)
    return [
        build_run_folder(
            Path(output) / item.id,
            model,
            item,
            solver=solver,
            options=options,
            parameters=encoding_parameters.to_table(),
        )
        for item in stimuli
    ]


def run(
    folders: PathLike | RunFolder | Sequence[PathLike | RunFolder],
    *,
    threads: int | None = None,
    jobs: int = 1,
    time_limit_s: float | None = None,
    stall_limit_s: float | None = STALL_LIMIT_S,
    iteration_limit: int | None = ITERATION_LIMIT,
    force: bool = False,
    cache: bool = True,
    on_progress: OnProgress | None = None,
) -> list[Outcome]:
    """Run the solver in run folders, or in what `build_deck` gave.

    Accepted results are beside their deck. A folder whose results are whole and of its
    deck is skipped, unless `force`; with `cache` results that this machine solved before
    are taken from its cache. An outcome's ``failure`` is None, or the cause why
    it is not accepted.

    Raises
    ------
    UsageError
        `threads` or `jobs` below 1, a limit that is not more than 0.

    Examples
    --------
    >>> import fembridge as fb
    >>> [outcome] = fb.run("no_run_folder")
    >>> outcome.accepted
    False
    """
    from fembridge.run_folder import RunFolder
    from fembridge.solver.ccx import run_folders

    settings = SolverSettings(
        threads, jobs, time_limit_s, stall_limit_s, iteration_limit, on_progress, cache
    )
    folder_list = [folders] if isinstance(folders, str | Path | RunFolder) else folders
    runs = [folder if isinstance(folder, RunFolder) else Path(folder) for folder in folder_list]
    return run_folders(runs, settings, force=force)


def encode(
    traces: PathLike | pandas.DataFrame | Sequence[StressTrace],
    *,
    parameters: str | ParameterSet | None = None,
    stimulus: str | None = None,
    derivative: str = "backward",
    afferents: Sequence[str] | None = None,
    columns: Mapping[str, str | Sequence[str]] | None = None,
    gain_pa: float | None = None,
    resample_ms: float | None = None,
    log: Callable[[str], None] | None = None,
) -> pandas.DataFrame:
    """Spikes of stress histories: ``stimulus, afferent, repeat, spike_time_ms``, a row a spike.

    Parameters
    ----------
    traces
        Each with the class of its afferent, in any even step; or their table, a DataFrame
        or a path: ``time_ms, afferent, node, von_mises_pa``, with ``unit`` or ``stimulus``
        where these distinguish them; or a folder of `simulate`, its ``traces.npz``, a run
        folder. `repeat` numbers the cells of a population from 1, and is 0 for one cell.
        Where a class has several units, ``unit`` is a column of the result.
    parameters
        ``fitted`` (for traces of a probe that was 75 um deep before time 0), ``published``
        (Table 2 of the paper), a TOML file or a set. None: those that the run of the traces
        names, else ``fitted``.
    stimulus
        What the table calls the stimulus, or which of several. None: as the run, else
        ``traces``.
    afferents
        Classes to encode, and those that a trace without a class is taken for.
    columns, gain_pa, resample_ms
        Of a table of another kind, as a robot's: ``{"time": "t_s", "value": ["f1", "f2"]}``,
        how many Pa a value of 1 is, and the step of an even grid for uneven times.
    log
        Called with a line where something was resampled, or was otherwise in the fit of the
        parameters. What looks wrong is a `FembridgeWarning`.

    Raises
    ------
    UsageError, ParameterError, TableError
        A trace without a class, parameters that read strain energy, a row that is no sample.

    Examples
    --------
    >>> import fembridge as fb
    >>> result = fb.simulate("sine_20_250", stored=True)
    >>> spikes = fb.encode(result.traces[0], stimulus="sine_20_250")
    >>> spikes.equals(result.spikes)
    True
    """
    from fembridge import encoding
    from fembridge.tables import spikes_frame

    log_line = log or (lambda line: None)
    encoded = encoding.encode(
        traces,
        parameters=parameters,
        derivative=derivative,
        stimulus=stimulus,
        unnamed="traces",
        afferents=afferents,
        columns=columns,
        gain_pa=gain_pa,
        resample_ms=resample_ms,
        log=log_line,
        note=log_line,
    )
    return spikes_frame(encoded.trains)


def plot(result: Simulation | Touch | ReceptiveField, picture: str | None = None) -> Figure:
    """The picture of what `simulate`, `touch` or `receptive_field` gave, as `fembridge` draws it.

    Parameters
    ----------
    picture
        Of a touch ``pad`` (the skin from above: who fires how much, the pressure on it) or
        ``raster``; of a simulation as of its own ``plot``. None: the first of each.

    Raises
    ------
    UsageError
        There is no such picture.

    Examples
    --------
    >>> import fembridge as fb
    >>> figure = fb.plot(fb.touch(press_um=200, population="one_each"))
    """
    from fembridge.plots.pad import PICTURES
    from fembridge.simulation import Simulation
    from fembridge.touching.touch import Touch

    if isinstance(result, Simulation):
        return result.plot(picture or "raster")
    if isinstance(result, Touch):
        if (picture or "pad") not in PICTURES:
            raise UsageError(f"picture {picture!r} of a touch, expected {' or '.join(PICTURES)}")
        return PICTURES[picture or "pad"](result)
    if picture:
        raise UsageError(f"picture {picture!r}: of a receptive field there is but one")
    from fembridge.plots.field import field_figure

    return field_figure(result)


def _without_none(options: Mapping[str, Any]) -> dict[str, Any]:
    """The options that were given."""
    return {name: value for name, value in options.items() if value is not None}


def _model(
    finger: str | Finger,
    probe: Probe | None,
    contact: Contact,
    element: str,
    inertia: bool,
    whole_section: bool,
    law: str,
) -> Model:
    from decks.analysis import LAWS, Model
    from decks.presets import mesh_of, read_finger
    from decks.probe import Probe

    loaded_finger = read_finger(finger) if isinstance(finger, str) else finger
    if law not in LAWS:
        raise UsageError(f"law {law!r}, expected {' or '.join(LAWS)}")
    return Model(
        loaded_finger,
        mesh_of(loaded_finger),
        probe or Probe(),
        contact,
        element,
        inertia,
        section="whole" if whole_section else "half",
        law=law,
    )


def fit(
    observed: PathLike | pandas.DataFrame,
    *,
    afferents: Sequence[str] | None = None,
    drive: str | None = None,
    cells: int | None = None,
    family: str = "sine",
    preindent_um: float | None = None,
    evaluations: int | None = None,
    population: int | None = None,
    seed: int = 1,
    rule: str = "smallest_error",
    thresholds: PathLike | None = None,
    timing: bool = False,
    spikes: PathLike | None = None,
    spike_distance: str = "van_rossum",
    held_out: bool = False,
    finger: str | None = None,
    response: PathLike | None = None,
    complete: bool = False,
    output: PathLike | None = None,
    log: Callable[[str], None] = lambda line: None,
    on_progress: Callable[[str, Any], None] | None = None,
) -> FitRun:
    """Parameters whose rates come closest to `observed` ones, class by class.

    Parameters
    ----------
    observed
        A DataFrame or the path of a table, ``stimulus, afferent, rate_ips``; `complete`
        where each stimulus must have a rate of each class.
    afferents, drive, cells
        Classes to fit, None: all that have rates; their model, and how many cells.
    family
        ``sine``, ``diharm``, ``noise`` or ``all``: what is fitted; the rest is judged.
    preindent_um
        Depth of the probe before time 0. None: 0 of the published model, else that of
        the fitted parameters.
    evaluations, population, seed, rule
        Of the search, and of the choice; the same seed gives the same fit.
    thresholds
        A table ``afferent, criterion, frequency_hz, amplitude_um``, or the name of one of
        `fembridge.evidence`: fitted beside the rates.
    timing
        Fit the published vector strengths at 20 Hz beside the rates.
    spikes
        A table ``stimulus, afferent, repeat, spike_time_ms``: fitted beside the rates,
        with a latency, by `spike_distance`, ``van_rossum`` or ``victor_purpura``.
    held_out
        Predict the stimuli of each frequency (each group) by one fit more that did not
        see them.
    finger, response
        Whose stored response makes the stress; or a response of one's own.
    output
        Folder for the files of the command. None: nothing is written.
    log, on_progress
        Called with a line about each fit; with a class and how far its search is.

    Returns
    -------
    FitRun
        ``fits`` has one a class, with ``parameters``; an interrupt leaves out later ones.

    Raises
    ------
    TableError
        A row of `observed` that is no rate, with its line.
    UsageError, ResponseError
        A class without rates; a finger without a stored response.

    Examples
    --------
    >>> import fembridge as fb
    >>> observed = fb.simulate("sine_20", stored=True).rates
    >>> [fit] = fb.fit(observed, afferents=["SA"], evaluations=80, population=40).fits
    >>> fit.afferent
    'SA'
    """
    from dataclasses import replace

    from fembridge.evidence import THRESHOLDS, published_timing, read_evidence
    from fembridge.fitting import fit as fitting
    from fembridge.fitting.problem import (
        EVERY,
        models_to_fit,
        phase_target,
        solved_source,
        stored_source,
        threshold_target,
        timing_target,
    )
    from fembridge.observed import FAMILIES, read_observed
    from fembridge.store import check_output, filling
    from fembridge.tables import AFFERENTS, read_spikes
    from neural import parameter_set

    default_preindent_um = 0.0 if drive == "published" else parameter_set("fitted").preindent_um
    search = {"evaluations": evaluations, "population": population}
    settings = fitting.FitSettings(
        families=FAMILIES if family == EVERY else (family,),
        preindent_um=default_preindent_um if preindent_um is None else preindent_um,
        cells=cells,
        seed=seed,
        rule=rule,
        held_out=held_out,
        **_without_none(search),
    )
    rates = read_observed(
        Path(observed) if isinstance(observed, str) else observed, complete=complete
    )
    models = models_to_fit(rates, afferents, drive, settings.families, log)
    source = solved_source(Path(response)) if response else stored_source(finger or "quick")
    threshold_rows = None if thresholds is None else read_evidence(thresholds, THRESHOLDS).table
    trains = None if spikes is None else read_spikes(Path(spikes))

    def targets_of(model: AfferentModel) -> list[Target]:
        model_arguments = (source.response, model, settings.preindent_um)
        targets: list[Target | None] = []
        if threshold_rows is not None:
            targets.append(threshold_target(threshold_rows, *model_arguments))
        if timing:
            targets.append(phase_target(published_timing(), *model_arguments))
        if trains is not None:
            targets.append(timing_target(trains, *model_arguments, spike_distance))
        return [target for target in targets if target is not None]

    if output is not None:
        front_files = map(fitting.front_file, models)
        files = (fitting.PARAMETERS_FILE, fitting.RATES_FILE, fitting.PICTURE_FILE)
        check_output(Path(output), *files, *front_files)
    run = fitting.fit_afferents(
        rates,
        source.response,
        models,
        settings,
        targets_of=targets_of,
        on_progress=on_progress,
        log=log,
    )
    options = {
        "afferent": None if afferents is None else list(afferents),
        "drive": drive,
        "cells": cells,
        "family": family,
        "preindent_um": preindent_um,
        "finger": finger,
        "thresholds": None if thresholds is None else Path(thresholds).name,
        "timing": timing,
        "spikes": None if spikes is None else Path(spikes).name,
        "spike_distance": None if spikes is None else spike_distance,
        "held_out": held_out or None,
        "own_response": response is not None,
        "allow_missing": not complete,
    }
    run = replace(run, provenance=fitting.fit_table(run, rates, source, options))
    if output is not None:
        from fembridge.plots.fit import tradeoffs_figure
        from fembridge.plots.style import save_figure

        with filling(Path(output), last=fitting.PARAMETERS_FILE) as draft:
            fitting.write_fit(draft, run, f"fit_{drive}" if drive else "fit")
            save_figure(tradeoffs_figure(run), draft / fitting.PICTURE_FILE)
        for name in set(map(fitting.front_file, AFFERENTS)) - set(run.front_files):
            (Path(output) / name).unlink(missing_ok=True)  # of an earlier fit
    return run


def thresholds(
    afferents: Sequence[str] = ("SA", "RA", "PC"),
    hz: str | Sequence[float] = "2:800",
    *,
    parameters: str | ParameterSet = "fitted",
    preindent_um: float | None = None,
    finger: str | None = None,
    response: PathLike | None = None,
) -> pandas.DataFrame:
    """How faint a vibration each class answers, against frequency.

    Parameters
    ----------
    hz
        Frequencies from 2 to 800 Hz, or a range of third octaves as ``5:800``.
    parameters, preindent_um
        As of `simulate`.
    finger, response
        Whose stored response makes the stress; or a response of one's own.

    Returns
    -------
    DataFrame
        ``afferent, criterion, frequency_hz, amplitude_um, least_um, most_um``: see
        `fembridge.tuning.thresholds`.

    Raises
    ------
    UsageError
        No such class, or a frequency that is not within 2 to 800 Hz.

    Examples
    --------
    >>> import fembridge as fb
    >>> keen = fb.thresholds(["PC"], [20, 250]).query("criterion == 'absolute'")
    >>> keen["amplitude_um"].is_monotonic_decreasing
    True
    """
    import pandas

    from fembridge.fitting.problem import solved_source, stored_source
    from fembridge.tuning import frequencies_of
    from fembridge.tuning import thresholds as class_thresholds
    from neural import parameter_set

    encoding_parameters = parameter_set(parameters)
    if unknown := [name for name in afferents if name not in encoding_parameters.parameters]:
        available = ", ".join(encoding_parameters.parameters)
        raise UsageError(f"afferent {unknown[0]!r}, expected one of {available}")
    depth_um = encoding_parameters.preindent_um if preindent_um is None else preindent_um
    source = solved_source(Path(response)) if response else stored_source(finger or "quick")
    frequencies_hz = frequencies_of(hz) if isinstance(hz, str) else list(hz)
    return pandas.concat(
        [
            class_thresholds(
                source.response, encoding_parameters.parameters[name], frequencies_hz, depth_um
            )
            for name in dict.fromkeys(afferents)
        ],
        ignore_index=True,
    )


def validate(
    output: PathLike | None = None,
    *,
    finger: str = "quick",
    response: PathLike | None = None,
    observed: PathLike | None = None,
    parameters: str = "fitted",
    thresholds: PathLike | None = None,
    spikes: PathLike | None = None,
    impulses: PathLike | None = None,
    distance: PathLike | None = None,
    log: Callable[[str], None] = lambda line: None,
) -> Validation:
    """The paper's figures and tables against the model; with `output` as a page there.

    Parameters
    ----------
    finger
        ``quick``, ``paper`` or a TOML file, whose response is then solved.
    response
        Or a response of one's own, as `simulate` keeps it.
    observed
        Table of observed rates, ``stimulus, afferent, rate_ips``.
    parameters
        ``fitted``, ``published`` or a TOML file.
    spikes
        Recorded spikes to show in the place of the published ones: a table as of `fit`.
    thresholds, impulses, distance
        Tables to show in the place of the published ones of `fembridge.evidence`:
        thresholds, impulses a cycle, amplitudes against distance. Lines that begin with #
        are their source.

    Returns
    -------
    Validation
        The tables of the page as DataFrames.

    Raises
    ------
    TableError, ParameterError, FingerError
        A file that is wrong, with its line or key.
    MissingError
        No solver, and no response is stored for `finger`.

    Examples
    --------
    >>> import fembridge as fb
    >>> fb.validate().judged.name
    'fitted'
    """
    from fembridge.evidence import DISTANCE, MAN, THRESHOLDS, read_evidence
    from fembridge.observed import read_observed
    from fembridge.report import validate as report
    from fembridge.report.validation_page import PAGE, write_report
    from fembridge.store import check_output
    from fembridge.tables import read_spikes

    files = {THRESHOLDS: thresholds, MAN: impulses, DISTANCE: distance}
    facts = {name: read_evidence(path, name) for name, path in files.items() if path is not None}
    trains = () if spikes is None else read_spikes(Path(spikes))
    rates = None if observed is None else read_observed(Path(observed), complete=False)
    models = report.judged_models(parameters)
    if output is not None:
        check_output(Path(output), PAGE)
    study = report.validate(
        report.response_of(finger, response, models, log), models, rates, log, facts, trains
    )
    if output is not None:
        write_report(Path(output), study, "fembridge validate")
    return study
