"""The doctor, and how the solver is found."""

import importlib.metadata
import json
import re
import tomllib
from pathlib import Path

import pytest

from fembridge.cli import main
from fembridge.errors import MissingError
from fembridge.host import machine
from fembridge.host.machine import (
    PACKAGES,
    SOLVER_INSTALL_LINE,
    check_ccx,
    check_folder,
    check_gmsh,
    check_names,
    check_package,
    find_ccx,
)


@pytest.fixture
def bin_folder(tmp_path, monkeypatch):
    """Make an empty folder the whole PATH; gmsh is asked for below, in a process of its own."""
    monkeypatch.setattr(machine, "check_gmsh", lambda: machine.Check("gmsh", "ok", "4.13"))
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))
    monkeypatch.delenv("FEMBRIDGE_CCX", raising=False)
    return folder


def program(path, script="exit 0"):
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return path


def test_of_versioned_names_the_newest_is_taken_multithreaded_and_plain_ccx_before_them(
    bin_folder,
):
    for name in ("ccx_2.9", "ccx_2.21", "ccx_2.21_MT", "ccx_2.10_MT", "ccx_step.py"):
        program(bin_folder / name)
    (bin_folder / "ccx_2.99").write_text("not executable")
    assert find_ccx() == bin_folder / "ccx_2.21_MT"
    plain = program(bin_folder / "ccx")
    assert find_ccx() == plain


def test_the_variable_comes_before_the_path(bin_folder, tmp_path, monkeypatch):
    program(bin_folder / "ccx")
    other = program(tmp_path / "my_ccx")
    monkeypatch.setenv("FEMBRIDGE_CCX", str(other))
    assert find_ccx() == other
    named = program(bin_folder / "ccx_dev")
    monkeypatch.setenv("FEMBRIDGE_CCX", "ccx_dev")
    assert find_ccx() == named
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FEMBRIDGE_CCX", "./my_ccx")
    assert find_ccx().is_absolute()
    assert find_ccx().samefile(other)


def test_a_variable_that_names_no_program_is_not_passed_over(bin_folder, monkeypatch):
    program(bin_folder / "ccx")
    monkeypatch.setenv("FEMBRIDGE_CCX", "/no/such/ccx")
    with pytest.raises(MissingError, match="FEMBRIDGE_CCX is '/no/such/ccx'"):
        find_ccx()
    check = check_ccx()
    assert check.state == "note"
    assert "FEMBRIDGE_CCX" in check.remedy


def test_exit_201_is_a_healthy_answer_to_the_version_question(bin_folder):
    program(bin_folder / "ccx", 'printf "\\nThis is Version 2.20\\n\\n"; exit 201')
    check = check_ccx()
    assert check.state == "ok"
    assert check.finding == f"2.20, {bin_folder / 'ccx'}"


def test_a_solver_that_does_not_start_tells_why(bin_folder):
    program(bin_folder / "ccx", "echo 'libspooles.so.2.2: cannot open' >&2; exit 127")
    check = check_ccx()
    assert check.state == "note"
    assert "exit 127" in check.finding
    assert "libspooles.so.2.2" in check.finding
    (bin_folder / "ccx").write_bytes(b"\x7fELF nonsense")
    assert check_ccx().finding.startswith(str(bin_folder / "ccx"))


def test_without_a_solver_the_doctor_is_content_and_tells_the_line(bin_folder, capsys):
    assert main(["doctor"]) == 0
    out = capsys.readouterr().out
    assert re.search(r"^note +ccx +not found", out, re.MULTILINE)
    assert f"-> {SOLVER_INSTALL_LINE}" in out


def test_a_missing_need_is_exit_1_and_a_missing_extra_is_not(bin_folder, monkeypatch, capsys):
    monkeypatch.setitem(PACKAGES, "no-such-extra", ((1, 0), False, "nothing"))
    assert main(["doctor", "--json"]) == 0
    capsys.readouterr()
    monkeypatch.setitem(PACKAGES, "no-such-need", ((1, 0), True, "nothing"))
    assert main(["doctor", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["missing"] == ["no-such-need"]
    assert main(["doctor"]) == 1
    assert "pip install 'no-such-need>=1.0'" in capsys.readouterr().out


def test_a_package_that_is_too_old_is_said_with_both_versions(monkeypatch):
    for here, state in (("2.0.0", "ok"), ("2.0rc1", "ok"), ("1.25.9", "missing")):
        monkeypatch.setattr(importlib.metadata, "version", lambda name, here=here: here)
        assert check_package("numpy").state == state
    assert check_package("numpy").finding == "1.25.9, older than 2.0"


def test_the_doctor_asks_for_the_dependencies_that_the_project_declares():
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    declared = tomllib.loads(text)["project"]["dependencies"]
    asked = {f"{n}>={'.'.join(map(str, row[0]))}" for n, row in PACKAGES.items()}
    assert {line.split(";")[0].replace(" ", "") for line in declared} == asked


def test_gmsh_without_its_system_libraries_names_the_library_and_the_line(tmp_path, monkeypatch):
    reason = "libGLU.so.1: cannot open shared object file"
    (tmp_path / "gmsh.py").write_text(f"raise OSError({reason!r})\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    check = check_gmsh()
    assert check.state == "note"
    assert reason in check.finding
    assert SOLVER_INSTALL_LINE in check.remedy


def test_a_folder_is_tried_and_left_as_it_was(tmp_path, monkeypatch):
    monkeypatch.setattr(machine, "ROOM_GIB", 0.0)
    assert check_folder(tmp_path).state == "ok"
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setattr(machine, "ROOM_GIB", 1e9)
    assert "make room" in check_folder(tmp_path).remedy
    gone = check_folder(tmp_path / "gone")
    assert gone.state == "note"
    assert "No such file" in gone.finding


def test_a_distribution_with_a_package_of_the_same_name_is_named(monkeypatch):
    assert check_names().state == "ok"
    owners = {"neural": ["fembridge", "neural"], "decks": ["fembridge"], "numpy": ["numpy"]}
    monkeypatch.setattr(importlib.metadata, "packages_distributions", lambda: owners)
    check = check_names()
    assert check.state == "note"
    assert "neural is also a package of neural" in check.finding
    assert "decks" not in check.finding
