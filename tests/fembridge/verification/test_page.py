"""The page and its files, of a finding that was made up."""

import csv
import json
from dataclasses import replace

import pytest

from fembridge.verification.chart_picture import chart_figure
from fembridge.verification.page import page_text
from fembridge.verification.report import summary_of, write_report

VERSIONS = {"fembridge": "1.2", "CalculiX": "2.20"}


@pytest.fixture
def page(small_finding):
    return page_text([small_finding], VERSIONS, quick=False)


def test_the_page_has_question_words_numbers_and_the_command(page):
    for line in (
        "## 1. A small study, made up",
        "Is two more than one?",
        "- It is.",
        "- By one.",
        "| which one | value (kPa) | count |",
        "| one | \N{MINUS SIGN}1.2 | 3 |",
        "| two | – | 4 |",
        "fembridge verify --only small",
        "![Both](images/verification_numbers.png)",
    ):
        assert line in page.split("\n"), line
    assert "fembridge 1.2, CalculiX 2.20" in page


def test_the_first_table_tells_which_checks_keep_their_bound(page):
    link = "[1. A small study, made up](#1-a-small-study-made-up)"
    assert f"| {link} | difference | 1 mm | ≤ 1.5 mm | ok |" in page
    assert f"| {link} | ratio | 2 | ≥ 3 | **fails** |" in page
    assert "**1 of 2 checks keep their bound.**" in page


def test_a_quick_page_says_so_and_what_was_left_out(small_finding):
    page = page_text([small_finding], VERSIONS, quick=True)
    assert "This is a quick run" in page
    assert "Quick run: half of it." in page
    assert "fembridge verify --quick --only small" in page


def test_a_study_that_was_skipped_says_why_and_has_no_numbers(small_finding):
    skipped = replace(small_finding, checks=(), skipped="no such program")
    page = page_text([skipped], VERSIONS, quick=False)
    assert "Skipped: no such program." in page
    assert "| no such program | | | skipped |" in page
    assert "which one" not in page


def test_every_file_that_the_page_names_is_there(small_finding, tmp_path):
    write_report(tmp_path, [small_finding], VERSIONS, quick=False)
    page = (tmp_path / "verification.md").read_text(encoding="utf-8")
    assert "images/verification_numbers.png" in page
    picture = (tmp_path / "images" / "verification_numbers.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    with (tmp_path / "tables" / "verification_numbers.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows == [["which_one", "value_kpa", "count"], ["one", "-1.25", "3"], ["two", "", "4"]]
    summary = json.loads((tmp_path / "verification.json").read_text())
    assert summary == summary_of([small_finding], VERSIONS, quick=False)
    assert not summary["passed"]
    assert [check["passed"] for check in summary["studies"][0]["checks"]] == [True, False]


def test_the_same_findings_give_the_same_files(small_finding, tmp_path):
    names = ["verification.md", "verification.json", "images/verification_numbers.png"]
    for place in ("a", "b"):
        write_report(tmp_path / place, [small_finding], VERSIONS, quick=False)
    for name in names:
        one, other = ((tmp_path / place / name).read_bytes() for place in "ab")
        assert one == other, name


def test_a_chart_has_a_panel_each_and_names_a_line_once(small_finding):
    [chart] = small_finding.charts
    figure = chart_figure(chart)
    first, second = figure.axes
    assert first.get_xscale() == "log"
    assert second.get_title() == "RA"
    assert [text.get_text() for text in first.get_legend().get_texts()] == ["SA", "limit"]
