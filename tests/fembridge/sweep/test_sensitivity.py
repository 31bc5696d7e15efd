"""Sensitivity: sweeps' tables as fingers, one parameter at a time, ranks; their picture."""

import json
import math
import warnings
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fembridge.cli import main
from fembridge.errors import TableError, UsageError
from fembridge.io.formatting import number, split_unit
from fembridge.plots.sensitivity_charts import effects_figure
from fembridge.sensitivity.effects import (
    OUTPUT,
    SweptFingers,
    find_base,
    is_one_at_a_time,
    ordered_parameters,
    rank_regressions,
    read_swept,
    single_effects,
)
from fembridge.sensitivity.wording import effects_markdown, regressions_markdown
from fembridge.sweeps import read_study
from fembridge.sweeps.fingers import Interval, one_at_a_time

GROUPS = ("all", "sine_20", "noise")
HEADER = (
    "finger,skin.dermis_mm,contact.friction,probe_x_mm,method,"
    "stimulus,afferent,rate_ips,spikes,peak_stress_pa,status,cause,run\n"
)


@pytest.fixture
def results(tmp_path):
    def write(*rows):
        path = tmp_path / "results.csv"
        path.write_text(HEADER + "".join(f"{row}\n" for row in rows))
        return path

    return write


def row(dermis, stimulus, rate, stress, afferent="SA", status="done,", friction=0.4):
    begin = f"quick,{dermis},{friction},0.0,map,{stimulus},{afferent}"
    return f"{begin},{rate},3,{stress},{status},runs/x"


def test_a_finger_is_what_stands_before_the_stimulus_and_constants_are_left_out(results):
    swept = read_swept(
        results(
            row(1.0, "sine_20_250", 10, 5000),
            row(1.0, "sine_20_125", 4, 3000),
            row(1.0, "noise_25_250_10", 1, 1000),
            row(1.2, "sine_20_250", 20, 6000),
            row(1.2, "sine_20_125", 6, 4000),
            row(1.2, "noise_25_250_10", 4, 2000),
        )
    )

    assert swept.parameters.to_dict("list") == {"skin.dermis_mm": [1.0, 1.2]}
    rates = {group: swept.answers["SA", "rate_ips", group].tolist() for group in GROUPS}
    assert rates == {"all": [5, 10], "sine_20": [7, 13], "noise": [1, 4]}
    assert swept.answers["SA", "peak_stress_pa", "sine_20"].tolist() == [4000, 5000]
    assert tuple(swept.answers.columns.unique("stimuli")) == GROUPS


def test_a_finger_of_which_anything_failed_is_left_out_and_its_cause_kept(results):
    swept = read_swept(
        results(
            row(1.0, "sine_20_250", 10, 5000),
            row(1.0, "sine_50_250", 10, 5000),
            row(1.1, "sine_20_250", 11, 5000),
            row(1.1, "sine_50_250", "", "", status="failed,it diverged"),
            row(1.2, "sine_20_250", 12, 5000),
            row(1.2, "sine_50_250", 12, 5000),
        )
    )

    np.testing.assert_array_equal(swept.parameters["skin.dermis_mm"], [1.0, 1.2])
    assert swept.causes == ("it diverged",)


ONE, OTHER = row(1.0, "sine_20_250", 1, 1), row(1.1, "sine_20_250", 2, 1)


@pytest.mark.parametrize(
    ("error", "rows", "found"),
    [
        (UsageError, [], "fingers: 0,"),
        (UsageError, [ONE], "fingers: 1,"),
        (UsageError, [ONE, row(1.1, "sine_20_250", "", "", status="failed,x")], "fingers: 1,"),
        (TableError, [ONE, row(1.0, "sine_20_250", 2, 1)], "csv:3: .*sine_20_250, SA"),
        (TableError, [ONE, row(1.1, "sine_50_250", 2, 1)], "sine_.*SA "),
        (
            TableError,
            [ONE.replace("1.0", "thin"), OTHER.replace("1.1", "thick")],
            "'thin', 'thick'",
        ),
        (TableError, [ONE, row("", "sine_20_250", 2, 1)], "dermis_mm is '1.0', ''"),
        (TableError, [ONE, row("1_1", "sine_20_250", 2, 1)], "dermis_mm is '1.0', '1_1'"),
        (TableError, [row(1.0, "sine_20_250", "nan", 1), OTHER], "rate_ips is 'nan'"),
        (TableError, [row(1.0, "sine_20_250", 1, 1, status="odd,")], "status is 'odd'"),
    ],
)
def test_what_is_no_table_of_two_fingers_or_more_is_refused(results, error, rows, found):
    with pytest.raises(error, match=found):
        read_swept(results(*rows))


RATE, STRESS = ("SA", "rate_ips", "all"), ("SA", "peak_stress_pa", "all")


def fingers(value, *answers, outputs=(RATE, STRESS)):
    """Fingers of `value`, rows of parameters, with a column of `answers` an output."""
    value = pd.DataFrame(value)
    columns = pd.MultiIndex.from_tuples(outputs[: len(answers)], names=OUTPUT)
    return SweptFingers(value, pd.DataFrame(np.stack(answers, axis=1), columns=columns))


@settings(settings.get_profile("costly"))
@given(slopes=st.lists(st.floats(-5, 5), min_size=2, max_size=5), half=st.floats(0.01, 0.5))
def test_the_change_of_a_linear_answer_is_slope_times_range(slopes, half):
    base = {f"p{k}": 1.0 for k in range(len(slopes))}
    rows = one_at_a_time(base, {name: Interval(1 - half, 1 + half) for name in base})
    answers = np.array([np.dot(slopes, list(row.values())) for row in rows])

    swept = fingers(rows, answers)

    assert is_one_at_a_time(swept)
    effects = single_effects(swept)
    assert effects["parameter"].tolist() == list(base)
    for effect, slope in zip(effects.itertuples(), slopes, strict=True):
        assert (effect.low, effect.high) == (rows[1]["p0"], rows[2]["p0"])
        assert effect.change == pytest.approx(slope * (effect.high - effect.low), abs=1e-9)
        assert effect.at_base == answers[0]
        if answers[0]:
            assert effect.change_percent == pytest.approx(100 * effect.change / answers[0])


@settings(settings.get_profile("costly"))
@given(order=st.permutations(range(5)))
def test_the_base_is_found_wherever_its_row_stands(order):
    rows = one_at_a_time({"p": 1.0, "q": 1.0}, {"p": Interval(0, 2), "q": Interval(0, 2)})
    answers = np.array([5.0, 3.0, 8.0, 4.0, 6.0])
    swept = fingers([rows[k] for k in order], answers[list(order)])
    effects = single_effects(swept)
    assert find_base(swept) == order.index(0)
    assert effects[["at_low", "at_base", "at_high"]].to_numpy().tolist() == [[3, 5, 8], [4, 5, 6]]


def test_no_finger_of_a_single_parameter_is_called_the_base():
    """Any of three could be what the other two were varied from."""
    swept = fingers([{"p": 1.0}, {"p": 0.0}, {"p": 2.0}], np.array([20.0, 10.0, 30.0]))
    assert is_one_at_a_time(swept)
    assert find_base(swept) is None
    [effect] = single_effects(swept).to_dict("records")
    assert math.isnan(effect["base"])
    assert math.isnan(effect["at_base"])
    assert (effect["at_low"], effect["at_high"]) == (10.0, 30.0)
    assert effect["change_percent"] == 200.0  # of the answer at the low value
    assert "(20" not in effects_markdown(single_effects(swept)).splitlines()[2]


def test_an_answer_that_comes_back_is_not_monotone_though_the_change_is_0():
    rows = one_at_a_time({"p": 1.0, "q": 1.0}, {"p": Interval(0, 2), "q": Interval(0, 2)})
    effects = single_effects(fingers(rows, np.array([5.0, 3.0, 3.0, 4.0, 5.0])))
    assert effects["change"].tolist() == [0.0, 1.0]
    assert effects["monotone"].tolist() == [False, True]


def test_more_than_two_levels_are_compared_from_end_to_end():
    rows = [{"p": 2.0, "q": 0.0}, *({"p": x, "q": 0.0} for x in (4.0, 1.0, 3.0))]
    rows.append({"p": 2.0, "q": 1.0})
    effect = single_effects(fingers(rows, np.array([20.0, 41.0, 9.0, 30.0, 20.0]))).iloc[0]
    assert effect[["low", "base", "high"]].tolist() == [1.0, 2.0, 4.0]
    assert effect[["at_low", "at_base", "at_high"]].tolist() == [9, 20, 41]
    assert effect["monotone"]


def test_a_silent_base_has_no_percentage():
    rows = one_at_a_time({"p": 1.0}, {"p": Interval(0, 2)})
    effect = single_effects(fingers(rows, np.array([0.0, 0.0, 4.0]))).iloc[0]
    assert effect["change"] == 4.0
    assert math.isnan(effect["change_percent"])


def test_the_strongest_comes_first_and_stress_parts_what_rates_do_not():
    rows = one_at_a_time({"p": 1.0, "q": 1.0, "r": 1.0}, {n: Interval(0, 2) for n in "pqr"})
    rates = np.array([10.0, 10, 10, 10, 10, 10, 12])
    stress = np.array([100.0, 99, 101, 90, 110, 100, 100])
    assert ordered_parameters(single_effects(fingers(rows, rates, stress))) == ["r", "q", "p"]
    value = orthogonal(3, 3)
    fits = rank_regressions(
        fingers(value, value[:, 2], value[:, 1] + 0.5 * value[:, 0]), resamples=5
    )
    assert ordered_parameters(fits) == [2, 1, 0]


def orthogonal(parameters, levels=5):
    """Every combination of evenly spaced levels: ranks that do not go together."""
    grid = np.meshgrid(*[np.arange(levels, dtype=float)] * parameters, indexing="ij")
    return np.stack([each.ravel() for each in grid], axis=1)


@settings(settings.get_profile("costly"))
@given(seed=st.integers(0, 2**32 - 1))
def test_it_is_least_squares_of_standardised_ranks(seed):
    """A plain loop beside the fast path: ranks with ties shared, then lstsq."""
    rng = np.random.default_rng(seed)
    value = rng.normal(size=(30, 3)).round(1)
    answer = (value @ [1.0, -0.5, 0.0] + rng.normal(size=30)).round(1)

    fit = rank_regressions(fingers(value, answer), resamples=5)

    def standard(column):
        below = np.array([(column < each).sum() for each in column])
        ties = np.array([(column == each).sum() for each in column])
        ranks = below + (ties + 1) / 2
        return (ranks - ranks.mean()) / ranks.std()

    x = np.stack([standard(column) for column in value.T], axis=1)
    expected, residue, *_ = np.linalg.lstsq(x, standard(answer), rcond=None)
    np.testing.assert_allclose(fit["coefficient"], expected, atol=1e-9)
    np.testing.assert_allclose(fit["r_squared"], 1 - residue[0] / 30, atol=1e-9)


def test_an_answer_that_hardly_ever_changes_has_numbers_and_one_that_never_does_has_none():
    """Most resamples leave out the one finger that fires; nothing warns."""
    value = orthogonal(2)
    rare = (np.arange(25) == 24).astype(float)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fits = rank_regressions(fingers(value, rare, np.full(25, 7.0)), resamples=200)
    numbers = fits.set_index("quantity").loc[:, "coefficient":]
    assert np.isfinite(numbers.loc["rate_ips"]).all(axis=None)
    assert np.isnan(numbers.loc["peak_stress_pa"]).all(axis=None)


def test_too_few_fingers_and_parameters_that_rise_together_are_refused():
    few = np.random.default_rng(0).normal(size=(9, 4))
    with pytest.raises(UsageError, match=r"9 .* 4 "):
        rank_regressions(fingers(few, few[:, 0]))
    value = np.random.default_rng(0).normal(size=(20, 2))
    value = pd.DataFrame({"p": value[:, 0], "q": value[:, 1], "r": -(value[:, 0] ** 3)})
    with pytest.raises(UsageError, match=r"\bp\b.*\br\b"):
        rank_regressions(fingers(value, value["q"]))


DOCS = Path(__file__).parents[3] / "docs"
PAGE = (DOCS / "science" / "sensitivity.md").read_text("utf-8")
STUDIES = ("sensitivity_one_at_a_time", "sensitivity_hypercube")


def stored(name):
    return read_swept(DOCS / "studies" / f"{name}.csv")


@pytest.mark.slow
def test_the_tables_of_the_page_are_those_of_the_stored_fingers():
    one, cube = map(stored, STUDIES)
    tables = (
        effects_markdown(single_effects(one)),
        regressions_markdown(cube, rank_regressions(cube)),
    )
    for name, table in zip(STUDIES, tables, strict=True):
        _title, stored_table = (DOCS / "studies" / f"{name}.md").read_text("utf-8").split("\n", 1)
        assert stored_table.strip() == table.strip()


@pytest.mark.parametrize("name", [STUDIES[0], pytest.param(STUDIES[1], marks=pytest.mark.slow)])
def test_the_stored_fingers_are_those_of_the_study(name):
    study = read_study(DOCS / "studies" / f"{name}.toml")
    expected = pd.DataFrame([each.changes for each in study.variants]).astype(float)
    pd.testing.assert_frame_equal(stored(name).parameters, expected, rtol=1e-5)


def test_stress_goes_up_as_all_moduli_together():
    """Euler: the probe's way is given, so stress is of degree 1 in the moduli.

    The exponents of stress for each modulus, d ln σ / d ln E, add up to 1, but for
    what bone, nail and the contact's springs hold.
    """
    effects = single_effects(stored(STUDIES[0]))
    effects = effects[
        effects["parameter"].str.endswith("young_mpa")
        & (effects["quantity"] == "peak_stress_pa")
        & (effects["stimuli"] == "all")
    ]
    exponents = np.log(effects["at_high"] / effects["at_low"]) / np.log(
        effects["high"] / effects["low"]
    )

    assert len(exponents) == 3 * 4
    for afferent, mine in exponents.groupby(effects["afferent"]):
        assert mine.sum() == pytest.approx(1, abs=0.01)
        shown = ", ".join(number(each, "+.2f") for each in mine)
        assert f"{afferent} {shown}" in " ".join(PAGE.split())


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("skin.dermis_mm", ("skin.dermis", "mm")),
        ("contact.stiffness_mpa_per_mm", ("contact.stiffness", "MPa/mm")),
        ("slide_mm_per_s", ("slide", "mm/s")),
        ("materials.dermis.density_kg_m3", ("materials.dermis.density", "kg/m³")),
        ("contact.friction", ("contact.friction", "")),
    ],
)
def test_a_name_is_parted_from_its_whole_unit(name, words):
    assert split_unit(name) == words


def summary_of(capsys, *words):
    assert main(["plot", "sensitivity", *map(str, words), "--json"]) == 0
    said = capsys.readouterr()
    return json.loads(said.out), said.err


def test_one_at_a_time_is_known_by_its_table_and_drawn(results, tmp_path, capsys):
    swept = ((1.0, 0.4, 20), (0.8, 0.4, 18), (1.2, 0.4, 26), (1.0, 0.3, 20), (1.0, 0.5, 21))
    table = results(*(row(d, "sine_20_250", rate, 9e3, friction=f) for d, f, rate in swept))
    picture, numbers = tmp_path / "s.png", tmp_path / "effects.csv"
    summary, _ = summary_of(capsys, table, "-o", picture, "--table", numbers)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert (summary["kind"], summary["fingers"]) == ("one-at-a-time", 5)
    assert summary["parameters"] == ["skin.dermis_mm", "contact.friction"]
    one = summary["effects"][0]
    assert [one[name] for name in OUTPUT] == ["SA", "rate_ips", "all"]
    assert (one["change"], one["change_percent"]) == (8.0, 40.0)
    written = pd.read_csv(numbers)
    assert len(written) == len(summary["effects"]) == 2 * 2 * 2
    assert set(written["monotone"]) == {"yes"}


@pytest.mark.usefixtures("unrendered")
def test_a_hypercube_is_ranked_and_its_summary_gives_the_same_again(
    results, tmp_path, capsys, monkeypatch
):
    """The rate of PC never changes; a finger failed."""
    few = partial(rank_regressions, resamples=50)
    monkeypatch.setattr("fembridge.sensitivity.effects.rank_regressions", few)
    made = np.random.default_rng(1).random((20, 2)).tolist()
    rows = [
        row(d, "sine_20_250", rate, 9e3 * d, afferent, friction=f)
        for d, f in made[1:]
        for afferent, rate in (("SA", 5 + 20 * d - 4 * f), ("PC", 50))
    ]
    failed = row(made[0][0], "sine_20_250", "", "", status="failed,it broke", friction=made[0][1])
    first, again, short = (tmp_path / name for name in ("first.md", "again.md", "fingers.csv"))
    out = ["-o", tmp_path / "s.svg", "--table"]
    table = results(failed, failed.replace(",SA,", ",PC,"), *rows)
    summary, said = summary_of(capsys, table, *out, first, "--fingers", short)
    assert "a finger is left out: it broke" in said
    summary_of(capsys, short, *out, again)
    assert (summary["kind"], summary["fingers"]) == ("rank regression", 19)
    assert summary["left_out"] == 1
    assert first.read_text() == again.read_text()
    still = [e for e in summary["effects"] if e["afferent"] == "PC"]
    assert {e["coefficient"] for e in still if e["quantity"] == "rate_ips"} == {None}
    assert "no variation" in first.read_text()


def test_a_table_of_an_unknown_kind_is_refused_before_anything_is_written(results, refused):
    words = [results(ONE, OTHER), "-o", "s.png", "--table", "effects.xls"]
    refused(["plot", "sensitivity", *words], {"argument": "--table", "found": "effects.xls"})


def test_the_picture_has_a_line_from_low_to_high_in_each_row():
    base = {"skin.dermis_mm": 1.0, "contact.friction": 0.4}
    rows = one_at_a_time(base, {name: Interval(0.8 * at, 1.2 * at) for name, at in base.items()})
    rates, stress = np.array([16.0, 15, 17, 12, 20]), np.array([9e3, 1e4, 8e3, 9e3, 9e3])
    sa, sa_stress = effects_figure(single_effects(fingers(rows, rates, stress))).axes
    assert [text.get_text() for text in sa.get_yticklabels()] == ["friction", "dermis thickness"]
    assert sa.get_title() == "SA"
    ends = [line.get_xdata() for line in sa.lines if len(line.get_xdata()) == 2]
    np.testing.assert_allclose(ends[:2], [[12, 20], [15, 17]])
    assert sa_stress.get_xlabel() == "Mean peak stress (kPa)"
    assert sa.get_ylim() == (1.5, -0.5)
