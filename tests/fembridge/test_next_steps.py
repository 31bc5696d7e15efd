"""Help that helps: the first page, the next command, completion, --quiet, and plot of a folder."""

import json
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

import fembridge as fb
from fembridge.cli import FIRST_HOUR, VERBS, complete_parser, main
from fembridge.commands.next_steps import next_commands
from fembridge.commands.plot import _trains

SIMULATE = ["simulate", "--stimulus", "sine_20_250", "--stored", "-o", "out"]
TOUCH = ["touch", "--press-um", "100", "--population", "one_each", "--no-plot", "-o", "touched"]


@pytest.fixture
def without_solver(monkeypatch, tmp_path):
    """Stored responses: a solver would solve the finger in each test."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("FEMBRIDGE_CCX", raising=False)


def printed(words, capsys, code=0):
    """Output of a command, and the commands that it prints last."""
    assert main(words) == code, capsys.readouterr().err
    text = capsys.readouterr().out
    _, _, following = text.rpartition("next:\n")
    return text, [line.strip() for line in following.splitlines()] if "next:\n" in text else []


def test_without_a_verb_the_first_hour_of_each_kind_of_user_comes_first(capsys):
    assert main([]) == 0
    text = capsys.readouterr().out
    commands = [command for rows in FIRST_HOUR.values() for _, command in rows]
    assert len(commands) == 5
    ends = [text.index(command) for command in commands]
    assert ends == sorted(ends)
    assert ends[-1] < text.index("All verbs")
    assert all(f"  {verb} " in text for verb in VERBS)
    assert max(map(len, text.splitlines())) <= 100


@pytest.mark.usefixtures("here", "without_solver")
@pytest.mark.parametrize(
    "rows",
    [
        pytest.param(rows, id=who, marks=[pytest.mark.slow] * (who == "You study touch"))
        for who, rows in FIRST_HOUR.items()
    ],
)
def test_the_commands_of_the_first_hour_work(rows, capsys):
    for _, command in rows:
        words = shlex.split(command)[1:]
        assert main([*words, *(["--stored"] if words[0] == "simulate" else [])]) == 0
    capsys.readouterr()


@pytest.mark.usefixtures("here", "without_solver")
@pytest.mark.parametrize(
    "first",
    [
        pytest.param(["stimuli", "sine_20_250"], marks=pytest.mark.slow),
        pytest.param(SIMULATE, marks=pytest.mark.slow),
        TOUCH,
        ["sample", "frd"],
        ["threshold", "--afferent", "PC", "--frequencies-hz", "100", "-o", "threshold"],
    ],
    ids=lambda words: words[0],
)
def test_the_next_command_works_as_printed_and_so_does_the_one_after_it(first, capsys):
    _, following = printed(first, capsys)
    assert following
    for _ in range(2):
        words = shlex.split(following[0])
        assert words[0] == "fembridge"
        if words[1] in ("validate", "touch"):  # minutes, or data of its own
            break
        _, following = printed(words[1:], capsys)
        if not following:
            break


@pytest.mark.usefixtures("here")
def test_traces_of_another_model_are_encoded_by_the_printed_command(capsys):
    main(["sample", "frd"])
    Path("other").mkdir()
    [result] = Path("sample").rglob("*.frd")
    shutil.copy(result, "other/results.frd")
    capsys.readouterr()
    main(["ingest", "other/results.frd", "--list", "--json"])
    capsys.readouterr()
    text, following = printed(["ingest", "other/results.frd"], capsys)
    extraction = next(line for line in text.splitlines() if "fembridge ingest" in line)
    words = shlex.split(extraction.partition("fembridge ")[2])
    text, following = printed(words, capsys)
    assert "results_traces.csv" in text
    [command] = following
    text, _ = printed(shlex.split(command)[1:], capsys)
    assert "rate_ips" in text


def test_a_failed_command_has_no_next_one():
    assert next_commands("doctor", None, {"exit_code": 1}) == []
    assert next_commands("report", None, {"page": "x"}) == []


@pytest.mark.usefixtures("here")
def test_quiet_prints_nothing_but_warnings_and_errors(capsys):
    assert main([*SIMULATE, "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert Path("out/rates.csv").exists()
    assert main([*TOUCH, "--quiet", "--parameters", "fitted"]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    assert all(line.startswith("warning: ") for line in err.splitlines())
    assert main(["simulate", "--stimulus", "sin", "--quiet"]) == 2
    assert capsys.readouterr().err.startswith("fembridge: ")


def test_quiet_leaves_a_text_that_is_the_result(capsys):
    assert main(["export-c", "--quiet"]) == 0
    assert "afferents_step" in capsys.readouterr().out


@pytest.mark.usefixtures("here")
def test_json_has_the_next_commands(capsys):
    assert main([*SIMULATE, "--no-plot", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["next"] == ["fembridge plot out"]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completions_name_every_verb_and_are_valid(shell, capsys, tmp_path):
    assert main(["completion", shell]) == 0
    text = capsys.readouterr().out
    assert all(verb in text for verb in VERBS)
    assert "noise_25_250" in text
    if program := shutil.which(shell):
        path = tmp_path / "completion"
        path.write_text(text)
        subprocess.run([program, "-n", path], check=True)


@pytest.mark.skipif(not shutil.which("bash"), reason="no bash")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("fembridge simu", {"simulate"}),
        ("fembridge simulate --stimulus noise_25", {"noise_25_250", "noise_25_500"}),
        ("fembridge plot ra", {"raster", "rates"}),
        ("fembridge export-c --precision ", {"double", "float"}),
    ],
)
def test_bash_completes(words, expected, capsys, tmp_path):
    main(["completion", "bash"])
    (tmp_path / "completion").write_text(capsys.readouterr().out)
    script = (
        'source completion; IFS=" " read -ra COMP_WORDS <<< "$1"; [[ $1 == *" " ]] && '
        'COMP_WORDS+=(""); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); COMPREPLY=(); '
        '_shtab_fembridge; echo "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        ["bash", "-c", script, "bash", words], cwd=tmp_path, capture_output=True, text=True
    )
    assert set(done.stdout.split()) == expected


def test_the_parser_of_all_verbs_has_them():
    text = complete_parser().format_help()
    assert all(verb in text for verb in VERBS)


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_plot_of_a_folder_draws_all_that_its_files_allow(capsys):
    main([*SIMULATE, "--no-plot"])
    main(TOUCH)
    capsys.readouterr()
    for words, names in (
        (["plot", "out"], {"raster", "psth", "isi", "rates", "trace", "mesh"}),
        (["plot", "touched", "-o", "pictures", "--suffix", ".pdf"],
         {"pad", "raster", "psth", "isi", "force"}),
    ):  # fmt: skip
        assert main([*words, "--json"]) == 0
        files = [Path(file) for file in json.loads(capsys.readouterr().out)["files"]]
        assert {file.stem for file in files} == names
        assert all(file.stat().st_size > 1000 for file in files)


@pytest.mark.usefixtures("here")
def test_plot_of_a_folder_without_results_names_it(capsys):
    Path("empty").mkdir()
    assert main(["plot", "empty"]) == 1
    assert "empty" in capsys.readouterr().err
    assert main(["plot", "rastr", "out"]) == 2
    assert "raster" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("plot nowhere", "nowhere: no such folder; a picture is named by mesh, response, trace"),
        ("plot xy.csv", "xy.csv: not a folder; `fembridge plot PICTURE xy.csv` draws a file"),
        ("report nowhere", "nowhere: folder does not exist, expected: a run folder"),
        ("report empty", "empty: folder is none of these: a run folder"),
        ("explore nowhere", "nowhere: no such folder, expected: a "),
        ("explore xy.csv", "xy.csv: is none of these: a "),
        ("sweep xy.csv", "x is no column of a table of touches; expected an argument of"),
    ],
)
@pytest.mark.usefixtures("here")
def test_a_wrong_path_or_table_gets_one_line_with_the_way_out(words, line, capsys):
    Path("empty").mkdir()
    Path("xy.csv").write_text("x,y\n1,2\n", encoding="utf-8")
    assert main(shlex.split(words)) == (1 if words.startswith("sweep") else 2)  # 1: its contents
    [printed] = capsys.readouterr().err.splitlines()
    assert line in printed


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_rates_of_a_touch_are_means_over_silent_units_too(capsys):
    main(["touch", "--press-um", "150", "--no-plot", "-o", "touched"])
    capsys.readouterr()
    assert main(["plot", "psth", "touched", "--json"]) == 0
    spikes = json.loads(capsys.readouterr().out)["spikes"]
    touch = fb.Touch.read("touched")
    assert spikes == len(touch.spikes)
    silent = (touch.rates["rate_ips"] == 0).sum()
    assert silent > 100
    assert sum(train.times_ms.size == 0 for train in _trains(Path("touched/spikes.csv"))) >= silent
