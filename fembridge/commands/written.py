"""What each verb writes: its files, and of each table every column with unit and meaning.

The one place of it is ``outputs.md`` beside this module, a page for people; here it is read,
for ``fembridge VERB --help``. A name in angle brackets stands for columns that differ from
case to case.
"""

import re
import textwrap
from importlib.resources import files
from typing import NamedTuple


class Column(NamedTuple):
    """A column of a table: its name, the unit of its numbers ("" for none), its meaning."""

    name: str
    unit: str
    meaning: str


class Output(NamedTuple):
    """A file that a verb writes, what it is, and its columns if it is a table."""

    file: str
    what: str
    columns: tuple[Column, ...] = ()


_FILE = re.compile(r"^\*\*`(.*)`\*\*: (.*)$", re.MULTILINE)
_COLUMN = re.compile(r"^\| `(.*?)` \| (.*?) ?\| (.*) \|$", re.MULTILINE)


def outputs_of(verb: str) -> tuple[Output, ...]:
    """What `verb` writes; () where that is no file."""
    page = files("fembridge.commands").joinpath("outputs.md").read_text(encoding="utf-8")
    section = page.partition(f"\n## {verb}\n")[2].partition("\n## ")[0]
    pieces = iter(_FILE.split(section)[1:])
    return tuple(
        Output(file, what, tuple(Column(*row) for row in _COLUMN.findall(table)))
        for file, what, table in zip(pieces, pieces, pieces, strict=True)
    )


def help_text(verb: str) -> str:
    """The outputs of `verb` for its ``--help``; "" where it writes nothing."""
    outputs = outputs_of(verb)
    lines = ["outputs:"] if outputs else []
    for output in outputs:
        lines.append(f"  {output.file}: {output.what}")
        for name, unit, meaning in output.columns:
            words = f"{name}{f' ({unit})' if unit else ''}: {meaning}".replace("`", "")
            lines += textwrap.wrap(words, 88, initial_indent=" " * 4, subsequent_indent=" " * 6)
    return "\n".join(lines)
