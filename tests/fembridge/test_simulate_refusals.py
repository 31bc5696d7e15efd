"""``fembridge simulate``: what it refuses, in one line, and what it leaves alone."""

import pytest

from fembridge.cli import main
from fembridge.machine import CCX_VARIABLE, SOLVER_INSTALL_LINE


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Work in an empty folder of a machine that has no solver."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(CCX_VARIABLE, raising=False)
    monkeypatch.setenv("PATH", "")
    return tmp_path


@pytest.fixture(scope="module")
def earlier(tmp_path_factory):
    """What a run left: names and bytes."""
    folder = tmp_path_factory.mktemp("earlier")
    words = ["--stimulus", "sine_50_250", "--stored", "-o", str(folder)]
    assert main(["simulate", *words]) == 0
    return contents(folder)


@pytest.fixture
def result(here, earlier):
    """Give the folder of an earlier run, as that left it."""
    folder = here / "out"
    folder.mkdir()
    for name, content in earlier.items():
        (folder / name).write_bytes(content)
    return folder


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def refused(capsys, *words):
    """Run, expect one line on stderr and nothing else; give code and line."""
    code = main(["simulate", *words])
    streams = capsys.readouterr()
    assert streams.out == ""
    lines = streams.err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("fembridge: ")
    return code, lines[0].removeprefix("fembridge: ")


def test_an_unknown_stimulus_is_misuse_and_the_near_ones_are_named(here, capsys):
    code, line = refused(capsys, "--stimulus", "nois_25_250")
    assert code == 2
    assert "no stimulus 'nois_25_250'; did you mean noise_25_250" in line


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--preindent-um", "nan"], "preindent_um must be from 0 to 10000, got nan"),
        (["--preindent-um", "-3"], "preindent_um must be from 0 to 10000, got -3"),
        (["--seed", "-1"], "seed is -1, expected 0 or more"),
        (["--jobs", "0"], "jobs is 0, expected 1 or more"),
        (["--jobs", "-1"], "jobs is -1, expected 1 or more"),
        (["--threads", "0"], "threads is 0, expected 1 or more"),
        (["--time-limit", "nan"], "time_limit_s is nan, expected more than 0"),
        (["--probe-x-mm", "nan"], "probe: x_mm must be finite, got nan"),
        (["--probe-diameter-mm", "0"], "probe: diameter_mm must be 0.01 to 20, got 0"),
        (["--stored", "--method", "transient"], "a stored response answers no"),
    ],
)
def test_a_number_without_meaning_is_misuse_and_nothing_is_written(here, capsys, words, told):
    code, line = refused(capsys, "--stimulus", "sine_20_250", "-o", "out", *words)
    assert (code, told in line) == (2, True), line
    assert not (here / "out").exists()


@pytest.mark.parametrize(
    "words",
    [
        ["-o", ""],
        ["--method", "magic"],
        ["--preindent-um", "deep"],
        ["--element", "C3D8"],
        ["--jobs", "two"],
    ],
)
def test_a_word_without_meaning_is_misuse(here, capsys, words):
    assert main(["simulate", "--stimulus", "sine_20_250", *words]) == 2
    assert "fembridge simulate: error: argument" in capsys.readouterr().err
    assert contents(here) == {}


def test_a_stimulus_is_asked_for(capsys):
    assert main(["simulate"]) == 2
    assert "--stimulus" in capsys.readouterr().err


SOFT = "[materials.dermis]\nyoung_mpa = 0.08\n"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--preindent-um", "500"], "sine_20_250 goes 750 um deep, the stored response"),
        (["--method", "transient"], "--method transient: that takes a solver"),
        (["--finger", "soft.toml"], "no response is stored for finger 'soft'"),
        (["--finger", "named.toml"], "young_mpa 0.05, asked for is 0.08"),
        (["--element", "CPE8R"], "no response is stored for this element"),
        (["--probe-diameter-mm", "2"], "diameter_mm 1.0, asked for is 2.0"),
    ],
)
def test_what_takes_a_solver_ends_in_the_line_that_installs_one(here, capsys, words, told):
    (here / "soft.toml").write_text(SOFT, encoding="utf-8")
    (here / "named.toml").write_text('name = "quick"\n' + SOFT, encoding="utf-8")

    code, line = refused(capsys, "--stimulus", "sine_20_250", "-o", "out", *words)

    assert code == 1
    assert told in line
    assert line.endswith(SOLVER_INSTALL_LINE)
    assert not (here / "out").exists()


@pytest.mark.parametrize(
    ("option", "word", "told"),
    [
        ("--finger", "absent.toml", "absent.toml"),
        ("--parameters", "absent.toml", "absent.toml: "),
        ("--parameters", "", "''"),
        ("--parameters", "wrong.toml", "wrong.toml: SA: unknown key 'tau'"),
        ("--parameters", "never.toml", "never.toml: "),
    ],
)
def test_a_file_that_is_wrong_is_named(here, capsys, option, word, told):
    (here / "wrong.toml").write_text("[SA]\ntau = 3.0\n", encoding="utf-8")
    (here / "never.toml").write_text("[SA\n", encoding="utf-8")
    code, line = refused(capsys, "--stimulus", "sine_20_250", "-o", "out", option, word)
    assert (code, told in line) == (1, True), line
    assert not (here / "out").exists()


def test_a_solver_that_is_asked_for_and_not_there_is_told(here, capsys, monkeypatch):
    monkeypatch.setenv(CCX_VARIABLE, "/opt/ccx")
    code, line = refused(capsys, "--stimulus", "sine_20_250")
    assert code == 1
    assert line == "FEMBRIDGE_CCX is '/opt/ccx', which is no program here"


@pytest.mark.parametrize("output", ["file", "file/deeper"])
def test_an_output_that_is_a_file_is_told_and_stays(here, capsys, output):
    (here / "file").write_text("mine")

    assert main(["simulate", "--stimulus", "sine_20_250", "-o", output]) == 1

    last = capsys.readouterr().err.splitlines()[-1]
    assert last == "fembridge: file: a file stands where a folder is wanted"
    assert (here / "file").read_text() == "mine"


@pytest.mark.parametrize(
    "words",
    [
        ["--stimulus", "sine_20_250", "--preindent-um", "500"],
        ["--stimulus", "sine_20_250", "--method", "transient"],
        ["--stimulus", "sine_20_250", "--parameters", "absent.toml"],
        ["--stimulus", "nois"],
    ],
)
def test_an_earlier_result_survives_a_run_that_fails(result, earlier, words):
    assert main(["simulate", "-o", "out", *words]) != 0

    assert contents(result) == earlier
    assert "raster.png" in earlier


def test_an_earlier_result_survives_a_picture_that_cannot_be_drawn(
    result, earlier, capsys, monkeypatch
):
    from fembridge.errors import OutputError
    from fembridge.plots import style

    def disk_full(figure, path, **options):
        raise OutputError("cannot write: No space left on device", path)

    monkeypatch.setattr(style, "save_figure", disk_full)
    assert main(["simulate", "--stimulus", "sine_20_250", "-o", "out"]) == 1

    last = capsys.readouterr().err.splitlines()[-1]
    assert last == "fembridge: out/raster.png: cannot write: No space left on device"
    assert contents(result) == earlier
