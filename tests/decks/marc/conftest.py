"""Decks cut into options by a plain reader that shares no code with their writer."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from decks.analysis import Contact, analyse
from decks.marc.deck import marc_deck
from decks.presets import QUICK, mesh_of
from decks.probe import Probe
from fembridge.stimulus import Stimulus

SAMPLES = Path(__file__).parents[3] / "fixtures" / "marc_samples"


@dataclass
class Option:
    """A keyword line, the data lines after it, the comments before it."""

    line: str
    rows: list = field(default_factory=list)
    comments: list = field(default_factory=list)

    @property
    def keyword(self):
        return self.line[:20].strip()

    @property
    def word(self):
        """What stands after the keyword."""
        return self.line[20:].strip()

    @property
    def widths(self):
        return [len(row.rstrip()) for row in self.rows]


# Names stand alone on a line of these options, where they look like keywords.
NAMING = ("loadcase", "fixed disp", "geometry", "point load", "dist loads")
KEYWORDS = {
    "title", "extended", "sizing", "alloc", "elements", "version", "table", "processor",
    "large stra", "follow for", "all points", "no echo", "end", "solver", "optimize",
    "connectivity", "coordinates", "define", "isotropic", "mat color", "geometry",
    "fixed disp", "loadcase", "contact", "con intera", "con table", "contact table",
    "no print", "post", "nodal", "parameters", "end option", "control", "auto load",
    "auto step", "time step", "continue", "points", "attach node", "attach edge",
    "attach face", "ogden", "dist loads", "point load", "cad bodies",
}  # fmt: skip


def cut(text):
    """Cut a deck into options; every line is one of a keyword, of data or a comment."""
    options, comments = [], []
    for line in text.splitlines():
        if line.startswith("$"):
            comments.append(line)
        elif line[:20].strip() in KEYWORDS:
            options.append(Option(line, comments=comments))
            comments = []
        else:
            options[-1].rows.append(line)
    return options


def integers(line):
    assert len(line) % 10 == 0, line
    return [int(line[k : k + 10]) for k in range(0, len(line), 10)]


def reals(line):
    assert len(line) % 20 == 0, line
    return [real(line[k : k + 20]) for k in range(0, len(line), 20)]


def real(text):
    """Read a real that may lack the letter of its exponent."""
    at = max(text.rfind("+"), text.rfind("-"))
    if at > text.index("."):
        text = f"{text[:at]}e{text[at:]}"
    return float(text)


class Deck:
    """Options by keyword, and what the tests often ask for."""

    def __init__(self, text):
        self.text = text
        self.options = cut(text)
        self.keywords = [option.keyword for option in self.options]

    def all(self, keyword, word=None):
        return [
            option
            for option in self.options
            if option.keyword == keyword and word in (None, option.word)
        ]

    def one(self, keyword, word=None):
        (option,) = self.all(keyword, word)
        return option

    def elements(self):
        """Type and nodes by number."""
        found = {}
        for block in self.all("connectivity"):
            for row in block.rows[1:]:
                number, *rest = integers(row)
                assert number not in found
                found[number] = rest
        return found

    def nodes(self):
        rows = self.one("coordinates").rows[1:]
        found = {int(row[:10]): reals(row[10:]) for row in rows}
        assert len(found) == len(rows)
        return found

    def members(self, kind, name):
        """Numbers of the set `name`."""
        words = f"{kind:<20}{'set':<20}{name}"
        *most, last = self.one("define", words).rows
        assert all(len(row) == 13 * 12 + 4 and row.endswith("   c") for row in most)
        assert len(last) <= 13 * 12
        flat = "".join([row[:-4] for row in most] + [last])
        return [int(flat[k : k + 12]) for k in range(0, len(flat), 12)]


SHORT = Stimulus("short", np.array([0.0, 1.5, -2.25, 100.0]), 0.5, (0.0, 1.5))
SKIN = mesh_of(QUICK)


def model_of(element="CPE4H", *, stimulus=SHORT, probe=None, contact=None, **changes):
    analysis = analyse(QUICK, SKIN, stimulus, probe=probe, contact=contact, element=element)
    return replace(analysis, **changes)


KINDS = {
    "80 rigid": (model_of(), "rigid"),
    "80 meshed": (model_of(), "meshed"),
    "11 rigid": (model_of("CPE4"), "rigid"),
    "11 meshed": (model_of("CPE4"), "meshed"),
    "27 rigid": (model_of("CPE8"), "rigid"),
    "27 meshed": (model_of("CPE8"), "meshed"),
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
    return model, probe, Deck(marc_deck(model, probe=probe))


@pytest.fixture(scope="session")
def make_model():
    """Give the function that numbers an analysis of the quick finger."""
    return model_of


@pytest.fixture(scope="session")
def read_deck():
    """Give the plain reader."""
    return Deck


@pytest.fixture(scope="session")
def sample():
    """Give a real deck by its name."""

    def read(name):
        return Deck((SAMPLES / f"{name}.dat").read_text(encoding="ascii"))

    return read


@pytest.fixture(scope="session")
def columns():
    """Give the functions that read whole numbers and reals by column."""
    return integers, reals
