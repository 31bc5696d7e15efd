"""What a machine has: where the solver is, what is installed, what is missing.

Nothing heavy is imported here. Versions come from package metadata; gmsh, which
fails with an OSError where system libraries are absent, is tried in a process
of its own.
"""

import importlib.metadata
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from fembridge.errors import MissingError

SOLVER_INSTALL_LINE = (
    "apt-get install -y calculix-ccx libglu1-mesa libgl1 libxcursor1 libxft2 libxinerama1 libgomp1"
)
"""Debian and Ubuntu: the solver, and what gmsh's wheel links to."""

CCX_ELSEWHERE = (
    "conda install -c conda-forge calculix, or on macOS "
    "brew install costerwi/homebrew-calculix/calculix-ccx"
)
CCX_VARIABLE = "FEMBRIDGE_CCX"
CCX_TRIED = (2, 20)
"""The version that everything was tried with."""

PACKAGES = {
    "numpy": ((2, 0), True, "everything"),
    "scipy": ((1, 13), True, "interpolating stored responses"),
    "pandas": ((2, 2, 2), False, "tables"),
    "tomli-w": ((1, 0), True, "run folders"),
    "cattrs": ((24, 1), True, "TOML files"),
    "filelock": ((3, 24), True, "run folders"),
    "jinja2": ((3, 1), False, "report pages"),
    "matplotlib": ((3, 9), False, "plots"),
    "rich": ((13, 7), False, "progress bars"),
    "meshio": ((5, 3, 5), False, "meshes from other programs"),
    "pygmsh": ((7, 1, 17), False, "meshing other fingers"),
    "pymoo": ((0, 6, 1, 3), False, "fitting parameters"),
}
"""Each dependency: least version, whether the stored response needs it, its use."""

GIB = 1024**3
ROOM_GIB = 2.0
"""A transient run of the finest finger writes about a third of a GiB."""


class State(Enum):
    """What a check found; only `MISSING` keeps the stored response from working."""

    OK = "ok"
    NOTE = "note"
    MISSING = "missing"


@dataclass(frozen=True, slots=True)
class Check:
    """One line of the doctor: what was looked at, what was found, what to do."""

    name: str
    state: State
    found: str
    remedy: str = ""


def find_ccx() -> Path | None:
    """Absolute path of CalculiX, or None where there is none.

    ``FEMBRIDGE_CCX``, a path or a name on the PATH, comes first. Then ``ccx``,
    the name that packages give it. Then the newest ``ccx_2.21`` or
    ``ccx_2.21_MT`` on the PATH, as built from source; of one version the
    multithreaded one.

    Raises
    ------
    MissingError
        ``FEMBRIDGE_CCX`` is set and is no program: running another solver than
        the one asked for would be worse than running none.
    """
    asked = os.environ.get(CCX_VARIABLE)
    if asked:
        found = shutil.which(asked)
        if found is None:
            raise MissingError(f"{CCX_VARIABLE} is {asked!r}, which is no program here")
        return Path(found).absolute()
    plain = shutil.which("ccx")
    return Path(plain).absolute() if plain else _newest_versioned_ccx()


def _newest_versioned_ccx() -> Path | None:
    versions: dict[tuple[int, int, bool], Path] = {}
    for folder in map(Path, os.get_exec_path()):
        try:
            programs = [path for path in folder.iterdir() if path.name[:4] == "ccx_"]
        except OSError:
            continue
        for path in programs:
            match = re.fullmatch(r"ccx_(\d+)\.(\d+)(_MT)?", path.name)
            if match and path.is_file() and os.access(path, os.X_OK):
                key = (int(match[1]), int(match[2]), bool(match[3]))
                versions.setdefault(key, path.absolute())
    return versions[max(versions)] if versions else None


def examine(version: str) -> list[Check]:
    """Look at everything the doctor reports; `version` is fembridge's own."""
    return [
        Check("fembridge", State.OK, version),
        Check("python", State.OK, f"{sys.version.split()[0]}, {sys.executable}"),
        *(check_package(name) for name in PACKAGES),
        check_ccx(),
        check_gmsh(),
        check_threads(),
        check_folder(Path.cwd()),
        check_encoding(),
    ]


def to_lines(checks: Sequence[Check]) -> list[str]:
    """Write each check as a line, with its remedy on a line of its own."""
    lines = []
    for check in checks:
        lines.append(f"{check.state.value:<8} {check.name:<11} {check.found}")
        if check.remedy:
            lines.append(f"{'':<20} -> {check.remedy}")
    return lines


def check_package(name: str) -> Check:
    """Compare the installed version of a dependency with the least one."""
    least, needed, use = PACKAGES[name]
    least_text = ".".join(map(str, least))
    remedy = f"{sys.executable} -m pip install '{name}>={least_text}'"
    state = State.MISSING if needed else State.NOTE
    try:
        found = importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return Check(name, state, f"not installed; for {use}", remedy)
    numbers = tuple(int(part) for part in re.findall(r"\d+", found)[: len(least)])
    if numbers < least:
        return Check(name, state, f"{found}, older than {least_text}", remedy)
    return Check(name, State.OK, found)


def check_ccx() -> Check:
    """Find the solver and ask for its version; without it nothing new is solved."""
    remedy = f"{SOLVER_INSTALL_LINE} (Debian, Ubuntu); elsewhere {CCX_ELSEWHERE}"
    try:
        path = find_ccx()
    except MissingError as error:
        return Check("ccx", State.NOTE, str(error), f"unset or correct {CCX_VARIABLE}")
    if path is None:
        found = "not found; stored responses work without it, new decks need it"
        return Check("ccx", State.NOTE, found, remedy)
    try:
        answer = subprocess.run(
            [str(path), "-v"], capture_output=True, text=True, timeout=20, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return Check("ccx", State.NOTE, f"{path} does not run: {error}", remedy)
    # exit 201 is what a healthy ccx gives for -v
    match = re.search(r"Version (\d+)\.(\d+)", answer.stdout)
    if match is None:
        said = (answer.stderr.strip() or answer.stdout.strip() or "nothing").split("\n")
        found = f"{path} prints no version (exit {answer.returncode}): {said[0]}"
        return Check("ccx", State.NOTE, found, remedy)
    found = f"{match[1]}.{match[2]}, {path}"
    if (int(match[1]), int(match[2])) != CCX_TRIED:
        found += f" (tried with {CCX_TRIED[0]}.{CCX_TRIED[1]})"
    return Check("ccx", State.OK, found)


def check_gmsh() -> Check:
    """Import gmsh in another process; it is for fingers without a stored mesh."""
    command = [sys.executable, "-P", "-c", "import gmsh; print(gmsh.__version__)"]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return Check("gmsh", State.NOTE, f"not tried: {error}")
    if answer.returncode == 0:
        return Check("gmsh", State.OK, answer.stdout.strip())
    last = (answer.stderr.strip() or f"exit {answer.returncode}").split("\n")[-1]
    found = f"cannot be imported ({last}); stored meshes work without it"
    if "No module named 'gmsh'" in last:
        return Check("gmsh", State.NOTE, found, f"{sys.executable} -m pip install gmsh")
    return Check(
        "gmsh",
        State.NOTE,
        found,
        f"{SOLVER_INSTALL_LINE} (Debian, Ubuntu); elsewhere "
        "conda install -c conda-forge python-gmsh",
    )


def check_threads() -> Check:
    """How many cores there are and how many ccx will take."""
    if hasattr(os, "sched_getaffinity"):
        cores = len(os.sched_getaffinity(0))
    else:
        cores = os.cpu_count() or 1
    asked = os.environ.get("OMP_NUM_THREADS")
    taken = f"OMP_NUM_THREADS is {asked}" if asked else "OMP_NUM_THREADS is not set"
    return Check("threads", State.OK, f"{cores} cores; {taken}")


def check_folder(folder: Path) -> Check:
    """Whether `folder` can be written and has room for a run."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            free_gib = shutil.disk_usage(folder).free / GIB
    except OSError as error:
        found = f"{folder} cannot be written: {error.strerror}"
        return Check("folder", State.NOTE, found, "go to another folder, or name one with -o")
    found = f"{folder}, {free_gib:.1f} GiB free"
    if free_gib < ROOM_GIB:
        remedy = f"make room: a long run wants {ROOM_GIB:g} GiB"
        return Check("folder", State.NOTE, found, remedy)
    return Check("folder", State.OK, found)


def check_encoding() -> Check:
    """Whether files and terminal speak UTF-8."""
    encoding = sys.getfilesystemencoding().lower()
    named = [f"{n}={os.environ[n]}" for n in ("LC_ALL", "LC_CTYPE", "LANG") if os.environ.get(n)]
    found = f"{encoding}, {' '.join(named) or 'no locale set'}"
    if encoding.replace("-", "") != "utf8":
        return Check("locale", State.NOTE, found, "export LC_ALL=C.UTF-8")
    return Check("locale", State.OK, found)
