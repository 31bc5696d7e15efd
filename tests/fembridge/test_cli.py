"""The command line: exit codes, what goes to which stream, and errors on their way there."""

import json
import os
import pickle
import shlex
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import fembridge
from fembridge import cli, errors
from fembridge.errors import (
    FembridgeError,
    FembridgeWarning,
    FingerError,
    ResultError,
    StimulusError,
    UsageError,
)
from fembridge.host.terminal import wrapped

ROOT = Path(fembridge.__file__).parents[1]


PYTHON = f'"{sys.executable}" -P -m fembridge.cli'


def in_a_shell(words, before="", stdout=subprocess.PIPE, **environment):
    """Run the command in a process of its own, after what the shell does `before`."""
    return subprocess.run(
        ["sh", "-c", f"{before} exec {PYTHON} {words}"],
        env=os.environ | {"PYTHONPATH": str(ROOT)} | environment,
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        check=False,
        timeout=60,
    )


@pytest.fixture
def verb(monkeypatch):
    """Make a verb ``try`` that does what `run` does."""

    def make(run):
        words = {"__doc__": "Try things.", "EXAMPLE": "fembridge try"}
        module = SimpleNamespace(**words, add_arguments=lambda parser: None, run=run)
        monkeypatch.setitem(cli.VERBS, "try", "try things")
        monkeypatch.setitem(sys.modules, "fembridge.commands.try", module)

    return make


def raising(error):
    def run(args):
        raise error

    return run


def test_version_is_printed_on_stdout(capsys):
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"fembridge {fembridge.__version__}\n"


def test_without_a_verb_the_help_lists_every_verb(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    assert cli.main([]) == 0
    out = capsys.readouterr().out
    width = max(len(verb_name) for verb_name in cli.VERBS)
    for verb_name, help_line in cli.VERBS.items():
        assert f"\n  {verb_name:<{width}}  {help_line}\n" in out


@pytest.mark.parametrize(
    ("verb_name", "similar"),
    [("stimul", "stimuli"), ("build_deck", "build-deck"), ("xyzzy", ", ".join(cli.VERBS))],
)
def test_an_unknown_verb_is_misuse_and_names_the_near_one(capsys, verb_name, similar):
    assert cli.main([verb_name, "--json"]) == 2
    streams = capsys.readouterr()
    error = json.loads(streams.out)["error"]
    assert (error["kind"], error["found"]) == ("UsageError", verb_name)
    assert similar in error["message"]
    assert streams.err == f"fembridge: {error['message']}\n"


@pytest.mark.parametrize(
    ("words", "argument", "found", "named"),
    [
        ("stimuli --nope", "--nope", "--nope", ["fembridge stimuli --help"]),
        ("stimuli --seed x", "--seed", "x", ["0"]),
        ("plot raster --stimlus sine", "--stimlus", "--stimlus", ["--stimulus?"]),
        ("plot rastr", "PICTURE", "rastr", ["raster"]),
        ("stimuli --export cvs", "--export", "cvs", ["csv, wav, npy, marc-table", "csv?"]),
        ("simulate", None, None, ["--stimulus/--waveform", "fembridge simulate --help"]),
        ("simulate --stimulus sine_20_250 --jobs 0", "--jobs", "0", ["1", "4096"]),
        ("deflect --stored --solver run", "--solver", None, ["--stored"]),
        ("stimuli --seed", "--seed", None, ["fembridge stimuli --help"]),
        ("encode --afferent SA RA", None, None, ["CSV|NPZ|DIR"]),
        ("encode --afferent SA,XA t.csv", "--afferent", "XA", ["SA, RA, PC"]),
    ],
)
def test_misuse_of_options_is_2_in_one_line_with_option_and_value(
    capsys, words, argument, found, named
):
    assert cli.main([*words.split(), "--json"]) == 2
    streams = capsys.readouterr()
    error = json.loads(streams.out)["error"]
    assert (error.get("argument"), error.get("found")) == (argument, found)
    assert streams.err == f"fembridge: {error['message']}\n"
    assert len(streams.err) <= 301
    for text in named:
        assert text in error["message"]


SIMULATE = ("simulate", "--stored", "--stimulus", "sine_20_250")
OBSERVED = "stimulus,afferent,rate_ips\nsine_20_250,SA,25\n"


@pytest.mark.parametrize(
    "words",
    [
        (*SIMULATE, "--parameters", "nothing"),
        (*SIMULATE, "--preindent-um", "nan"),
        ("build-deck", "--stimulus", "sine_20_250", "--element", "nothing"),
        ("build-deck", "--stimulus", "sine_20_250", "--base-deck", "nothing.inp"),
        ("run", "nothing"),
        ("ingest", "nothing.frd"),
        ("encode", "nothing.csv"),
        ("fit", "--observed", "nothing.csv"),
        ("fit", "--observed", "observed.csv", "--response", "nothing.toml"),
        ("sweep", "nothing.toml"),
        ("validate", "--observed", "nothing.csv"),
        ("verify", "--only", "nothing"),
        ("deflect", "--finger", "nothing"),
        ("plot", "raster", "nothing.csv"),
        ("stimuli", "nothing"),
    ],
    ids=" ".join,
)
def test_a_word_that_stands_for_nothing_is_2_whatever_the_option(
    words, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    Path("observed.csv").write_text(OBSERVED, encoding="utf-8")
    assert cli.main([*words, "--json"]) == 2
    streams = capsys.readouterr()
    summary = json.loads(streams.out)
    assert summary["exit_code"] == 2
    assert summary["error"]["kind"].endswith("Error")
    assert streams.err == f"fembridge: {summary['error']['message']}\n"
    assert len(streams.err) <= 301
    assert [path.name for path in tmp_path.iterdir()] == ["observed.csv"]


GONE = PermissionError(13, "Permission denied", "closed/run.toml")


@pytest.mark.parametrize(
    ("error", "code", "message", "fields"),
    [
        (
            ResultError("cut short\nhere", Path("a.frd"), 7),
            *(1, "a.frd:7: cut short\nhere", {"path": "a.frd", "line": 7}),
        ),
        (StimulusError("no stimulus 'x'"), 2, "no stimulus 'x'", {}),
        (
            UsageError(argument="depth_um", found=5, expected="0 to 2"),
            *(2, "depth_um is 5, expected 0 to 2"),
            {"argument": "depth_um", "found": 5, "expected": "0 to 2"},
        ),
        (GONE, 1, "closed/run.toml: Permission denied", {}),
        (KeyboardInterrupt(), 130, "interrupted", {}),
    ],
)
def test_an_error_is_one_line_on_stderr(verb, capsys, error, code, message, fields):
    verb(raising(error))
    for words in (["try"], ["try", "--json"]):
        assert cli.main(words) == code
        streams = capsys.readouterr()
        assert streams.err == f"fembridge: {' '.join(message.splitlines())}\n"
        details = {"kind": type(error).__name__, "message": message, **fields}
        assert not streams.out or json.loads(streams.out) == {"error": details, "exit_code": code}
        assert bool(streams.out) == ("--json" in words)


@pytest.mark.parametrize(
    ("argument", "option"),
    [
        ("time_limit_s", "--time-limit"),
        ("sets", "--set"),
        ("afferents", "--afferent"),
        ("dt", "dt"),
    ],
)
def test_an_argument_of_a_function_is_named_as_the_option_of_the_verb(
    verb, capsys, monkeypatch, argument, option
):
    verb(raising(UsageError(argument=argument, found=5, expected="0 to 2")))

    def add_arguments(parser):
        parser.add_argument("--time-limit", dest="time_limit_s")
        parser.add_argument("--set", dest="sets")
        parser.add_argument("-a", "--afferent")

    monkeypatch.setattr(sys.modules["fembridge.commands.try"], "add_arguments", add_arguments)
    assert cli.main(["try", "--json"]) == 2
    streams = capsys.readouterr()
    error = json.loads(streams.out)["error"]
    assert (error["argument"], error["found"], error["expected"]) == (option, 5, "0 to 2")
    assert streams.err.split()[:2] == ["fembridge:", option]


@pytest.mark.parametrize("options", [[], ["--json"]])
def test_a_long_error_is_one_whole_line_and_leaves_no_file(
    verb, capsys, monkeypatch, tmp_path, options
):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    words = "begin " + 200 * "wörter\x1b[31m " + "the\nend"
    verb(raising(ResultError(words, Path("a.frd"))))
    assert cli.main(["try", *options]) == 1
    streams = capsys.readouterr()
    assert streams.err == f"fembridge: a.frd: {words}\n".replace("\x1b", "\\x1b").replace(
        "the\n", "the "
    )
    assert not list(tmp_path.iterdir())
    if options:
        assert json.loads(streams.out)["error"]["message"] == f"a.frd: {words}"


def test_an_error_of_megabytes_does_not_flood_the_terminal(verb, capsys):
    verb(raising(ResultError("x" * 1_000_000 + " the end", Path("a.frd"))))
    assert cli.main(["try"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert len(line) < 10_100
    assert line.startswith("fembridge: a.frd: xxx")
    assert " characters left out ... " in line
    assert line.endswith(" the end")


def test_what_a_file_says_does_not_steer_the_terminal(verb, capsys):
    title = "a\x1b]0;owned\x07\x1b[2J\x9b1m\r\u202eb\tc"

    def run(args):
        print(title)
        print(title, file=sys.stderr)
        return {"title": title}

    verb(run)
    shown = "a\\x1b]0;owned\\x07\\x1b[2J\\x9b1m\\r\\u202eb\tc\n"
    assert cli.main(["try"]) == 0
    assert capsys.readouterr() == (shown, shown)


@pytest.mark.parametrize("error", [ZeroDivisionError, BrokenPipeError])
def test_an_error_that_is_not_ours_keeps_its_traceback(verb, error):
    """A broken pipe too: this one is not our output."""
    verb(raising(error))
    with pytest.raises(error):
        cli.main(["try"])


def test_json_is_alone_and_strict_whatever_the_summary_holds(verb, capsys):
    summary = {
        "rate_ips": float("nan"),
        "peak": np.float64("inf"),
        "counts": np.array([1, 2]),
        "files": (Path("a.csv"),),
        3: True,
    }
    verb(lambda args: print("for people") or summary)
    assert cli.main(["try", "--json"]) == 0

    def no_constant(name):
        raise AssertionError(name)

    out = json.loads(capsys.readouterr().out, parse_constant=no_constant)
    strict = {"rate_ips": None, "peak": None, "counts": [1, 2], "files": ["a.csv"], "3": True}
    assert out == strict | {"notes": [], "warnings": [], "next": [], "exit_code": 0}


def test_a_summary_can_say_that_not_all_is_well(verb, capsys):
    verb(lambda args: {"exit_code": 1})
    assert cli.main(["try"]) == 1
    assert cli.main(["try", "--json"]) == 1
    assert json.loads(capsys.readouterr().out) == {
        "notes": [],
        "warnings": [],
        "next": [],
        "exit_code": 1,
    }


def test_a_warning_is_a_line_on_stderr_once_and_part_of_the_summary(verb, capsys):
    def warn(args):
        for text in ("edge", "edge", "deep"):
            warnings.warn(text, FembridgeWarning, stacklevel=1)
        return {}

    verb(warn)
    assert cli.main(["try", "--json"]) == 0
    printed = capsys.readouterr()
    assert printed.err == "warning: edge\nwarning: deep\n"
    assert json.loads(printed.out)["warnings"] == ["edge", "deep"]


def test_options_are_not_guessed_from_their_beginnings(capsys):
    assert cli.main(["stimuli", "--exp", "csv", "sine_20_250"]) == 2
    assert cli.main(["--vers"]) == 2


@pytest.mark.parametrize(
    ("output", "problem"),
    [("> /dev/full", "No space left on device"), ("1< /dev/null", "Bad file descriptor")],
)
def test_output_that_cannot_be_written_is_one_line(output, problem):
    ran = in_a_shell(f"stimuli {output}")
    assert ran.returncode == 1
    assert ran.stderr == f"fembridge: cannot print: {problem}\n"


def test_a_name_that_the_terminal_cannot_show_is_printed_nevertheless(tmp_path):
    path = tmp_path / "ä.csv"
    words = f'stimuli --export csv sine_20_250 -o "{path}"'
    ran = in_a_shell(words, PYTHONIOENCODING="ascii", LC_ALL="C.UTF-8")
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout == f"{path}\n".encode("ascii", "backslashreplace").decode()
    assert path.is_file()


def test_closed_standard_streams_keep_nothing_from_being_done(tmp_path):
    words = f'stimuli --export csv sine_20_250 -o "{tmp_path / "a.csv"}" <&- >&- 2>&-'
    ran = in_a_shell(words)
    assert ran.returncode == 0, ran.stderr
    lines = (tmp_path / "a.csv").read_text("utf-8").splitlines()
    assert (lines[0], len(lines)) == ("time_ms,displacement_um", 502)


@pytest.mark.parametrize(("words", "unbuffered"), [("stimuli", ""), ("--help", "1")])
def test_output_that_nobody_reads_ends_quietly(words, unbuffered):
    reader, writer = os.pipe()
    os.close(reader)
    try:
        ran = in_a_shell(words, stdout=writer, PYTHONUNBUFFERED=unbuffered)
    finally:
        os.close(writer)
    assert (ran.returncode, ran.stderr) == (0, "")


def test_a_folder_that_was_deleted_is_named_in_one_line(tmp_path):
    gone = tmp_path / "gone"
    gone.mkdir()
    remove = f"{sys.executable} -c 'import os; os.rmdir(os.getcwd())'"
    before = f'cd "{gone}" && {remove} &&'
    ran = in_a_shell("stimuli --export csv sine_20_250", before)
    assert ran.returncode == 1, ran.stderr
    assert ran.stderr.splitlines()[-1].startswith("fembridge: ")
    assert "Traceback" not in ran.stderr


@pytest.mark.parametrize(
    "words",
    [
        pytest.param(" ".join([*SIMULATE, "-o", "out"]), marks=pytest.mark.slow),
        pytest.param("deflect -o out", marks=pytest.mark.slow),
        "plot stimulus sine_20_250 -o out/a.png",
    ],
)
def test_the_backend_of_a_notebook_is_no_reason_not_to_draw(tmp_path, words):
    backend = "module://matplotlib_inline.backend_inline"
    ran = in_a_shell(words, f'cd "{tmp_path}" &&', MPLBACKEND=backend)
    assert ran.returncode == 0, ran.stderr
    [picture] = (tmp_path / "out").glob("*.png")
    assert picture.read_bytes().startswith(b"\x89PNG")


CLASSES = {
    name: thing
    for name, thing in vars(errors).items()
    if isinstance(thing, type) and issubclass(thing, FembridgeError)
}
PUBLIC = [thing for name, thing in CLASSES.items() if not name.startswith("_")]


@pytest.mark.parametrize("error", PUBLIC, ids=lambda error: error.__name__)
def test_an_error_survives_a_pickle(error):
    path = Path("runs/job.frd")
    whole = error("cut short", path, 12)
    named = error(argument="seed", found=-1, expected="0 or more")
    for before in (error("not this"), error("cut short", path), whole, named):
        after = pickle.loads(pickle.dumps(before))
        assert (type(after), after.args, str(after)) == (error, before.args, str(before))
        assert vars(after) == vars(before)
    assert str(whole) == f"{path}:12: cut short"
    assert str(named) == "seed is -1, expected 0 or more"
    assert named.message("--seed") == "--seed is -1, expected 0 or more"


def test_an_error_becomes_one_of_a_section_of_a_table_with_its_fields():
    path = Path("study.toml")
    cause = FingerError(argument="dermis_mm", found=-1, expected="0 or more")
    error = UsageError.from_error(UsageError.from_error(cause, section="skin"), path, "fingers 1")
    assert (error.path, error.argument, error.key) == (path, None, "fingers 1.skin.dermis_mm")
    assert (error.found, error.expected, error.exit_code) == (-1, "0 or more", 2)
    assert str(error) == "study.toml: fingers 1.skin.dermis_mm is -1, expected 0 or more"


def test_an_error_without_a_subject_begins_with_the_section():
    error = UsageError.from_error(FingerError("layers leave a gap"), section="fingers 2")
    assert (str(error), error.key) == ("fingers 2: layers leave a gap", None)


def test_an_error_that_names_a_file_keeps_it():
    cause = FingerError(path=Path("soft.toml"), key="name", found="", expected="a name")
    error = UsageError.from_error(cause, Path("study.toml"), "fingers 1")
    assert (error.path, error.key) == (cause.path, "name")


def test_misuse_is_2_and_all_else_is_1():
    codes = {error: error.exit_code for error in PUBLIC}
    assert {error for error, code in codes.items() if code == 2} == {UsageError, StimulusError}
    assert set(codes.values()) == {1, 2}


@pytest.mark.parametrize(
    ("words", "option", "parts"),
    [
        (
            "plot DIR --stimulus sine_20",
            "--stimulus",
            ["fembridge plot all", "plot raster", "--suffix"],
        ),
        ("plot mesh --bin-ms 3", "--bin-ms", ["fembridge plot mesh", "plot psth", "--finger"]),
        ("plot psth DIR --bim-ms 3", "--bim-ms", ["plot psth", "did you mean --bin-ms"]),
        ("simulate --press-n 3", "--press-n", ["fembridge simulate", "touch", "simulate --help"]),
    ],
)
def test_an_option_of_another_verb_or_picture_is_named_with_its_owners_in_one_line(
    words, option, parts, tmp_path, capsys
):
    assert cli.main([*words.replace("DIR", str(tmp_path)).split(), "--json"]) == 2
    printed = capsys.readouterr()
    assert printed.err.count("\n") == 1
    assert json.loads(printed.out)["error"]["argument"] == option
    for part in parts:
        assert part in printed.err


def test_an_argument_too_many_is_quoted_with_the_usage_of_the_picture(tmp_path, capsys):
    assert cli.main(["plot", "raster", str(tmp_path), "extra"]) == 2
    line = capsys.readouterr().err
    assert "'extra'" in line
    assert "fembridge plot raster FILE|DIR [options]" in line


@pytest.mark.parametrize("columns", [60, 80, 120])
def test_help_and_outputs_fit_into_the_terminal(columns, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", str(columns))
    pages = [[], ["--help"], ["plot", "mesh", "--help"], ["plot", "stimulus", "--help"]]
    verbs = ["encode", "ingest", "touch", "calibrate", "completion"]
    pages += [[verb, page] for verb in verbs for page in ("--help", "--help-outputs")]
    for words in pages:
        assert cli.main(words) == 0
        lines = capsys.readouterr().out.splitlines()
        assert lines
        assert [line for line in lines if len(line) > columns] == [], words


def test_a_wrapped_command_is_the_same_command_for_a_shell():
    command = "fembridge touch --shape 'braille:text=a b' --press-n 0.25 -o touch_b"
    lines = wrapped(f"Text.\n\nexample: {command}", 40).splitlines()
    assert max(map(len, lines)) <= 40
    assert len(lines) > 4
    text = "\n".join(lines[2:]).removeprefix("example: ")
    assert shlex.split(text.replace("\\\n", " ")) == shlex.split(command)


def test_a_list_keeps_its_columns_when_it_is_wrapped():
    item = "  rates.csv   one row per trace,\n              with its rate\n"
    text = f"Files of a run:\n{item}and no more."
    assert wrapped(text, 30).splitlines() == [
        "Files of a run:",
        "  rates.csv   one row per",
        "              trace, with its",
        "              rate",
        "and no more.",
    ]
