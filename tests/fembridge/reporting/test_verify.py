"""`fembridge verify`: decks of the studies, stored runs, checks and the page."""

import argparse
import csv
import json
import math
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose
from pandas import DataFrame

from decks.finger import Material
from fembridge.cli import outputs_of
from fembridge.commands import verify as command
from fembridge.errors import MissingError, UsageError
from fembridge.reporting import pressed_finger
from fembridge.reporting import verify as module
from fembridge.reporting.map_and_transient import TransientComparison, finding_of
from fembridge.reporting.plane import PlaneProblem
from fembridge.reporting.verification_runs import (
    AT_LEAST,
    BoundCheck,
    Cost,
    Finding,
    Indented,
    Runs,
)
from fembridge.reporting.verify import (
    STUDIES,
    Verification,
    run_studies,
    studies_named,
    verification_of,
)
from fembridge.trace import StressTrace

VERSIONS = {"fembridge": "1.2", "CalculiX": "2.20"}


@pytest.fixture
def small_finding():
    """A finding with one check that passes and one that fails."""
    columns = ["element", "patch", "strain", "displacement_mm", "stress"]
    return Finding(
        checks=(
            BoundCheck("difference", 1.0, 1.5, "mm"),
            BoundCheck("ratio", 2.0, 3.0, side=AT_LEAST),
        ),
        tables={
            "patch": DataFrame(
                [("one", "a", "b", -0.012, 3.0), ("two", "a", "b", math.nan, 4.0)],
                columns=columns,
            )
        },
        figure=Figure(figsize=(1, 1)),
        cost=Cost(10, 23, 3.25),
    )


@pytest.fixture
def calls_of_patch(monkeypatch, small_finding):
    """Replace the function of `patch` by one that returns the small finding; its calls."""
    calls = []

    def study(runs):
        calls.append(runs)
        return small_finding

    patch, *others = STUDIES
    monkeypatch.setattr(module, "STUDIES", (replace(patch, function=study), *others))
    monkeypatch.setattr(module, "versions_here", lambda: VERSIONS)
    return calls


@pytest.mark.parametrize(
    ("value", "side", "passed"),
    [
        (1.0, "at most", True),
        (1.1, "at most", False),
        (0.9, AT_LEAST, False),
        (math.nan, AT_LEAST, False),
    ],
)
def test_a_check_passes_when_its_bound_is_kept_and_fails_for_nan(value, side, passed):
    check = BoundCheck("a", value, 1.0, side=side)
    assert check.passed == passed


def test_studies_are_in_page_order_with_unique_names():
    names = [study.name for study in STUDIES]
    assert len(set(names)) == len(names) == 9
    assert [s.name for s in studies_named(["laws", "patch"])] == ["patch", "laws"]
    assert studies_named(None) == STUDIES
    with pytest.raises(UsageError) as caught:
        studies_named(["patsch"])
    assert (caught.value.argument, caught.value.found) == ("only", "patsch")


def test_without_a_solver_the_error_has_the_command_that_installs_one(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "find_ccx", lambda: None)
    with pytest.raises(MissingError, match="apt-get"):
        command.run(arguments(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_a_study_reports_its_cost_and_writes_its_figure(calls_of_patch, tmp_path, small_finding):
    finding = run_studies(tmp_path, ["patch"], quick=True)["patch"]
    assert [runs.quick for runs in calls_of_patch] == [True]
    assert finding.checks == small_finding.checks
    assert finding.cost == Cost()  # no run of the solver
    assert [path.name for path in (tmp_path / "images").iterdir()] == ["verification_patch.png"]


def test_the_page_and_its_files_have_the_checks_and_the_numbers(small_finding, tmp_path):
    for folder in ("a", "b"):
        made = verification_of({"patch": small_finding}, VERSIONS, quick=False)
        made.write(tmp_path / folder)
    read = Verification.read(tmp_path / "a")
    assert read.summary == made.summary
    assert read.checks.equals(made.checks)
    assert read.page == made.page
    returned = made.summary
    page = (tmp_path / "a" / "verification.md").read_text(encoding="utf-8")
    link = "[1. Patch test](#1-patch-test)"
    for line in (
        f"| {link} | difference | 1 mm | ≤ 1.5 mm | ok |",
        f"| {link} | ratio | 2 | ≥ 3 | **fails** |",
        "| element | patch | strain | displacement (mm) | stress |",
        "| one | a | b | \N{MINUS SIGN}1.2e-02 | 3.0e+00 |",
        "| two | a | b | – | 4.0e+00 |",
        "fembridge verify --only patch",
    ):
        assert line in page.split("\n"), line
    assert "1 of 2" in page
    assert "10 increments, 23 iterations, 3 s" in page
    with (tmp_path / "a" / "tables" / "verification_patch.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[1:] == [["one", "a", "b", "-0.012", "3.0"], ["two", "a", "b", "", "4.0"]]
    summary = json.loads((tmp_path / "a" / "verification.json").read_text())
    assert summary == returned
    assert not summary["passed"]
    assert [check["passed"] for check in summary["studies"][0]["checks"]] == [True, False]
    for name in ("verification.md", "verification.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def arguments(folder, *options):
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    parser.add_argument("--json", action="store_true")
    return parser.parse_args([*options, "-o", str(folder)])


def test_a_check_that_fails_makes_the_exit_code_1(calls_of_patch, tmp_path, capsys):
    summary = command.run(arguments(tmp_path, "--only", "patch"))
    assert summary["exit_code"] == 1
    [line] = [line for line in capsys.readouterr().out.splitlines() if "ratio" in line]
    assert re.findall(r"\d+", line) == ["2", "3"]
    assert (tmp_path / "verification.md").is_file()


@pytest.mark.slow
@pytest.mark.solver
def test_the_cheapest_study_passes_and_reuses_its_complete_runs(tmp_path):
    """With the solver; then again after damage to a result file, as after a killed run."""
    summary = command.run(arguments(tmp_path, "--quick", "--only", "patch"))
    assert summary["exit_code"] == 0
    [study] = summary["studies"]
    assert study["increments"] == 45
    assert json.loads((tmp_path / "verification.json").read_text())["studies"] == [study]
    files = {"verification.md", "verification.json", "tables/verification_*.csv"}
    assert set(outputs_of("verify")) == files
    assert (tmp_path / "verification.md").is_file()
    assert (tmp_path / "tables/verification_patch.csv").is_file()

    runs = tmp_path / "runs" / "patch"
    before = {path: path.stat().st_mtime_ns for path in runs.glob("*/job.frd")}
    assert len(before) == 15
    damaged = runs / "CPE4_distorted_linear_small" / "job.frd"
    damaged.write_bytes(damaged.read_bytes()[:-100])
    finding = run_studies(tmp_path, ["patch"], quick=True)["patch"]
    assert all(check.passed for check in finding.checks)
    assert [p for p, ns in before.items() if p.stat().st_mtime_ns != ns] == [damaged]
    assert finding.tables["patch"]["strain"].nunique() == 3


def test_a_verification_without_a_single_check_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "versions_here", lambda: VERSIONS)
    monkeypatch.setattr("fembridge.reporting.plane.skfem_version", lambda: None)
    with pytest.raises(MissingError, match="scikit-fem"):
        module.verify(tmp_path, only=["solver"], jobs=1)
    assert not (tmp_path / module.PAGE_FILE).exists()


@pytest.mark.parametrize(
    ("quick", "skipped"), [(True, {"mesh"}), (False, {"mesh", "incompressible"})]
)
def test_without_gmsh_studies_that_mesh_fingers_are_skipped_and_the_others_run(
    calls_of_patch, tmp_path, monkeypatch, capsys, quick, skipped
):
    monkeypatch.setitem(sys.modules, "gmsh", None)  # as if it were not installed
    names = ["patch", "incompressible", "mesh"] if not quick else ["patch", "mesh"]
    options = ["--only", ",".join(names), "--jobs", "1", *(["--quick"] if quick else [])]
    summary = command.run(arguments(tmp_path, *options))
    reasons = {study["name"]: study["skipped"] for study in summary["studies"] if study["skipped"]}
    assert set(reasons) == skipped
    assert all("gmsh" in reason and "pip install" in reason for reason in reasons.values())
    assert len(calls_of_patch) == 1
    lines = capsys.readouterr().err.splitlines()
    assert lines[: len(skipped)] == [f"{name}: skipped: {reasons[name]}" for name in reasons]
    page = (tmp_path / module.PAGE_FILE).read_text(encoding="utf-8")
    assert page.count(f"Skipped: {reasons['mesh']}.") == len(skipped)


def test_a_verification_of_skipped_studies_alone_is_refused_at_once(
    tmp_path, monkeypatch, calls_of_patch
):
    monkeypatch.setitem(sys.modules, "gmsh", None)
    with pytest.raises(MissingError, match="gmsh"):
        module.verify(tmp_path, only=["mesh", "incompressible"])
    assert not (tmp_path / module.PAGE_FILE).exists()


@pytest.mark.slow
@pytest.mark.solver
def test_two_studies_at_a_time_are_in_order_and_agree_with_a_second_solver(tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    findings = run_studies(tmp_path, ["solver", "patch"], quick=True, jobs=2)
    assert list(findings) == ["patch", "solver"]
    assert findings["solver"].skipped or len(findings["solver"].checks) == 2
    assert all(check.passed for finding in findings.values() for check in finding.checks)
    assert not list(tmp_path.glob(".*"))


@pytest.mark.slow
@pytest.mark.solver
def test_a_cylinder_on_a_block_has_the_contact_and_the_stress_of_hertz(tmp_path):
    finding = run_studies(tmp_path, ["hertz"], quick=True)["hertz"]
    assert [check.passed for check in finding.checks] == [True] * 4


def indented(stress_pa, force_n_per_mm):
    """Result of `indent` with a made-up stress ``(T, afferent)`` and force."""
    depth_um = np.linspace(0, 400, len(stress_pa))
    cost = Cost(4, 9, 1.0)
    return Indented(100, depth_um, stress_pa, force_n_per_mm, 0.9 * depth_um, 1, cost)


def test_springs_in_series_are_extrapolated_to_rigid_contact(monkeypatch, tmp_path):
    """Stress of 1000 (1 - 5/K) Pa: the loss at 200 MPa/mm is 2.5 %."""

    def indent(runs, name, model):
        loss = 5 / model.contact.stiffness_mpa_per_mm
        return indented(1000 * (1 - loss) * np.array([[0, 0, 0], [3.0, 2.0, 1.0]]), np.ones(2))

    monkeypatch.setattr(pressed_finger, "indent", indent)
    finding = pressed_finger.stiffness(Runs(tmp_path, quick=True))
    assert_allclose(finding.checks[0].value, 2.5)
    assert_allclose(list(finding.tables["penalty"].SA[:-1]), [2.7, 2.85, 2.925, 2.9625])
    assert_allclose(finding.tables["penalty"].iloc[-1, 1:4].astype(float), [3, 2, 1])
    page = module.page_text({"penalty": finding}, VERSIONS, quick=True)
    assert "| limit | 3.000 | 2.000 | 1.0000 | 0.00 |" in page


def test_laws_that_differ_in_proportion_to_depth_are_equal_at_rest(monkeypatch, tmp_path):
    """A neo-Hookean finger that is 0.9, 2 and 4 % softer every 50 um, its force 1 % stiffer."""

    def indent(runs, name, model, stimulus, *, law):
        steps = np.arange(stimulus.displacement_um.size)[:, None]
        share = -np.array([0.009, 0.02, 0.04]) * steps if law == "neo-hookean" else 0
        off = 1 + 0.01 * steps[:, 0] if law == "neo-hookean" else 1
        return indented(1000.0 * steps * (1 + share * np.ones(3)), steps[:, 0] * off)

    monkeypatch.setattr(pressed_finger, "indent", indent)
    finding = pressed_finger.laws(Runs(tmp_path, quick=True))
    assert_allclose(finding.checks[0].value, 0, atol=1e-9)
    assert finding.numbers["large_difference_from_um"] == {"SA": 300.0, "RA": 150.0, "PC": 100.0}
    assert_allclose(finding.tables["laws"].PC_percent, [-4, -8, -16, -24, -32])
    assert_allclose(finding.tables["laws"].force_percent, [1, 2, 4, 6, 8])
    page = module.page_text({"laws": finding}, VERSIONS, quick=True)
    assert all(
        f"{name} from {um} µm" in page for name, um in (("SA", 300), ("RA", 150), ("PC", 100))
    )


def test_a_deck_has_each_element_s_material_and_the_prescribed_displacements():
    corners, elements = [(x, y) for y in (0, 1) for x in (0, 1, 2)], [[0, 1, 4, 3], [1, 2, 5, 4]]
    deck = PlaneProblem(
        kind="CPE4",
        node_mm=np.array(corners, dtype=float),
        element=np.array(elements),
        materials=(Material(1.0, 0.3), Material(2.0, 0.25)),
        element_material=np.array([1, 0]),
        moved=np.array([0, 5]),
        moved_mm=np.array([[0.0, np.nan], [0.25, -0.5]]),
    ).deck()
    soft, hard = deck.split("*ELEMENT, ")[1:3]
    assert "\n2, 2, 3, 6, 5\n" in soft and "*ELASTIC\n1.0, 0.3\n" in soft
    assert "\n1, 1, 2, 5, 4\n" in hard and "*ELASTIC\n2.0, 0.25\n" in hard
    assert "*BOUNDARY\n1, 1, 1, 0.0\n6, 1, 1, 0.25\n6, 2, 2, -0.5\n*" in deck


@pytest.fixture
def compared():
    stress_pa = np.array([0.0, 100.0, 200.0, 100.0])
    traces = [StressTrace(stress_pa, 0.5, 3, name) for name in ("SA", "RA", "PC")]
    row = {"finger": "`quick`", "stimulus": "`diharm_10_50_125`", "held_um": 0.0}
    row |= {"solved_ms": 1.5, "SA_stress": 0.01, "RA_stress": 0.3, "PC_stress": 0.02}
    row |= {"SA_drive": 0.1, "RA_drive": 0.2, "PC_drive": 0.75, "spikes": 120, "equal": 119}
    row |= {"different": 2, "iterations": 6, "cpu_s": 1.5, "contact": "node-to-surface"}
    return TransientComparison(row, Cost(3, 6, 1.5), (traces, traces))


MAPS = {"quick": (Cost(39, 80, 19.0), 1.0)}


def test_checks_use_the_largest_errors_and_all_different_spikes(compared):
    """119 of 121 spikes are in both trains; each train lacks one."""
    other = {**compared.row, "SA_stress": 0.4, "spikes": 0, "equal": 0, "different": 0}
    finding = finding_of([compared, replace(compared, row=other)], MAPS)
    trace, drive, equal_share = finding.checks[:3]
    assert (trace.value, drive.value) == (0.4, 0.75)
    assert_allclose(equal_share.value, 100 * 119 / 121)
    assert [check.passed for check in finding.checks[:3]] == [False, True, False]
    page = module.page_text({"map": finding}, VERSIONS, quick=False)
    assert "1.5 ms on `quick`" in page
