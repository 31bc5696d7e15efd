"""A finding: what it refuses, and that a file brings it back or says why not."""

import math
from dataclasses import replace

import pytest

from fembridge.errors import ResponseError
from fembridge.verification.bench import Cost
from fembridge.verification.finding import AT_LEAST, Check, Finding, Line, NumberTable
from fembridge.verification.finding_file import inputs_of_study, read_finding, write_finding

INPUTS = {"quick": True, "versions": {"CalculiX": "2.20"}}


def test_costs_add_up():
    assert Cost(1, 2, 3.0, 4.0) + Cost(10, 20, 30.0, 40.0) == Cost(11, 22, 33.0, 44.0)


@pytest.mark.parametrize(
    ("check", "passed"),
    [
        (Check("a", 1.0, 1.0), True),
        (Check("a", 1.1, 1.0), False),
        (Check("a", 1.0, 1.0, side=AT_LEAST), True),
        (Check("a", 0.9, 1.0, side=AT_LEAST), False),
        (Check("a", math.nan, 1.0), False),
        (Check("a", math.nan, 1.0, side=AT_LEAST), False),
    ],
)
def test_a_check_is_passed_when_its_bound_is_kept_and_never_without_a_number(check, passed):
    assert check.passed == passed


def test_a_finding_is_passed_when_all_checks_are(small_finding):
    assert not small_finding.passed
    kept = replace(small_finding, checks=small_finding.checks[:1])
    assert kept.passed


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda: Check("a", 1.0, math.inf), "check 'a': at most inf"),
        (lambda: Check("a", 1.0, 1.0, side="below"), "below"),
        (lambda: Line("l", (1.0,), (1.0, 2.0)), "1 x, 2 y"),
        (lambda: Line("l", (1.0,), (1.0,), "dotted"), "'dotted'"),
        (
            lambda: NumberTable("t", "", ("a", "b"), ((1, 2), (3,)), ("d", "d")),
            r"table t: 2 columns, rows and formats of \[1, 2\]",
        ),
    ],
)
def test_what_is_no_finding_is_refused(make, problem):
    with pytest.raises(ResponseError, match=problem):
        make()


def test_a_file_brings_a_finding_back(small_finding, tmp_path):
    path = tmp_path / "findings" / "small.toml"
    write_finding(path, small_finding, INPUTS)
    found = read_finding(path, INPUTS)
    assert isinstance(found, Finding)
    assert math.isnan(found.tables[0].rows[1][1])  # NaN is not itself
    same = replace(found, tables=())
    assert same == replace(small_finding, tables=())
    assert found.tables[0].rows[0] == small_finding.tables[0].rows[0]


def test_a_finding_of_other_inputs_is_not_taken(small_finding, tmp_path):
    path = tmp_path / "small.toml"
    write_finding(path, small_finding, INPUTS)
    assert read_finding(path, {**INPUTS, "quick": False}) is None
    assert read_finding(tmp_path / "absent.toml", INPUTS) is None


def test_a_finding_that_was_edited_is_refused(small_finding, tmp_path):
    path = tmp_path / "small.toml"
    write_finding(path, small_finding, INPUTS)
    text = path.read_text()
    assert text.count("found = 2.0") == 1
    path.write_text(text.replace("found = 2.0", "found = 4.0"))
    with pytest.raises(ResponseError, match="edited or cut"):
        read_finding(path, INPUTS)


def test_a_finding_that_was_cut_is_refused(small_finding, tmp_path):
    path = tmp_path / "small.toml"
    write_finding(path, small_finding, INPUTS)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(ResponseError):
        read_finding(path, INPUTS)


def test_a_finding_depends_on_the_source_of_its_study():
    one, other = (
        inputs_of_study(f"fembridge.verification.{name}", quick=True, versions={})
        for name in ("patch", "laws")
    )
    assert one["source_sha256"] != other["source_sha256"]
