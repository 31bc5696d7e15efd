"""The report of a folder: what it is about, and what its page has.

A run folder, a simulation, a touch, a response map and a pad are told apart by their files. The
sections are the same for all, as far as a folder has them: model, mesh, what drives it, closure,
stress, spikes, checks, and the commands that repeat it.
"""

from __future__ import annotations

import math
import os
import shlex
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from decks.finger import LAYERS, Finger
from decks.prony import name_of_prony
from fembridge.errors import FembridgeError, FembridgeWarning, UsageError
from fembridge.host.store import sha256_of
from fembridge.io.formatting import split_unit
from fembridge.io.run_folder import RUN_FILE, read_run_folder
from fembridge.reporting.folder_page import Check, Picture, Report, Section
from fembridge.response.indentation import CLOSURE_PERCENT
from fembridge.response.response_map import MAP_FILE, ResponseMap, read_map
from fembridge.simulation.deck_response import REASONS_FILE
from fembridge.simulation.folder import RECORD_FILE, TRACES_FILE, stimuli_in
from fembridge.touching.touch_result import RECORD_FILE as TOUCH_RECORD

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from fembridge.io.run_folder import RunFolder
    from fembridge.simulation.encoding import Encoding
    from fembridge.simulation.simulation import Simulation
    from fembridge.stimulus import Stimulus
    from fembridge.touching.pad import Pad
    from fembridge.touching.touch_result import Touch
    from fembridge.trace import Traces

_MOST_WAVEFORMS, _MOST_TRACES, _MOST_RASTER_STIMULI = 12, 12, 12
_MAX_HASHED_BYTES = 2_000_000_000
_PAD_SUFFIX = ".npz"
MAP_RUN = "run"
"""Folder of the load-unload run beside the response map of a user's deck."""
_DECK_TABLES = ("parts", "materials", "steps", "motions", "loads", "contacts", "afferents", "sets")
_CAPTIONS = {
    "parts": "Parts and element types.",
    "materials": "Materials.",
    "steps": "Steps.",
    "motions": "Prescribed displacements.",
    "loads": "Loads.",
    "contacts": "Contact.",
    "afferents": "Afferents.",
    "sets": "Sets.",
}


def report(folder: str | os.PathLike[str]) -> Report:
    """Report of a run folder, a simulation, a touch, a response map or a pad.

    Parameters
    ----------
    folder
        A run folder of `build_deck` or `rebase_deck`, solved or not; the folder of `simulate`
        or `touch`; a response map (``response.toml`` or its folder), also a refused one; or the
        file of a pad.

    Returns
    -------
    Report
        ``checks`` is a DataFrame, ``plot(kind)`` draws a picture of the page, ``write()``
        writes it: one HTML file without scripts.

    Raises
    ------
    UsageError
        The folder is none of these.
    FembridgeError
        A file in it is damaged.

    Examples
    --------
    >>> import fembridge as fb
    >>> fb.simulate("sine_20_250", stored=True).write("out")
    >>> report = fb.report("out")
    >>> report.kind, report.passed
    ('simulation', True)
    """
    path = Path(folder)
    for names, make in _KINDS:
        if any((path / name).is_file() for name in names):
            return make(path)
    if path.is_file():
        if path.name == MAP_FILE or path.suffix == ".toml":
            return _of_map(path)
        if path.suffix == _PAD_SUFFIX:
            return _of_pad(path)
    if (path / MAP_RUN / RUN_FILE).is_file():
        return _of_refused_map(path)
    expected = "a run folder, a folder of simulate or touch, a response map, or a pad"
    problem = "is none of these" if path.exists() else "does not exist, expected"
    raise UsageError(
        f"{problem}: {expected}",
        path,
        argument="folder",
        found=str(path),
        expected=expected,
    )


# ---- A run folder


def _of_refused_map(folder: Path) -> Report:
    """The run of a map that was refused or is not made yet."""
    refused = folder / REASONS_FILE
    if refused.is_file():
        check = Check("map", False, refused.read_text(encoding="utf-8").strip())
    else:
        command = f"fembridge map {shlex.quote(str(folder))}"
        check = Check("map", None, f"no map is made of this run: {command}")
    return _of_run(folder / MAP_RUN, (check,), folder)


def _of_run(folder: Path, first_checks: Sequence[Check] = (), about: Path | None = None) -> Report:
    """The report of the run in `folder`; the page is in the folder `about`, else in its own."""
    run = read_run_folder(folder)
    base = run.inputs.get("base_deck")
    base = base if isinstance(base, Mapping) else None
    stimuli = stimuli_in(folder).stimuli
    checks = [*first_checks, *_deck_checks(run)]
    sections = [_run_model(run, base)]
    finger = None if base else _finger_of(run.inputs.get("finger"))
    if base:
        sections += list(_own_mesh(run))
        sections.append(_own_drive(run, base, stimuli, checks))
    else:
        sections += _finger_sections(finger, run.inputs.get("probe"))
        sections.append(_drive_section(stimuli))
    sections += _run_results(run, stimuli, checks)
    sections.append(Section("Commands", commands=tuple(_run_commands(run, base))))
    name = base.get("file", "own deck") if base else run.inputs.get("finger", {}).get("name", "")
    title = f"{stimuli[0].id if stimuli else folder.name} in {name}"
    lead = f"A run folder for {_solver_name(run.solver)}: {folder}."
    return Report(about or folder, "run", title, lead, tuple(sections), tuple(checks))


def _solver_name(solver: str) -> str:
    from fembridge.solver.check import SOLVER_NAMES

    return SOLVER_NAMES.get(solver, solver)


def _run_model(run: RunFolder, base: Mapping[str, Any] | None) -> Section:
    inputs = run.inputs
    facts: dict[str, object] = {
        "solver": _solver_name(run.solver),
        "deck": run.deck.name,
        "deck sha256": run.deck_sha256,
        "increments": run.increments_in_all,
        "dt_ms": run.dt_ms,
        "start of the waveform_ms": run.start_ms,
        "afferents": [f"{site.key}: node {site.node}" for site in run.afferents],
    }
    if base:
        facts |= {"made of": base.get("file"), "its sha256": base.get("sha256")}
        facts |= {"length in": run.length_unit, "stress in": run.stress_unit}
    else:
        facts |= {
            "finger": inputs.get("finger", {}).get("name"),
            "element": inputs.get("element"),
            "law": inputs.get("law", "linear"),
            "contact": _pairs(inputs.get("contact")),
            "probe": _pairs(inputs.get("probe")),
        }
    facts["parameter set"] = _mapping(inputs.get("parameters")).get("name")
    return Section("Model", facts=facts)


def _own_mesh(run: RunFolder) -> Iterator[Section]:
    from decks.own_model.deck_mesh import read_deck_mesh
    from decks.unit_system import LENGTH_UNITS
    from fembridge.plots.deck_mesh import deck_mesh_figure

    try:
        mesh = read_deck_mesh(run.deck)
    except (FembridgeError, OSError) as error:
        yield Section("Mesh", f"The mesh cannot be drawn: {error}")
        return
    mm = LENGTH_UNITS[run.length_unit].length_mm if run.length_unit in LENGTH_UNITS else 1.0
    sites = {
        site.key: (site.x_mm / mm, site.y_mm / mm, (site.z_mm or 0.0) / mm)
        for site in run.afferents
    }
    caption = f"{len(mesh.face)} faces by material, and the afferents."
    if not mesh.flat:
        caption += (
            " Seen from above a corner, and along y; afferents inside are drawn over the faces."
        )
    draw = partial(deck_mesh_figure, mesh, sites, run.length_unit)
    yield Section("Mesh", pictures=(Picture("mesh", caption, draw),))


def _own_drive(
    run: RunFolder, base: Mapping[str, Any], stimuli: Sequence[Stimulus], checks: list[Check]
) -> Section:
    """Waveform and changes of a user's deck, and what the check of its deck finds."""
    from decks.own_model import Request
    from fembridge.solver.build import BaseDeck
    from fembridge.solver.check import inspect

    tables: dict[str, DataFrame] = {}
    with suppress(FembridgeError, OSError):
        data = run.deck.read_bytes()
        afferents = {site.key: site.node for site in run.afferents}
        request = Request(afferents=afferents, length_unit=_length_unit(run.length_unit))
        inspection = inspect(BaseDeck(run.deck, data, run.solver), request)
        from pandas import DataFrame

        for name in _DECK_TABLES:
            if rows := getattr(inspection, name):
                frame = DataFrame(rows).dropna(axis=1, how="all")
                tables[_CAPTIONS[name]] = frame.loc[:, [(frame[c] != "").any() for c in frame]]
        for finding in inspection.problems:
            checks.append(Check(f"deck: {finding.topic}", False, str(finding)))
        for finding in inspection.warnings:
            checks.append(Check(f"deck: {finding.topic}", None, str(finding)))
    section = _drive_section(stimuli)
    return Section(
        section.title,
        "Changes of your deck, each with its line, and the deck as it is now.",
        pictures=section.pictures,
        tables=tables,
        items=tuple(map(str, base.get("changes", ()))),
    )


def _length_unit(unit: str) -> str | None:
    from decks.unit_system import LENGTH_UNITS

    return unit if unit in LENGTH_UNITS else None


def _deck_checks(run: RunFolder) -> Iterator[Check]:
    if not run.deck.is_file():
        yield Check("deck", False, f"{run.deck.name} is missing")
        return
    same = sha256_of(run.deck) == run.deck_sha256
    text = "as it was written" if same else "changed since it was written"
    yield Check("deck", same or None, f"{run.deck.name}: {text}")


def _run_results(
    run: RunFolder, stimuli: Sequence[Stimulus], checks: list[Check]
) -> Iterator[Section]:
    """Cost, stress and spikes of a run that is solved."""
    from fembridge.solver.ccx import finished_outcome
    from fembridge.solver.mechanics import check_mechanics

    if not run.results.is_file():
        checks.append(Check("results", None, f"no {run.results.name}: the run is not solved yet"))
        return
    outcome = None
    if run.solver == "calculix" and run.results.stat().st_size <= _MAX_HASHED_BYTES:
        outcome = finished_outcome(run)
    if outcome is not None:
        text = f"accepted: {outcome.increments} increments, {outcome.iterations} iterations"
        checks.append(Check("run", True, f"{text} in {outcome.wall_s:.0f} s"))
        facts: dict[str, object] = {"version": outcome.version, "increments": outcome.increments}
        facts |= {"iterations": outcome.iterations, "wall_s": outcome.wall_s}
        yield Section("Run", facts=facts)
    else:
        text = (
            "no record of an accepted run with these results: they were not made by fembridge run"
        )
        checks.append(Check("run", None, text))
    with warnings.catch_warnings(record=True) as doubts:
        warnings.simplefilter("always", FembridgeWarning)
        traces = _traces_of(run, checks)
        encoding = None if traces is None else _encoded(run, checks)
    checks += [
        Check("encoding", None, str(doubt.message))
        for doubt in doubts
        if issubclass(doubt.category, FembridgeWarning)
    ]
    if traces is None:
        return
    checks.append(_stress_check(list(traces)))
    yield from _stress_sections(list(traces), stimuli[0] if stimuli else None)
    if encoding is None:
        return
    if traces.origin is not None:  # `encode` warned, which the checks have
        origin = traces.origin
        check_mechanics(encoding.parameters, origin.finger, {origin.preindent_um})
    spikes = partial(encoding.plot, "raster")
    yield Section(
        "Spikes",
        pictures=(Picture("raster", "Spikes of each class; a line per spike and cell.", spikes),),
        tables={"Firing rates in impulses/s.": encoding.rates},
    )


def _traces_of(run: RunFolder, checks: list[Check]) -> Traces | None:
    from fembridge.results.result import read

    if not run.afferents:
        checks.append(Check("stress", None, "no afferent is named: build-deck --afferent SA=NODE"))
        return None
    try:
        return read(run)
    except FembridgeError as error:
        checks.append(Check("stress", False, str(error)))
        return None


def _encoded(run: RunFolder, checks: list[Check]) -> Encoding | None:
    from fembridge.simulation.encode import encode

    try:
        return encode(run)
    except FembridgeError as error:
        checks.append(Check("spikes", None, f"not encoded: {error}"))
        return None


def _own_options(run: RunFolder, base: Mapping[str, Any]) -> list[str]:
    """Options of a user's deck: those of its request, and its afferents."""
    words = []
    for name, value in _mapping(base.get("request")).items():
        option = name.replace("_", "-")
        words += [f"--no-{option}"] if value is False else [f"--{option}", str(value)]
    if load := _mapping(base.get("load")):
        option = "--newton-per-um" if load.get("quantity") == "force" else "--mpa-per-um"
        words += [option, str(load.get("per_um"))]
    nodes: dict[str, list[str]] = {}
    for site in run.afferents:
        nodes.setdefault(site.afferent, []).append(str(site.node))
    for name, numbers in nodes.items():
        words += ["--afferent", f"{name}={','.join(numbers)}"]
    return words


def _run_commands(run: RunFolder, base: Mapping[str, Any] | None) -> Iterator[str]:
    folder, stimulus = shlex.quote(str(run.folder)), _mapping(run.inputs.get("stimulus"))
    words = ["fembridge", "build-deck", "--stimulus", str(stimulus.get("id", "ID"))]
    if base:
        words += ["--base-deck", str(base.get("file"))]
        words += _own_options(run, base)
    else:
        words += ["--solver", run.solver]
        finger = _mapping(run.inputs.get("finger")).get("name")
        words += ["--finger", str(finger)]
    if preindent_um := stimulus.get("preindent_um"):
        words += ["--preindent-um", f"{preindent_um:g}"]
    yield shlex.join([*words, "-o", str(run.folder.parent)])
    if run.solver == "calculix":
        yield f"fembridge run {folder}"
    yield f"fembridge ingest {folder} -o traces.csv"
    yield f"fembridge encode {folder} -o spikes"
    yield f"fembridge report {folder}"


# ---- A simulation


def _of_simulation(folder: Path) -> Report:
    from fembridge.simulation.simulation import Simulation

    result = Simulation.read(folder)
    origin = dict(result.origin)
    response = _mapping(origin.get("response"))
    finger = _finger_of(response.get("finger"))
    checks = list(_simulation_checks(result))
    facts: dict[str, object] = {
        "method": origin.get("method"),
        "why no map": origin.get("no_map"),
        "solver": origin.get("source"),
        "finger": finger.name if finger else response.get("finger"),
        "element": response.get("element"),
        "law": response.get("law", "linear") if finger else None,
        "contact": _pairs(response.get("contact")),
        "probe": _pairs(response.get("probe")),
        "parameter set": origin.get("parameter_set"),
    }
    sections = [Section("Model", facts=facts), *_finger_sections(finger, response.get("probe"))]
    sections.append(_drive_section(result.stimuli))
    if (folder / "response" / MAP_FILE).is_file():
        sections.append(_closure_section(read_map(folder / "response" / MAP_FILE), checks))
    first = next(iter(result.stimuli))
    checks.append(_stress_check([trace for row in result.traces for trace in row]))
    sections += _stress_sections(list(result.traces[0]), first)
    sections.append(_simulated_spikes(result))
    sections.append(
        Section("Commands", commands=tuple(_simulation_commands(folder, result, finger)))
    )
    names = [stimulus.id for stimulus in result.stimuli]
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    title = f"Simulation of {', '.join(names[:3])}{more}"
    lead = f"From a stimulus to spikes of the median afferent of each class: {folder}."
    return Report(folder, "simulation", title, lead, tuple(sections), tuple(checks))


def _simulation_checks(result: Simulation) -> Iterator[Check]:
    closure = result.origin.get("closure_percent")
    if isinstance(closure, int | float) and math.isfinite(closure):
        text = f"unloading within {closure:.2g} % of loading, limit {CLOSURE_PERCENT:g} %"
        yield Check("closure", closure <= CLOSURE_PERCENT, text)
    yield from _fit_checks(result)
    if reason := result.origin.get("no_map"):
        yield Check("response map", None, f"not used: {reason}")
    silent = sorted({rate.afferent for rate in result.mean_rates})
    silent = [
        name
        for name in silent
        if not any(rate.rate_ips for rate in result.mean_rates if rate.afferent == name)
    ]
    text = f"silent under every stimulus: {', '.join(silent)}" if silent else "every class fires"
    yield Check("spikes", None if silent else True, text)


def _fit_checks(result: Simulation) -> Iterator[Check]:
    """Whether the parameter set was fitted on these mechanics."""
    from fembridge.trace import model_id

    mechanics = model_id(_mapping(result.origin.get("response")))
    depths_um = {stimulus.preindent_um for stimulus in result.stimuli}
    yield from _mechanics_checks(result.origin, mechanics, depths_um)


def _mechanics_checks(
    record: Mapping[str, Any], mechanics: Mapping[str, str], depths_um: set[float] | None
) -> Iterator[Check]:
    """Whether the parameter set of a record was fitted on `mechanics`; a difference is a warning.

    None of `depths_um`: the shape began above the skin.
    """
    from fembridge.solver.mechanics import check_mechanics
    from neural.parameter_sets import ParameterSet

    selected = ParameterSet.from_record(dict(record), "the record")
    if selected is None or not mechanics:
        return
    mismatch = check_mechanics(selected, mechanics, depths_um)
    yield Check("parameters", None if mismatch else True, mismatch or "fitted on these mechanics")


def _simulated_spikes(result: Simulation) -> Section:
    from fembridge.plots.spike_figures import raster_figure

    shown = [stimulus.id for stimulus in result.stimuli][:_MOST_RASTER_STIMULI]
    classes = list(dict.fromkeys(rate.afferent for rate in result.mean_rates))
    trains = [train for train in result.trains if train.stimulus in shown]
    draw = partial(
        raster_figure,
        trains,
        stimuli=shown,
        afferents=classes,
        waveform=result.stimuli[0] if len(result.stimuli) == 1 else None,
    )
    caption = "Spikes: a panel per class, a row per stimulus, a line per spike and cell."
    return Section(
        "Spikes",
        pictures=(Picture("raster", caption, draw),),
        tables={"Firing rates in impulses/s.": result.rates},
    )


def _simulation_commands(folder: Path, result: Simulation, finger: Finger | None) -> Iterator[str]:
    from decks.presets import PRESETS

    words = ["fembridge", "simulate"]
    for stimulus in result.stimuli:
        words += ["--stimulus", stimulus.id]
    if finger is not None:
        is_preset = PRESETS.get(finger.name) == finger
        words += ["--finger", finger.name if is_preset else str(folder / "finger.toml")]
    if name := result.origin.get("parameter_set"):
        words += ["--parameters", str(name)]
    if (preindent_um := result.stimuli[0].preindent_um) is not None:
        words += ["--preindent-um", f"{preindent_um:g}"]
    yield shlex.join([*words, "-o", f"{folder}_again"])
    yield f"fembridge plot raster {shlex.quote(str(folder))}"
    yield f"fembridge report {shlex.quote(str(folder))}"


# ---- A touch


def _of_touch(folder: Path) -> Report:
    from fembridge.touching.touch_result import Touch

    touch = Touch.read(folder)
    origin, pad = dict(touch.origin), touch.contact.nodes.pad
    doubts = [str(text) for text in origin.get("warnings", ())]
    checks = [Check("contact", None, text) for text in doubts]
    checks = checks or [Check("contact", True, "no warning")]
    start_um = touch.trajectory.preindent_um
    depths_um = None if start_um is None else {start_um}
    checks += _mechanics_checks(origin, pad.mechanics, depths_um)
    deepest, hardest = float(touch.depth_um.max()), float(touch.force_n.max())
    facts: dict[str, object] = {
        "pad": _mapping(origin.get("pad")).get("source") or "in memory",
        "pad solver": _mapping(origin.get("pad")).get("solver"),
        "model": pad.mechanics["name"],
        "shape": _pairs(origin.get("shape")) or "pins",
        "friction": origin.get("friction"),
        "units": len(touch.population),
        "parameter set": origin.get("parameter_set"),
        "trials": origin.get("trials"),
        "noise mv": origin.get("noise_mv"),
        "nodes in contact": origin.get("nodes_in_contact"),
    }
    drive = {
        "trajectory": touch.trajectory.name,
        "control": "force" if touch.trajectory.by_force else "depth",
        "samples": int(touch.trajectory.level.size),
        "dt_ms": touch.trajectory.dt_ms,
        "largest depth_um": deepest,
        f"largest force ({touch.force_unit})": hardest,
    }
    caption = "The pad from above: rates of the units and contact pressure, a panel per class."
    sections = [
        Section("Model", facts=facts),
        *_pad_materials(pad),
        Section(
            "What drives it",
            facts=drive,
            pictures=(
                Picture("force", "Depth and force over time.", partial(touch.plot, "force")),
            ),
        ),
    ]
    if relaxation := _mapping(origin.get("relaxation")):
        sections.append(_relaxation_section(relaxation))
    sections += [
        Section("Skin", pictures=(Picture("pad", caption, partial(touch.plot, "pad")),)),
        _touched_spikes(touch),
        Section("Commands", commands=tuple(_touch_commands(folder, touch))),
    ]
    title = f"{_mapping(origin.get('shape')).get('name', 'pins')}: {touch.trajectory.name}"
    lead = f"A touch on a whole fingertip, spikes of every afferent: {folder}."
    return Report(folder, "touch", title, lead, tuple(sections), tuple(checks))


def _touched_spikes(touch: Touch) -> Section:
    from pandas import DataFrame

    rows = [{"afferent": name, **values} for name, values in touch.summary().items()]
    caption = "Every unit that fires, a line per spike."
    return Section(
        "Spikes",
        pictures=(Picture("raster", caption, partial(touch.plot, "raster")),),
        tables={"Units, and rates in impulses/s.": DataFrame(rows)},
    )


def _relaxation_section(relaxation: Mapping[str, Any]) -> Section:
    from pandas import DataFrame

    tau_ms = relaxation["tau_ms"]
    shares = {"force": relaxation["g"], **_mapping(relaxation.get("layers"))}
    rows = []
    for name, values in shares.items():
        lost = {f"at {tau:g} ms": g for tau, g in zip(tau_ms, values, strict=True)}
        rows.append({"of": name.replace("_", " "), **lost, "lasting": 1 - sum(values)})
    text = "Skin relaxes: shares that are lost with each time constant at a depth that is kept."
    return Section("Relaxation", text, tables={"Shares.": DataFrame(rows)})


def _touch_commands(folder: Path, touch: Touch) -> Iterator[str]:
    if command := touch.origin.get("command"):
        yield str(command)
    yield f'python -c "import fembridge as fb; print(fb.Touch.read({str(folder)!r}))"'
    yield f"fembridge report {shlex.quote(str(folder))}"


# ---- A response map, a pad


def _of_map(path: Path) -> Report:
    file = path / MAP_FILE if path.is_dir() else path
    response = read_map(file)
    origin, checks = _mapping(response.origin), list[Check]()
    finger = _finger_of(origin.get("finger"))
    facts: dict[str, object] = {
        "solver": origin.get("solver"),
        "deck sha256": origin.get("deck_sha256"),
        "finger": finger.name if finger else None,
        "element": origin.get("element"),
        "deepest_um": response.deepest_um,
        "afferents": [f"{site.key}: node {site.node}" for site in response.places],
    }
    commands = [
        f"fembridge simulate --response {shlex.quote(str(file))} --stimulus sine_20_250",
        f"fembridge report {shlex.quote(str(path))}",
    ]
    sections = [Section("Model", facts=facts), *_finger_sections(finger, origin.get("probe"))]
    closure = _closure_section(response, checks)
    if (run := _own_run(file.parent / MAP_RUN)) is not None:
        base = run.inputs["base_deck"]
        checks += _deck_checks(run)
        sections += _own_mesh(run)
        sections.append(_own_drive(run, base, stimuli_in(run.folder).stimuli, checks))
        words = ["fembridge", "map", "--base-deck", str(base.get("file")), *_own_options(run, base)]
        for name in ("depth_um", "retract_um", "steps"):
            if value := _mapping(run.inputs.get("stimulus")).get(name):
                words += [f"--{name.replace('_', '-')}", f"{value:g}"]
        commands.insert(0, shlex.join([*words, "-o", str(file.parent)]))
    sections += [closure, Section("Commands", commands=tuple(commands))]
    lead = f"Stress at each afferent against the depth of the probe: {file}."
    return Report(path, "map", f"Response map {file}", lead, tuple(sections), tuple(checks))


def _own_run(folder: Path) -> RunFolder | None:
    """The run folder of your own deck; None for another folder."""
    if not (folder / RUN_FILE).is_file():
        return None
    run = read_run_folder(folder)
    return run if isinstance(run.inputs.get("base_deck"), Mapping) else None


def _closure_section(response: ResponseMap, checks: list[Check]) -> Section:
    from fembridge.plots.response import closure_text, response_figure

    closed = response.closure_percent
    if not any(check.name == "closure" for check in checks):
        finite = math.isfinite(closed)
        text = f"unloading within {closed:.2g} % of loading, limit {CLOSURE_PERCENT:g} %"
        passed = closed <= CLOSURE_PERCENT if finite else None
        checks.append(Check("closure", passed, text if finite else "unloading was not compared"))
    caption = "Stress at each afferent and force on the probe against its depth; dots are solved."
    return Section(
        "Closure",
        closure_text(response),
        pictures=(Picture("response", caption, partial(response_figure, response)),),
    )


def _pad_materials(pad: Pad) -> tuple[Section, ...]:
    """Materials of the finger of a pad; none for the pad of a mesh."""
    from fembridge.touching.prism_pad import PrismPad

    return (_materials_section(pad.finger),) if isinstance(pad, PrismPad) else ()


def _of_pad(path: Path) -> Report:
    from fembridge.touching.pad_file import resolve_pad

    pad = resolve_pad(path)
    facts: dict[str, object] = {
        "model": pad.mechanics["name"],
        "spacing_mm": pad.spacing_mm,
        "reach_mm": pad.reach_mm,
        "sha256": pad.sha256,
        **{
            str(name): value for name, value in pad.origin.items() if not isinstance(value, Mapping)
        },
    }
    checks = (Check("file", True, "its numbers match its checksum"),)
    sections = (
        Section("Model", facts=facts),
        *_pad_materials(pad),
        Section(
            "Commands", commands=(f"fembridge touch --pad {shlex.quote(str(path))} --press-um 200",)
        ),
    )
    return Report(path, "pad", f"Pad {path.name}", repr(pad), sections, checks)


_KINDS: tuple[tuple[tuple[str, ...], Callable[[Path], Report]], ...] = (
    ((TOUCH_RECORD,), _of_touch),
    ((RECORD_FILE, TRACES_FILE), _of_simulation),
    ((RUN_FILE,), _of_run),
    ((MAP_FILE,), _of_map),
)
"""Files of each kind of folder, and the function that makes its report."""


# ---- What several kinds have


def _drive_section(stimuli: Sequence[Stimulus]) -> Section:
    from fembridge.plots.waveform_overview import waveform_figure

    shown = list(stimuli)[:_MOST_WAVEFORMS]
    if not shown:
        return Section("What drives it", "No waveform is known.")
    facts: dict[str, object] = {}
    if len(stimuli) == 1:
        facts = {
            "stimulus": shown[0].id,
            "dt_ms": shown[0].dt_ms,
            "samples": len(shown[0].displacement_um),
            "counting window_ms": list(shown[0].window_ms),
            "preindent_um": shown[0].preindent_um,
            "deepest_um": float(shown[0].displacement_um.max()),
        }
    caption = "Depth of the probe over time."
    if len(stimuli) > len(shown):
        caption += f" The first {len(shown)} of {len(stimuli)} stimuli."
    picture = Picture("waveform", caption, partial(waveform_figure, shown))
    return Section("What drives it", facts=facts, pictures=(picture,))


def _stress_check(traces: Sequence[Any]) -> Check:
    """Whether each of the traces, of all stimuli, has stress."""
    flat = [trace.afferent or f"node {trace.node}" for trace in traces if not trace.stress_pa.any()]
    text = f"0 all along: {', '.join(flat)}" if flat else f"{len(traces)} traces, none of them 0"
    return Check("stress", None if flat else True, text)


def _stress_sections(traces: Sequence[Any], waveform: Stimulus | None) -> Iterator[Section]:
    from pandas import DataFrame

    from fembridge.plots.stress_history import trace_figure

    shown = list(traces)[:_MOST_TRACES]
    caption = "Von Mises stress at each afferent."
    if waveform is not None:
        caption += f" {waveform.id}; the time outside the counting window is shaded."
    rows = [
        {
            "afferent": trace.afferent,
            "node": trace.node,
            "largest_pa": float(trace.stress_pa.max()),
            "first_pa": float(trace.stress_pa[0]),
            "last_pa": float(trace.stress_pa[-1]),
        }
        for trace in traces
    ]

    def draw() -> Figure:
        return trace_figure(shown, waveform=waveform)

    yield Section(
        "Stress",
        pictures=(Picture("traces", caption, draw),),
        tables={"Stress at each afferent.": DataFrame(rows)},
    )


def _finger_of(table: object) -> Finger | None:
    from decks.presets import PRESETS, finger_from

    if isinstance(table, str):
        return PRESETS.get(table)
    if not isinstance(table, Mapping):
        return None
    with suppress(FembridgeError):
        return finger_from(table, name="own")
    return None


def _finger_sections(finger: Finger | None, probe: object) -> list[Section]:
    """Layers of a finger as a table, and its mesh if that is stored or can be made."""
    if finger is None:
        return []
    return [_materials_section(finger, tuple(_finger_pictures(finger, probe)))]


def _materials_section(finger: Finger, pictures: tuple[Picture, ...] = ()) -> Section:
    from pandas import DataFrame

    rows = []
    for layer in LAYERS:
        material = finger.materials[layer]
        named = name_of_prony(material.prony)
        terms = ", ".join(f"{term.g:g} at {1e3 * term.tau_s:g} ms" for term in material.prony)
        rows.append(
            {
                "layer": layer.replace("_", " "),
                "young_mpa": material.young_mpa,
                "poisson": material.poisson,
                "law": material.law or "",
                "anisotropy": "yes" if material.anisotropy else "",
                "prony": f"{named}: {terms}" if named else terms,
            }
        )
    frame = DataFrame(rows)
    frame = frame.loc[:, [(frame[name] != "").any() for name in frame]]
    return Section("Finger", pictures=pictures, tables={"Materials at rest.": frame})


def _finger_pictures(finger: Finger, probe: object) -> Iterator[Picture]:
    from decks.presets import mesh_of
    from decks.probe import Probe
    from fembridge.plots.finger_mesh import mesh_figure

    with suppress(FembridgeError, TypeError):
        placed = Probe(**probe) if isinstance(probe, Mapping) else Probe()
        mesh = mesh_of(finger)
        caption = "The section and the pad under the probe, with its layers and afferents."
        yield Picture("mesh", caption, partial(mesh_figure, finger, mesh, placed))


def _mapping(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _pairs(value: object) -> str:
    """A table as one line."""
    texts = []
    for name, item in _mapping(value).items():
        plain, unit = split_unit(name)
        number = isinstance(item, int | float) and not isinstance(item, bool)
        words = plain.replace("_", " ").strip()
        texts.append(f"{words} {item:g} {unit}".rstrip() if number else str(item))
    return ", ".join(texts)
