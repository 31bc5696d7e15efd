"""``fembridge plot sensitivity``: from a sweep's table to a picture and its numbers."""

import csv
import json
from functools import partial

import numpy as np
import pandas as pd
import pytest

from fembridge.cli import main
from fembridge.plots.sensitivity import effects_figure
from fembridge.sensitivity import (
    OUTPUT,
    SweptFingers,
    rank_regressions,
    single_effects,
)
from fembridge.sweeps.fingers import Range, one_at_a_time

PNG = b"\x89PNG\r\n\x1a\n"
NAMES = ("skin.dermis_mm", "materials.dermis.young_mpa", "contact.friction")
BASE = dict(zip(NAMES, (1.0, 0.05, 0.4), strict=True))
RANGES = {name: Range(0.8 * value, 1.2 * value, False) for name, value in BASE.items()}
OUTPUTS = [
    (afferent, quantity, group)
    for quantity in ("rate_ips", "peak_stress_pa")
    for afferent in ("SA", "PC")
    for group in ("all", "sine_20")
]


def drawn():
    """Rows of 20 fingers in which all parameters are different."""
    shares = np.random.default_rng(1).random((20, len(NAMES))).tolist()
    return [{n: RANGES[n].at(x) for n, x in zip(NAMES, row, strict=True)} for row in shares]


def answers(row):
    """SA goes up with the dermis' modulus, PC never changes its rate."""
    share = [row[name] / BASE[name] for name in NAMES]
    sa = 20 * share[1] - 4 * share[0]
    return [sa, 2 * sa, 50, 50, 1000 * share[1], 900, 500 + 10 * share[0], 400]


def fingers(rows):
    columns = pd.MultiIndex.from_tuples(OUTPUTS, names=OUTPUT)
    return SweptFingers(pd.DataFrame(rows), pd.DataFrame(map(answers, rows), columns=columns))


@pytest.fixture
def results(tmp_path):
    """Tables as a sweep leaves them, of one design or the other."""

    def write(rows, *, failed=()):
        path = tmp_path / "results.csv"
        with path.open("w", newline="") as file:
            table = csv.writer(file)
            head = ["finger", *NAMES, "stimulus", "afferent", "rate_ips", "spikes"]
            table.writerow([*head, "peak_stress_pa", "status", "cause", "run"])
            for k, row in enumerate(rows):
                sa, _, pc, _, stress, _, deep, _ = answers(row)
                for afferent, rate, peak in (("SA", sa, stress), ("PC", pc, deep)):
                    begin = ["quick", *row.values(), "sine_20_250", afferent]
                    if k in failed:
                        table.writerow([*begin, "", "", "", "failed", "it broke", "x"])
                    else:
                        table.writerow([*begin, rate, 3, peak, "done", "", "x"])
        return path

    return write


def summary_of(capsys, *words):
    assert main(["plot", "sensitivity", *map(str, words), "--json"]) == 0
    said = capsys.readouterr()
    return json.loads(said.out), said.err


def test_one_at_a_time_is_known_by_its_table_and_drawn(results, tmp_path, capsys):
    picture, numbers = tmp_path / "s.png", tmp_path / "effects.csv"
    rows = one_at_a_time(BASE, RANGES)
    summary, _ = summary_of(capsys, results(rows), "-o", picture, "--table", numbers)

    assert picture.read_bytes().startswith(PNG)
    assert (summary["kind"], summary["fingers"]) == ("one-at-a-time", 7)
    assert summary["parameters"] == list(NAMES)
    one = next(
        each
        for each in summary["effects"]
        if (each["parameter"], each["afferent"], each["quantity"], each["stimuli"])
        == (NAMES[1], "SA", "rate_ips", "all")
    )
    assert one["change"] == pytest.approx(8.0)
    assert one["change_percent"] == pytest.approx(50.0)
    with numbers.open() as file:
        written = list(csv.DictReader(file))
    assert len(written) == len(summary["effects"]) == 3 * 2 * 2 * 2
    assert {row["monotone"] for row in written} == {"yes"}


@pytest.mark.usefixtures("unrendered")
def test_a_hypercube_is_ranked_and_its_summary_gives_the_same_again(
    results, tmp_path, capsys, monkeypatch
):
    few = partial(rank_regressions, resamples=50)
    monkeypatch.setattr("fembridge.sensitivity.rank_regressions", few)
    rows = drawn()
    first, again = tmp_path / "first.md", tmp_path / "again.md"
    short = tmp_path / "fingers.csv"
    out = ["-o", tmp_path / "s.svg"]
    summary, said = summary_of(
        capsys, results(rows, failed=[4]), *out, "--table", first, "--fingers", short
    )
    assert "a finger is left out: it broke" in said
    summary_of(capsys, short, *out, "--table", again)

    assert (summary["kind"], summary["fingers"]) == ("rank regression", 19)
    assert summary["left_out"] == 1
    assert first.read_text() == again.read_text()
    still = [e for e in summary["effects"] if e["afferent"] == "PC"]
    assert {e["coefficient"] for e in still if e["quantity"] == "rate_ips"} == {None}
    assert "no variation" in first.read_text()


def test_a_table_of_an_unknown_kind_is_refused_before_anything_is_written(results, refused):
    words = ["-o", "s.png", "--table", "effects.xls"]
    refused(
        ["plot", "sensitivity", results(one_at_a_time(BASE, RANGES)), *words],
        "effects.xls: expected .csv or .md",
    )


def test_the_picture_has_a_line_from_low_to_high_in_each_row():
    figure = effects_figure(single_effects(fingers(one_at_a_time(BASE, RANGES))))
    sa, pc, sa_stress, _ = figure.axes
    rows = [text.get_text() for text in sa.get_yticklabels()]
    assert rows == ["dermis modulus", "dermis thickness", "friction"]
    assert sa.get_title() == "SA"
    ends = [line.get_xdata() for line in sa.lines if len(line.get_xdata()) == 2]
    np.testing.assert_allclose(ends[:3], [[12, 20], [16.8, 15.2], [16, 16]])
    np.testing.assert_allclose(pc.lines[0].get_xdata(), [50, 50])
    assert sa_stress.get_xlabel() == "Mean peak stress (kPa)"
    assert sa.get_ylim() == (2.5, -0.5)
