"""The command line: exit codes, and what goes to which stream."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import fembridge
from fembridge import cli
from fembridge.errors import ResultError, StimulusError

ROOT = Path(fembridge.__file__).parents[1]


def in_a_process(*words, **options):
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, "-m", "fembridge.cli", *words],
        env=environment,
        text=True,
        check=False,
        timeout=60,
        **options,
    )


@pytest.fixture
def verb(monkeypatch):
    """Make a verb ``try`` that does what it is told."""

    def make(run):
        module = SimpleNamespace(
            __doc__="Try things.",
            EXAMPLE="fembridge try",
            add_arguments=lambda parser: None,
            run=run,
        )
        monkeypatch.setitem(cli.VERBS, "try", "try things")
        monkeypatch.setitem(sys.modules, "fembridge.commands.try", module)

    return make


def raising(error):
    def run(args):
        raise error

    return run


def test_version_is_told_on_stdout(capsys):
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"fembridge {fembridge.__version__}\n"


def test_without_a_verb_the_help_lists_every_verb(capsys):
    assert cli.main([]) == 0
    out = capsys.readouterr().out
    width = max(len(verb_name) for verb_name in cli.VERBS)
    for verb_name, help_line in cli.VERBS.items():
        assert f"\n  {verb_name:<{width}}  {help_line}\n" in out


@pytest.mark.parametrize(
    ("word", "told"),
    [
        ("stimul", "no verb 'stimul'; did you mean stimuli"),
        ("build_deck", "did you mean build-deck"),
        ("docter", "did you mean doctor"),
        ("xyzzy", "choose stimuli, build-deck, run"),
    ],
)
def test_an_unknown_verb_is_misuse_and_tells_the_near_one(capsys, word, told):
    assert cli.main([word, "--json"]) == 2
    streams = capsys.readouterr()
    assert told in streams.err
    assert streams.out == ""


@pytest.mark.parametrize("words", [["stimuli", "--nope"], ["--nope"], ["stimuli", "--seed", "x"]])
def test_misuse_of_options_is_2_with_a_line_of_its_own(capsys, words):
    assert cli.main(words) == 2
    assert "error: " in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize("verb_name", ["stimuli", "doctor"])
def test_help_of_a_verb_has_its_description_and_an_example(capsys, verb_name):
    assert cli.main([verb_name, "--help"]) == 0
    out = capsys.readouterr().out
    assert f"example: fembridge {verb_name}" in out
    assert "--json" in out


@pytest.mark.parametrize("json_wanted", [[], ["--json"]])
@pytest.mark.parametrize(
    ("error", "code"),
    [(ResultError("cut short\nhere", Path("a.frd"), 7), 1), (StimulusError("no stimulus 'x'"), 2)],
)
def test_our_errors_are_one_line_on_stderr(verb, capsys, error, code, json_wanted):
    verb(raising(error))
    assert cli.main(["try", *json_wanted]) == code
    streams = capsys.readouterr()
    assert streams.err == f"fembridge: {' '.join(str(error).splitlines())}\n"
    assert streams.out == ""


def test_an_error_that_is_not_ours_keeps_its_traceback(verb):
    verb(raising(ZeroDivisionError("a bug")))
    with pytest.raises(ZeroDivisionError):
        cli.main(["try"])


def test_ctrl_c_is_one_line_and_130(verb, capsys):
    verb(raising(KeyboardInterrupt()))
    assert cli.main(["try"]) == 130
    assert capsys.readouterr().err == "fembridge: interrupted\n"


def test_a_pipe_that_is_not_our_output_may_not_break_silently(verb, capfd):
    verb(raising(BrokenPipeError()))
    with pytest.raises(BrokenPipeError):
        cli.main(["try"])


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("words", [["stimuli"], ["stimuli", "--json"], ["--help"]])
def test_output_that_nobody_reads_ends_quietly(words, unbuffered, monkeypatch):
    monkeypatch.setenv("PYTHONUNBUFFERED", unbuffered)
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = in_a_process(*words, stdout=writer, stderr=subprocess.PIPE)
    finally:
        os.close(writer)
    assert (done.returncode, done.stderr) == (0, "")


def test_json_is_strict_whatever_the_summary_holds(verb, capsys):
    summary = {
        "rate_ips": float("nan"),
        "peak": np.float64("inf"),
        "counts": np.array([1, 2]),
        "files": (Path("a.csv"),),
        3: True,
    }
    verb(lambda args: summary)
    assert cli.main(["try", "--json"]) == 0

    def no_constant(name):
        raise AssertionError(name)

    out = json.loads(capsys.readouterr().out, parse_constant=no_constant)
    assert out == {"rate_ips": None, "peak": None, "counts": [1, 2], "files": ["a.csv"], "3": True}


def test_a_summary_can_say_that_not_all_is_well(verb, capsys):
    verb(lambda args: {"exit_code": 1})
    assert cli.main(["try"]) == 1
    assert cli.main(["try", "--json"]) == 1
    assert json.loads(capsys.readouterr().out) == {"exit_code": 1}


def test_options_are_not_guessed_from_their_beginnings(capsys):
    assert cli.main(["stimuli", "--exp", "csv", "sine_20_250"]) == 2
    assert cli.main(["--vers"]) == 2


def _in_a_shell(words, **environment):
    return subprocess.run(
        ["sh", "-c", f'"{sys.executable}" -m fembridge.cli {words}'],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_disk_behind_standard_output_is_one_line():
    ran = _in_a_shell("stimuli > /dev/full")
    assert ran.returncode == 1
    assert ran.stderr == "fembridge: cannot print: No space left on device\n"


def test_a_name_that_the_terminal_cannot_show_is_printed_nevertheless(tmp_path):
    path = tmp_path / "ä.csv"
    words = f'stimuli --export csv sine_20_250 -o "{path}"'
    ran = _in_a_shell(words, PYTHONIOENCODING="ascii", LC_ALL="C.UTF-8")
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout == f"{tmp_path}/\\xe4.csv\n"
    assert path.is_file()
