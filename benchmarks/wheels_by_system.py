"""Systems on which pip finds a wheel of every dependency.

``python -m benchmarks.wheels_by_system``: pip resolves the dependencies of ``pyproject.toml`` for
other systems, with wheels alone and without installing anything; markers are evaluated for the
system. It needs a network. Packages that stop a system are left out one by one, so that all of
them are listed.
"""

import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import NamedTuple

from packaging.markers import default_environment
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
PYTHONS = ("3.11", "3.13")


class System(NamedTuple):
    """Tags of wheels that a system takes, and the values of its markers."""

    platforms: tuple[str, ...]
    sys_platform: str
    machine: str
    system: str


def _manylinux(machine: str) -> tuple[str, ...]:
    versions = ("2014", *(f"_2_{minor}" for minor in range(17, 36)))
    return tuple(f"manylinux{version}_{machine}" for version in versions)


SYSTEMS = {
    "Linux x86-64, glibc": System(_manylinux("x86_64"), "linux", "x86_64", "Linux"),
    "Linux ARM, glibc": System(_manylinux("aarch64"), "linux", "aarch64", "Linux"),
    "Linux x86-64, musl": System(
        ("musllinux_1_1_x86_64", "musllinux_1_2_x86_64"), "linux", "x86_64", "Linux"
    ),
    "macOS ARM": System(
        tuple(f"macosx_{major}_0_arm64" for major in range(11, 16)), "darwin", "arm64", "Darwin"
    ),
    "Windows x86-64": System(("win_amd64",), "win32", "AMD64", "Windows"),
    "Windows ARM": System(("win_arm64",), "win32", "ARM64", "Windows"),
}


def required(system: System, python: str) -> list[str]:
    """Dependencies of the project on `system`, without their markers."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    environment = {
        **default_environment(),
        "sys_platform": system.sys_platform,
        "platform_machine": system.machine,
        "platform_system": system.system,
        "python_version": python,
    }
    requirements = [Requirement(line) for line in project["dependencies"]]
    return [
        f"{requirement.name}{requirement.specifier}"
        for requirement in requirements
        if requirement.marker is None or requirement.marker.evaluate(environment)
    ]


def without_wheels(system: System, python: str) -> list[str]:
    """Packages without a wheel for `system`, found one after the other."""
    requirements, stopped = required(system, python), []
    while True:
        with tempfile.TemporaryDirectory() as folder:
            words = [sys.executable, "-m", "pip", "install", "--dry-run", "--ignore-installed"]
            words += ["--quiet", "--only-binary=:all:", "--target", folder]
            words += ["--python-version", python, "--implementation", "cp"]
            words += [word for tag in system.platforms for word in ("--platform", tag)]
            words += ["--abi", f"cp{python.replace('.', '')}", "--abi", "abi3", "--abi", "none"]
            done = subprocess.run([*words, *requirements], capture_output=True, text=True)
        if done.returncode == 0:
            return stopped
        match = re.search(r"No matching distribution found for ([\w.-]+)", done.stderr)
        if match is None:
            return [*stopped, done.stderr.strip().splitlines()[-1]]
        name = match[1]
        kept = [line for line in requirements if re.split(r"[<>=!~]", line)[0] != name]
        if kept == requirements:  # a dependency of a dependency: its parent is pygmsh
            kept = [line for line in requirements if not line.startswith("pygmsh")]
        if kept == requirements:
            return [*stopped, name]
        requirements, stopped = kept, [*stopped, name]


def main() -> None:
    """Print a row for each system and version of Python."""
    for name, system in SYSTEMS.items():
        for python in PYTHONS:
            stopped = without_wheels(system, python)
            print(f"{name:22} {python:5} {', '.join(stopped) or 'every wheel'}", flush=True)


if __name__ == "__main__":
    main()
