"""What CI runs, ``nox -s check`` and ``docs``, and what runs before a release.

``bare`` installs the wheel in each supported Python, ``lowest`` tests the oldest versions of the
dependencies, and ``release`` checks what is published.
"""

import shutil
from pathlib import Path

import nox

nox.options.default_venv_backend = "venv"
nox.options.sessions = ["check"]

LOWEST = (
    "numpy==2.0.*",
    "scipy==1.13.*",
    "pandas==2.2.2",
    "matplotlib==3.9.*",
    "rich==13.7.*",
    "tomli-w==1.0.*",
    "cattrs==24.1.*",
    "filelock==3.24.*",
    "platformdirs==4.2.*",
    "threadpoolctl==3.5.*",
    "jinja2==3.1.*",
    "shtab==1.7.*",
    "meshio==5.3.5",
    "pygmsh==7.1.17",
    "pymoo==0.6.1.3",
    "numba==0.60.*",
    "neo==0.14.*",
    "pynwb==3.0.*",
    "h5py==3.11.*",
    "pyparsing==3.1.*",  # newer ones warn about matplotlib 3.9
)


@nox.session
def check(session: nox.Session) -> None:
    """Format, lint, types, layers, tests, and what the wheel holds."""
    session.install("-c", "constraints.txt", ".[dev]")
    session.run("ruff", "format", "--check")
    session.run("ruff", "check")
    session.run("mypy")
    session.run("lint-imports")
    session.run("pytest", *session.posargs, env={"CI": "true"})
    wheel(session)


@nox.session
def wheel(session: nox.Session) -> None:
    """Build the wheel and look inside it."""
    session.install("-c", "constraints.txt", "build", "hatchling")
    folder = session.create_tmp()
    session.run("python", "-m", "build", "--wheel", "--outdir", folder, "--no-isolation")
    session.run("python", "tests/look_inside_wheel.py", folder)


@nox.session(python=["3.11", "3.12", "3.13"])
def bare(session: nox.Session) -> None:
    """Install the wheel alone, in each supported Python, and run what a newcomer runs.

    ``nox -s bare -- DIR`` installs the wheel in DIR instead of building one.
    """
    dist = Path(session.create_tmp()) / "dist"
    if session.posargs:
        dist = Path(session.posargs[0]).absolute()
    else:
        session.install("build", "hatchling")
        session.run("python", "-m", "build", "--wheel", "--outdir", str(dist), "--no-isolation")
        session.run("python", "-m", "pip", "uninstall", "-q", "-y", "build", "hatchling")
    wheels = list(map(str, dist.glob("*.whl")))
    if len(wheels) != 1:
        session.error(f"{dist}: found {len(wheels)} wheels, expected 1")
    session.install(*wheels)
    session.cd(session.create_tmp())  # the checkout is not on the path
    session.run("fembridge", "doctor")
    session.run("fembridge", "simulate", "--stimulus", "noise_25_250", "--stored", "-o", "out")
    touch = ("--shape", "braille:text=b", "--press-n", "0.25")
    session.run("fembridge", "touch", *touch, "-o", "touch_b")


@nox.session
def release(session: nox.Session) -> None:
    """Build wheel and source twice, compare them, and check their metadata: files of ``dist``."""
    tools = ("build", "hatchling", "twine", "check-wheel-contents", "pyroma", "cffconvert")
    session.install("-c", "constraints.txt", *tools)
    folders = [Path(session.create_tmp()) / name for name in ("first", "second")]
    for folder in folders:
        shutil.rmtree(folder, ignore_errors=True)
        session.run("python", "-m", "build", "--outdir", str(folder), "--no-isolation")
    files = sorted(folders[0].iterdir())
    for file in files:
        if file.read_bytes() != (folders[1] / file.name).read_bytes():
            session.error(f"{file.name} differs from build to build")
    session.run("twine", "check", "--strict", *map(str, files))
    session.run("check-wheel-contents", str(next(folders[0].glob("*.whl"))))
    session.run("pyroma", "--min", "10", ".")
    session.run("cffconvert", "--validate")
    shutil.rmtree("dist", ignore_errors=True)
    shutil.copytree(folders[0], "dist")


@nox.session
def docs(session: nox.Session) -> None:
    """Build the documentation site, warnings as errors, and look inside its pages."""
    session.install("-c", "constraints.txt", ".[docs]")
    site = "docs/_build/html"
    session.run("python", "-m", "sphinx", "-b", "html", "-W", "--keep-going", "docs", site)
    session.run("python", "tests/look_inside_site.py", site)


@nox.session
def lowest(session: nox.Session) -> None:
    """Run the tests on the oldest versions that pyproject.toml allows."""
    session.install(".[test]", *LOWEST)
    session.run("pytest", *session.posargs)
