"""Changes to the bytes of a Marc deck: lines put in the place of lines.

Everything that no edit covers stays as it is. Numbers are written as the deck lays
them out: in 20 columns as Mentat does, ``5.000000000000000-4``, or between commas.
Ten columns hold too few digits for a waveform, so that reals of a fixed deck go
between commas too, which Marc reads on any line.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from decks.marc_grammar.layout import Layout, is_free, real, with_integer
from decks.marc_grammar.line import Line

_COLUMNS = 20
_DIGITS = 15


@dataclass(slots=True)
class Edits:
    """Changes to `data`, collected and then made at once."""

    data: bytes
    _made: dict[tuple[int, int], bytes] = field(default_factory=dict)

    def replace(self, line: Line, *texts: str) -> None:
        """Put `texts`, each a line, in the place of `line`; none deletes it."""
        self._own(line)
        self._made[line.start, line.stop] = self._lines(line, texts)

    def insert(self, before: Line, *texts: str) -> None:
        """Put lines before the line `before`."""
        self._own(before)
        place = before.start, before.start
        self._made[place] = self._made.get(place, b"") + self._lines(before, texts)

    def changed(self) -> bytes:
        """Give the bytes with all changes made."""
        parts, place = [], 0
        for (start, stop), new in sorted(self._made.items()):
            parts += [self.data[place:start], new]
            place = stop
        return b"".join([*parts, self.data[place:]])

    def _lines(self, like: Line, texts: Sequence[str]) -> bytes:
        """Encode lines with the end that `like` has."""
        end = self.data[like.start + len(like.text) : like.stop].decode("latin-1")
        if not end.endswith("\n"):
            end = "\r\n" if b"\r\n" in self.data else "\n"
        return "".join(text + end for text in texts).encode("latin-1")

    def _own(self, line: Line) -> None:
        if line.included:
            raise line.refuse(
                "would have to change, but stands in an included file; only the deck "
                "itself is changed: put these lines into it"
            )


def real_text(value: float) -> str:
    """Write a real in 20 columns, as Mentat does: no letter before its exponent."""
    value = value or 0.0  # no negative zero
    for digits in range(_DIGITS, 0, -1):
        mantissa, exponent = f"{value:.{digits}e}".split("e")
        text = f"{mantissa}{exponent[0]}{int(exponent[1:])}"
        if len(text) < _COLUMNS or (len(text) == _COLUMNS and value < 0):
            break
    return text.rjust(_COLUMNS)


def free_text(value: float) -> str:
    """Write a real to stand between commas, with all its digits."""
    text = repr(value or 0.0).upper()
    return text if "." in text else text.replace("E", ".0E")


def reals_line(values: Sequence[float], layout: Layout, like: str) -> str:
    """Write a line of reals, laid out as the line `like` is."""
    if layout is Layout.FIXED or is_free(like):
        return ", ".join(map(free_text, values)) + ("," if len(values) == 1 else "")
    return "".join(map(real_text, values))


def integers_line(values: Sequence[int], layout: Layout, like: str) -> str:
    """Write a line of integers, laid out as the line `like` is."""
    if is_free(like):
        return ", ".join(map(str, values)) + ("," if len(values) == 1 else "")
    return "".join(str(value).rjust(layout.integer) for value in values)


def with_first_real(text: str, layout: Layout, value: float) -> str:
    """Put `value` into the first field of a line of reals; the rest stays."""
    if is_free(text):
        return ",".join([free_text(value), *text.split(",")[1:]])
    rest = text[layout.real :]
    if layout is Layout.EXTENDED:
        return real_text(value) + rest
    written = f"{value:.4e}".replace("e-0", "-").replace("e+0", "+")
    if len(written) > layout.real or real(written) != value:
        if rest.strip():
            raise ValueError(text)
        return free_text(value) + ","
    return written.rjust(layout.real) + rest


def set_integer(edits: Edits, line: Line, layout: Layout, row: int, value: int) -> None:
    """Put `value` into field `row`, from 0, of a line of integers.

    Raises
    ------
    DeckError
        The field has too few columns.
    """
    try:
        edits.replace(line, with_integer(line.text, layout, row, value))
    except ValueError:
        raise line.refuse(
            f"{value} does not fit into field {row + 1}, of {layout.integer} columns"
        ) from None
