"""Our decks as their options, to be held against real ones; small own decks."""

import re
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np
import pytest

from decks.contact_analysis import Contact, Model
from decks.dialects import DeckOptions
from decks.marc.grammar import read_options
from decks.marc.write import marc_deck
from decks.presets import QUICK, mesh_of
from decks.probe import Probe
from fembridge.stimulus import Stimulus

SAMPLES = Path(__file__).parents[3] / "fixtures" / "marc_samples"


@dataclass
class Option:
    """A keyword line and the data lines after it."""

    line: str
    rows: list
    keyword: str

    @property
    def widths(self):
        return [len(row.rstrip()) for row in self.rows]


class Deck:
    """Options by keyword, as text, and what the tests often ask for."""

    def __init__(self, text):
        self.text = text
        options = read_options(text.encode("ascii"))
        self.options = [
            Option(one.head.text, [line.text for line in one.data], one.keyword) for one in options
        ]
        self.keywords = [option.keyword for option in self.options]

    def all(self, keyword):
        return [option for option in self.options if option.keyword == keyword]

    def one(self, keyword, word=None):
        (option,) = (each for each in self.all(keyword) if word in (None, each.line[20:].strip()))
        return option

    @staticmethod
    def integers(line):
        assert len(line) % 10 == 0, line
        return [int(line[k : k + 10]) for k in range(0, len(line), 10)]

    @staticmethod
    def reals(line):
        """Reals that lack the letter of their exponent."""
        assert len(line) % 20 == 0, line
        fields = [line[k : k + 20] for k in range(0, len(line), 20)]
        return [float(re.sub(r"(?<=\d)([+-])", r"e\1", one)) for one in fields]

    @cached_property
    def elements(self):
        """Type and nodes by number."""
        rows = [row for block in self.all("connectivity") for row in block.rows[1:]]
        return {number: rest for number, *rest in map(self.integers, rows)}

    @cached_property
    def nodes(self):
        return {int(row[:10]): self.row(row[10:]) for row in self.one("coordinates").rows[1:]}


SHORT = Stimulus("short", np.array([0.0, 1.5, -2.25, 100.0]), 0.5, (0.0, 1.5))
SKIN = mesh_of(QUICK)


def model_of(element="CPE4H", *, stimulus=SHORT, probe=None, contact=None, **changes):
    analysis = Model(
        QUICK,
        SKIN,
        probe=probe or Probe(),
        contact=contact or Contact(),
        element=element,
        support="prescribed",
    ).analysis(stimulus)
    return replace(analysis, **changes)


KINDS = {
    "80 meshed": (model_of(), "meshed"),
    "54 rigid": (model_of("CPE8R"), "rigid"),
    "118 rigid": (model_of("CPE4RH"), "rigid"),
    "flat, no friction": (
        model_of(probe=Probe("flat", 2.0, 0.2, 0.3), contact=Contact(friction=0.0)),
        "rigid",
    ),
}


@pytest.fixture(scope="session", params=KINDS)
def built(request):
    """Give a model, its kind of probe, and its deck as a plain reader sees it."""
    model, probe = KINDS[request.param]
    return model, probe, Deck(marc_deck(model, DeckOptions(probe=probe)))


@pytest.fixture(scope="session")
def make_model():
    """Give the function that numbers an analysis of the quick finger."""
    return model_of


@pytest.fixture(scope="session")
def sample():
    """Give a real deck by its name."""

    return cache(lambda name: Deck((SAMPLES / f"{name}.dat").read_text(encoding="ascii")))


@dataclass(frozen=True)
class MarcText:
    """A deck of two elements; its parts can be replaced by name."""

    layout: str = "extended"
    version: int = 15
    drive: str = "body"  # or "disp"
    factor: float = -1.0
    stepping: str = "auto load"
    post: tuple = (301,)
    post_head: dict = field(default_factory=dict)
    end: str = "\n"

    def row(self, *values, name=""):
        """A line of integers, of reals as Mentat prints them, and of a name."""
        if self.layout == "free":
            return f"{', '.join(map(repr, values))}," + f" {name}" * bool(name)
        return "".join(map(self.cell, values)) + name

    def cell(self, value):
        if self.layout == "fixed":
            return f"{value:5d}" if isinstance(value, int) else f"{value:10.4f}"
        if isinstance(value, int):
            return f"{value:10d}"
        mantissa, exponent = f"{value:.15e}".split("e")
        return f"{mantissa}{int(exponent):+d}".rjust(20)

    def head(self, *words):
        if self.layout == "free":
            return ",".join(map(str, words))
        width = 20 if self.layout == "extended" else 10
        cells = [one.ljust(width) if isinstance(one, str) else self.cell(one) for one in words]
        return "".join(cells).rstrip()

    def parameters(self):
        workspace = (0,) if self.layout == "free" else (0, 0)
        yield "title"
        if self.layout == "extended":
            yield "extended"
        yield self.head("sizing", *workspace, 2, 6, 0)
        yield self.head("elements", 11)
        yield self.head("version", self.version, 2, 0, 0)
        yield self.head("table", 0, 0, 2, 1, 1, 0, 0, 1)
        yield "end"

    def mesh(self):
        yield "connectivity"
        yield self.row(0, 0, 1, 0, 1, 1, 0, 1, 0)
        yield self.row(1, 11, 1, 2, 5, 4)
        yield self.row(2, 11, 2, 3, 6, 5)
        yield "coordinates"
        yield self.row(3, 6, 0, 1)
        for node in range(1, 7):
            x, y = float((node - 1) % 3), -float((node - 1) // 3)
            yield self.row(node, x, y, 0.0)
        yield self.head("define", "node", "set", "held_nodes")
        yield "4 to 6"

    def table(self, name="wave", number=1, points=((0.0, 0.0), (1.0, 1.0))):
        yield self.head("table", name)
        yield self.row(number, 1, 0, 0, 2)
        yield self.row(1, len(points), 2, 0, 0, 2, 0, 0, 2, 0, 0, 2)
        for point in points:
            yield self.row(*point)

    def fixed(self, name, value, table, where="held_nodes"):
        yield self.row(1, 0, 0, 0, 1, 0, name=name)
        yield self.row(0.0, value)
        yield self.row(0, table)
        yield self.row(1, 2)
        yield self.row(2)
        yield where

    def conditions(self):
        yield "fixed disp"
        yield ""
        yield from self.fixed("held", 0.0, 0)
        if self.drive == "disp":
            yield from self.fixed("indent", self.factor, 1)

    def contact(self):
        if self.drive != "body":
            return
        yield self.head("contact", 5, 0, 0)
        yield self.row(1, 0, 9, 6, 0, 9999, 3, *[0] * 9)
        yield self.row(*[0] * 7, 1, *[0] * 8)
        yield self.row(*[0.0] * 5, 0.95, 0.0, 0.05)
        yield self.row(1.0, 0.0)
        yield "$....contact body 1: probe"
        yield self.row(1, 0, 0, 0, 1, -1, 0, -1, name="probe")
        yield self.row(2, 0, 0, 0, 1, 1, 1, 1)
        yield self.row(*[0.0] * 6, 1.0)
        yield self.row(*[0.0] * 4)
        yield self.row(0.0, self.factor, *[0.0] * 6)
        yield self.row(0, 1, *[0] * 6)
        yield self.row(0, 0, 0, 0)

    def output(self):
        head = [len(self.post), 16, 17, 0, 0, 19, 20, 0, 1, *[0] * 7]
        for place, value in self.post_head.items():
            head[place - 1] = value
        yield "post"
        yield self.row(*head)
        for code in self.post:
            yield self.row(code, 0)

    def case(self, name="press", increments=10, most=99999, stepping=None):
        stepping = stepping or self.stepping
        yield self.head("loadcase", name)
        active = ["held", "indent"] if self.drive == "disp" else ["held"]
        yield self.row(len(active))
        yield from active
        yield "control"
        yield self.row(most, 10, 0, 0, 0, 1)
        yield self.row(0.1)
        if stepping == "auto load":
            yield "auto load"
            yield self.row(increments, 0, 10, 0, 0)
            yield "time step"
            yield self.row(0.1)
        elif stepping == "auto step":
            yield "auto step"
            adaptive = self.row(0.01, 1.0, 0.1, 10.0, 0.001, 0.5)
            yield adaptive + self.row(99999, 5, 1, 0)
            yield self.row(0, 10, 0, 0)
        else:
            yield stepping
            yield self.row(0.1, 1.0)
        yield "continue"

    def text(self, **parts):
        """Join the parts; one given by name (a list of lines) replaces its own."""
        order = ("parameters", "mesh", "table", "conditions", "contact", "output")
        lines = []
        for part in order:
            lines += parts.get(part) or getattr(self, part)()
        lines.append("end option")
        lines += parts.get("cases") or self.case()
        return (self.end.join(map(str, lines)) + self.end).encode("latin-1")


@pytest.fixture(scope="session")
def marc_text():
    """The class, to be made with what a test wants."""
    return MarcText
