"""Writing of a run folder: a deck of our finger, or a user's own deck with a waveform."""

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from decks.contact_analysis import Model
from decks.dialects import DeckOptions, dialect_named
from decks.motion import motion_of
from decks.presets import finger_table
from fembridge.errors import DeckError
from fembridge.host.store import MAX_DECK_BYTES, filling, read_bytes, replacing
from fembridge.io.run_folder import RUN_FILE, STIMULUS_FILE, AfferentNode, RunFolder
from fembridge.io.waveform_file import write_csv
from fembridge.stimulus import Stimulus
from fembridge.trace import MS_PER_S, split_afferent_key
from fembridge.typing import IntArray, Table

if TYPE_CHECKING:
    from decks.own_model import Rebased, Request


_SOLVERS = {".inp": ("calculix", "abaqus"), ".dat": ("marc",)}
_RESERVED_NAMES = (RUN_FILE, STIMULUS_FILE, "job.inp", "job.dat")


def build_run_folder(
    folder: Path,
    model: Model,
    stimulus: Stimulus,
    *,
    solver: str = "calculix",
    options: DeckOptions = DeckOptions(),  # noqa: B008 - frozen
    parameters: Table | None = None,
    watched: IntArray | None = None,
    made_from: Mapping[str, Any] = MappingProxyType({}),
) -> RunFolder:
    """Write deck, waveform and ``run.toml`` into `folder`.

    `solver` names one of `decks.dialects.DIALECTS`, `parameters` is the set by which its
    stress is to be encoded, as `neural.ParameterSet.to_table` has it. Nodes of rows
    `watched` are written too. ``run.toml`` says what the run is made from, first of it
    `made_from`, and takes its place last: a folder that has one is whole. Where the same
    files are already, nothing is touched.

    Raises
    ------
    OutputError
        The folder cannot be made or written.
    DeckError, FingerError
        The model or the stimulus cannot be put into a deck.
    """
    dialect = dialect_named(solver)
    analysis = model.analysis(stimulus, watched=watched)
    inputs: Table = {
        **made_from,
        "element": model.element,
        "stimulus": stimulus_inputs(stimulus),
        "probe": asdict(model.probe),
        "contact": {name: getattr(model.contact, name) for name in dialect.contact},
        "finger": finger_table(model.finger),
    }
    if model.inertia:
        inputs["inertia"] = True
    if model.law != "linear":
        inputs["law"] = model.law
    if analysis.support != "prescribed" and dialect.springs:
        inputs["drive"] = analysis.support
        reason = analysis.why_whole
        inputs["section"] = f"whole: {reason}" if reason else "half"
    if parameters:
        inputs["parameters"] = parameters
    files = {name: text.encode() for name, text in dialect.write(analysis, options).items()}
    motion = analysis.motion
    last_phase = motion.phases[-1]
    has_own_steps = len(motion.phases) > 1  # up to the waveform
    increments = last_phase.increments // last_phase.sample_increments
    start_ms = (
        MS_PER_S * motion.start_s
        if has_own_steps
        else motion.ramp // last_phase.sample_increments * stimulus.dt_ms
    )
    afferent_nodes = []
    for name, node in analysis.afferent.items():
        x_mm, y_mm = analysis.node_mm[node - 1].tolist()
        layer = model.finger.afferents[name].layer
        afferent_nodes.append(AfferentNode(name, node, layer, x_mm, y_mm, depth_mm=-y_mm))
    run = RunFolder(
        folder=folder,
        solver=solver,
        increments=increments,
        solver_increments=0 if motion.increments == increments else motion.increments,
        dt_ms=stimulus.dt_ms,
        start_ms=start_ms,
        before_ms=start_ms if has_own_steps else 0.0,
        branches=analysis.branches if dialect.branches else {},
        on_axis=analysis.watched_on_axis if dialect.springs else (),
        afferents=tuple(afferent_nodes),
        apex_node=analysis.apex,
        deck_sha256=hashlib.sha256(files[dialect.deck]).hexdigest(),
        inputs=inputs,
    )
    _write(run, stimulus, files)
    return run


def stimulus_inputs(stimulus: Stimulus) -> Table:
    """What `stimulus` is: name, window, pre-indentation, origin."""
    return {
        "id": stimulus.id,
        "window_ms": list(stimulus.window_ms),
        "preindent_um": stimulus.preindent_um,
        **{key: value for key, value in stimulus.origin.items() if value is not None},
    }


@dataclass(frozen=True, slots=True)
class BaseDeck:
    """A deck as its owner has it: `data` is the file, `solver` whose it is."""

    path: Path
    data: bytes
    solver: str


def read_base_deck(path: Path, solver: str | None = None) -> BaseDeck:
    """Read `path`; `solver` says whose it is where the text leaves it open.

    Raises
    ------
    DeckError
        No such file, not a deck by its name, or another solver's.
    """
    from decks.own_model.inp_deck import solver_of

    solvers = _SOLVERS.get(path.suffix.lower())
    if solvers is None:
        expected = "a .inp of CalculiX or Abaqus, or a .dat of Marc"
        raise DeckError(f"not a deck, expected {expected}", path, expected=expected)
    data = read_bytes(path, MAX_DECK_BYTES, DeckError)
    if solver is None:
        solver = solvers[0] if len(solvers) == 1 else solver_of(data)
    elif solver not in solvers:
        expected = " or ".join(solvers)
        problem = f"a {path.suffix} is a deck for {expected}, not for {solver}"
        raise DeckError(problem, path, found=solver, expected=expected)
    return BaseDeck(path, data, solver)


def build_own_folder(
    folder: Path,
    base: BaseDeck,
    stimulus: Stimulus,
    request: "Request",
    parameters: Table | None = None,
) -> "tuple[RunFolder, Rebased]":
    """Write `base` with `stimulus` in it, as `build_run_folder`: the run, and the new deck.

    The deck is kept to the byte but for the waveform, the increments and the output.
    Files that it includes are copied beside it.

    Raises
    ------
    DeckError
        Something that is missing or ambiguous, with its line.
    OutputError
        The folder cannot be made or written.
    """
    if stimulus.aside_um is not None:
        raise DeckError(
            "is for the decks of fembridge: in your own deck, your boundary conditions slide the "
            "probe, and the waveform moves it into the skin only",
            argument="slide_mm_per_s",
        )
    try:
        rebased = rebased_deck(base, stimulus, request)
    except DeckError as error:
        raise DeckError.from_error(error, base.path) from error
    motion = motion_of(stimulus)
    files = {dialect_named(base.solver).deck: rebased.deck}
    for name in rebased.needs:
        source = base.path.parent / name
        if PurePosixPath(name.replace("\\", "/")).name != name or name in _RESERVED_NAMES:
            raise DeckError(
                f"includes {name!r}, expected a file of the same folder, by its name", base.path
            )
        if not source.is_file():
            raise DeckError(f"includes {name}, which does not exist", base.path)
        files[name] = read_bytes(source, MAX_DECK_BYTES, DeckError)
    before_ms = rebased.before_s * MS_PER_S
    run = RunFolder(
        folder=folder,
        solver=base.solver,
        increments=motion.increments,
        dt_ms=stimulus.dt_ms,
        start_ms=before_ms + motion.ramp * stimulus.dt_ms,
        before_ms=before_ms,
        stress_unit=rebased.units.stress_unit,
        length_unit=rebased.units.length_unit,
        afferents=tuple(
            AfferentNode(
                split_afferent_key(name)[0],
                request.afferents[name],
                "",
                site.position_mm[0],
                site.position_mm[1],
                z_mm=(*site.position_mm, None)[2],
                start_stress_pa=site.start_stress_pa,
                element=site.element,
                corner=site.corner,
                unit=split_afferent_key(name)[1],
            )
            for name, site in rebased.sites.items()
        ),
        at_rest=rebased.at_rest,
        branches={
            request.afferents[name]: site.branches
            for name, site in rebased.sites.items()
            if site.branches > 1
        },
        deck_sha256=hashlib.sha256(rebased.deck).hexdigest(),
        inputs={
            "base_deck": {
                "file": base.path.name,
                "sha256": hashlib.sha256(base.data).hexdigest(),
                **({"stands_um": 1e3 * rebased.stands_mm} if rebased.stands_mm else {}),
                "changes": list(rebased.remarks),
                **({"load": asdict(request.load)} if request.load else {}),
                **(
                    {"path_dependent": list(rebased.path_dependent)}
                    if rebased.path_dependent
                    else {}
                ),
                **({"request": options} if (options := _request_options(request)) else {}),
            },
            "stimulus": stimulus_inputs(stimulus),
            **({"parameters": parameters} if parameters else {}),
        },
    )
    _write(run, stimulus, files)
    return run, rebased


def _request_options(request: "Request") -> Table:
    """The options of a request that are set, without its afferents."""
    names = ("move", "amplitude", "step", "length_unit", "shell_face", "results")
    options = {name: value for name in names if (value := getattr(request, name)) is not None}
    return {
        **options,
        **({"increments": request.increments} if request.increments != "fixed" else {}),
        **({} if request.keeps_output else {"own_output": False}),
    }


def rebased_deck(base: BaseDeck, stimulus: Stimulus, request: "Request") -> "Rebased":
    """`base` with `stimulus` in it; nothing is written.

    Raises
    ------
    DeckError
        Something that is missing or ambiguous, with its line.
    """
    from decks.inp import folder_resolver
    from decks.own_model.inp_deck import rebase_inp
    from decks.own_model.marc_deck import rebase_marc

    motion = motion_of(stimulus)
    if base.solver == "marc":
        return rebase_marc(base.data, motion, request)
    resolver = folder_resolver(base.path)
    return rebase_inp(base.data, motion, request, dialect=base.solver, resolver=resolver)


def _write(run: RunFolder, stimulus: Stimulus, files: Mapping[str, bytes]) -> None:
    """Put `files`, the waveform and ``run.toml`` into the folder of `run`, all or none."""
    with filling(run.folder, last=RUN_FILE) as draft:
        for name, content in files.items():
            with replacing(draft / name) as path:
                path.write_bytes(content)
        write_csv(stimulus, draft / STIMULUS_FILE)
        replace(run, folder=draft).write()
