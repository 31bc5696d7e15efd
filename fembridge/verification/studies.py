"""All studies, in the order of the page: name and module."""

from dataclasses import dataclass
from importlib import import_module

from fembridge.errors import UsageError
from fembridge.verification.bench import Bench
from fembridge.verification.finding import Finding

_PACKAGE = "fembridge.verification"


@dataclass(frozen=True, slots=True)
class Study:
    """A study by name; `module` has a function ``study(bench) -> Finding``."""

    name: str
    module: str

    def make(self, bench: Bench) -> Finding:
        """Do it."""
        finding: Finding = import_module(self.module).study(bench)
        return finding


STUDIES = tuple(
    Study(name, f"{_PACKAGE}.{module}")
    for name, module in (
        ("patch", "patch"),
        ("solver", "second_solver"),
        ("hertz", "hertz"),
        ("incompressible", "incompressibility"),
        ("mesh", "mesh_convergence"),
        ("contact", "contact_models"),
        ("penalty", "penalty"),
        ("laws", "laws"),
        ("map", "map_and_transient"),
    )
)


def studies_named(names: list[str] | None) -> tuple[Study, ...]:
    """Give the studies of these names, in the order of the page; None: all.

    Raises
    ------
    UsageError
        A name that no study has.
    """
    known = {study.name for study in STUDIES}
    unknown = [name for name in names or () if name not in known]
    if unknown:
        raise UsageError(
            f"no study {unknown[0]!r}, expected one of {', '.join(study.name for study in STUDIES)}"
        )
    return tuple(study for study in STUDIES if not names or study.name in names)
