"""Ctrl-C at any moment of a command: one line and 130, or, once all is written, nothing."""

import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest

from fembridge import cli

INTERRUPT = "os.kill(os.getpid(), signal.SIGINT)"
AS_COMMAND = "import os, signal, sys; sys.orig_argv = ['python', '/bin/fembridge', 'stimuli']; "
LINE = "fembridge: interrupted\n"


def python(code, *words):
    """Run a program with Python's own handler, whatever the shell has us ignore."""
    return subprocess.run(
        [sys.executable, "-P", "-c", code, *words],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


@pytest.mark.parametrize(
    "before",
    ["import fembridge", "from fembridge.cli import main", "import fembridge.commands.touch"],
)
def test_an_interrupt_while_the_command_is_imported_is_a_line(before):
    done = python(f"{AS_COMMAND} {before}; {INTERRUPT}")
    assert (done.returncode, done.stderr, done.stdout) == (130, LINE, "")


def test_an_interrupt_of_an_import_is_in_json_too():
    done = python(f"{AS_COMMAND} import fembridge; {INTERRUPT}", "stimuli", "--json")
    assert (done.returncode, done.stderr) == (130, LINE)
    assert '"kind": "KeyboardInterrupt"' in done.stdout


def test_an_interrupt_after_the_work_changes_nothing():
    done = python(
        f"{AS_COMMAND} from fembridge.cli import main; code = main(['stimuli', 'sine_20_250']); "
        f"{INTERRUPT}; sys.exit(code)"
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "1 stimulus" in done.stdout


def test_a_program_that_imports_us_keeps_its_handler():
    code = "import os, signal; before = signal.getsignal(signal.SIGINT); import fembridge.cli; "
    code += "fembridge.cli.main(['stimuli', 'sine_20_250']); "
    code += "assert signal.getsignal(signal.SIGINT) is before; " + INTERRUPT
    done = python(code)
    assert done.returncode == -signal.SIGINT
    assert "KeyboardInterrupt" in done.stderr


def test_an_interrupt_in_the_work_of_the_command_is_an_exception_and_then_a_line():
    code = AS_COMMAND + "from fembridge import cli; from fembridge.commands import stimuli\n"
    code += "def run(args):\n"
    code += "    try:\n"
    code += f"        {INTERRUPT}\n"
    code += "    finally:\n"
    code += "        print('cleaned up')\n"
    code += "stimuli.run = run\n"
    code += "sys.exit(cli.main(['stimuli']))"
    done = python(code)
    assert (done.returncode, done.stderr, done.stdout) == (130, LINE, "cleaned up\n")


@pytest.mark.parametrize("words", [["try"], ["try", "--json"]])
def test_an_interrupt_while_a_verb_declares_its_options_is_a_line(words, monkeypatch, capsys):
    """There its modules are imported."""

    def interrupted(parser):
        raise KeyboardInterrupt

    module = SimpleNamespace(__doc__="Try.", EXAMPLE="fembridge try", add_arguments=interrupted)
    monkeypatch.setitem(cli.VERBS, "try", "try things")
    monkeypatch.setitem(sys.modules, "fembridge.commands.try", module)
    handler = signal.getsignal(signal.SIGINT)
    assert cli.main(words) == 130
    assert capsys.readouterr().err == LINE
    assert signal.getsignal(signal.SIGINT) is handler
