"""The page's parts: words are escaped, figures keep their ids to themselves."""

import re

from hypothesis import given
from hypothesis import strategies as st

from fembridge.plots.picture import save_figure
from fembridge.validation.inline_svg import to_inline
from fembridge.validation.page import (
    Caption,
    Cell,
    Made,
    Section,
    TableText,
    page,
    paragraph,
    table_block,
)

WORDS = st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]))


def drawn(path):
    from matplotlib.figure import Figure

    figure = Figure(figsize=(2, 2))
    panel = figure.subplots()
    panel.plot([0, 1], [0, 1], color="#1A1A1A", marker="o", markerfacecolor="#FFFFFF")
    panel.set_title("a title", color="#009E73")
    save_figure(figure, path)
    return path.read_text(encoding="utf-8")


@given(words=WORDS)
def test_no_words_become_markup(words):
    for block in (paragraph(words), page(words, [words], [])):
        body = block.partition("<body>")[2] or block
        tags = re.findall(r"<[^>]*>", body)
        known = {"p", "main", "h1", "nav", "ol", "body", "html"}
        assert {re.match(r"</?(\w+)", tag)[1] for tag in tags} <= known


def test_a_row_of_one_cell_heads_the_rows_below_across_the_table():
    table = TableText(
        ((Cell("a"), Cell("b", span=2)),),
        ((Cell("first"),), (Cell("x"), Cell("1"), Cell("2 < 3", "met"))),
    )
    made = Made(("fembridge doctor",), ("a.csv",))
    block = table_block(table, "name", Caption("Title.", "Text."), made)
    assert '<th scope="colgroup" class="block" colspan="3">first</th>' in block
    assert '<th scope="row">x</th><td>1</td><td class="met">2 &lt; 3</td>' in block
    assert "<strong>Title.</strong> Text." in block
    assert "<pre><code>fembridge doctor</code></pre>" in block
    assert '<a href="a.csv">a.csv</a>' in block


def test_the_table_of_contents_leads_to_every_section():
    text = page("t", [], [Section("one", "One", ()), Section("two", "Two", ("<p>",))])
    for anchor in ("one", "two"):
        assert f'<a href="#{anchor}">' in text
        assert f'<section id="{anchor}">' in text


def test_every_id_of_a_figure_is_its_own_and_every_reference_finds_one(tmp_path):
    text = drawn(tmp_path / "a.svg")
    first, second = (to_inline(text, name, "words") for name in ("first", "second"))
    ids = [re.findall(r'\bid="([^"]+)"', one) for one in (first, second)]
    assert ids[0]
    assert not set(ids[0]) & set(ids[1])
    used = re.findall(r'(?:xlink:href="#|url\(#)([^")]+)', first)
    assert used
    assert set(used) <= set(ids[0])


def test_the_colours_of_a_figure_are_the_page_s_and_it_has_no_size_of_its_own(tmp_path):
    inner = to_inline(drawn(tmp_path / "a.svg"), "one", 'a "title" & more')
    head = inner.partition(">")[0]
    assert head.startswith('<svg role="img" aria-label="a &quot;title&quot; &amp; more"')
    assert "viewBox" in head
    assert "width" not in head
    assert "height" not in head
    for name in ("ink", "paper", "sa"):
        assert f"var(--{name})" in inner
    assert not re.search("#1a1a1a|#ffffff|#009e73", inner, re.IGNORECASE)
    assert "<?xml" not in inner
    assert "metadata" not in inner
