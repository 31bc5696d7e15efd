"""Post files written from values that a test knows.

It shares no code with the reader: what it writes follows the description of real files
alone. `Storage.kept` is what is left of a number once it is stored.
"""

import math
import struct
from dataclasses import dataclass

import numpy as np

FIELDS_A_LINE = 6


@dataclass(frozen=True)
class Storage:
    """How a file stores numbers."""

    binary: bool = True
    big_endian: bool = False
    real_bytes: int = 4
    line_end: str = "\n"

    @property
    def name(self):
        return "job.t16" if self.binary else "job.t19"

    def kept(self, values):
        """Give `values` as a file of this storage holds them."""
        values = np.array(values, dtype=float)
        if not self.binary:
            texts = [e13_6(value) for value in values.ravel()]
            return np.array([number(text) for text in texts]).reshape(values.shape)
        kind = np.float32 if self.real_bytes == 4 else np.float64
        return values.astype(kind).astype(float)


def e13_6(value):
    """Print a real as Fortran's E13.6 does."""
    if not math.isfinite(value):
        return f"{'NaN' if math.isnan(value) else 'Infinity'!s:>13}"
    mantissa, exponent = f"{abs(value):.5e}".split("e")
    power = int(exponent) + 1 if value else 0
    digits = mantissa.replace(".", "")
    sign = "-" if math.copysign(1, value) < 0 else " "
    tail = f"E{power:+03d}" if abs(power) < 100 else f"{power:+04d}"
    return f"{sign}0.{digits}{tail}"


def number(text):
    """Read what `e13_6` prints."""
    text = text.strip()
    if "E" not in text and text[-4] in "+-":
        return float(f"{text[:-4]}E{text[-4:]}")
    return float(text)


class BinarySink:
    """Unformatted records."""

    def __init__(self, storage):
        self.storage, self.parts = storage, []
        self.order = ">" if storage.big_endian else "<"

    def record(self, payload):
        marker = struct.pack(f"{self.order}i", len(payload))
        self.parts += [marker, payload, marker]

    def characters(self, text):
        return "".join(c + "   " for c in text).encode("latin-1")

    def word(self, text):
        if text in ("****", "----", "++++"):
            self.record(text.encode())
        else:
            self.record(self.characters(text.ljust(70 if "beg" in text else 5)))

    def text(self, text, width):
        self.record(self.characters(text.ljust(width)))

    def packed_integers(self, values):
        return struct.pack(f"{self.order}{len(values)}i", *values)

    def packed_reals(self, values):
        kind = "f" if self.storage.real_bytes == 4 else "d"
        return np.array(values, dtype=f"{self.order}{kind}").tobytes()

    def mixed(self, integers, reals):
        self.record(self.packed_integers(integers) + self.packed_reals(reals))

    def label(self, integers, text, width):
        characters = self.characters(text.ljust(width))
        self.record(self.packed_integers(integers) + characters)

    def verification(self, words):
        self.mixed(words[:18], ())
        self.mixed(words[18:], ())

    def flow(self, reals):
        self.record(self.packed_reals(reals))


class TextSink:
    """Lines of six fields of thirteen characters."""

    def __init__(self, storage):
        self.storage, self.parts = storage, []

    def line(self, text):
        self.parts.append((text + self.storage.line_end).encode("latin-1"))

    def word(self, text):
        self.line(text.ljust(70) if "beg" in text else text)

    def text(self, text, width):
        self.line(text.ljust(width))

    def fields(self, fields):
        for first in range(0, max(1, len(fields)), FIELDS_A_LINE):
            self.line("".join(fields[first : first + FIELDS_A_LINE]))

    def mixed(self, integers, reals):
        self.fields([f"{value:13d}" for value in integers] + [*map(e13_6, reals)])

    def label(self, integers, text, width):
        self.line("".join(f"{value:13d}" for value in integers) + text.ljust(width))

    def verification(self, words):
        self.mixed(words, ())

    def flow(self, reals):
        self.mixed((), reals)


WITH_SIDES = {12: "edge", 13: "face", 18: "edge", 19: "face"}


@dataclass(frozen=True)
class Model:
    """A mesh, the post codes and what else stands before increments.

    An element is (number, type, nodes, extras); a set is (name, type, members,
    sides), a code (code, layer, label).
    """

    node_ids: tuple = (1, 2, 3, 4)
    coordinates: tuple = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
    elements: tuple = ((7, 11, (1, 2, 3, 4), (1, 1, 1, 2, 0)),)
    points: int = 4
    codes: tuple = ((17, 0, "Equivalent Von Mises Stress"),)
    sets: tuple = ()
    dimensions: int = 2
    revision: int = 14
    strange_block: bool = False

    @property
    def corners(self):
        return max((len(element[2]) for element in self.elements), default=4)


@dataclass(frozen=True)
class Quantity:
    """A nodal quantity; `values` ``(N, components)`` or None for no data."""

    name: str
    code: int
    components: int
    values: object = None
    imaginary: bool = False


@dataclass(frozen=True)
class Increment:
    """What one increment holds; `element` ``(E, points, codes)`` or None."""

    number: int = 0
    sub: int = 0
    time_s: float = 0.0
    hz: float = 0.0  # of a harmonic one
    title: str = "lcase1"
    element: object = None
    nodal: tuple = ()
    variables: tuple = ()
    new_model: Model | None = None
    loads: tuple = ()


def post_bytes(storage, model, increments, title="job1", ended=True):
    """Write a whole file."""
    sink = (BinarySink if storage.binary else TextSink)(storage)
    block(sink, 50100, "Analysis Title", lambda: sink.text(" " * 10 + title, 70))
    write_model(sink, model)
    at = model
    for increment in increments:
        at = increment.new_model or at
        write_increment(sink, at, increment)
    if ended:
        sink.word("++++")
    return b"".join(sink.parts)


def block(sink, number, name, write):
    sink.word(f"=beg={number} ({name})")
    write()
    sink.word("=end=")


def write_model(sink, model):
    old = model.revision < 13
    words = [0] * 30
    counted = (len(model.codes), len(model.node_ids), len(model.elements), 2)
    words[0:4] = counted
    words[4], words[5], words[6] = model.points, -1, 1
    words[8], words[9], words[13] = model.dimensions, model.corners, model.revision
    block(sink, 50200, "Analysis Verification Data", lambda: sink.verification(words))
    block(sink, 50400, "Dummy", lambda: sink.mixed((0,), ()))
    block(sink, 50500, "Domain Decomposition", lambda: sink.mixed((0, 0), ()))

    def codes():
        for code, layer, label in model.codes:
            sink.label((code,) if old else (code, layer), label, 24 if old else 48)

    def elements():
        extras = 0
        if not old:
            extras = max((len(element[3]) for element in model.elements), default=5)
            sink.mixed((0, model.corners, extras), ())
        for number, kind, nodes, more in model.elements:
            # Zero in real files; here it is not, so that nothing depends on it.
            corners = [*nodes, *[-7] * (model.corners - len(nodes))]
            sink.mixed((number, kind, len(nodes), *corners, *more[:extras]), ())

    def coordinates():
        for node, place in zip(model.node_ids, model.coordinates, strict=True):
            sink.mixed((node,), place)

    def sets():
        sink.mixed((len(model.sets),), ())
        for name, kind, members, sides in model.sets:
            sink.text(name, 32 if old else 160)
            sink.mixed((len(members), kind), ())
            if not old:
                sink.mixed((0, 0, 0, 0), ())
            sink.mixed(members, ())
            if members and kind in WITH_SIDES:
                sink.mixed(sides, ())

    if model.codes:
        block(sink, 50600 if old else 50602, "Element Variable Postcodes", codes)
    block(sink, 50700 if old else 50702, "Element Connectivities", elements)
    block(sink, 50800, "Nodal Coordinates", coordinates)
    if not old:
        block(sink, 54000, "Materials", lambda: sink.mixed((0,), ()))
    if model.strange_block:
        block(sink, 59900, "Strange", lambda: sink.mixed((1, 2, 3), ()))
    block(sink, 51000, "Nodal Codes", lambda: sink.mixed([2] * counted[1], ()))
    block(sink, 51301 if old else 51302, "Set Definitions", sets)
    block(sink, 51501, "Flow Line Data", lambda: sink.mixed([0] * 6, ()))


def write_increment(sink, model, increment):
    words = [0] * 12
    words[0] = 1 if increment.new_model else 0
    words[1:4] = increment.number, increment.sub, 2
    words[6] = int(increment.hz > 0)
    words[3] = 2 if increment.element is None else 102
    sink.word("****")
    block(sink, 51600, "Loadcase Title", lambda: sink.text(" " * 10 + increment.title, 70))
    block(sink, 51701, "Integer Verification Data", lambda: sink.mixed(words, ()))

    def reals():
        sink.mixed((24,), ())
        sink.flow([increment.time_s, increment.hz, *range(2, 24)])

    def element():
        for row in np.asarray(increment.element).reshape(-1, len(model.codes)):
            sink.mixed((), row)

    def nodal():
        total = sum(quantity.components for quantity in increment.nodal)
        sink.mixed((len(increment.nodal), total), ())
        for quantity in increment.nodal:
            write_quantity(sink, quantity)

    def variables():
        sink.mixed((len(increment.variables),) * 2, ())
        for name, values in increment.variables:
            sink.text(name, 48)
            sink.mixed((7, 0, 0, len(values), 0, 0), ())
            sink.mixed((), values)

    block(sink, 51801, "Real Increment Verification Data", reals)
    if increment.new_model:
        block(sink, 51900, "New Model", lambda: sink.mixed((1,), ()))
        write_model(sink, increment.new_model)
    if increment.loads:
        block(sink, 52000, "Loads", lambda: sink.mixed((), increment.loads))
    if increment.element is not None:
        block(sink, 52300, "Element Integration Point Values", element)
    block(sink, 52401, "Nodal Results", nodal)
    block(sink, 52900, "Global Variables", variables)
    sink.word("----")


def write_quantity(sink, quantity):
    words = [quantity.code, 0, 0, quantity.components, *[0] * 8]
    words[5] = 4 if quantity.imaginary else 0
    words[6] = 0 if quantity.values is None else -1
    sink.text(quantity.name, 48)
    sink.mixed(words, ())
    if quantity.values is not None:
        for sign in (1, -1)[: 1 + quantity.imaginary]:
            sink.flow((sign * np.asarray(quantity.values, dtype=float)).ravel())
