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

from fembridge.errors import MissingError, SolverError, UsageError
from fembridge.executor import OnMessage, WorkerDiedError, executor_of, finished
from fembridge.machine import SOLVER_INSTALL_LINE, check_ccx, find_ccx
from fembridge.plots.style import in_style, save_figure
from fembridge.report import hertz, map_and_transient, plane, pressed_finger, study
from fembridge.report.study import THREADS, Finding, Runs
from fembridge.solver.process import signals_as_exits
from fembridge.store import make_folder, write_text
from fembridge.typing import Table
from fembridge.version import __version__
from fembridge.words import markdown, rendered, split_unit, worded

PAGE_FILE = "verification.md"
SUMMARY_FILE = "verification.json"


@dataclass(frozen=True, slots=True)
class Study:
    """A study: name, title on the page, function, and the text on reductions of a quick run."""

    name: str
    title: str
    function: Callable[[Runs], Finding]
    left_out: str = ""

    def make(self, folder: Path, quick: bool) -> Finding:
        """Finding of the study; runs, and the figure as a PNG file, are in `folder`."""
        runs = Runs(folder, quick)
        finding = in_style(self.function)(runs)
        if finding.figure is not None:
            save_figure(finding.figure, folder / "images" / f"verification_{self.name}.png")
        return replace(finding, figure=None, cost=runs.spent)

    @property
    def constants(self) -> Mapping[str, Any]:
        """Constants of its module and of `study`, for the text of the page."""
        return {**vars(study), **vars(sys.modules[self.function.__module__])}

    def command(self, quick: bool) -> str:
        """Command that runs only this study."""
        return f"fembridge verify {'--quick ' if quick else ''}--only {self.name}"


# In page order.
STUDIES = (
    Study("patch", "Patch test", plane.patch),
    Study("solver", "A second solver", plane.second_solver),
    Study("hertz", "Hertz line contact", hertz.study),
    Study(
        "incompressible",
        "A nearly incompressible dermis",
        pressed_finger.incompressible,
        "rings with up to 16 elements across; `quick` finger only",
    ),
    Study(
        "mesh",
        "Convergence with the mesh",
        pressed_finger.mesh,
        "three meshes, 4 increments; limits from a full run",
    ),
    Study(
        "contact",
        "Contact models",
        pressed_finger.contact_models,
        "four of thirteen contact models, half the increments",
    ),
    Study(
        "penalty",
        "Stiffness of the contact",
        pressed_finger.stiffness,
        "four stiffnesses, 4 increments",
    ),
    Study(
        "laws",
        "Linear law against neo-Hookean",
        pressed_finger.laws,
        "8 increments instead of 16",
    ),
    Study(
        "map",
        "Response map against complete transients",
        map_and_transient.study,
        "`quick` only, 10 ms of each stimulus",
    ),
)


def studies_named(names: Sequence[str] | None) -> tuple[Study, ...]:
    """Studies of these names in page order; all for None.

    Raises UsageError for an unknown name.
    """
    options = [study.name for study in STUDIES]
    unknown = [name for name in names or () if name not in options]
    if unknown:
        raise UsageError(f"unknown study {unknown[0]!r}, expected one of {', '.join(options)}")
    return tuple(study for study in STUDIES if not names or study.name in names)


def verify(
    folder: Path,
    names: Sequence[str] | None = None,
    *,
    quick: bool = False,
    jobs: int = 1,
    on_message: OnMessage = lambda message: None,
) -> dict[str, Finding]:
    """Findings of the studies by name, in page order.

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
    jobs = min(jobs, len(studies))
    order = deque(studies[::-1] if jobs > 1 else studies)  # long studies first: all cores stay busy
    findings: dict[str, Finding] = {}
    # The first failure stops the other studies; their finished runs are kept.
    with signals_as_exits(), executor_of(jobs, on_message) as executor:

        def submit(task: Study) -> Future[Finding]:
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
    versions = {"fembridge": __version__, "CalculiX": check_ccx().found.split(",")[0]}
    skfem = plane.skfem_version()
    return versions if skfem is None else {**versions, "scikit-fem": skfem}


def write_report(
    folder: Path, findings: Mapping[str, Finding], versions: Mapping[str, str], *, quick: bool
) -> Table:
    """Summary of the findings; writes tables, summary and, last, the page. Figures exist."""
    for finding in findings.values():
        for name, frame in finding.tables.items():
            csv_text = frame.to_csv(index=False, lineterminator="\n")
            write_text(folder / "tables" / f"verification_{name}.csv", csv_text)
    summary = _summary(findings, versions, quick=quick)
    write_text(folder / SUMMARY_FILE, json.dumps(summary, indent=2, ensure_ascii=False) + "\n")
    write_text(folder / PAGE_FILE, page_text(findings, versions, quick=quick))
    return summary


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
