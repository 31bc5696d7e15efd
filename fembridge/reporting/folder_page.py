"""A report as a value and as a page: sections of texts, tables, pictures, checks and commands.

The page is one HTML file without scripts and without anything from elsewhere: pictures are SVG
elements in it, in the colours of the page. The style is that of `fembridge.reporting.validation`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fembridge.errors import UsageError
from fembridge.host.store import write_text
from fembridge.io.formatting import rendered, split_unit
from fembridge.plots.shown import Shown
from fembridge.typing import Table
from fembridge.version import __version__

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.figure import Figure
    from pandas import DataFrame

PAGE = "report.html"
_MOST_ROWS = 40
_LONGEST_CELL = 160


@dataclass(frozen=True, slots=True)
class Check:
    """A check of a run: what was checked, whether it holds, and what was found.

    `passed` is None for a doubt: nothing is wrong for certain.
    """

    name: str
    passed: bool | None
    finding: str = ""

    @property
    def verdict(self) -> str:
        """``ok``, ``doubt`` or ``failed``."""
        return {True: "ok", False: "failed", None: "doubt"}[self.passed]


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture: its `name` in a report, a caption, and the function that draws it."""

    name: str
    caption: str
    draw: Callable[[], Figure]


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """A part of a report, in this order: text, facts, picture, tables, list, commands.

    `facts` are values by name; `tables` are frames by caption.
    """

    title: str
    text: str = ""
    facts: Mapping[str, object] = field(default_factory=dict)
    pictures: tuple[Picture, ...] = ()
    tables: Mapping[str, DataFrame] = field(default_factory=dict)
    items: tuple[str, ...] = ()
    commands: tuple[str, ...] = ()

    @property
    def anchor(self) -> str:
        """The title as an id."""
        return "".join(letter if letter.isalnum() else "-" for letter in self.title.lower())


class Report(Shown):
    """A report of a folder, the result of `report`.

    Parameters
    ----------
    folder
        The folder, or file, that it is about.
    kind
        ``run``, ``simulation``, ``touch``, ``map`` or ``pad``.
    title, lead
        Title and first lines of the page.
    sections
        Parts of the page.
    checks
        What was checked.

    Examples
    --------
    >>> import fembridge as fb
    >>> fb.simulate("sine_20_250", stored=True).write("out")
    >>> set(fb.report("out").checks["verdict"])
    {'ok'}
    """

    def __init__(
        self,
        folder: Path,
        kind: str,
        title: str,
        lead: str,
        sections: tuple[Section, ...],
        checks: tuple[Check, ...],
    ) -> None:
        self.folder, self.kind, self.title, self.lead = folder, kind, title, lead
        self.sections, self._checks = sections, checks

    @property
    def checks(self) -> DataFrame:
        """Checks, one row each: ``check, verdict, finding``."""
        from pandas import DataFrame

        rows = [(check.name, check.verdict, check.finding) for check in self._checks]
        return DataFrame(rows, columns=["check", "verdict", "finding"])

    @property
    def passed(self) -> bool:
        """Whether no check failed."""
        return all(check.passed is not False for check in self._checks)

    @property
    def pictures(self) -> tuple[str, ...]:
        """Names of the pictures."""
        return tuple(picture.name for picture in self._pictures())

    @property
    def provenance(self) -> Table:
        """Version, kind and folder."""
        return {"fembridge": __version__, "kind": self.kind, "folder": str(self.folder)}

    def _pictures(self) -> Iterator[Picture]:
        for section in self.sections:
            yield from section.pictures

    def _lines(self) -> list[str]:
        verdicts = [check.verdict for check in self._checks]
        counted = ", ".join(
            f"{verdicts.count(verdict)} {verdict}"
            for verdict in ("ok", "doubt", "failed")
            if verdict in verdicts
        )
        return [
            f"Report of {self.folder}: {self.title}",
            f"  checks: {counted or 'none'}",
            f"  pictures: {', '.join(self.pictures) or 'none'}",
            "  .checks, .plot(kind), .write(path)",
        ]

    def plot(self, kind: str | None = None, ax: Any = None) -> Figure:  # noqa: ANN401 - axes
        """Picture of the page.

        Parameters
        ----------
        kind
            One of `pictures`. Default: the first.
        ax
            Not taken: a picture of a report is a new figure. Default: None.

        Raises
        ------
        UsageError
            Another kind, axes, or a report without pictures.
        """
        if ax is not None:
            raise UsageError("is not taken: draw with the result itself", argument="ax")
        pictures = {picture.name: picture for picture in self._pictures()}
        if not pictures:
            raise UsageError("this report has no picture", argument="kind")
        name = kind or next(iter(pictures))
        if name not in pictures:
            expected = f"one of {', '.join(pictures)}"
            raise UsageError(argument="kind", found=kind, expected=expected)
        return pictures[name].draw()

    def to_html(self) -> str:
        """The page."""
        return rendered(
            "folder_page.html.j2",
            {"table": _table_html, "picture": _picture_html, "facts": _facts},
            report=self,
            checks=self._checks,
            version=__version__,
        )

    def write(self, path: str | os.PathLike[str] | None = None) -> Path:
        """Write the page and return its path.

        Parameters
        ----------
        path
            HTML file. Default: None, ``report.html`` in the folder.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        home = self.folder if self.folder.is_dir() else self.folder.parent
        page = home / PAGE if path is None else Path(path)
        write_text(page, self.to_html())
        return page


def _picture_html(picture: Picture) -> Markup:
    from fembridge.reporting.svg import svg_element

    return svg_element(picture.draw(), picture.name)


def _table_html(frame: DataFrame) -> Markup:
    """HTML of a table; of a long one the first rows."""
    from markupsafe import Markup, escape
    from pandas import option_context

    def cell(value: object) -> Markup:
        if value is None or value != value:
            return Markup("")
        text = f"{value:.6g}" if isinstance(value, float) else str(value)
        return escape(text if len(text) <= _LONGEST_CELL else f"{text[:_LONGEST_CELL]}…")

    shown = frame.head(_MOST_ROWS)
    heads = {name: escape(_head(str(name))) for name in shown.columns}
    escaped = shown.astype(object).map(cell).rename(columns=heads)
    with option_context("display.max_colwidth", None):
        html = escaped.to_html(escape=False, border=0, index=False, classes="prose")
    if len(frame) > _MOST_ROWS:
        html += f"<p>… and {len(frame) - _MOST_ROWS} more rows.</p>"
    return Markup(html)


def _head(name: str) -> str:
    """A column's name in words, with its unit."""
    plain, unit = split_unit(name)
    words = plain.replace("_", " ").strip()
    return f"{words} ({unit})" if unit else words


def _facts(values: Mapping[str, object]) -> list[tuple[str, str]]:
    """Names and values of facts as texts, without those that are empty."""
    rows = []
    for name, value in values.items():
        if value is None or value == "" or value == [] or value == {}:
            continue
        if isinstance(value, float):
            text = f"{value:.6g}"
        elif isinstance(value, list | tuple):
            text = ", ".join(f"{x:.6g}" if isinstance(x, float) else str(x) for x in value)
        else:
            text = str(value)
        rows.append((_head(name), text))
    return rows
