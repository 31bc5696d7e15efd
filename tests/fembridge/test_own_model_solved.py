"""Decks as their owners have them, from build-deck through ccx to spikes, without an edit."""

import csv
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import fembridge as fb
from fembridge.cli import main
from fembridge.results.source import read_values
from fembridge.run_folder import read_run_folder

moved_at = partial(read_values, quantity="displacement")


pytestmark = pytest.mark.solver

RUN = "runs/wave"
TIMES_MS = np.arange(0.0, 60.5, 0.5)
WAVE_UM = 100 * np.sin(2 * np.pi * 50e-3 * TIMES_MS)


def plane_of(wide, high, cell, first, *, x=0.0, y=0.0):
    """Nodes ``{number: (x, y)}`` and quads of a grid, numbered from `first`."""
    nodes = {
        first + row * (wide + 1) + column: (x + column * cell, y + row * cell)
        for row in range(high + 1)
        for column in range(wide + 1)
    }
    quads = [
        (low, low + 1, low + wide + 2, low + wide + 1)
        for row in range(high)
        for low in range(first + row * (wide + 1), first + row * (wide + 1) + wide)
    ]
    return nodes, quads


# ---- PrePoMax: solids in metres, a punch that is rigid by a reference point, hard contact,
# increments and ramp by default, no amplitude

WIDE, HIGH, CELL_M = 6, 4, 0.0005
PUNCH, LAYER, POINT = 1000, 500, 2001
SKIN_NODE = 25  # in the middle, one element under the skin


def section(title):
    return ["**", f"** {title} ".ljust(60, "+"), "**"]


def prepomax():
    skin, quads = plane_of(WIDE, HIGH, CELL_M, 1)
    punch, bits = plane_of(2, 1, 1.3 * CELL_M, PUNCH, x=1.7 * CELL_M, y=HIGH * CELL_M)
    both = {**skin, **punch}
    solid = [(*quad, *(node + LAYER for node in quad)) for quad in (*quads, *bits)]
    layers = [(z, k) for z, k in ((0.0, 0), (CELL_M, LAYER))]
    top = [HIGH * (WIDE + 1) + k + 1 for k in range(WIDE + 1)]
    yield from (*section("Heading"), "*Heading")
    yield "Hash: 9X2bQ7Kd, Date: 03/14/2024, Unit system: M_KG_S_C"
    yield from (*section("Nodes"), "*Node")
    for z, shift in layers:
        yield from (f"{k + shift}, {x:.8E}, {y:.8E}, {z:.8E}" for k, (x, y) in both.items())
    yield from (f"{POINT + k}, 1.50000000E-003, 3.0E-003, 2.50000000E-004" for k in (0, 1))
    yield from (*section("Elements"), "*Element, Type=C3D8, Elset=Solid_part-1")
    yield from (f"{k}, {', '.join(map(str, nodes))}" for k, nodes in enumerate(solid, 1))
    yield from section("Node sets")
    for name, some in (
        ("Base", [k + shift for _, shift in layers for k in range(1, WIDE + 2)]),
        ("Flat", [k + shift for _, shift in layers for k in skin]),
        ("Skin", [k + shift for _, shift in layers for k in top]),
        ("Punch", [k + shift for _, shift in layers for k in punch]),
    ):
        yield f"*Nset, Nset={name}"
        for start in range(0, len(some), 16):
            yield ", ".join(map(str, some[start : start + 16])) + ","
    yield from (*section("Surfaces"), "*Surface, Name=Slave, Type=Node", "Skin")
    first = WIDE * HIGH + 1
    yield from ("*Surface, Name=Master, Type=Element", f"{first}, S3", f"{first + 1}, S3")
    yield from (*section("Materials"), "*Material, Name=Soft", "*Elastic", "2000000, 0.4")
    yield from (*section("Sections"), "*Solid section, Elset=Solid_part-1, Material=Soft")
    yield from section("Constraints")
    yield f"*Rigid body, Nset=Punch, Ref node={POINT}, Rot node={POINT + 1}"
    yield from (*section("Surface interactions"), "*Surface interaction, Name=Touch")
    yield from ("*Surface behavior, Pressure-overclosure=Hard",)
    yield from (*section("Contact pairs"),)
    yield "*Contact pair, Interaction=Touch, Type=Node to surface"
    yield "Slave, Master"
    yield from (*section("Steps"), *section("Step-1"), "*Step, Nlgeom, Inc=100")
    yield from ("*Static, Solver=Pardiso", "0.1, 1, 1E-05, 1E+30")
    yield from (*section("Output frequency"), "*Output, Frequency=1")
    yield from (*section("Boundary conditions"), "*Boundary, op=New", "** Name: Fixed-1")
    yield from ("*Boundary", "Base, 1, 6, 0", "** Name: Plane", "*Boundary", "Flat, 3, 3, 0")
    yield from ("** Name: Press", "*Boundary", f"{POINT}, 1, 1, 0", f"{POINT}, 2, 2, -0.0002")
    yield from (f"{POINT}, 3, 3, 0", f"{POINT + 1}, 1, 3, 0")
    yield from (*section("Loads"), "*Cload, op=New", "*Dload, op=New")
    yield from (*section("Field outputs"), "*Node file", "RF, U", "*El file", "S, E, NOE")
    yield from (*section("End step"), "*End step")


# ---- Axisymmetric, in mm, pre-indented in a step of its own, then an amplitude

RINGS, DEEP, CELL_MM, PROBE = 6, 4, 0.5, 1000
UNDER = 2 + RINGS  # 0.5 mm off the axis is 2; a row up


def axisymmetric(curve="0., 3., 0.01, 3.3, 0.02, 3.", between="*STATIC\n0.05, 1.", deep="-0.3"):
    skin, quads = plane_of(RINGS, DEEP, CELL_MM, 1)
    probe, bits = plane_of(2, 1, 1.3 * CELL_MM, PROBE, y=DEEP * CELL_MM)
    yield from ("*HEADING", "finger pad under a flat pin, mm N s", "*NODE, NSET=NALL")
    yield from (f"{k}, {x:g}, {y:g}, 0." for k, (x, y) in {**skin, **probe}.items())
    yield "*ELEMENT, TYPE=CAX4, ELSET=PAD"
    yield from (f"{k}, {', '.join(map(str, quad))}" for k, quad in enumerate(quads, 1))
    yield "*ELEMENT, TYPE=CAX4, ELSET=PIN"
    yield from (f"{k}, {', '.join(map(str, quad))}" for k, quad in enumerate(bits, 101))
    yield from ("*NSET, NSET=BASE, GENERATE", f"1, {RINGS + 1}")
    yield from ("*NSET, NSET=AXIS, GENERATE", f"1, {DEEP * (RINGS + 1) + 1}, {RINGS + 1}")
    yield from ("*NSET, NSET=PIN", ", ".join(map(str, probe)) + ",")
    yield from ("*NSET, NSET=TOP, GENERATE", f"{DEEP * (RINGS + 1) + 1}, {len(skin)}")
    yield from ("*SURFACE, NAME=S, TYPE=NODE", "TOP")
    yield from ("*SURFACE, NAME=M, TYPE=ELEMENT", "101, S1", "102, S1")
    yield from ("*MATERIAL, NAME=SOFT", "*ELASTIC", "0.5, 0.4")
    yield from (
        "*SOLID SECTION, ELSET=PAD, MATERIAL=SOFT",
        "*SOLID SECTION, ELSET=PIN, MATERIAL=SOFT",
    )
    yield from ("*SURFACE INTERACTION, NAME=I", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR")
    yield from ("100., 0.001", "*CONTACT PAIR, INTERACTION=I, TYPE=NODE TO SURFACE", "S, M")
    yield from ("*AMPLITUDE, NAME=VIB", curve)
    yield from ("*STEP, NLGEOM", *between.splitlines(), "*BOUNDARY", "BASE, 1, 2", "AXIS, 1, 1")
    yield from ("PIN, 1, 1", f"PIN, 2, 2, {deep}", "*NODE FILE", "U", "*EL FILE", "S", "*END STEP")
    yield from ("*STEP, NLGEOM", "*STATIC", "0.001, 0.02", "*BOUNDARY, AMPLITUDE=VIB")
    yield from ("PIN, 2, 2, -0.1", "*NODE FILE", "U", "*EL FILE", "S", "*END STEP")


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    return tmp_path


def build(here, lines, *options):
    rows = np.column_stack([TIMES_MS, WAVE_UM])
    np.savetxt("wave.csv", rows, "%.17g", ",", header="time_ms,displacement_um", comments="")
    (here / "mine.inp").write_text("\n".join([*lines, ""]))
    words = ["build-deck", "--base-deck", "mine.inp", "--stimulus", "wave.csv", "-o", "runs"]
    assert main([*words, *options]) == 0


def spikes_of(here, lines, *options):
    """Build, run, ingest and encode: the classes that fire."""
    build(here, lines, *options)
    assert main(["run", RUN, "--no-cache"]) == 0
    assert main(["ingest", RUN, "-o", "traces.csv"]) == 0
    assert main(["encode", "traces.csv", "-o", "out"]) == 0
    lines = (here / "out/spikes.csv").read_text().splitlines()
    return {row["afferent"] for row in csv.DictReader(lines)}


def depth_um(probe, unit_um):
    """The probe's way into the skin, along -y, as ccx wrote it; the start is not in it."""
    _, moved = moved_at(Path(RUN, "job.frd"), [probe])
    return -unit_um * moved[-(len(WAVE_UM) - 1) :, 0, 1]


def test_a_deck_of_prepomax_goes_through_to_spikes(here, capsys):
    found = spikes_of(
        here,
        prepomax(),
        *("--move", f"{POINT},2", "--increments", "automatic"),
        *("--afferent", f"RA={SKIN_NODE}", "--frames", "1"),
    )
    said = capsys.readouterr().err
    assert "unit system M_KG_S_C" in said
    assert "NLGEOM" not in said
    # named before the run and after it, which is taken: hard contact has a default stiffness
    assert "mine.inp: CalculiX warns: reading *SURFACE BEHAVIOR: K must" in said
    assert f"{RUN}: CalculiX warned: reading *SURFACE BEHAVIOR: K must" in said
    assert found == {"RA"}
    assert_allclose(depth_um(PUNCH, 1e6), WAVE_UM[1:], atol=1e-6)
    (trace,) = fb.read(RUN)
    assert trace.stress_pa.max() > 1e3
    (place,) = read_run_folder(here / RUN).afferents
    assert_allclose((place.x_mm, place.y_mm, place.z_mm), (1.5, 1.5, 0.0), atol=1e-12)


AUTOMATIC = ("--afferent", f"SA={UNDER}", "--frames", "1", "--increments", "automatic")


@pytest.mark.slow
def test_an_axisymmetric_model_keeps_its_pre_indentation(here):
    assert spikes_of(here, axisymmetric(), *AUTOMATIC) == {"SA"}
    assert_allclose(depth_um(PROBE, 1e3), 300.0 + WAVE_UM[1:], atol=1e-6)
    (trace,) = fb.read(RUN)
    assert_allclose(trace.stress_pa[0], trace.stress_pa[40], rtol=0.02)  # a cycle later


@pytest.mark.slow
def test_what_fixed_increments_do_not_solve_automatic_ones_do(here, capsys):
    build(here, axisymmetric(), "--afferent", f"SA={UNDER}")
    assert main(["run", RUN, "--no-cache"]) == 1
    assert "did not converge" in (said := capsys.readouterr().err)
    assert "build-deck --increments automatic" in said
    spikes_of(here, axisymmetric(), *AUTOMATIC)
    times_ms, _ = moved_at(here / RUN / "job.frd", [PROBE])
    assert_allclose(times_ms[-120:], 1000.5 + TIMES_MS[:-1], rtol=1e-9)


@pytest.mark.slow
def test_a_ramp_to_a_pre_indentation_begins_where_the_probe_stands(here):
    spikes_of(here, axisymmetric(), *AUTOMATIC, "--preindent-um", "50")
    _, moved = moved_at(here / RUN / "job.frd", [PROBE])
    ramp_um = -1e3 * moved[-(len(WAVE_UM) + 20) : -(len(WAVE_UM) - 1), 0, 1]
    assert_allclose(ramp_um, 300 + 2.5 * np.arange(21), atol=1e-6)
    assert_allclose(depth_um(PROBE, 1e3), 350.0 + WAVE_UM[1:], atol=1e-6)


@pytest.mark.slow
def test_a_line_that_ccx_cannot_read_is_said_and_the_run_taken(here, capsys):
    lines = [*axisymmetric()]
    lines.insert(lines.index("*STEP, NLGEOM") + 1, "press it in")
    spikes_of(here, lines, *AUTOMATIC)
    said = capsys.readouterr().err
    line = lines.index("press it in") + 1
    assert f"mine.inp: line {line}: CalculiX warns: " in said
    assert "CalculiX warned: in calinput. Card image cannot be interpreted [PRESSITIN]" in said
