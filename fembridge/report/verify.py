"""Make the studies: each once, several at a time, what is finished kept, and their page."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fembridge import __version__
from fembridge.errors import MissingError, ResponseError, SolverError, UsageError
from fembridge.executor import LocalExecutor, WorkerDiedError, send
from fembridge.machine import SOLVER_INSTALL_LINE, check_ccx, find_ccx
from fembridge.plots.style import save_figure
from fembridge.report.runs import THREADS, Cost, Runs
from fembridge.report.study import AT_MOST, Check, Finding
from fembridge.solver.ccx import signals_as_exits
from fembridge.solver.settings import OnProgress
from fembridge.store import make_folder, read_sealed, sha256_of, write_sealed, write_text
from fembridge.typing import Table

if TYPE_CHECKING:
    from pandas import DataFrame

PAGE_FILE = "verification.md"
SUMMARY_FILE = "verification.json"
FORMAT = 2

_TEMPLATE = "verification.md.j2"
_UNKNOWN = "–"
# The longer first: a column ends in one of them.
_UNITS = {
    "_n_per_mm": "N/mm",
    "_percent": "%",
    "_kpa": "kPa",
    "_mpa": "MPa",
    "_mm": "mm",
    "_um": "µm",
    "_ms": "ms",
    "_s": "s",
}

Log = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Study:
    """A study by name: its title on the page, its function, what a quick run leaves out."""

    name: str
    title: str
    place: str
    left_out: str = ""

    @property
    def module(self) -> str:
        """Module of the function."""
        return f"fembridge.report.{self.place.partition(':')[0]}"

    def make(self, runs: Runs) -> Finding:
        """Do it."""
        function = getattr(import_module(self.module), self.place.partition(":")[2])
        finding: Finding = function(runs)
        return replace(finding, cost=runs.spent)


# In the order of the page.
STUDIES = (
    Study("patch", "Patch test", "patch:study"),
    Study("solver", "A second solver", "second_solver:study"),
    Study("hertz", "Hertz line contact", "hertz:study"),
    Study(
        "incompressible",
        "A nearly incompressible dermis",
        "incompressibility:study",
        "rings to 16 elements across; `quick` finger alone",
    ),
    Study(
        "mesh",
        "Convergence with the mesh",
        "mesh_convergence:study",
        "three meshes, 4 increments; limits are those of a whole run",
    ),
    Study(
        "contact",
        "Contact models",
        "contact:models",
        "four of thirteen contact models, half the increments",
    ),
    Study(
        "penalty",
        "Stiffness of the contact",
        "contact:stiffness",
        "four stiffnesses, 4 increments",
    ),
    Study("laws", "Linear law against neo-Hookean", "laws:study", "8 increments instead of 16"),
    Study(
        "map",
        "Response map against whole transients",
        "map_and_transient:study",
        "`quick` alone, 10 ms of each stimulus",
    ),
)
# The longest first, so that none of the cores waits at the end.
_LONGEST = ("map", "mesh", "contact", "incompressible", "hertz")


def studies_named(names: Sequence[str] | None) -> tuple[Study, ...]:
    """Studies of these names, in the order of the page; None: all.

    Raises
    ------
    UsageError
        A name that no study has.
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
    on_progress: OnProgress | None = None,
    log: Log = lambda line: None,
) -> dict[str, Finding]:
    """Make the studies `names`, or all; findings by name, in the order of the page.

    A finding in `folder` is taken if it was made from the same; of a study that was not
    finished the runs of the solver that are whole are taken. Tables are written as CSV,
    figures as PNG, as soon as they are made.

    Parameters
    ----------
    jobs
        Studies at the same time, each in a process of its own.
    log
        Called with a line for each step.

    Raises
    ------
    MissingError
        No solver; the message names the line that installs one.
    SolverError, ResponseError
        A run of the solver failed.
    OutputError
        `folder` cannot be written.
    """
    studies = studies_named(names)
    make_folder(folder)
    places = {study.name: _Place(study, folder, quick, versions_here()) for study in studies}
    found = {name: place.kept(log) for name, place in places.items()}
    waiting = [place for name, place in places.items() if found[name] is None]
    if jobs == 1 or len(waiting) <= 1:
        for place in waiting:
            place.make(on_progress, log)
    else:
        _make_at_once(waiting, jobs, log)
    return {name: found[name] or place.read() for name, place in places.items()}


def versions_here() -> dict[str, str]:
    """Versions that the numbers depend on.

    Raises
    ------
    MissingError
        There is no solver.
    """
    from fembridge.report.second_solver import skfem_version

    if find_ccx() is None:
        raise MissingError(
            "verify takes a solver, and there is no ccx on the PATH; "
            f"install it: {SOLVER_INSTALL_LINE}"
        )
    versions = {"fembridge": __version__, "CalculiX": check_ccx().found.split(",")[0]}
    other = skfem_version()
    return versions if other is None else {**versions, "scikit-fem": other}


@dataclass(frozen=True, slots=True)
class _Place:
    """A study, and where its finding goes."""

    study: Study
    folder: Path
    quick: bool
    versions: Mapping[str, str]

    @property
    def path(self) -> Path:
        return self.folder / "findings" / f"{self.study.name}.toml"

    @property
    def picture(self) -> Path:
        return self.folder / "images" / f"verification_{self.study.name}.png"

    @property
    def inputs(self) -> Table:
        """What a finding depends on: extent, versions, source of the study."""
        return {
            "quick": self.quick,
            "versions": dict(self.versions),
            "source_sha256": sha256_of(Path(str(import_module(self.study.module).__file__))),
        }

    def make(self, on_progress: OnProgress | None, log: Log) -> None:
        """Do the study and write its finding, its figure first."""
        runs = Runs(self.folder, quick=self.quick, on_progress=on_progress, log=log)
        finding = self.study.make(runs)
        if finding.figure is not None:
            save_figure(finding.figure, self.picture)
        table = {
            "skipped": finding.skipped,
            "checks": [check._asdict() for check in finding.checks],
            "tables": {
                name: frame.to_dict("split", index=False) for name, frame in finding.tables.items()
            },
            "numbers": dict(finding.numbers),
            "cost": asdict(finding.cost),
            "has_figure": finding.figure is not None,
        }
        write_sealed(self.path, {"format": FORMAT, "inputs": self.inputs, "finding": table})

    def read(self) -> Finding:
        """Finding in the folder, its figure left out; a `ResponseError` where damaged."""
        from pandas import DataFrame

        table = read_sealed(self.path, "finding", FORMAT)["finding"]
        return Finding(
            checks=tuple(Check(**check) for check in table["checks"]),
            tables={name: DataFrame(**split) for name, split in table["tables"].items()},
            numbers=table["numbers"],
            skipped=table["skipped"],
            cost=Cost(**table["cost"]),
        )

    def kept(self, log: Log) -> Finding | None:
        """Finding of the same inputs; a damaged one is recomputed, which `log` says."""
        if not self.path.exists():
            return None
        try:
            table = read_sealed(self.path, "finding", FORMAT)
            same = table["inputs"] == self.inputs
            if not same or (table["finding"]["has_figure"] and not self.picture.is_file()):
                return None
            finding = self.read()
        except ResponseError as error:
            log(f"{self.study.name}: recomputed: {error}")
            return None
        log(f"{self.study.name}: finished before")
        return finding


def _make_at_once(places: Sequence[_Place], jobs: int, log: Log) -> None:
    """Make several; the first that fails ends the others, whose runs are kept."""
    order = sorted(
        places, key=lambda p: _LONGEST.index(p.study.name) if p.study.name in _LONGEST else 99
    )
    with signals_as_exits(), LocalExecutor(min(jobs, len(order)), log) as executor:
        futures = {executor.submit(place.make, None, send): place.study.name for place in order}
        for count, future in enumerate(as_completed(futures), start=1):
            try:
                future.result()
            except WorkerDiedError as error:
                raise SolverError(
                    f"{error}; what is finished is kept: run this again", order[0].folder
                ) from error
            log(f"{futures[future]}: done, {count} of {len(order)}")


def write_report(
    folder: Path, findings: Mapping[str, Finding], versions: Mapping[str, str], *, quick: bool
) -> None:
    """Write tables, summary and, last, the page; the figures are there.

    Raises
    ------
    OutputError
        `folder` cannot be written.
    """
    for finding in findings.values():
        for name, frame in finding.tables.items():
            text = frame.to_csv(index=False, lineterminator="\n")
            write_text(folder / "tables" / f"verification_{name}.csv", text)
    summary = summary_of(findings, versions, quick=quick)
    write_text(folder / SUMMARY_FILE, json.dumps(summary, indent=2, ensure_ascii=False) + "\n")
    write_text(folder / PAGE_FILE, page_text(findings, versions, quick=quick))


def summary_of(
    findings: Mapping[str, Finding], versions: Mapping[str, str], *, quick: bool
) -> Table:
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
                "command": command_of(study.name, quick=quick),
                "increments": finding.cost.increments,
                "iterations": finding.cost.iterations,
                "cpu_s": round(finding.cost.cpu_s, 3),
                "checks": [
                    {**check, "found": None if math.isnan(check["found"]) else check["found"]}
                    for check in finding.to_frame().to_dict("records")
                ],
            }
            for study in STUDIES
            if (finding := findings.get(study.name)) is not None
        ],
    }


def command_of(name: str, *, quick: bool) -> str:
    """Command that makes one study."""
    return f"fembridge verify {'--quick ' if quick else ''}--only {name}"


def page_text(findings: Mapping[str, Finding], versions: Mapping[str, str], *, quick: bool) -> str:
    """The page as Markdown; the same findings give the same text."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("fembridge.report", "."),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters |= {
        "number": _number,
        "span": _span,
        "oneline": lambda words: " ".join(words.split()),
        "markdown": _markdown,
        "found": lambda check: (
            _UNKNOWN if math.isnan(check.found) else f"{check.found:.3g}{_unit(check)}"
        ),
        "bound": lambda check: (
            f"{'≤' if check.side == AT_MOST else '≥'} {check.bound:g}{_unit(check)}"
        ),
    }
    made = [study for study in STUDIES if study.name in findings]
    studies = [
        {
            "number": number,
            "name": study.name,
            "title": study.title,
            "anchor": _anchor(f"{number} {study.title}"),
            "command": command_of(study.name, quick=quick),
            "left_out": study.left_out if quick else "",
            "finding": findings[study.name],
        }
        for number, study in enumerate(made, start=1)
    ]
    checks = [check for finding in findings.values() for check in finding.checks]
    return environment.get_template(_TEMPLATE).render(
        studies=studies,
        versions=versions,
        quick=quick,
        threads=THREADS,
        checks=len(checks),
        passed=sum(check.passed for check in checks),
        cpu_s=sum(finding.cost.cpu_s for finding in findings.values()),
    )


def _markdown(frame: "DataFrame", formats: str) -> str:
    """Table as Markdown; `formats` has one for the numbers of each column, ``|`` between."""
    heads = [_head(column) for column in frame.columns]
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    for row in frame.astype(object).itertuples(index=False):
        cells = [_number(cell, spec) for cell, spec in zip(row, formats.split("|"), strict=True)]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _head(column: str) -> str:
    """Name of a column with its unit in parentheses."""
    for ending, unit in _UNITS.items():
        if column.endswith(ending):
            return f"{column.removesuffix(ending).replace('_', ' ')} ({unit})"
    return column.replace("_", " ")


def _number(cell: Any, spec: str) -> str:  # noqa: ANN401 - a word or a number
    if isinstance(cell, str):
        return cell
    if math.isnan(cell):
        return _UNKNOWN
    return format(cell, spec).replace("-", "\N{MINUS SIGN}", int(cell < 0))


def _unit(check: Check) -> str:
    return f" {check.unit}" if check.unit else ""


def _span(values: Sequence[float]) -> str:
    """Ends of rising `values`: ``5`` or ``5 to 7``."""
    return " to ".join(f"{value:g}" for value in dict.fromkeys((values[0], values[-1])))


def _anchor(heading: str) -> str:
    kept = "".join(letter for letter in heading.lower() if letter.isalnum() or letter in " -")
    return kept.replace(" ", "-")
