"""Make the studies, several at a time, and their page; each run of the solver is kept."""

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
    """A study by name: its title on the page, its function, what a quick run leaves out."""

    name: str
    title: str
    found_by: Callable[[Runs], Finding]
    left_out: str = ""

    def make(self, folder: Path, quick: bool) -> Finding:
        """Do it in `folder`; its figure goes into a file there."""
        runs = Runs(folder, quick)
        finding = in_style(self.found_by)(runs)
        if finding.figure is not None:
            save_figure(finding.figure, folder / "images" / f"verification_{self.name}.png")
        return replace(finding, figure=None, cost=runs.spent)

    @property
    def constants(self) -> Mapping[str, Any]:
        """Constants of its module and of all studies, which the words of the page hold."""
        return {**vars(study), **vars(sys.modules[self.found_by.__module__])}

    def command(self, quick: bool) -> str:
        """Command that makes it alone."""
        return f"fembridge verify {'--quick ' if quick else ''}--only {self.name}"


# In the order of the page.
STUDIES = (
    Study("patch", "Patch test", plane.patch),
    Study("solver", "A second solver", plane.second_solver),
    Study("hertz", "Hertz line contact", hertz.study),
    Study(
        "incompressible",
        "A nearly incompressible dermis",
        pressed_finger.incompressible,
        "rings to 16 elements across; `quick` finger alone",
    ),
    Study(
        "mesh",
        "Convergence with the mesh",
        pressed_finger.mesh,
        "three meshes, 4 increments; limits are those of a whole run",
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
        "Response map against whole transients",
        map_and_transient.study,
        "`quick` alone, 10 ms of each stimulus",
    ),
)


def studies_named(names: Sequence[str] | None) -> tuple[Study, ...]:
    """Studies of these names, in the order of the page; None: all.

    Raises UsageError: a name that no study has.
    """
    known = [study.name for study in STUDIES]
    unknown = [name for name in names or () if name not in known]
    if unknown:
        raise UsageError(f"no study {unknown[0]!r}, expected one of {', '.join(known)}")
    return tuple(study for study in STUDIES if not names or study.name in names)


def verify(
    folder: Path,
    names: Sequence[str] | None = None,
    *,
    quick: bool = False,
    jobs: int = 1,
    on_message: OnMessage = lambda message: None,
) -> dict[str, Finding]:
    """Make the studies `names`, or all; findings by name, in the order of the page.

    Runs of the solver in `folder` that are whole are taken, so that what was stopped goes on
    where it was. Figures are written as PNG as soon as they are made. `jobs` studies are made at
    the same time, each in a process of its own; `on_message` gets a line for each step, and the
    `Progress` of each run. Raises SolverError, ResponseError: a run of the solver failed.
    """
    studies = studies_named(names)
    make_folder(folder)
    jobs = min(jobs, len(studies))
    order = deque(studies[::-1] if jobs > 1 else studies)  # the longer first: no core waits
    found: dict[str, Finding] = {}
    # The first that fails ends the others, whose runs are kept.
    with signals_as_exits(), executor_of(jobs, on_message) as executor:

        def submit(one: Study) -> Future[Finding]:
            return executor.submit(one.make, folder, quick)

        for one, made in finished(submit, order, jobs):
            try:
                found[one.name] = made.result()
            except WorkerDiedError as error:
                raise SolverError(
                    f"{error}; what is finished is kept: run this again", folder
                ) from error
            on_message(f"{one.name}: done, {len(found)} of {len(studies)}")
    return {study.name: found[study.name] for study in studies}


def versions_here() -> dict[str, str]:
    """Versions that the numbers depend on; a `MissingError` where there is no solver."""
    if find_ccx() is None:
        raise MissingError(
            "verify takes a solver, and there is no ccx on the PATH; "
            f"install it: {SOLVER_INSTALL_LINE}"
        )
    versions = {"fembridge": __version__, "CalculiX": check_ccx().found.split(",")[0]}
    other = plane.skfem_version()
    return versions if other is None else {**versions, "scikit-fem": other}


def write_report(
    folder: Path, findings: Mapping[str, Finding], versions: Mapping[str, str], *, quick: bool
) -> Table:
    """Write tables, summary and, last, the page; the figures are there. The summary."""
    for finding in findings.values():
        for name, frame in finding.tables.items():
            text = frame.to_csv(index=False, lineterminator="\n")
            write_text(folder / "tables" / f"verification_{name}.csv", text)
    summary = _summary(findings, versions, quick=quick)
    write_text(folder / SUMMARY_FILE, json.dumps(summary, indent=2, ensure_ascii=False) + "\n")
    write_text(folder / PAGE_FILE, page_text(findings, versions, quick=quick))
    return summary


def _summary(findings: Mapping[str, Finding], versions: Mapping[str, str], *, quick: bool) -> Table:
    """What a program asks for: each check, found, bound, passed."""
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
                    {
                        **check._asdict(),
                        "found": None if math.isnan(check.found) else check.found,
                        "passed": check.passed,
                    }
                    for check in finding.checks
                ],
            }
            for study in STUDIES
            if (finding := findings.get(study.name)) is not None
        ],
    }


def page_text(findings: Mapping[str, Finding], versions: Mapping[str, str], *, quick: bool) -> str:
    """The page as Markdown; the same findings give the same text."""
    filters: dict[str, Callable[..., Any]] = {
        "markdown": lambda frame, spec: markdown(worded(frame, spec).rename(columns=_head)),
        "anchor": _anchor,
    }
    return rendered(
        "verification.md.j2",
        filters,
        studies=[study for study in STUDIES if study.name in findings],
        findings=findings,
        versions=versions,
        quick=quick,
        threads=THREADS,
    )


def _head(column: str) -> str:
    """Name of a column with its unit in parentheses."""
    name, unit = split_unit(column)
    name = name.replace("_", " ")
    return f"{name} ({unit})" if unit else name


def _anchor(heading: str) -> str:
    kept = "".join(letter for letter in heading.lower() if letter.isalnum() or letter in " -")
    return kept.replace(" ", "-")
