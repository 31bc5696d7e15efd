"""One HTML page that needs nothing beside it: text, tables, figures, how each was made.

Words are escaped here and nowhere else. A figure or table is a ``<figure>`` whose
caption opens with what it is, in bold, and goes on with what is seen in it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from fembridge.validation.inline_svg import to_inline

_STYLE = Path(__file__).with_name("style.css")


@dataclass(frozen=True, slots=True)
class Made:
    """The commands that make a figure's or table's numbers again; files that hold them.

    `files` lie beside the page.
    """

    commands: tuple[str, ...]
    files: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Caption:
    """What a figure or table is, and what is to be seen in it."""

    title: str
    text: str


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of a table: words, a class of the style sheet, columns it spans."""

    text: str
    look: str = ""
    span: int = 1


@dataclass(frozen=True, slots=True)
class TableText:
    """Rows of a table on the page.

    `heads` are rows of the head. In `rows` the first cell names the row; a row of one
    cell heads those after it.
    """

    heads: tuple[tuple[Cell, ...], ...]
    rows: tuple[tuple[Cell, ...], ...]


@dataclass(frozen=True, slots=True)
class Section:
    """A heading, and what stands under it as HTML."""

    anchor: str
    title: str
    blocks: tuple[str, ...]


def paragraph(text: str, look: str = "") -> str:
    """Give a paragraph."""
    return f"<p{_class(look)}>{escape(text)}</p>"


def bullets(texts: Sequence[str]) -> str:
    """Give a list."""
    items = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f'<ul class="short">{items}</ul>'


def figure_block(svg: str, name: str, caption: Caption, made: Made) -> str:
    """Give a figure; `svg` is the text of its file, `name` is its own on the page."""
    drawing = to_inline(svg, name, caption.title)
    return (
        f'<figure id="{name}"><div class="wide">{drawing}</div>'
        f"<figcaption>{_caption(caption)}</figcaption>{_made(made)}</figure>"
    )


def table_block(table: TableText, name: str, caption: Caption, made: Made) -> str:
    """Give a table, its caption above it."""
    columns = max(sum(cell.span for cell in row) for row in table.heads)
    heads = "".join(f"<tr>{_head_row(row)}</tr>" for row in table.heads)
    rows = "".join(f"<tr>{_row(row, columns)}</tr>" for row in table.rows)
    return (
        f'<figure id="{name}">'
        f'<figcaption class="above">{_caption(caption)}</figcaption>'
        f'<div class="wide"><table><thead>{heads}</thead>'
        f"<tbody>{rows}</tbody></table></div>{_made(made)}</figure>"
    )


def page(title: str, lead: Sequence[str], sections: Sequence[Section]) -> str:
    """Put a page together: title, what it is about, a table of contents, sections."""
    entries = "".join(
        f'<li><a href="#{one.anchor}">{escape(one.title)}</a></li>' for one in sections
    )
    bodies = "\n".join(
        f'<section id="{one.anchor}"><h2>{escape(one.title)}</h2>\n'
        + "\n".join(one.blocks)
        + "</section>"
        for one in sections
    )
    leads = "".join(paragraph(text, "lead") for text in lead)
    return (
        "<!DOCTYPE html>\n"
        '<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n"
        f"<style>\n{_STYLE.read_text(encoding='utf-8')}</style></head>\n"
        f"<body><main><h1>{escape(title)}</h1>{leads}\n"
        f'<nav aria-label="Contents"><ol>{entries}</ol></nav>\n'
        f"{bodies}\n</main></body></html>\n"
    )


def _caption(caption: Caption) -> str:
    return f"<strong>{escape(caption.title)}</strong> {escape(caption.text)}"


def _made(made: Made) -> str:
    lines = escape("\n".join(made.commands))
    links = ", ".join(f'<a href="{escape(name)}">{escape(name)}</a>' for name in made.files)
    beside = f"<p>Beside this page: {links}</p>" if links else ""
    return (
        '<details class="made"><summary>How this was made</summary>'
        f"<pre><code>{lines}</code></pre>{beside}</details>"
    )


def _head_row(row: Sequence[Cell]) -> str:
    return "".join(
        f'<th scope="{"col" if cell.span == 1 else "colgroup"}"'
        f"{_class(cell.look)}{_span(cell.span)}>{escape(cell.text)}</th>"
        for cell in row
    )


def _row(row: Sequence[Cell], columns: int) -> str:
    if len(row) == 1:
        text = escape(row[0].text)
        return f'<th scope="colgroup" class="block"{_span(columns)}>{text}</th>'
    first, *others = row
    cells = "".join(
        f"<td{_class(cell.look)}{_span(cell.span)}>{escape(cell.text)}</td>" for cell in others
    )
    return f'<th scope="row"{_class(first.look)}>{escape(first.text)}</th>{cells}'


def _class(look: str) -> str:
    return f' class="{look}"' if look else ""


def _span(columns: int) -> str:
    return f' colspan="{columns}"' if columns > 1 else ""
