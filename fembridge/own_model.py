"""A user's own deck as run folders: his model, our waveform.

The deck is kept to the byte but for the waveform, the increments and the output;
`decks.own_model` does that, this puts it into a folder with ``run.toml``.
"""

import hashlib
import shutil
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from decks.dialects import dialect_of
from decks.motion import Motion, motion_of
from decks.own_model.request import Rebased, Request
from fembridge.build import stimulus_inputs
from fembridge.errors import DeckError
from fembridge.exports import write_csv
from fembridge.run_folder import RUN_FILE, STIMULUS_FILE, AfferentNode, RunFolder
from fembridge.stimulus import Stimulus
from fembridge.store import filling

_SUFFIXES = {".inp": ("calculix", "abaqus"), ".dat": ("marc",)}
_OURS = (RUN_FILE, STIMULUS_FILE, "job.inp", "job.dat")
_MS_PER_S = 1.0e3


@dataclass(frozen=True, slots=True)
class BaseDeck:
    """A deck as its owner has it: `data` is the file, `solver` whose it is."""

    path: Path
    data: bytes
    solver: str

    def with_motion(self, motion: Motion, request: Request) -> Rebased:
        """Put `motion` into it; files that it includes are read beside it.

        Raises
        ------
        DeckError
            Something is missing or ambiguous; the message has file and line.
        """
        from decks.marc.contents import beside
        from decks.own_model.inp import rebase_inp
        from decks.own_model.marc import rebase_marc

        resolver = beside(self.path)
        try:
            if self.solver == "marc":
                return rebase_marc(self.data, motion, request, resolver)
            return rebase_inp(self.data, motion, request, dialect=self.solver, resolver=resolver)
        except DeckError as error:
            raise DeckError(f"{self.path}: {error}") from error


def read_base_deck(path: Path, solver: str | None = None) -> BaseDeck:
    """Read `path`; `solver` says whose it is where the text leaves it open.

    Raises
    ------
    DeckError
        No such file, not a deck by its name, or another solver's.
    """
    known = _SUFFIXES.get(path.suffix.lower())
    if known is None:
        raise DeckError(f"{path}: expected a deck: a .inp of CalculiX or Abaqus, or a .dat of Marc")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DeckError(f"{path}: cannot be read: {error.strerror}") from error
    if solver is not None and solver not in known:
        raise DeckError(
            f"{path}: a {path.suffix} is a deck for {' or '.join(known)}, not for {solver}"
        )
    if solver is None:
        solver = known[0] if len(known) == 1 else _dialect_in(data)
    return BaseDeck(path, data, solver)


def _dialect_in(data: bytes) -> str:
    from decks.own_model.inp import dialect_of as told_by

    return told_by(data)


def build_own_folder(
    folder: Path, base: BaseDeck, stimulus: Stimulus, request: Request, stress_unit: str = "MPa"
) -> tuple[RunFolder, tuple[str, ...]]:
    """Write deck, waveform and ``run.toml`` into `folder`: the run, and what was changed.

    Files that the deck includes are copied beside it. `stress_unit` is the unit of
    its stresses: MPa for N and mm, Pa for N and m.

    Raises
    ------
    DeckError
        Something that is missing or ambiguous, with its line.
    OutputError
        The folder cannot be made or written.
    """
    if stimulus.aside_um is not None:
        raise DeckError(
            f"{stimulus.id}: a probe of your own deck slides by your own conditions; "
            "fembridge puts in its way into the skin alone"
        )
    motion = motion_of(stimulus)
    rebased = base.with_motion(motion, request)
    before_ms = rebased.before_s * _MS_PER_S
    included = [_included(base.path, name) for name in rebased.needs]
    run = RunFolder(
        folder=folder,
        solver=base.solver,
        increments=motion.increments,
        dt_ms=stimulus.dt_ms,
        start_ms=before_ms + motion.ramp * stimulus.dt_ms,
        before_ms=before_ms,
        stress_unit=stress_unit,
        afferents=tuple(
            AfferentNode(name, request.afferents[name], "", *place)
            for name, place in rebased.place_mm.items()
        ),
        deck_sha256=hashlib.sha256(rebased.deck).hexdigest(),
        inputs={
            "base_deck": {
                "file": base.path.name,
                "sha256": hashlib.sha256(base.data).hexdigest(),
                "changes": list(rebased.remarks),
            },
            "stimulus": stimulus_inputs(stimulus),
        },
    )
    with filling(folder, last=RUN_FILE) as draft:
        (draft / dialect_of(base.solver).deck).write_bytes(rebased.deck)
        for source, name in included:
            shutil.copyfile(source, draft / name)
        write_csv(stimulus, draft / STIMULUS_FILE)
        replace(run, folder=draft).write()
    return run, rebased.remarks


def _included(deck: Path, name: str) -> tuple[Path, str]:
    """Where an included file is, and its name in the run folder."""
    if PurePosixPath(name.replace("\\", "/")).name != name or name in _OURS:
        raise DeckError(f"{deck}: includes {name!r}, expected a file beside it, by its name alone")
    source = deck.parent / name
    if not source.is_file():
        raise DeckError(f"{deck}: includes {name}, which is not there")
    return source, name
