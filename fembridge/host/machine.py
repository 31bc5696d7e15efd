"""What a machine has: where the solver is, what is installed, what is missing.

Nothing heavy is imported here. Versions come from package metadata; gmsh, which
fails with an OSError where system libraries are absent, is tried in a process
of its own.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

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
CCX_TRIED = "2.20"
"""The version that everything was tried with."""

PACKAGES = {
    "numpy": ((2, 0), True, "everything"),
    "scipy": ((1, 13), True, "interpolating stored responses"),
    "pandas": ((2, 2, 2), False, "tables"),
    "tomli-w": ((1, 0), True, "run folders"),
    "cattrs": ((24, 1), True, "TOML files"),
    "filelock": ((3, 24), True, "run folders"),
    "platformdirs": ((4, 2), False, "the cache of what was solved"),
    "threadpoolctl": ((3, 5), False, "touches"),
    "jinja2": ((3, 1), False, "report pages"),
    "shtab": ((1, 7, 1), False, "completion of shells"),
    "matplotlib": ((3, 9), False, "plots"),
    "rich": ((13, 7), False, "progress bars"),
    "meshio": ((5, 3, 5), False, "meshes from other programs"),
    "pygmsh": ((7, 1, 17), False, "meshing other fingers"),
    "pymoo": ((0, 6, 1, 3), False, "fitting parameters"),
}
"""Each dependency: least version, whether the stored response needs it, its use."""

PACKAGE_NAMES = ("decks", "neural")
"""Packages of fembridge whose names another distribution may use, too."""

GIB = 1024**3
ROOM_GIB = 2.0
"""A transient run of the finest finger writes about a third of a GiB."""


class Check(NamedTuple):
    """One line of the doctor: what was looked at, what was found, what to do.

    `state` is ``ok``, ``note`` or ``missing``; only the last keeps the stored response
    from working.
    """

    name: str
    state: str
    finding: str
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
    requested = os.environ.get(CCX_VARIABLE)
    if requested:
        program = shutil.which(requested)
        if program is None:
            raise MissingError(f"{CCX_VARIABLE} is {requested!r}, which is no program here")
        return Path(program).absolute()
    default_program = shutil.which("ccx")
    if default_program:
        return Path(default_program).absolute()
    versions: dict[tuple[int, int, bool], Path] = {}
    for folder in os.get_exec_path():
        for path in Path(folder).glob("ccx_*"):
            match = re.fullmatch(r"ccx_(\d+)\.(\d+)(_MT)?", path.name)
            if match and path.is_file() and os.access(path, os.X_OK):
                key = (int(match[1]), int(match[2]), bool(match[3]))
                versions.setdefault(key, path.absolute())
    return versions[max(versions)] if versions else None


def version_of(ccx: Path) -> tuple[str, str]:
    """Version that a solver prints, as ``2.20``, "" for none; and its exit code and first words."""
    try:
        completed = _run([str(ccx), "-v"], patience_s=20)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise MissingError(f"{ccx} does not run: {error}") from error
    # exit 201 is what a healthy ccx gives for -v
    match = re.search(r"Version (\d+(?:\.\d+)*)", completed.stdout)
    output_lines = (completed.stderr.strip() or completed.stdout.strip() or "nothing").split("\n")
    return match[1] if match else "", f"(exit {completed.returncode}): {output_lines[0]}"


def examine(version: str) -> list[Check]:
    """Look at everything the doctor reports; `version` is fembridge's own."""
    return [
        Check("fembridge", "ok", version),
        Check("python", "ok", f"{sys.version.split()[0]}, {sys.executable}"),
        *(check_package(name) for name in PACKAGES),
        check_ccx(),
        check_gmsh(),
        check_threads(),
        check_folder(Path.cwd()),
        check_encoding(),
        check_names(),
    ]


def check_package(name: str) -> Check:
    """Compare the installed version of a dependency with the least one."""
    from importlib.metadata import PackageNotFoundError, version

    minimum, is_required, use = PACKAGES[name]
    minimum_text = ".".join(map(str, minimum))
    remedy = f"{sys.executable} -m pip install '{name}>={minimum_text}'"
    state = "missing" if is_required else "note"
    try:
        installed = version(name)
    except PackageNotFoundError:
        return Check(name, state, f"not installed; for {use}", remedy)
    numbers = tuple(int(part) for part in re.findall(r"\d+", installed)[: len(minimum)])
    if numbers < minimum:
        return Check(name, state, f"{installed}, older than {minimum_text}", remedy)
    return Check(name, "ok", installed)


def check_ccx() -> Check:
    """Find the solver and ask for its version; without it nothing new is solved."""
    remedy = f"{SOLVER_INSTALL_LINE} (Debian, Ubuntu); elsewhere {CCX_ELSEWHERE}"
    path = None
    try:
        path = find_ccx()
        version, output = version_of(path) if path else ("", "")
    except MissingError as error:
        return Check("ccx", "note", str(error), remedy if path else f"correct {CCX_VARIABLE}")
    if path is None:
        message = "not found; stored responses work without it, new decks need it"
        return Check("ccx", "note", message, remedy)
    if not version:
        return Check("ccx", "note", f"{path} prints no version {output}", remedy)
    tested_text = "" if version == CCX_TRIED else f" (tried with {CCX_TRIED})"
    return Check("ccx", "ok", f"{version}, {path}{tested_text}")


def check_gmsh() -> Check:
    """Import gmsh in another process; it is for fingers without a stored mesh."""
    try:
        command = [sys.executable, "-P", "-c", "import gmsh; print(gmsh.__version__)"]
        completed = _run(command, patience_s=60)
    except (OSError, subprocess.TimeoutExpired) as error:
        return Check("gmsh", "note", f"not tried: {error}")
    if completed.returncode == 0:
        return Check("gmsh", "ok", completed.stdout.strip())
    last_line = (completed.stderr.strip() or f"exit {completed.returncode}").split("\n")[-1]
    if "No module named 'gmsh'" in last_line:
        remedy = f"{sys.executable} -m pip install gmsh"
    else:
        conda_line = "conda install -c conda-forge python-gmsh"
        remedy = f"{SOLVER_INSTALL_LINE} (Debian, Ubuntu); elsewhere {conda_line}"
    message = f"cannot be imported ({last_line}); stored meshes work without it"
    return Check("gmsh", "note", message, remedy)


def cores() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def check_threads() -> Check:
    """How many cores there are and how many ccx will take."""
    requested = os.environ.get("OMP_NUM_THREADS")
    setting = f"OMP_NUM_THREADS is {requested or 'not set'}"
    return Check("threads", "ok", f"{cores()} cores; {setting}")


def check_folder(folder: Path) -> Check:
    """Whether `folder` can be written and has room for a run."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            free_gib = shutil.disk_usage(folder).free / GIB
    except OSError as error:
        message = f"{folder} cannot be written: {error.strerror}"
        return Check("folder", "note", message, "go to another folder, or name one with -o")
    message = f"{folder}, {free_gib:.1f} GiB free"
    if free_gib < ROOM_GIB:
        return Check("folder", "note", message, f"make room: a long run wants {ROOM_GIB:g} GiB")
    return Check("folder", "ok", message)


def check_encoding() -> Check:
    """Whether files and terminal speak UTF-8."""
    encoding = sys.getfilesystemencoding().lower()
    variables = [
        f"{name}={os.environ[name]}"
        for name in ("LC_ALL", "LC_CTYPE", "LANG")
        if os.environ.get(name)
    ]
    message = f"{encoding}, {' '.join(variables) or 'no locale set'}"
    if encoding.replace("-", "") != "utf8":
        return Check("locale", "note", message, "export LC_ALL=C.UTF-8")
    return Check("locale", "ok", message)


def check_names() -> Check:
    """Whether another distribution also installs a package ``decks`` or ``neural``.

    The names are generic. Whichever is installed last overwrites files of the other.
    """
    from importlib.metadata import packages_distributions

    owners = packages_distributions()
    others = {
        name: sorted({owner for owner in owners.get(name, ()) if owner.lower() != "fembridge"})
        for name in PACKAGE_NAMES
    }
    if any(others.values()):
        message = "; ".join(
            f"{name} is also a package of {', '.join(distributions)}"
            for name, distributions in others.items()
            if distributions
        )
        remedy = "install fembridge in an environment of its own: python3 -m venv .venv"
        return Check("names", "note", message, remedy)
    return Check("names", "ok", f"{', '.join(PACKAGE_NAMES)} are of fembridge alone")


def _run(command: list[str], patience_s: float) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, capture_output=True, text=True, errors="replace", timeout=patience_s, check=False
    )
