"""Deflection of the skin: profile, convergence, probe pressed in, verb, picture, page."""

import argparse
import csv
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from decks.presets import PAPER, QUICK, mesh_of
from fembridge.commands import deflect
from fembridge.errors import ResponseError
from fembridge.response import deflection as module
from fembridge.response.deflection import (
    COMPARED_MM,
    PAPER_STEP_MM,
    PROFILE_FILE,
    Deflection,
    build_press_folder,
    convergence,
    fold_sides,
    press_of,
    press_problem,
    press_stimulus,
    read_profile,
    richardson,
    solve_deflection,
    stored_deflection,
    stored_deflections,
    write_profile,
)
from fembridge.solver.settings import Solver

MESHES = stored_deflections()
STORED = {mesh.name: mesh for mesh in MESHES}
NODE_MM = np.array([0.0, 0.1, 0.4, 1.0, 2.5, 6.0])


def profile(**changes):
    fields = {
        "name": "µ-mesh",
        "elements": 3698,
        "distance_mm": NODE_MM,
        "deflection_mm": 1.0 - NODE_MM / 8,
        "depth_mm": 1.0,
        "loading_mm": np.array([0.0, 0.25, 1.0]),
        "loading_n_per_mm": np.array([0.0, 0.008, 0.035]),
        "origin": {"solver": "calculix", "finger": {"name": "µ-mesh"}},
    }
    return Deflection(**(fields | changes))


@pytest.mark.parametrize("distance_mm", [-0.01, 6.01, [0.0, 7.0], np.nan])
def test_beyond_its_ends_nothing_is_known(distance_mm):
    with pytest.raises(ResponseError, match=" 6 mm"):
        profile().at(np.array(distance_mm))


def test_a_profile_comes_back_from_its_file_bit_by_bit(tmp_path):
    made = profile(deflection_mm=np.sqrt(np.arange(6.0)) / 3)
    path = tmp_path / "deflection.toml"
    write_profile(path, made)
    found = read_profile(path)
    for name in ("distance_mm", "deflection_mm", "loading_mm", "loading_n_per_mm"):
        assert_array_equal(getattr(found, name), getattr(made, name))
    for name in ("name", "elements", "depth_mm", "origin"):
        assert getattr(found, name) == getattr(made, name)
    first = path.read_bytes()
    write_profile(path, found)
    assert path.read_bytes() == first


def mesh(elements, error):
    """A mesh whose deflection and force are wrong by `error` everywhere."""
    force = np.array([0.0, 0.01, 0.035 + error])
    down_mm = 1.0 - NODE_MM / 8 + error
    return profile(elements=elements, deflection_mm=down_mm, loading_n_per_mm=force)


@given(
    limit=st.floats(-2, 2),
    factor=st.floats(0.1, 5) | st.floats(-5, -0.1),
    order=st.floats(0.5, 4),
    ratios=st.tuples(st.floats(1.3, 3), st.floats(1.3, 3)),
)
def test_three_meshes_give_limit_and_order_of_a_power_law(limit, factor, order, ratios):
    width = np.array([ratios[0] * ratios[1], ratios[1], 1.0])
    found, found_order = richardson(width, limit + factor * width**order)
    assert_allclose(found_order, order, rtol=1e-6)
    assert_allclose(found, limit, rtol=1e-6, atol=1e-6 * abs(factor))


@pytest.mark.parametrize(
    "values",
    [
        pytest.param([1.0, 1.2, 1.1], id="from both sides"),
        pytest.param([1.0, 1.1, 1.5], id="ever faster"),
        pytest.param([1.0, 1.1, np.nan], id="no number"),
    ],
)
def test_values_that_do_not_close_in_have_no_limit(values):
    limit, order = richardson(np.array([4.0, 2.0, 1.0]), np.array(values))
    assert math.isnan(limit)
    assert math.isnan(order)


def test_the_table_has_the_distances_and_the_force_and_finds_the_limit_of_each():
    """Errors go with the width squared, so with one over the number of elements."""
    meshes = [mesh(count, error=30 / count) for count in (18000, 3000, 8000)]
    *down, force = convergence(meshes)
    names = [f"deflection_mm at {x_mm:g} mm" for x_mm in COMPARED_MM]
    assert [row["quantity"] for row in down] == names
    for row, distance_mm in zip(down, COMPARED_MM, strict=True):
        exact = 1 - distance_mm / 8
        assert_allclose(row["values"], [exact + 30 / n for n in (3000, 8000, 18000)])
        assert_allclose((row["limit"], row["order"]), (exact, 2.0), rtol=1e-6)
        change = 100 * (30 / 18000 - 30 / 8000) / (exact + 30 / 18000)
        assert_allclose(row["change_percent"], change)
    assert force["quantity"] == "force_n_per_mm"
    assert_allclose(force["limit"], 0.035, rtol=1e-6)


FORCE = np.linspace(0.0, 0.035, 41) ** 1.1


@pytest.mark.parametrize(
    ("apex_mm", "force", "found"),
    [
        (0.999, np.zeros(41), "0 N/mm"),
        (0.999, np.where(np.arange(41) == 7, np.nan, FORCE), "0.025"),
        (0.0, FORCE, "moved 0 mm"),
        (1.03, FORCE, "moved 1.03 mm"),
        (np.nan, FORCE, "moved nan mm"),
        (0.999, np.where(np.arange(41) == 30, 0.0, FORCE), "0.0176"),
    ],
)
def test_a_run_in_which_the_probe_did_not_push_is_refused(apex_mm, force, found):
    assert found in press_problem(1.0, apex_mm, force)
    assert press_problem(1.0, 0.999, FORCE) is None


@given(
    x_mm=st.lists(st.floats(0.01, 8), min_size=2, max_size=30, unique=True),
    slope=st.floats(-0.01, 0.01),
)
def test_folding_gives_the_even_part_and_tells_the_odd_part(x_mm, slope):
    """Of ``cos(x/8) + slope x`` the mean of both sides is the cosine alone."""
    right_mm = np.sort(x_mm)
    all_mm = np.concatenate([-right_mm[::-1], [0.0], right_mm])
    down_mm = np.cos(all_mm / 8) + slope * all_mm
    distance_mm, mean_mm, unlike_mm = fold_sides(all_mm, down_mm)
    assert_allclose(distance_mm, [0.0, *right_mm])
    assert_allclose(mean_mm, np.cos(distance_mm / 8), atol=1e-12)
    assert_allclose(unlike_mm, 2 * abs(slope) * right_mm[-1], rtol=1e-9, atol=1e-12)


@pytest.fixture(params=STORED)
def deflection(request):
    return STORED[request.param]


@pytest.mark.parametrize("finger", [QUICK, PAPER], ids=lambda finger: finger.name)
def test_those_of_the_presets_were_solved_on_the_meshes_that_we_ship(finger, tmp_path):
    found, press = STORED[finger.name], press_of(finger)
    run = build_press_folder(tmp_path, press, press_stimulus())
    assert found.elements == len(press.mesh.quad)
    for part, made_of in {**run.inputs, "deck_sha256": run.deck_sha256}.items():
        assert found.origin[part] == made_of, part


def test_the_skin_follows_the_probe_to_a_millimetre_and_the_force_grows(deflection):
    """Figure 2c: "the maximum skin surface deflection was approximately 1 mm"."""
    forces = deflection.loading_n_per_mm
    assert press_problem(1.0, float(deflection.at(0.0)), forces) is None
    assert_allclose(deflection.at(0.0), 1.0, atol=0.002)
    assert (np.diff(forces) > 0).all()
    assert deflection.deflection_mm.max() == deflection.deflection_mm[0]


def test_the_deflection_gradually_decreases_with_distance(deflection):
    """As Fig. 2c says, at the interval of the paper and at each node."""
    every_mm = np.arange(0.0, 6.0 + 1e-9, PAPER_STEP_MM)
    steps_mm = -np.diff(deflection.at(every_mm))
    assert (steps_mm > 0).all()
    assert steps_mm.max() < 0.15
    assert (np.diff(deflection.deflection_mm) < 0.0005).all()  # ridges tilt
    assert 0 < deflection.at(6.0) < 0.1


def test_the_uncertainty_covers_both_limits():
    """Of the force, and of the deflection 3 mm away, from the first and last three."""
    width = np.array([mesh.elements**-0.5 for mesh in MESHES])
    for values in (
        np.array([mesh.force_n_per_mm for mesh in MESHES]),
        np.array([float(mesh.at(3.0)) for mesh in MESHES]),
    ):
        first, _ = richardson(width[:3], values[:3])
        last, _ = richardson(width[1:], values[1:])
        assert not math.isnan(first + last)
        assert abs(first / last - 1) <= 0.005


@pytest.fixture
def call(tmp_path):
    """Run the verb with words, into a folder ``out``; give its summary."""

    def run(*words):
        parser = argparse.ArgumentParser()
        deflect.add_arguments(parser)
        parser.add_argument("--json", action="store_true")
        return deflect.run(parser.parse_args([*words, "-o", str(tmp_path / "out")]))

    return run


def table(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_without_options_all_stored_meshes_are_written_and_drawn(call, tmp_path):
    call()
    rows = table(tmp_path / "out" / "deflection.csv")
    assert list(rows[0]) == ["mesh", "distance_mm", "deflection_mm"]
    for mesh in MESHES:
        mine = [row for row in rows if row["mesh"] == mesh.name]
        distance_mm = np.array([float(row["distance_mm"]) for row in mine])
        deflection_mm = np.array([float(row["deflection_mm"]) for row in mine])
        assert_array_equal(distance_mm, mesh.distance_mm)
        assert_array_equal(deflection_mm, mesh.deflection_mm)
    assert len(rows) == sum(m.distance_mm.size for m in MESHES)
    assert (tmp_path / "out" / "deflection.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
@pytest.mark.solver
def test_the_coarsest_mesh_gives_again_what_is_stored(tmp_path):
    press = press_of(QUICK)
    solved = solve_deflection(tmp_path, press, settings=Solver(threads=1))
    stored = stored_deflection("quick")
    assert solved.origin["deck_sha256"] == stored.origin["deck_sha256"]
    assert_allclose(solved.deflection_mm, stored.deflection_mm, rtol=0, atol=1e-4)
    assert_allclose(solved.loading_n_per_mm, stored.loading_n_per_mm, rtol=0, atol=1e-5)
    written = read_profile(tmp_path / PROFILE_FILE)
    assert_allclose(written.deflection_mm, solved.deflection_mm, rtol=0, atol=0)

    before = (tmp_path / "job.frd").stat().st_mtime_ns
    again = solve_deflection(tmp_path, press, settings=Solver(threads=1))
    assert (tmp_path / "job.frd").stat().st_mtime_ns == before
    assert_allclose(again.deflection_mm, solved.deflection_mm, rtol=0, atol=0)


@pytest.mark.slow
@pytest.mark.solver
def test_in_a_finger_of_one_material_the_skin_goes_down_as_under_flamants_line_load(
    call, tmp_path, capsys, monkeypatch
):
    """``u(a) − u(b) = 2 P (1 − ν²)/(π E) ln(b/a)`` on a half plane, of a run of the command.

    Johnson, Contact Mechanics (1985), section 2.3. From 0.1 to 1 mm away the probe
    is thin, and bone and sides are far; ridges, they and a mesh refined once leave 5 %.
    """
    monkeypatch.setattr(module, "FINE_MM", module.FINE_MM[:1])
    monkeypatch.setattr(module, "STEPS", 10)
    young_mpa, poisson = 0.05, 0.40
    of_skin = ("stratum_corneum", "epidermis", "dermis", "subcutaneous_tissue")
    soft = f"young_mpa = {young_mpa}\npoisson = {poisson}\n"
    finger = "".join(f"[materials.{name}]\n{soft}" for name in of_skin)
    (tmp_path / "soft.toml").write_text(f"name = 'soft'\n{finger}", encoding="utf-8")
    summary = call(
        *("--solver", "run", "--finger", str(tmp_path / "soft.toml")),
        *("--depth-mm", "0.05", "--threads", "1"),
    )
    solved = read_profile(tmp_path / "out/run" / PROFILE_FILE)
    assert (summary["source"], summary["depth_mm"]) == ("solved", 0.05)
    assert summary["meshes"][0]["force_n_per_mm"] == solved.force_n_per_mm > 0
    rows = table(tmp_path / "out" / "deflection.csv")
    assert {row["mesh"] for row in rows} == {"soft"}
    assert_allclose(float(rows[0]["deflection_mm"]), 0.05, rtol=0.03)
    assert "stored differ" not in capsys.readouterr().err  # it is of another depth
    plane = 2 * (1 - poisson**2) / (math.pi * young_mpa)
    for near_mm, far_mm in ((0.1, 0.2), (0.25, 0.5), (0.5, 1.0)):
        found_mm = float(solved.at(near_mm) - solved.at(far_mm))
        flamant_mm = solved.force_n_per_mm * plane * math.log(far_mm / near_mm)
        assert_allclose(found_mm, flamant_mm, rtol=0.05)


@pytest.mark.slow
@pytest.mark.solver
def test_on_the_mesh_as_it_is_stored_the_probe_slips_and_the_run_is_refused(tmp_path):
    """CalculiX ends well there: at 1 mm, with no force and the skin at rest."""
    press = press_of(QUICK, mesh_of(QUICK))
    write_profile(tmp_path / PROFILE_FILE, stored_deflection("quick"))  # of before
    with pytest.raises(ResponseError, match=r"0\.95 to 1\.01"):
        solve_deflection(tmp_path, press, settings=Solver(threads=1))
    assert (tmp_path / "solver.toml").is_file()
    assert not (tmp_path / PROFILE_FILE).exists()


@pytest.mark.slow
def test_deflections_come_back_from_their_files_and_draw_into_axes(tmp_path):
    from matplotlib.figure import Figure

    import fembridge as fb

    made = fb.deflect(output=tmp_path / "first")
    read = fb.Deflections.read(tmp_path / "first")
    read.write(tmp_path / "second")
    assert read.table.equals(made.table)
    assert read.provenance == made.provenance
    for path in (tmp_path / "first").iterdir():
        assert path.read_bytes() == (tmp_path / "second" / path.name).read_bytes(), path.name
    panels = Figure().subplots(1, 3)
    assert made.plot(ax=panels) is panels[0].figure
    assert len(panels[0].lines) > len(made.meshes)  # dots and the axis besides
