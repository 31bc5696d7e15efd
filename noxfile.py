"""What CI runs, ``nox -s check`` and ``docs``; the oldest versions we claim, ``nox -s lowest``."""

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
