"""Ctrl-C of the command ``fembridge``, from our first line to the end of the process.

Imports take most of the time of a short command, and an interrupted import of a compiled
module may end in any error. Until a verb begins to work nothing has to be cleaned up, so the
process ends at once. While a verb works Ctrl-C is a `KeyboardInterrupt`. After that the results
are written and only Python's own shutdown remains: Ctrl-C is ignored.

`fembridge` imports this module first, and it does nothing unless the process was started as the
command: programs that import `fembridge` keep their own handling of signals. So little is
imported here.
"""

import _signal as signal  # type: ignore[import-not-found] # without enumerations, in no time
import os
import sys

TYPE_CHECKING = False  # `typing` takes longer to import than all of this
if TYPE_CHECKING:
    from types import FrameType

INTERRUPTED = 130
"""Exit code of what Ctrl-C ended: 128 + SIGINT, as shells have it."""

_COMMANDS = ("fembridge", "fembridge.cli")
_LINE = b"fembridge: interrupted\n"
_JSON = b"""{
  "error": {
    "kind": "KeyboardInterrupt",
    "message": "interrupted"
  },
  "exit_code": 130
}
"""


def is_command() -> bool:
    """Whether this process is the console script, or ``python -m fembridge.cli``."""
    program = next((text for text in sys.orig_argv[1:] if not text.startswith("-")), "")
    return os.path.basename(program) in _COMMANDS  # noqa: PTH119 - pathlib takes long to import


def end_at_once() -> None:
    """From now on Ctrl-C ends the process, without a traceback; nothing under nohup."""
    if is_command() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)


def raise_keyboard_interrupt() -> None:
    """Make Ctrl-C raise `KeyboardInterrupt` again, after `end_at_once`."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def ignore_from_now_on() -> None:
    """From now on Ctrl-C does nothing, if this process is the command."""
    handlers = (_end, signal.default_int_handler)
    if is_command() and signal.getsignal(signal.SIGINT) in handlers:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _end(number: int, frame: "FrameType | None") -> None:
    os.write(2, _LINE)
    if "--json" in sys.argv:
        os.write(1, _JSON)
    os._exit(INTERRUPTED)


end_at_once()
