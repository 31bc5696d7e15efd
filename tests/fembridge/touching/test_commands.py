"""The verbs touch and receptive-field as a user calls them."""

import json

import numpy as np
import pandas as pd
import pytest

from fembridge.cli import main


def run(capsys, *words):
    code = main([str(word) for word in words])
    return code, capsys.readouterr()


@pytest.mark.usefixtures("unrendered")
def test_a_picture_of_ones_own_is_scanned_and_leaves_tables_and_pictures(
    tmp_path, monkeypatch, capsys
):
    from matplotlib.image import imsave

    monkeypatch.setattr("fembridge.plots.touch_view.FRAMES", 2)
    imsave(tmp_path / "dot.png", np.pad(np.ones((6, 6)), 10), cmap="gray")
    code, printed = run(
        capsys, "touch", "--shape", tmp_path / "dot.png", "--pixel-mm", 0.25, "--slide-mm-per-s",
        40, "--duration-ms", 50, "--press-n", 0.2, "--population", "fingertip:density=0.2",
        "--animate", "short.gif", "--json", "-o", tmp_path / "out",
    )  # fmt: skip
    assert code == 0, printed.err
    summary, out = json.loads(printed.out), tmp_path / "out"
    assert summary["force_n"] == pytest.approx(0.2)
    assert set(summary["classes"]) == {"SA", "RA", "PC"}
    units = pd.read_csv(out / "population.csv")
    rates, spikes = pd.read_csv(out / "rates.csv"), pd.read_csv(out / "spikes.csv")
    assert list(units)[:5] == ["unit", "afferent", "x_mm", "z_mm", "depth_mm"]
    assert list(rates) == ["stimulus", "afferent", "unit", "rate_ips"]
    assert list(spikes) == ["stimulus", "afferent", "unit", "trial", "spike_time_ms"]
    assert list(rates["unit"]) == list(units["unit"])
    assert set(spikes["unit"]) <= set(units["unit"])
    assert pd.read_csv(out / "touch.csv")["force_n"].max() == pytest.approx(0.2)
    assert (out / "pad.png").is_file() and (out / "raster.png").is_file()
    assert (out / "short.gif").read_bytes().startswith(b"GIF8")


@pytest.mark.usefixtures("unrendered")
def test_receptive_field_writes_areas_and_maps(tmp_path, capsys):
    code, printed = run(
        capsys, "receptive-field", "--afferent", "SA,RA", "--depth-um", "100,300",
        "--step-mm", 1, "--units", 3, "-o", tmp_path,
    )  # fmt: skip
    assert code == 0, printed.err
    areas = pd.read_csv(tmp_path / "areas.csv")
    assert list(areas)[:3] == ["unit", "afferent", "times_threshold"]
    assert len(areas) == 2 * 3 * 3
    fields = pd.read_csv(tmp_path / "fields.csv")
    sizes = fields[fields["afferent"] == "RA"].groupby("unit").size()
    assert set(sizes.index) == {"RA1", "RA2", "RA3"} and (fields["impulses"] > 0).all()
    units = pd.read_csv(tmp_path / "units.csv")
    assert (units["threshold_mn"] > 0).all() and len(units) == 6
    summary = pd.read_csv(tmp_path / "summary.csv").set_index(["afferent", "quantity"])
    medians = units.groupby("afferent")["threshold_um"].median()
    for name in ("SA", "RA"):
        assert summary.loc[(name, "threshold_um"), "median"] == pytest.approx(medians[name])
    assert (tmp_path / "field_RA.png").is_file()


@pytest.mark.usefixtures("unrendered")
def test_files_of_two_touches_never_stand_side_by_side(tmp_path, capsys):
    words = ("touch", "--hold-ms", 20, "--population", "one_each", "-o", tmp_path)
    assert run(capsys, *words, "--press-um", 100)[0] == 0
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    (tmp_path / "raster.png").unlink()
    (tmp_path / "raster.png").mkdir()
    code, printed = run(capsys, *words, "--press-um", 200)
    assert code == 1 and "raster.png" in printed.err
    files = set(before) - {"raster.png"}
    assert all((tmp_path / name).read_bytes() == before[name] for name in files)
    (tmp_path / "raster.png").rmdir()
    assert run(capsys, *words, "--press-um", 200, "--no-plot")[0] == 0
    assert {path.name for path in tmp_path.iterdir()} == files - {"pad.png"}
    assert (tmp_path / "touch.csv").read_bytes() != before["touch.csv"]


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("touch", "--shape", "dot.png", "--press-um", "100", "--pixel-mm", "0.1"), "dot.png"),
        (("touch", "--press-um", "100", "--pad", "nobody"), "reference"),
        (("touch", "--press-um", "100", "--parameters", "nobody"), "fitted_pad"),
        (("touch", "--press-um", "100", "--animate", "way.avi"), ".gif or .mp4"),
        (("receptive-field", "--depth-um", "deep"), "deep"),
        (("receptive-field", "--pad", "plane"), "plane"),
        (("pad", "-o", "pad.txt"), ".npz"),
        (("pad", "--spacing-mm", "0"), {"argument": "--spacing-mm", "found": "0"}),
    ],
)
def test_misuse_gets_one_line(refused, words, named):
    refused(words, named)


@pytest.mark.slow
def test_a_grating_is_scanned_across_the_ridged_section(tmp_path, capsys):
    code, printed = run(
        capsys, "touch", "--pad", "plane", "--shape", "grating", "--angle-deg", 90,
        "--slide-mm-per-s", 40, "--direction-deg", 0, "--duration-ms", 100, "--press-um", 300,
        "--population", "line:along=x", "--json", "-o", tmp_path / "out",
    )  # fmt: skip
    assert code == 0, printed.err
    classes = json.loads(printed.out)["classes"]
    assert all(each["firing"] for each in classes.values())


def test_the_force_on_a_plane_pad_is_printed_by_millimetre(tmp_path, capsys):
    code, printed = run(
        capsys, "touch", "--pad", "plane", "--shape", "bar", "--press-n", 0.05,
        "--population", "one_each", "--no-plot", "-o", tmp_path,
    )  # fmt: skip
    assert code == 0, printed.err
    assert ", 0.05 N/mm\n" in printed.out


@pytest.mark.slow
@pytest.mark.solver
@pytest.mark.parametrize(
    ("words", "stored"),
    [(("--spacing-mm", 0.5), "reference"), (("--plane", "--spacing-mm", 0.25), "plane")],
)
def test_a_coarse_pad_made_here_presses_about_as_the_stored_one(tmp_path, capsys, words, stored):
    code, printed = run(capsys, "pad", *words, "--reach-mm", 2, "-o", tmp_path / "pad.npz")
    assert code == 0, printed.err
    forces = []
    for pad in (tmp_path / "pad.npz", stored):
        code, printed = run(
            capsys, "touch", "--shape", "punch:diameter_mm=2", "--press-um", 200, "--pad", pad,
            "--population", "one_each", "--no-plot", "--json", "-o", tmp_path / "out",
        )  # fmt: skip
        assert code == 0, printed.err
        forces.append(json.loads(printed.out)["force_n"])
    assert forces[0] == pytest.approx(forces[1], rel=0.1)
