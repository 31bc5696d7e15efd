"""Which stress a post file gives, in which unit; recorded runs."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fembridge import read
from fembridge.errors import ResultError, UsageError
from fembridge.results.marc import read_displacement, read_stress_tensor
from fembridge.results.read_options import ReadOptions


def _sibling(name):
    found = importlib.util.spec_from_file_location(
        f"fembridge_test_{name}", Path(__file__).parent / f"{name}.py"
    )
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


models = _sibling("stress_models")
TIMES_S = (0.0, 0.0005, 0.001, 0.0015)


def linear_stress(x, y, layer, time_s):
    return [1e3 * time_s * (k + x - 2 * y) for k in range(6)]


def test_the_first_stress_tensor_there_is_is_taken_and_named(writer, write_post):
    nodes, quads = models.grid(1, 1)
    plane = models.Plane(11, nodes, quads)
    codes = tuple((341 + k, 0, "") for k in range(6))
    both = (*((311 + k, 0, "") for k in range(6)), *reversed(codes))

    def file(codes, values):
        element = [[values] * 4]
        increments = [writer.Increment(number=k, time_s=k * 1e-3, element=element) for k in (0, 1)]
        model = plane.model(writer, codes=codes)
        return write_post(writer.Storage(), model, increments)

    said = []
    options = ReadOptions(tell=said.append)
    only = read_stress_tensor(file(codes, [1, 2, 3, 4, 5, 6]), [1], options)[1]
    assert_allclose(only[0, 0], [1e6, 2e6, 3e6, 4e6, 5e6, 6e6])
    assert said[-1].startswith("stress: Cauchy Stress (codes 341 to 346)")
    mixed = file(both, [1, 2, 3, 4, 5, 6, 12, 11, 10, 9, 8, 7])
    found = read_stress_tensor(mixed, [1], options)[1]
    assert_allclose(found[0, 0], [7e6, 8e6, 9e6, 10e6, 11e6, 12e6])
    assert said[-1].startswith("stress: Cauchy Stress (codes 341 to 346)")
    plain = file(both[:6], [1, 2, 3, 4, 5, 6])
    assert_allclose(read_stress_tensor(plain, [1], options)[1][0, 0, 0], 1e6)
    assert said[-1].startswith("stress: Stress (codes 311 to 316)")
    single = file(tuple((11 + k, 0, "") for k in range(6)), [1, 2, 3, 4, 5, 6])
    assert_allclose(read_stress_tensor(single, [1], options)[1][0, 0, 5], 6e6)


@pytest.mark.parametrize(
    ("codes", "told"),
    [
        (((17, 0, ""),), "it holds Equivalent Von Mises Stress .code 17.; --von-mises"),
        (
            tuple((681 + k, 0, "") for k in range(6)),
            "it holds Logarithmic Strain .codes 681 to 686",
        ),
        (((7, 0, ""), (301, 0, "")), "no stress tensor .post code 311 or 341. in it"),
        (
            tuple((311 + k, layer, "") for layer in (1, 3) for k in range(6)),
            "code 311 is stored for layers 1, 3",
        ),
    ],
)
def test_a_file_without_one_stress_tensor_says_what_it_has(codes, told, writer, write_post):
    plane = models.Plane(11, *models.grid(1, 1))
    element = [[[1.0] * len(codes)] * 4]
    increments = [writer.Increment(number=0, element=element)]
    path = write_post(writer.Storage(), plane.model(writer, codes=codes), increments)
    with pytest.raises(ResultError, match=told):
        read_stress_tensor(path, [1])


def test_the_unit_of_the_file_scales_the_stress(writer, write_post):
    plane = models.Plane(11, *models.grid(1, 1))
    path = write_post(
        writer.Storage(), plane.model(writer), plane.increments(writer, linear_stress, TIMES_S)
    )
    mpa = read(path, [1])[0].stress_pa
    assert_allclose(read(path, [1], stress_unit="kPa")[0].stress_pa, mpa / 1e3)


def test_words_for_points_mean_nothing_to_nodal_files(samples_frd):
    with pytest.raises(UsageError, match="ccx-frd holds stress at nodes"):
        read(samples_frd, [11], extrapolate="average")
    with pytest.raises(UsageError, match="extrapolation 'cubic', expected linear"):
        ReadOptions(extrapolate="cubic")
    with pytest.raises(UsageError, match="von Mises of 'both', expected tensor"):
        ReadOptions(von_mises="both")


@pytest.fixture
def samples_frd(marc_samples):
    """A file of CalculiX."""
    return marc_samples.parent / "frd_samples" / "cpe4_ascii.frd"


def test_displacement_of_a_recorded_run_is_that_of_its_status_file(marc_samples):
    """Largest displacement of each increment, `.sts` of the same run."""
    path = marc_samples / "nour_plastic.t16"
    lines = path.with_suffix(".sts").read_text().splitlines()
    rows = [line.split() for line in lines if line[:1] == " " and len(line.split()) > 9]
    wanted = {int(r[1]): float(r[-1]) for r in rows if r[0].isdigit() and r[1].isdigit()}
    from fembridge.results.marc_format.post_file import PostFile

    with PostFile(path) as post:
        nodes = post.meshes[0].node_ids.tolist()
        numbers = [one.increment for one in post.increments]
    times_ms, moved_mm = read_displacement(path, nodes)
    assert moved_mm.shape == (24, 85, 3)
    assert times_ms[-1] == pytest.approx(1000.0)
    largest = np.linalg.norm(moved_mm, axis=2).max(axis=1)
    assert wanted
    for number, value in wanted.items():
        assert largest[numbers.index(number)] == pytest.approx(value, rel=1e-4)


def test_a_recorded_run_without_stress_says_what_it_holds(marc_samples):
    with pytest.raises(ResultError, match="holds Plastic Strain in Global System"):
        read(marc_samples / "nour_plastic.t16", [1])
    with pytest.raises(ResultError, match=r"no stress tensor .* it holds no elem"):
        read(marc_samples / "nour_linear.t16", [1])
