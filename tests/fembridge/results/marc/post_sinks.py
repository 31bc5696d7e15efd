"""How post files store records: packed between two lengths, or as lines of text.

It shares no code with the reader.
"""

import math
import struct
from dataclasses import dataclass

import numpy as np

FIELDS_A_LINE = 6


@dataclass(frozen=True)
class Storage:
    """How a file stores numbers; `piece_bytes` splits records of nodal values."""

    binary: bool = True
    big_endian: bool = False
    real_bytes: int = 4
    word_bytes: int = 4
    piece_bytes: int = 0
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
        filler = " " * (self.storage.word_bytes - 1)
        return "".join(c + filler for c in text).encode("latin-1")

    def word(self, text):
        if text in ("****", "----", "++++"):
            self.record(text.encode())
        else:
            self.record(self.characters(text.ljust(70 if "beg" in text else 5)))

    def text(self, text, width):
        self.record(self.characters(text.ljust(width)))

    def packed_integers(self, values):
        kind = "i" if self.storage.word_bytes == 4 else "q"
        return struct.pack(f"{self.order}{len(values)}{kind}", *values)

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
        payload, size = self.packed_reals(reals), self.storage.piece_bytes
        if not size or len(payload) <= size:
            self.record(payload)
            return
        pieces = [payload[at : at + size] for at in range(0, len(payload), size)]
        for place, piece in enumerate(pieces):
            more, later = place + 1 < len(pieces), place > 0
            self.parts += [
                struct.pack(f"{self.order}i", -len(piece) if more else len(piece)),
                piece,
                struct.pack(f"{self.order}i", -len(piece) if later else len(piece)),
            ]


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
