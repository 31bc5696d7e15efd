"""The documentation site: what its check finds, and that the reference is complete."""

import importlib.util
import inspect
import re
from pathlib import Path

import pytest

import decks
import fembridge
import neural

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def look():
    spec = importlib.util.spec_from_file_location("look", ROOT / "tests/look_inside_site.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "text",
    [
        '<script src="https://example.org/a.js"></script>',
        '<script src="//example.org/a.js"></script>',
        '<link rel="stylesheet" href="https://example.org/a.css">',
        '<link rel="preconnect" href="https://example.org">',
        '<img srcset="a.png 1x, https://example.org/b.png 2x" src="a.png">',
        '<iframe src="http://example.org"></iframe>',
        "<style>@import 'https://example.org/a.css';</style>",
        "<style>body { background: url(https://example.org/a.png) }</style>",
        '<p style="background: url(//example.org/a.png)">x</p>',
        "<script>fetch('https://example.org/a.json')</script>",
        "<script>image.src = 'https://example.org/a.png'</script>",
        "<script type='module'>import x from 'https://example.org/x.mjs'</script>",
        "<script>const base = `https://example.org/`; load(base + 'a.js')</script>",
        '<form action="https://example.org/search"></form>',
        '<base href="https://example.org/">',
        '<link rel="preload" imagesrcset="https://example.org/a.png 1x">',
        '<a href="a.png" ping="https://example.org/p">a</a>',
        """<img src="a.png" onload="this.src='https://example.org/b.png'">""",
        """<iframe srcdoc="<img src='https://example.org/b.png'>"></iframe>""",
        '<meta http-equiv="refresh" content="0; url=https://example.org/">',
        '<body background="//example.org/a.png"></body>',
    ],
)
def test_an_outside_address_that_is_loaded_is_found(look, tmp_path, text):
    (tmp_path / "a.png").touch()
    (tmp_path / "page.html").write_text(text)

    (fault,) = look.faults_of(tmp_path)

    assert "example.org" in fault


@pytest.mark.parametrize(
    "text",
    [
        '<a href="https://example.org">a paper</a>',
        '<link rel="canonical" href="https://example.org/page.html">',
        '<a href="page.html#part">here</a> <a href="#part">here</a>',
        '<svg xmlns="http://www.w3.org/2000/svg"></svg>',
        "<script>document.createElementNS('http://www.w3.org/2000/svg', 'g')</script>",
        "<script>/* see https://example.org */ let a = 1; // 'https://example.org'\n</script>",
        '<meta name="citation" content="https://example.org">',
        '<img src="data:image/png;base64,AAAA">',
    ],
)
def test_links_and_names_are_no_fault(look, tmp_path, text):
    (tmp_path / "page.html").write_text(text)

    assert look.faults_of(tmp_path) == []


def test_a_link_to_a_missing_file_is_found(look, tmp_path):
    (tmp_path / "page.html").write_text('<a href="other.html#part">there</a>')

    (fault,) = look.faults_of(tmp_path)

    assert "other.html" in fault


def test_scripts_and_styles_in_files_are_searched(look, tmp_path):
    (tmp_path / "a.css").write_text("@import url(https://example.org/a.css);")
    (tmp_path / "a.js").write_text('importScripts("https://example.org/a.js")')

    assert len(look.faults_of(tmp_path)) == 2


def test_the_reference_has_every_public_name():
    text = (ROOT / "docs/reference/api.rst").read_text(encoding="utf-8")
    sections = re.split(r"^\.\. currentmodule:: (\w+)$", text, flags=re.MULTILINE)[1:]
    names = {
        module: set(re.findall(r"^   (\w+)$", body, flags=re.MULTILINE))
        for module, body in zip(sections[::2], sections[1::2], strict=True)
    }

    assert names["fembridge"] == set(fembridge._HOMES) | set(fembridge.__all__)
    assert names["neural"] == set(neural.__all__)
    assert names["decks"] == set(decks.__all__) - set(fembridge._HOMES)


def test_each_public_name_but_tables_and_plain_types_has_an_example():
    for name in sorted(set(fembridge._HOMES) | set(fembridge.__all__)):
        assert ">>>" in (inspect.getdoc(getattr(fembridge, name)) or ""), name
    for name in set(neural.__all__) - {"MODELS", "PUBLISHED", "Parameters", "StreamSpike"}:
        assert ">>>" in (inspect.getdoc(getattr(neural, name)) or ""), name


def test_decisions_have_one_topic_and_one_number_each():
    folder = ROOT / "docs/decisions"
    listed = re.findall(
        r"^- \[\]\(\./(\d{4}-[\w-]+\.md)\)$", (folder / "index.md").read_text(), re.MULTILINE
    )
    notes = [path.name for path in folder.glob("[0-9]*.md")]

    assert len(listed) > 60
    assert len(set(listed)) == len(listed)
    assert set(listed) <= set(notes)
    assert len({name[:4] for name in notes}) == len(notes)


def test_each_page_of_a_section_is_in_its_index():
    for section in ("how_to", "science", "tutorials"):
        folder = ROOT / "docs" / section
        index = (folder / "index.md").read_text(encoding="utf-8")
        for page in folder.glob("*.md"):
            assert page.stem == "index" or f"({page.name})" in index, f"{section}/{page.name}"
