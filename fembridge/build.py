"""From a finger and stimuli to run folders: decks that a solver, or a person, takes."""

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path

from decks.analysis import Analysis, Model
from decks.dialects import DeckOptions, dialect_named
from decks.finger_file import finger_table
from fembridge.exports import write_csv
from fembridge.run_folder import RUN_FILE, STIMULUS_FILE, AfferentNode, RunFolder
from fembridge.stimulus import Stimulus
from fembridge.store import filling, write_text
from fembridge.typing import Table

_MS_PER_S = 1.0e3


def build_run_folder(
    folder: Path,
    model: Model,
    stimulus: Stimulus,
    *,
    solver: str = "calculix",
    options: DeckOptions = DeckOptions(),  # noqa: B008 - frozen
) -> RunFolder:
    """Write deck, waveform and ``run.toml`` into `folder`.

    `solver` names one of `decks.dialects.DIALECTS`. ``run.toml`` takes its place
    last: a folder that has one is whole. Where the same files are already,
    nothing is touched.

    Raises
    ------
    OutputError
        The folder cannot be made or written.
    DeckError, FingerError
        The model or the stimulus cannot be put into a deck.
    """
    inputs = inputs_of(model, stimulus)
    held = dialect_named(solver).contact
    inputs["contact"] = {name: getattr(model.contact, name) for name in held}
    analysis = model.analysis(stimulus)
    if analysis.support != "prescribed" and dialect_named(solver).springs:
        inputs["drive"] = analysis.support
        why = analysis.why_whole
        inputs["section"] = f"whole: {why}" if why else "half"
    return build_analysis_folder(folder, analysis, stimulus, inputs, solver=solver, options=options)


def build_analysis_folder(
    folder: Path,
    analysis: Analysis,
    stimulus: Stimulus,
    inputs: Table,
    *,
    solver: str = "calculix",
    options: DeckOptions = DeckOptions(),  # noqa: B008 - frozen
) -> RunFolder:
    """As `build_run_folder`, for an analysis that was put together already.

    `inputs` is in ``run.toml`` what it was made from; `stimulus` is what it
    prescribes. Errors are the same.
    """
    dialect = dialect_named(solver)
    files = dialect.write(analysis, options)
    motion = analysis.motion
    own_steps = len(motion.phases) > 1  # up to the waveform
    last = motion.phases[-1]
    start_ms = (
        _MS_PER_S * motion.start_s if own_steps else motion.ramp // last.every * stimulus.dt_ms
    )
    run = RunFolder(
        folder=folder,
        solver=solver,
        increments=last.increments // last.every,
        solver_increments=(
            motion.increments if motion.increments != last.increments // last.every else 0
        ),
        dt_ms=stimulus.dt_ms,
        start_ms=start_ms,
        before_ms=start_ms if own_steps else 0.0,
        branches=dialect.branches_at(analysis),
        on_axis=analysis.watched_on_axis if dialect.springs else (),
        afferents=_places(analysis),
        apex_node=analysis.apex,
        deck_sha256=hashlib.sha256(files[dialect.deck].encode()).hexdigest(),
        inputs=inputs,
    )
    with filling(folder, last=RUN_FILE) as draft:
        for name, text in files.items():
            write_text(draft / name, text)
        write_csv(stimulus, draft / STIMULUS_FILE)
        replace(run, folder=draft).write()
    return run


def _places(analysis: Analysis) -> tuple[AfferentNode, ...]:
    places = []
    for name, node in analysis.afferent.items():
        x, y = analysis.node_mm[node - 1].tolist()
        layer = analysis.finger.afferents[name].layer
        places.append(AfferentNode(name, node, layer, x, y, -y))
    return tuple(places)


def inputs_of(model: Model, stimulus: Stimulus) -> Table:
    """What a run is made from: element, stimulus, probe, contact, finger."""
    return {
        "element": model.element,
        "stimulus": stimulus_inputs(stimulus),
        "probe": asdict(model.probe),
        "contact": asdict(model.contact),
        "finger": finger_table(model.finger),
        **({"inertia": True} if model.inertia else {}),
    }


def stimulus_inputs(stimulus: Stimulus) -> Table:
    """What `stimulus` is: name, window, pre-indentation, origin."""
    origin: Mapping[str, object] = stimulus.origin
    return {
        "id": stimulus.id,
        "window_ms": list(stimulus.window_ms),
        "preindent_um": stimulus.preindent_um,
        **{key: value for key, value in origin.items() if value is not None},
    }
