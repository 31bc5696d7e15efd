"""``fembridge validate``: words and exit codes; the report itself is tested beside."""

import json

import pytest

from fembridge.cli import main
from fembridge.report import validation_page


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Work in an empty folder without a solver; the page is left empty, which is quick.

    What is on it is tested with `write_report`.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr(validation_page, "page_text", lambda *arguments: "")
    return tmp_path


@pytest.mark.usefixtures("computed")
def test_a_table_on_the_screen_and_a_page_in_the_folder(here, capsys, observed_file, own_file):
    words = ["--observed", str(observed_file), "--parameters", str(own_file)]
    assert main(["validate", *words]) == 0

    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "own against observed rates: R² (RMSE in impulses/s)"
    assert lines[1].split() == ["SA", "RA", "PC"]
    assert lines[2].startswith("sine ")
    assert lines[4].split() == ["noise", *["no", "rates"] * 3]
    assert lines[-1].startswith("report/index.html, and ")
    assert (here / "report/index.html").is_file()
    assert (here / "report/validation.toml").is_file()


@pytest.mark.usefixtures("computed")
def test_json_is_all_that_stdout_holds(here, capsys):
    words = ["validate", "-o", "out", "--parameters", "published", "--json"]
    assert main(words) == 0

    summary = json.loads(capsys.readouterr().out)
    assert summary["page"] == "out/index.html"
    assert summary["models"] == ["published", "fingertip"]
    assert summary["reference"] == "TouchSim"
    assert {row["source"] for row in summary["agreement"]} == {"published", "fingertip"}
    assert len(summary["agreement"]) == 2 * 3 * 3
    assert {row["meets_paper"] for row in summary["agreement"]} == {None}
    assert set(summary["files"]) == {path.name for path in (here / "out").iterdir()}


@pytest.mark.parametrize(
    ("words", "code", "shown"),
    [
        (["--observed", "absent.csv"], 2, "absent.csv: cannot be read"),
        (["--parameters", "absent.toml"], 2, "absent.toml"),
        (["--finger", "mine.toml"], 2, "mine.toml"),
        (["-o", ""], 2, "expected the name of a folder"),
    ],
)
def test_what_is_not_there_is_one_line_before_anything_is_computed(
    here, capsys, monkeypatch, words, code, shown
):
    monkeypatch.setattr("fembridge.report.validate.validate", None)
    assert main(["validate", "--parameters", "published", *words]) == code
    assert shown in capsys.readouterr().err
    assert list(here.iterdir()) == []


def test_an_output_that_cannot_be_written_is_said_before_anything_is_computed(
    here, capsys, monkeypatch
):
    monkeypatch.setattr("fembridge.report.validate.validate", None)
    (here / "out").write_text("mine")
    assert main(["validate", "--parameters", "published", "-o", "out"]) == 1
    assert capsys.readouterr().err.startswith("fembridge: out: ")
    assert (here / "out").read_text() == "mine"
