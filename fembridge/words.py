"""Numbers and tables as people read them, on pages and in Markdown."""

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pandas import DataFrame

ABSENT = "–"


def number(value: float, spec: str) -> str:
    """A number with a true minus, 0 without a sign, or a dash for one that does not exist."""
    if math.isnan(value):
        return ABSENT
    text = format(value, spec)
    if text[0] in "+-" and not float(text):
        text = text[1:]
    return text.replace("-", "\N{MINUS SIGN}", int(value < 0))


def worded(frame: "DataFrame", formats: str) -> "DataFrame":
    """`frame` in words; `formats` has one for the numbers of each column, ``|`` between."""
    columns = zip(frame.columns, formats.split("|"), strict=True)
    return frame.astype(object).assign(
        **{
            name: [cell if isinstance(cell, str) else number(cell, spec) for cell in frame[name]]
            for name, spec in columns
        }
    )


def markdown(words: "DataFrame") -> str:
    """A table of words, without its index."""
    head, *body = (f"| {' | '.join(line)} |" for line in [[*words], *words.itertuples(index=False)])
    return "\n".join([head, "|" + "---|" * words.shape[1], *body])
