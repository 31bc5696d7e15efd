"""Files of a release that no other test reads: they parse, and name what the project has."""

import json
import re
import shlex
import tomllib
from pathlib import Path

import pytest

from fembridge.host.machine import SOLVER_INSTALL_LINE
from fembridge.version import __version__

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")
WORKFLOW = (ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8")
LIBRARIES = set(SOLVER_INSTALL_LINE.split()[3:])


def test_the_citation_has_the_version_and_the_address_of_the_project():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (\S+)$", text, flags=re.MULTILINE)[1] == __version__
    address = re.search(r"^repository-code: (\S+)$", text, flags=re.MULTILINE)[1]
    assert address == PROJECT["urls"]["Homepage"]


def test_the_classifiers_are_the_versions_of_python_that_are_tested():
    declared = {
        match[1]
        for line in PROJECT["classifiers"]
        if (match := re.fullmatch(r"Programming Language :: Python :: (3\.\d+)", line))
    }
    bare = re.search(r"@nox.session\(python=\[(.*)\]\)", (ROOT / "noxfile.py").read_text())[1]
    assert declared == set(re.findall(r"3\.\d+", bare))
    assert f">={min(declared, key=lambda text: int(text[2:]))}" == PROJECT["requires-python"]


@pytest.mark.parametrize("file", ["Dockerfile", ".devcontainer/devcontainer.json"])
def test_containers_install_the_solver_and_what_the_mesher_opens(file):
    assert set((ROOT / file).read_text(encoding="utf-8").split()) >= LIBRARIES - {"libgomp1"}
    assert "libgomp1" in (ROOT / file).read_text(encoding="utf-8")


def test_the_image_copies_existing_files_that_its_context_holds():
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    assert ignored[0] == "*"
    for line in re.findall(r"^COPY (.*)$", DOCKERFILE, flags=re.MULTILINE):
        for name in shlex.split(line)[:-1]:
            assert (ROOT / name).exists()
            assert f"!{name}" in ignored


def test_the_development_container_is_valid_json():
    container = json.loads((ROOT / ".devcontainer/devcontainer.json").read_text(encoding="utf-8"))
    assert "-c constraints.txt" in container["postCreateCommand"]


def test_the_source_archive_holds_what_these_tests_read():
    builds = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]
    sdist = builds["build"]["targets"].get("sdist", {})
    assert not {"include", "only-include", "exclude"} & set(sdist)


def test_the_workflow_may_read_the_repository_in_every_job():
    own = re.findall(r"^    permissions:\n((?:      .*\n)+)", WORKFLOW, flags=re.MULTILINE)
    assert own
    assert all("contents: read" in permissions for permissions in own)


def test_the_released_files_are_those_that_were_checked_and_installed():
    """Only the job `package` builds; `bare` and `release` get its files."""
    jobs = dict(
        re.findall(r"^  (\w+):\n((?:(?:    .*)?\n)+)", WORKFLOW.partition("jobs:")[2], re.M)
    )
    assert set(jobs) == {"check", "package", "bare", "release"}
    assert "nox -s release" in jobs["package"]
    assert re.search(r"upload-artifact@\S+\n\s+with: \{ name: dist, path: dist\b", jobs["package"])
    for name in ("bare", "release"):
        assert re.search(r"download-artifact@\S+\n\s+with: \{ name: dist, path: dist ", jobs[name])
        assert "package" in re.search(r"needs: (.*)", jobs[name])[1]
    assert "run:" not in jobs["release"] and "checkout" not in jobs["release"]
    assert "bare-${{ matrix.python }} -- dist" in jobs["bare"]


def test_the_workflow_runs_existing_sessions_and_names_no_secret():
    assert "secrets." not in WORKFLOW
    sessions = set(re.findall(r"^def (\w+)\(session", (ROOT / "noxfile.py").read_text(), re.M))
    named = set(re.findall(r"nox -s (\w+)", WORKFLOW))
    assert named
    assert named <= sessions
    assert (ROOT / ".ci/run").exists()
