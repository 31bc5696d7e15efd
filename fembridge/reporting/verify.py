"""Studies of the finite-element model: run in parallel, then written as one page."""

import json
import math
import sys
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pandas import DataFrame, read_csv

from decks.mesher import mesher_problem
from fembridge.errors import MissingError, ResultError, SolverError, UsageError
from fembridge.host.executor import OnMessage, WorkerDiedError, executor_of, finished
from fembridge.host.machine import SOLVER_INSTALL_LINE, check_ccx, cores, find_ccx
from fembridge.host.process import signals_as_exits
from fembridge.host.store import make_folder, write_text
from fembridge.io.formatting import markdown, rendered, split_unit, worded
from fembridge.plots.style import in_style, save_figure
from fembridge.reporting import hertz, map_and_transient, plane, pressed_finger, verification_runs
from fembridge.reporting.verification_runs import THREADS, Finding, Runs
from fembridge.typing import Table
from fembridge.version import __version__

PAGE_FILE = "verification.md"
SUMMARY_FILE = "verification.json"
_TABLES, _PREFIX = "tables", "verification_"


@dataclass(frozen=True, slots=True)
class VerificationStudy:
    """A study: name, title on the page, function, and the text on reductions of a quick run.

    `needs_gmsh` and `quick_needs_gmsh` state whether a full and a quick run mesh fingers.
    """

    name: str
    title: str
    function: Callable[[Runs], Finding]
    left_out: str = ""
    needs_gmsh: bool = False
    quick_needs_gmsh: bool = False

    def make(self, folder: Path, quick: bool) -> Finding:
        """Finding of the study; runs, and the figure as a PNG file, are in `folder`."""
        runs = Runs(folder, quick)
        finding = in_style(self.function)(runs)
        if finding.figure is not None:
            save_figure(finding.figure, folder / "images" / f"verification_{self.name}.png")
        return replace(finding, figure=None, cost=runs.spent)

    def problem(self, quick: bool) -> str:
        """Why the study cannot run on this machine, known before anything is solved; or ""."""
        return mesher_problem() if (self.quick_needs_gmsh if quick else self.needs_gmsh) else ""

    @property
    def constants(self) -> Mapping[str, Any]:
        """Constants of its module and of `verification_runs`, for the text of the page."""
        return {**vars(verification_runs), **vars(sys.modules[self.function.__module__])}

    def command(self, quick: bool) -> str:
        """Command that runs only this study."""
        return f"fembridge verify {'--quick ' if quick else ''}--only {self.name}"


# In page order.
STUDIES = (
    VerificationStudy("patch", "Patch test", plane.patch),
    VerificationStudy("solver", "A second solver", plane.second_solver),
    VerificationStudy("hertz", "Hertz line contact", hertz.study),
    VerificationStudy(
        "incompressible",
        "A nearly incompressible dermis",
        pressed_finger.incompressible,
        "rings with up to 16 elements across; `quick` finger only",
        needs_gmsh=True,
    ),
    VerificationStudy(
        "mesh",
        "Convergence with the mesh",
        pressed_finger.mesh,
        "three meshes, 4 increments; limits from a full run",
        needs_gmsh=True,
        quick_needs_gmsh=True,
    ),
    VerificationStudy(
        "contact",
        "Contact models",
        pressed_finger.contact_models,
        "four of thirteen contact models, half the increments",
    ),
    VerificationStudy(
        "penalty",
        "Stiffness of the contact",
        pressed_finger.stiffness,
        "four stiffnesses, 4 increments",
    ),
    VerificationStudy(
        "laws",
        "Linear law against neo-Hookean",
        pressed_finger.laws,
        "8 increments instead of 16",
    ),
    VerificationStudy(
        "map",
        "Response map against complete transients",
        map_and_transient.study,
        "`quick` only, 10 ms of each stimulus",
    ),
)


class Verification:
    """Result of `verify`: the checks of the studies, with their tables.

    Parameters
    ----------
    summary
        Content of ``verification.json``: versions, and each study with its cost and checks.
    tables
        Tables of the studies by name.
    page
        The page as Markdown.

    Examples
    --------
    >>> import fembridge as fb
    >>> fb.verify(only=["patch"], quick=True).passed  # doctest: +SKIP
    True
    """

    def __init__(self, summary: Table, tables: Mapping[str, DataFrame], page: str) -> None:
        self.summary, self.tables, self.page = summary, tables, page

    @property
    def passed(self) -> bool:
        """Whether all checks keep their bounds."""
        return bool(self.summary["passed"])

    @property
    def checks(self) -> DataFrame:
        """A row per check: ``study, what, found, bound, unit, side, passed``."""
        rows = [
            {"study": study["name"], **check}
            for study in self.summary["studies"]
            for check in study["checks"]
        ]
        columns = ["study", "what", "found", "bound", "unit", "side", "passed"]
        return DataFrame(rows, columns=columns)

    @property
    def provenance(self) -> Table:
        """Versions of the programs, and whether the runs were quick."""
        return {key: self.summary[key] for key in ("versions", "quick")}

    def __repr__(self) -> str:
        checks = self.checks
        lines = [f"Verification: {int(checks['passed'].sum())} of {len(checks)} checks passed"]
        for row in checks[~checks["passed"].astype(bool)].head(3).itertuples():
            lines.append(f"  failed: {row.study}: {row.what}: {row.found}")
        return "\n".join(lines)

    def write(self, folder: Path | str) -> None:
        """Write tables, ``verification.json`` and the page into `folder`, without figures.

        Parameters
        ----------
        folder
            Folder of the files, which is made.

        Raises
        ------
        OutputError
            The folder cannot be written.
        """
        folder = Path(folder)
        for name, frame in self.tables.items():
            csv_text = frame.to_csv(index=False, lineterminator="\n")
            write_text(folder / _TABLES / f"{_PREFIX}{name}.csv", csv_text)
        summary_text = json.dumps(self.summary, indent=2, ensure_ascii=False)
        write_text(folder / SUMMARY_FILE, summary_text + "\n")
        write_text(folder / PAGE_FILE, self.page)

    @classmethod
    def read(cls, folder: Path | str) -> "Verification":
        """Verification from the files of `write`.

        Parameters
        ----------
        folder
            Folder that `write` or ``fembridge verify`` wrote.

        Raises
        ------
        ResultError
            A file is missing or is not one of `write`.
        """
        path = Path(folder) / SUMMARY_FILE
        try:
            summary = json.loads(path.read_text(encoding="utf-8"))
            page = (Path(folder) / PAGE_FILE).read_text(encoding="utf-8")
            tables = {
                table.stem.removeprefix(_PREFIX): read_csv(table)
                for table in sorted((Path(folder) / _TABLES).glob(f"{_PREFIX}*.csv"))
            }
        except (OSError, ValueError) as error:
            raise ResultError("was not written by `fembridge verify`", path) from error
        return cls(summary, tables, page)


def verify(
    output: Path | str = "verification",
    *,
    only: str | Sequence[str] | None = None,
    quick: bool = False,
    jobs: int | None = None,
    on_message: OnMessage = lambda message: None,
) -> Verification:
    """Checks of the finite-element model against closed forms and other references.

    CalculiX is required; studies that mesh fingers are skipped if gmsh cannot be imported. Complete
    runs in `output` are reused, so a stopped verification resumes.

    Parameters
    ----------
    output
        Folder of solver runs, figures, tables and the page. Default: ``verification``.
    only
        Name or names of studies: ``patch``, ``solver``, ``hertz``, ``incompressible``, ``mesh``,
        ``contact``, ``penalty``, ``laws``, ``map``. Default: None, all.
    quick
        Run fewer and shorter solver runs: minutes instead of most of an hour. Default: False.
    jobs
        Number of studies at the same time, each in its own process. Default: None, the number
        of cores.
    on_message
        Called with a line for each step, and with the progress of each run. Default: none.

    Returns
    -------
    Verification
        ``checks`` has a row per check, ``passed`` is True if all keep their bounds.

    Raises
    ------
    UsageError
        An unknown study, or `jobs` below 1.
    MissingError
        CalculiX is not installed, or a library without which every study of `only` is skipped.
    SolverError, ResponseError
        A solver run failed.

    Examples
    --------
    >>> import fembridge as fb
    >>> verification = fb.verify(only=["patch"], quick=True)  # doctest: +SKIP
    >>> verification.passed  # doctest: +SKIP
    True
    """
    if isinstance(only, str):
        only = [only]
    studies_named(only)  # an unknown name is reported before a missing solver
    if jobs is not None and jobs < 1:
        raise UsageError(argument="jobs", found=jobs, expected="1 or more")
    versions = versions_here()
    folder = Path(output)
    findings = run_studies(
        folder,
        only,
        quick=quick,
        jobs=jobs or cores(),
        on_message=on_message,
    )
    skipped = [finding.skipped for finding in findings.values() if finding.skipped]
    if len(skipped) == len(findings):  # no check was made, and none has passed
        raise MissingError("; ".join(skipped))
    result = verification_of(findings, versions, quick=quick)
    result.write(folder)
    return result


def studies_named(names: Sequence[str] | None) -> tuple[VerificationStudy, ...]:
    """Studies of these names in page order; all for None.

    Raises UsageError for an unknown name.
    """
    options = [study.name for study in STUDIES]
    unknown = [name for name in names or () if name not in options]
    if unknown:
        raise UsageError(argument="only", found=unknown[0], expected=f"one of {', '.join(options)}")
    return tuple(study for study in STUDIES if not names or study.name in names)


def run_studies(
    folder: Path,
    names: Sequence[str] | None = None,
    *,
    quick: bool = False,
    jobs: int = 1,
    on_message: OnMessage = lambda message: None,
) -> dict[str, Finding]:
    """Findings of the studies by name, in page order.

    Studies that mesh fingers are skipped if gmsh cannot be imported.

    Parameters
    ----------
    folder
        Folder of solver runs and figures. Complete runs in it are reused, so a stopped
        verification resumes.
    names
        Names of studies. Default: all.
    quick
        Run fewer and shorter solver runs. Default: False.
    jobs
        Number of studies at the same time, each in its own process. Default: 1.
    on_message
        Called with a line for each step, and with the `Progress` of each run. Default: discards
        both.

    Raises
    ------
    SolverError, ResponseError
        A solver run failed, or a worker process died.
    """
    studies = studies_named(names)
    make_folder(folder)
    findings: dict[str, Finding] = {}
    for study in studies:
        if problem := study.problem(quick):
            findings[study.name] = Finding(skipped=problem)
            on_message(f"{study.name}: skipped: {problem}")
    runnable = [study for study in studies if study.name not in findings]
    # long studies first: all cores stay busy
    order = deque(runnable[::-1] if jobs > 1 else runnable)
    jobs = max(1, min(jobs, len(runnable)))
    # The first failure stops the other studies; their finished runs are kept.
    with signals_as_exits(), executor_of(jobs, on_message) as executor:

        def submit(task: VerificationStudy) -> Future[Finding]:
            return executor.submit(task.make, folder, quick)

        for task, future in finished(submit, order, jobs):
            try:
                findings[task.name] = future.result()
            except WorkerDiedError as error:
                raise SolverError(
                    f"{error}; finished runs are kept, run the command again to resume", folder
                ) from error
            on_message(f"{task.name}: finished {len(findings)} of {len(studies)} studies")
    return {study.name: findings[study.name] for study in studies}


def versions_here() -> dict[str, str]:
    """Versions of the programs behind the numbers; raises MissingError without CalculiX."""
    if find_ccx() is None:
        raise MissingError(
            f"verify requires a solver, but ccx is not on the PATH; install it: "
            f"{SOLVER_INSTALL_LINE}"
        )
    versions = {"fembridge": __version__, "CalculiX": check_ccx().finding.split(",")[0]}
    skfem = plane.skfem_version()
    return versions if skfem is None else {**versions, "scikit-fem": skfem}


def verification_of(
    findings: Mapping[str, Finding], versions: Mapping[str, str], *, quick: bool
) -> Verification:
    """Verification with the checks, tables and page of `findings`."""
    tables = {name: table for f in findings.values() for name, table in f.tables.items()}
    summary = _summary(findings, versions, quick=quick)
    return Verification(summary, tables, page_text(findings, versions, quick=quick))


def _summary(findings: Mapping[str, Finding], versions: Mapping[str, str], *, quick: bool) -> Table:
    """Machine-readable summary: the checks of each study, with value, bound and result."""
    return {
        "quick": quick,
        "versions": dict(versions),
        "passed": all(check.passed for f in findings.values() for check in f.checks),
        "studies": [
            {
                "name": study.name,
                "title": study.title,
                "passed": all(check.passed for check in finding.checks),
                "skipped": finding.skipped or None,
                "command": study.command(quick),
                **asdict(finding.cost),
                "cpu_s": round(finding.cost.cpu_s, 3),
                "checks": [
                    {**table, "found": None if math.isnan(table["found"]) else table["found"]}
                    for table in (check.to_table() for check in finding.checks)
                ],
            }
            for study in STUDIES
            if (finding := findings.get(study.name)) is not None
        ],
    }


def page_text(findings: Mapping[str, Finding], versions: Mapping[str, str], *, quick: bool) -> str:
    """The page as Markdown; equal findings give equal text."""
    filters: dict[str, Callable[..., Any]] = {
        "markdown": lambda frame, spec: markdown(worded(frame, spec).rename(columns=_head)),
        "anchor": _anchor,
    }
    return rendered(
        "verification.md.j2",
        filters,
        studies=[study for study in STUDIES if study.name in findings],
        findings=findings,
        checks={
            name: [check.to_table() for check in finding.checks]
            for name, finding in findings.items()
        },
        versions=versions,
        quick=quick,
        threads=THREADS,
    )


def _head(column: str) -> str:
    """Heading of a column, with its unit in parentheses."""
    name, unit = split_unit(column)
    name = name.replace("_", " ")
    return f"{name} ({unit})" if unit else name


def _anchor(heading: str) -> str:
    letters = "".join(letter for letter in heading.lower() if letter.isalnum() or letter in " -")
    return letters.replace(" ", "-")
