"""Which CalculiX is here: part of what a result is the result of."""

import re
import subprocess

from fembridge.errors import MissingError
from fembridge.machine import SOLVER_INSTALL_LINE, find_ccx

_PATIENCE_S = 20.0


def solver_version() -> str:
    """Give its name and version, as ``calculix 2.20``.

    Raises
    ------
    MissingError
        There is none, or it does not run.
    """
    program = find_ccx()
    if program is None:
        raise MissingError(
            f"no ccx on the PATH; install it: {SOLVER_INSTALL_LINE}; or say "
            "'stored = true' in the study: the reference fingers have stored responses"
        )
    try:
        answer = subprocess.run(
            [str(program), "-v"],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_PATIENCE_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise MissingError(f"{program} does not run: {error}") from error
    match = re.search(r"Version (\d+(?:\.\d+)*)", answer.stdout)
    return f"calculix {match[1] if match else 'of no known version'}"
