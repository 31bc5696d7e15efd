"""Small decks for what is tested on them: a .inp, and Marc's in all three layouts."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from decks.motion import Motion
from decks.own_model.inp import rebase_inp
from decks.own_model.request import Request
from fembridge.errors import DeckError


@dataclass(frozen=True)
class MarcText:
    """A deck of two elements; its parts can be replaced by name."""

    layout: str = "extended"
    version: int = 15
    drive: str = "body"  # or "disp"
    factor: float = -1.0
    stepping: str = "auto load"
    step_name: str = "press"
    post: tuple = (301,)
    post_head: dict = field(default_factory=dict)
    end: str = "\n"

    def ints(self, *values):
        width = {"extended": 10, "fixed": 5, "free": 0}[self.layout]
        if width:
            return "".join(f"{value:{width}d}" for value in values)
        return ", ".join(map(str, values)) + ","

    def reals(self, *values):
        if self.layout == "free":
            return ", ".join(map(repr, values)) + ","
        if self.layout == "fixed":
            return "".join(f"{value:10.4f}" for value in values)
        return "".join(self.mentat(value) for value in values)

    def head(self, word, *values):
        if self.layout == "free":
            return ",".join([word, *map(str, values)])
        width = 20 if self.layout == "extended" else 10
        rest = [str(v) if isinstance(v, str) else self.ints(v) for v in values]
        return word.ljust(width) + "".join(rest)

    def define(self, name):
        if self.layout == "free":
            return f"define, node, set, {name}"
        width = 20 if self.layout == "extended" else 10
        return "".join(w.ljust(width) for w in ("define", "node", "set")) + name

    def named(self, *values, name):
        joined = self.ints(*values)
        return f"{joined} {name}" if self.layout == "free" else joined + name

    @staticmethod
    def mentat(value):
        mantissa, exponent = f"{value:.15e}".split("e")
        return f"{mantissa}{int(exponent):+d}".rjust(20)

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
        yield self.ints(0, 0, 1, 0, 1, 1, 0, 1, 0)
        yield self.ints(1, 11, 1, 2, 5, 4)
        yield self.ints(2, 11, 2, 3, 6, 5)
        yield "coordinates"
        yield self.ints(3, 6, 0, 1)
        for node in range(1, 7):
            x, y = float((node - 1) % 3), -float((node - 1) // 3)
            number = self.ints(node)
            yield (number + (" " if self.layout == "free" else "") + self.reals(x, y, 0.0))
        yield self.define("held_nodes")
        yield "4 to 6"

    def table(self, name="wave", number=1, points=((0.0, 0.0), (1.0, 1.0))):
        yield self.head("table", name)
        yield self.ints(number, 1, 0, 0, 2)
        yield self.ints(1, len(points), 2, 0, 0, 2, 0, 0, 2, 0, 0, 2)
        for point in points:
            yield self.reals(*point)

    def fixed(self, name, value, table, where="held_nodes"):
        yield self.named(1, 0, 0, 0, 1, 0, name=name)
        yield self.reals(0.0, value)
        yield self.ints(0, table)
        yield self.ints(1, 2)
        yield self.ints(2)
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
        yield self.ints(1, 0, 9, 6, 0, 9999, 3, *[0] * 9)
        yield self.ints(*[0] * 7, 1, *[0] * 8)
        yield self.reals(*[0.0] * 5, 0.95, 0.0, 0.05)
        yield self.reals(1.0, 0.0)
        yield "$....contact body 1: probe"
        yield self.named(1, 0, 0, 0, 1, -1, 0, -1, name="probe")
        yield self.ints(2, 0, 0, 0, 1, 1, 1, 1)
        yield self.reals(*[0.0] * 6, 1.0)
        yield self.reals(*[0.0] * 4)
        yield self.reals(0.0, self.factor, *[0.0] * 6)
        yield self.ints(0, 1, *[0] * 6)
        yield self.ints(0, 0, 0, 0)

    def output(self):
        head = [len(self.post), 16, 17, 0, 0, 19, 20, 0, 1, *[0] * 7]
        for place, value in self.post_head.items():
            head[place - 1] = value
        yield "post"
        yield self.ints(*head)
        for code in self.post:
            yield self.ints(code, 0)

    def case(self, name=None, increments=10, most=99999, stepping=None):
        stepping = stepping or self.stepping
        yield self.head("loadcase", name or self.step_name)
        active = ["held", "indent"] if self.drive == "disp" else ["held"]
        yield self.ints(len(active))
        yield from active
        yield "control"
        yield self.ints(most, 10, 0, 0, 0, 1)
        yield self.reals(0.1)
        if stepping == "auto load":
            yield "auto load"
            yield self.ints(increments, 0, 10, 0, 0)
            yield "time step"
            yield self.reals(0.1)
        elif stepping == "auto step":
            yield "auto step"
            adaptive = self.reals(0.01, 1.0, 0.1, 10.0, 0.001, 0.5)
            yield adaptive + self.ints(99999, 5, 1, 0)
            yield self.ints(0, 10, 0, 0)
        elif stepping != "none":
            yield stepping
            yield self.reals(0.1, 1.0)
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


MOTION = Motion(np.arange(5) * 5e-4, np.array([0.0, 0.1, 0.2, 0.1, 0.0]), 5e-4, 0)
DECK = """\
*HEADING
somebody's deck
*NODE, NSET=ALL
1, 0., 0., 0.
2, 1., 0., 0.
3, 1., 1., 0.
4, 0., 1., 0.
*ELEMENT, TYPE=CPE4, ELSET=SKIN
1, 1, 2, 3, 4
*AMPLITUDE, NAME=PRESS
0., 0., 1., 1.
*AMPLITUDE, NAME=OTHER
0., 0., 1., 1.
*STEP, NAME=push, INC=200
*STATIC
0.1, 1.
*BOUNDARY
1, 1, 2
*BOUNDARY, AMPLITUDE=PRESS
4, 2, 2, -1.
*NODE FILE
U
*END STEP
"""


@pytest.fixture
def deck():
    """Give somebody's `.inp`, which is taken as it is."""
    return DECK


@pytest.fixture
def step():
    """Give the step of that deck."""
    return DECK[DECK.index("*STEP") :]


@pytest.fixture
def rebase():
    """Give a function that puts a short motion into a deck."""

    def run(deck=DECK, dialect=None, resolver=None, **request):
        return rebase_inp(
            deck.encode(), MOTION, Request(**request), dialect=dialect, resolver=resolver
        )

    return run


@pytest.fixture
def refused(rebase):
    """Give a function that tells with which words a deck is refused."""

    def run(deck=DECK, **options):
        with pytest.raises(DeckError) as caught:
            rebase(deck, **options)
        return str(caught.value)

    return run


@pytest.fixture
def changed():
    """Give a function that replaces the one `old` in that deck."""

    def run(old, new):
        assert DECK.count(old) == 1
        return DECK.replace(old, new)

    return run
