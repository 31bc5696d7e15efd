"""Which studies are made, which are taken as they stand, and what is refused."""

import argparse
import json

import pytest

from fembridge.commands import verify as command
from fembridge.errors import MissingError, UsageError
from fembridge.machine import find_ccx
from fembridge.verification import patch as patch_study
from fembridge.verification import verify as module
from fembridge.verification.finding_file import finding_path
from fembridge.verification.page import command_of
from fembridge.verification.studies import STUDIES, studies_named
from fembridge.verification.verify import verify

needs_solver = pytest.mark.solver


@pytest.fixture
def made(monkeypatch, small_finding):
    """Put a study that gives the small finding for `patch`; count how often."""
    count = []

    def study(bench):
        count.append(bench)
        return small_finding

    monkeypatch.setattr(patch_study, "study", study)
    monkeypatch.setattr(module, "versions_here", lambda: {"CalculiX": "2.20"})
    return count


def test_studies_come_in_the_order_of_the_page_and_have_one_name_each():
    names = [study.name for study in STUDIES]
    assert len(set(names)) == len(names) == 9
    assert [s.name for s in studies_named(["laws", "patch"])] == ["patch", "laws"]
    assert studies_named(None) == STUDIES


def test_every_study_says_its_own_name():
    from importlib import import_module

    for study in STUDIES:
        assert study.name == import_module(study.module).NAME


def test_a_study_that_there_is_not_is_misuse():
    with pytest.raises(UsageError, match="no study 'patsch', expected one of patch"):
        studies_named(["patsch"])


def test_without_a_solver_the_line_that_installs_one_is_told(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "find_ccx", lambda: None)
    with pytest.raises(MissingError, match="no ccx on the PATH; install it: apt-get"):
        verify(tmp_path, ["patch"])


def test_a_finished_study_is_not_made_again(made, tmp_path, small_finding):
    told = []
    first = verify(tmp_path, ["patch"], tell=told.append)
    second = verify(tmp_path, ["patch"], tell=told.append)
    assert len(made) == 1
    assert told == ["patch: finished before"]
    assert [f.name for f in (*first, *second)] == ["small"] * 2


def test_a_quick_finding_is_not_taken_for_a_whole_one(made, tmp_path):
    verify(tmp_path, ["patch"], quick=True)
    verify(tmp_path, ["patch"])
    assert [bench.quick for bench in made] == [True, False]


def test_a_finding_that_was_edited_is_told_of_and_made_again(made, tmp_path):
    verify(tmp_path, ["patch"])
    path = finding_path(tmp_path, "patch")
    path.write_text(path.read_text().replace("Is two", "Is 2"))
    told = []
    verify(tmp_path, ["patch"], tell=told.append)
    assert len(made) == 2
    assert "made again" in told[0]
    assert "edited or cut" in told[0]


def arguments(folder, *words):
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    parser.add_argument("--json", action="store_true")
    return parser.parse_args([*words, "-o", str(folder)])


def test_a_check_that_fails_is_told_and_makes_the_exit_code_1(made, monkeypatch, tmp_path, capsys):
    summary = command.run(arguments(tmp_path, "--only", "patch"))
    assert summary["exit_code"] == 1
    out = capsys.readouterr().out
    assert "fails: small: ratio: 2 , expected at least 3" in out
    assert (tmp_path / "verification.md").is_file()


def test_no_jobs_are_misuse(tmp_path):
    with pytest.raises(UsageError, match="--jobs is 0, expected 1 or more"):
        command.run(arguments(tmp_path, "--jobs", "0"))


def test_the_command_of_a_study_is_one_that_the_verb_understands(tmp_path):
    for quick in (False, True):
        words = command_of("hertz", quick=quick).split()[2:]
        args = arguments(tmp_path, *words)
        assert args.quick == quick
        assert args.only == ["hertz"]


@needs_solver
def test_the_two_cheapest_studies_keep_their_bounds(tmp_path, monkeypatch):
    """For real, in two processes: patch test and second solver."""
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    assert find_ccx() is not None
    words = ("--quick", "--jobs", "2", "--only", "patch", "solver")
    summary = command.run(arguments(tmp_path, *words))
    assert summary["exit_code"] == 0
    patch, solver = summary["studies"]
    assert patch["passed"]
    assert patch["increments"] == 45
    assert solver["passed"]
    written = json.loads((tmp_path / "verification.json").read_text())
    assert written["studies"] == summary["studies"]
    if not solver["skipped"]:
        assert len(solver["checks"]) == 2
    assert not list(tmp_path.glob(".*"))


@needs_solver
def test_runs_that_are_whole_are_not_made_again_and_damaged_ones_are(tmp_path):
    """A verify that was killed: its finding is not there, its runs are."""
    verify(tmp_path, ["patch"])
    finding_path(tmp_path, "patch").unlink()
    runs = tmp_path / "runs" / "patch"
    before = {path: path.stat().st_mtime_ns for path in runs.glob("*/job.frd")}
    assert len(before) == 15
    damaged = runs / "CPE4_distorted_linear_small" / "job.frd"
    damaged.write_bytes(damaged.read_bytes()[:-100])
    [finding] = verify(tmp_path, ["patch"])
    assert finding.passed
    after = {path: path.stat().st_mtime_ns for path in before}
    assert [path for path in before if after[path] != before[path]] == [damaged]
