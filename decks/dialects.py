"""Deck dialects by name: solver, files and elements.

A dialect is one module with a function from `decks.contact_analysis.ContactAnalysis` to the text
of a deck; it is imported when a deck of it is written.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from numbers import Integral
from typing import TYPE_CHECKING

from fembridge.errors import DeckError, UsageError

if TYPE_CHECKING:
    from jinja2 import Template

    from decks.contact_analysis import ContactAnalysis


JOB = "job"
# Suffix of the deck that the procedure for Mentat writes.
REWRITTEN = "_s2s"
# Material laws at large strain; at small strain both are Hooke's law.
LAWS = ("linear", "neo-hookean")
# Formats of the results that a deck requests.
RESULTS = ("binary", "text", "both")
# Increments of a base deck: one per sample, or smaller ones chosen by the solver.
INCREMENTS = ("fixed", "automatic")
SHELL_FACES = ("bottom", "middle", "top")
"""Layers of a shell whose stress CalculiX writes; the normal points from bottom to top."""
# Whether Marc's probe is a curve, or elements whose nodes are prescribed.
PROBES = ("rigid", "meshed")


@dataclass(frozen=True, slots=True)
class DeckOptions:
    """Options of a deck in addition to its analysis; None: the default of the dialect.

    Results are written at all nodes every `frames` samples; 0: only at the afferents.
    """

    results: str | None = None
    probe: str | None = None
    frames: int = 0


@dataclass(frozen=True, slots=True)
class Dialect:
    """A solver's kind of deck.

    `deck` and `results` are names of files in a run folder; the first existing file of
    `results` contains the stresses. `result_kinds` and `probes` are the supported values of
    `DeckOptions`, the default first. `contact` are the supported fields of
    `decks.contact_analysis.Contact`. `elements` maps our (Abaqus's) name of an element to the
    name of the solver. `how_to_run` is an instruction for solvers that fembridge cannot run.
    `target` is ``module:function``; it is called with ``(analysis, options)``, returns the text
    of the deck and refuses an analysis that it cannot express. `extra_files` maps names of
    further files to their targets. `springs` is whether a spring-driven probe and a half
    section are supported, `branches` whether relaxing skin is written as Maxwell branches, and
    `frames` whether results at all nodes can be requested at intervals.
    """

    name: str
    deck: str
    results: tuple[str, ...]
    elements: Mapping[str, str]
    element: str
    result_kinds: tuple[str, ...]
    probes: tuple[str, ...]
    contact: tuple[str, ...]
    target: str
    extra_files: Mapping[str, str] = field(default_factory=dict)
    how_to_run: str = ""
    springs: bool = False
    branches: bool = False
    frames: bool = False

    def element_named(self, name: str) -> str:
        """Our name of the element `name`, which is our name or that of the solver."""
        for element, solver_element in self.elements.items():
            if name.upper() in (element, solver_element):
                return element
        expected = "one of " + ", ".join(
            element if element == solver_element else f"{solver_element} ({element})"
            for element, solver_element in self.elements.items()
        )
        raise DeckError(argument="element", found=name, expected=f"{expected} for {self.name}")

    def write(self, analysis: "ContactAnalysis", options: DeckOptions) -> dict[str, str]:
        """The text of each file: the deck and its extra files.

        Raises
        ------
        DeckError
            The analysis cannot be expressed in this dialect.
        """
        self.element_named(analysis.element)
        values = dict[str, str]()
        for option, argument, choices in (
            ("results", "results", self.result_kinds),
            ("probe", "probe_body", self.probes),
        ):
            value = values[option] = getattr(options, option) or choices[0]
            if value not in choices:
                expected = f"{' or '.join(choices)} in a deck for {self.name}"
                raise UsageError(argument=argument, found=value, expected=expected)
        if not isinstance(options.frames, Integral) or options.frames < 0:
            raise UsageError(argument="frames", found=options.frames, expected="0 or more samples")
        if options.frames and not self.frames:
            raise UsageError(
                f"has no effect: a deck for {self.name} has results at all nodes, at every sample",
                argument="frames",
            )
        resolved, files = DeckOptions(**values, frames=options.frames), dict[str, str]()
        for name, target in {self.deck: self.target, **self.extra_files}.items():
            module, _, function = target.partition(":")
            files[name] = getattr(import_module(module), function)(analysis, resolved)
        return files


DIALECTS = {
    dialect.name: dialect
    for dialect in (
        Dialect(
            name="calculix",
            deck=f"{JOB}.inp",
            results=(f"{JOB}.frd",),
            elements={name: name for name in ("CPE4", "CPE4R", "CPE8R")},
            element="CPE4",
            result_kinds=("binary", "text"),
            probes=("meshed",),
            contact=("formulation", "stiffness_mpa_per_mm", "friction", "stick_share"),
            target="decks.calculix:calculix_deck",
            springs=True,
            branches=True,
            frames=True,
        ),
        Dialect(
            name="marc",
            deck=f"{JOB}.dat",
            results=(f"{JOB}{REWRITTEN}.t16", f"{JOB}{REWRITTEN}.t19", f"{JOB}.t16", f"{JOB}.t19"),
            elements={"CPE4H": "80", "CPE4": "11", "CPE8": "27", "CPE8R": "54", "CPE4RH": "118"},
            element="CPE4H",
            result_kinds=("both", "binary", "text"),
            probes=("rigid", "meshed"),
            contact=("friction",),
            target="decks.marc.write:marc_deck",
            extra_files={f"{JOB}.proc": "decks.marc.write:mentat_procedure"},
            how_to_run=f"mentat -bg {JOB}.proc, run_marc -jid {JOB}{REWRITTEN}, then "
            f"fembridge ingest {JOB}{REWRITTEN}.t16; see docs/how_to/marc.md",
        ),
        Dialect(
            name="abaqus",
            deck=f"{JOB}.inp",
            results=(f"{JOB}.dat",),
            elements={name: name for name in ("CPE4", "CPE4R", "CPE4H", "CPE4RH", "CPE8", "CPE8R")},
            element="CPE4H",
            result_kinds=("binary",),
            probes=("meshed",),
            contact=("formulation", "stiffness_mpa_per_mm", "friction"),
            target="decks.keyword_deck:abaqus_deck",
            how_to_run=f"abaqus job={JOB}, then its von Mises stress to fembridge "
            "encode, as a table time_ms,afferent,node,von_mises_pa",
            frames=True,
        ),
    )
}


def dialect_of(solver: str) -> Dialect:
    """The dialect that `solver` reads; for a solver of another package, that of CalculiX."""
    return DIALECTS.get(solver, DIALECTS["calculix"])


def dialect_named(name: str) -> Dialect:
    """The dialect `name`."""
    if name not in DIALECTS:
        raise DeckError(argument="target", found=name, expected=f"one of {', '.join(DIALECTS)}")
    return DIALECTS[name]


@cache
def template(name: str) -> "Template":
    """The template `name` of this folder; an undefined variable is an error."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("decks", "."),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    return environment.get_template(name)
