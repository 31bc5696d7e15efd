"""Where a solver works, and how what it wrote gets its final name.

``solving/``  while it runs: a copy of the deck, and all files of the solver
``failed/``   after a run that was not accepted: the same, with ``cause.txt``

An accepted run's files move up beside the deck. So ``job.frd`` is always the
whole result of a good run, whatever became of later ones.
"""

import contextlib
import shutil
from pathlib import Path

from decks.dialects import JOB
from fembridge.errors import OutputError
from fembridge.run_folder import RunFolder
from fembridge.solvers.outcome import Failure
from fembridge.store import make_folder, write_text

WORK_FOLDER = "solving"
FAILED_FOLDER = "failed"
CAUSE_FILE = "cause.txt"
LOG_FILE = "solver.log"

FIXED_NAMES = ("spooles.out", "ResultsForLastIterations.frd")
"""Files that CalculiX writes where it was started, not beside its deck."""

OLD_RESULTS = (".frd", ".dat", ".sta", ".cvg", ".12d", ".cel")
"""What belongs to one run: none of it may stay beside the results of another."""


class Workplace:
    """The working folder of one run, from its preparation to its end."""

    def __init__(self, run: RunFolder) -> None:
        self._run = run
        self.folder = run.folder / WORK_FOLDER
        self.log = self.folder / LOG_FILE
        self.deck = self.folder / f"{JOB}.inp"

    def prepare(self) -> None:
        """Make it anew with a copy of the deck; what earlier attempts left goes.

        Raises
        ------
        OutputError
            The folder cannot be written, or the disk is full.
        """
        for name in (WORK_FOLDER, FAILED_FOLDER):
            _remove(self._run.folder / name)
        make_folder(self.folder)
        try:
            shutil.copyfile(self._run.deck, self.deck)
        except OSError as error:
            raise OutputError(
                f"the deck cannot be copied: {error.strerror}", self.folder
            ) from error

    def collect(self) -> None:
        """Bring in what the solver wrote outside of it."""
        for name in FIXED_NAMES:
            with contextlib.suppress(FileNotFoundError):
                (self._run.folder / name).replace(self.folder / name)

    def publish(self) -> None:
        """Move the results of an accepted run beside the deck, ``.frd`` last.

        Empty files are left out: a ``.dat`` that nobody asked for, say.

        Raises
        ------
        OutputError
            A file cannot be moved.
        """
        found = (path for path in self.folder.iterdir() if path.is_file())
        new = [p for p in found if p.stat().st_size and p.name != self.deck.name]
        new.sort(key=lambda path: path.suffix == ".frd")
        names = {path.name for path in new}
        try:
            for suffix in OLD_RESULTS:
                if f"{JOB}{suffix}" not in names:
                    (self._run.folder / f"{JOB}{suffix}").unlink(missing_ok=True)
            for path in new:
                path.replace(self._run.folder / path.name)
        except OSError as error:
            raise OutputError(
                f"the results in {self.folder} cannot be moved here: {error.strerror}",
                self._run.folder,
            ) from error
        _remove(self.folder)

    def keep_evidence(self, failure: Failure) -> None:
        """Keep the files of a run that failed, and why, under ``failed/``."""
        with contextlib.suppress(OutputError):  # on a full disk the cause is told
            write_text(self.folder / CAUSE_FILE, f"{failure}\n")
        failed = self._run.folder / FAILED_FOLDER
        try:
            self.folder.replace(failed)
        except OSError as error:
            raise OutputError(
                f"cannot become {failed.name}/: {error.strerror}", self.folder
            ) from error


def _remove(folder: Path) -> None:
    """Remove a folder of ours; a file or a link in its place is not ours."""
    try:
        shutil.rmtree(folder)
    except FileNotFoundError:
        return
    except OSError as error:
        raise OutputError(
            f"cannot be removed to make room for a run: {error.strerror or error}", folder
        ) from error
