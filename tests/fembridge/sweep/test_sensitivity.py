"""Sensitivity: tables of sweeps read as fingers, one parameter at a time, rank regression."""

import math
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.errors import TableError, UsageError
from fembridge.sensitivity import (
    Output,
    SweptFingers,
    effects_in_order,
    effects_markdown,
    group_of,
    is_one_at_a_time,
    rank_regressions,
    read_swept,
    regressions_in_order,
    regressions_markdown,
    signed,
    single_effects,
    swept_text,
)
from fembridge.sweeps import read_study
from fembridge.sweeps.design import Range, hypercube_shares, one_at_a_time

HEADER = (
    "finger,skin.dermis_mm,contact.friction,probe_x_mm,method,"
    "stimulus,afferent,rate_ips,spikes,peak_stress_pa,status,cause,run\n"
)


@pytest.fixture
def results(tmp_path):
    def write(*rows, header=HEADER):
        path = tmp_path / "results.csv"
        path.write_text(header + "".join(f"{row}\n" for row in rows))
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

    assert swept.names == ("skin.dermis_mm",)
    np.testing.assert_array_equal(swept.value, [[1.0], [1.2]])
    assert swept.afferents == ("SA",)
    assert swept.groups == ("all", "sine_20", "noise")
    rates = [swept.column(Output("SA", "rate_ips", g)) for g in swept.groups]
    np.testing.assert_array_equal(rates, [[5, 10], [7, 13], [1, 4]])
    stress = swept.column(Output("SA", "peak_stress_pa", "sine_20"))
    np.testing.assert_array_equal(stress, [4000, 5000])


def test_the_summary_reads_back_as_what_it_was_made_of(results, tmp_path):
    rows = [
        row(dermis, stimulus, rate + k, 1000.0 * (rate + k), afferent, friction=0.1 * k)
        for k, dermis in enumerate((1.0, 1.1, 1.2), start=1)
        for rate, stimulus in ((1, "sine_300_50"), (2, "diharm_10_50_125"))
        for afferent in ("SA", "PC")
    ]
    swept = read_swept(results(*rows))
    (tmp_path / "fingers.csv").write_text(swept_text(swept))

    again = read_swept(tmp_path / "fingers.csv")

    assert (again.names, again.outputs) == (swept.names, swept.outputs)
    np.testing.assert_allclose(again.value, swept.value, rtol=1e-6)
    np.testing.assert_allclose(again.answer, swept.answer, rtol=1e-6)
    assert swept_text(again) == swept_text(swept)


def test_a_finger_of_which_anything_failed_is_left_out_and_its_cause_told(results):
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

    np.testing.assert_array_equal(swept.value[:, 0], [1.0, 1.2])
    assert swept.causes == ("it diverged",)


@pytest.mark.parametrize(
    ("rows", "problem"),
    [
        ([row(1.0, "sine_20_250", 1, 1)], "fingers: 1, expected two or more"),
        (
            [row(1.0, "sine_20_250", 1, 1), row(1.1, "sine_20_250", "", "", status="failed,bad")],
            "fingers: 1, 1 failed, expected two",
        ),
        ([], "fingers: 0"),
    ],
)
def test_nothing_to_compare_is_told(results, rows, problem):
    with pytest.raises(UsageError, match=problem):
        read_swept(results(*rows))


@pytest.mark.parametrize(
    ("rows", "problem"),
    [
        (
            [row(1.0, "sine_20_250", 1, 1), row(1.0, "sine_20_250", 2, 1)],
            "csv:3: duplicate: sine_20_250, SA",
        ),
        (
            [row(1.0, "sine_20_250", 1, 1), row(1.1, "sine_50_250", 2, 1)],
            "is not there for all fingers",
        ),
        (
            [row("thin", "sine_20_250", 1, 1), row("thick", "sine_20_250", 2, 1)],
            "skin.dermis_mm is 'thin', 'thick': expected one for all, or different",
        ),
        (
            [row(1.0, "sine_20_250", 1, 1), row("", "sine_20_250", 2, 1)],
            "skin.dermis_mm is '1.0', '': expected",
        ),
        ([row(1.0, "sine_20_250", "nan", 1), row(1.1, "sine_20_250", 2, 1)], "rate_ips is nan"),
        ([row(1.0, "sine_20_250", 1, 1, status="odd,")], "status is 'odd'"),
    ],
)
def test_a_table_that_is_not_one_is_refused_in_words(results, rows, problem):
    with pytest.raises(TableError, match=problem):
        read_swept(results(*rows))


def test_another_table_is_refused_and_both_kinds_are_named(results):
    path = results("1.0,2.0", header="time_ms,node\n")
    with pytest.raises(TableError, match=r"neither results\.csv .* nor a summary"):
        read_swept(path)


def test_a_stimulus_belongs_to_its_frequency_or_its_family():
    stimuli = ("sine_20_250", "sine_300_50", "diharm_10_50_125", "noise_25_250_0.25")
    assert [group_of(each) for each in stimuli] == ["sine_20", "sine_300", "diharm", "noise"]
    assert group_of("my_own") == "my_own"


RATE = Output("SA", "rate_ips", "all")
STRESS = Output("SA", "peak_stress_pa", "all")


def fingers(rows, *answers, outputs=(RATE, STRESS)):
    names = tuple(rows[0])
    value = np.array([[row[name] for name in names] for row in rows])
    return SweptFingers(names, value, outputs[: len(answers)], np.stack(answers, axis=1))


@given(slopes=st.lists(st.floats(-5, 5), min_size=1, max_size=5), half=st.floats(0.01, 0.5))
def test_the_change_of_a_linear_answer_is_slope_times_range(slopes, half):
    base = {f"p{k}": 1.0 for k in range(len(slopes))}
    rows = one_at_a_time(base, {name: Range(1 - half, 1 + half) for name in base})
    answers = np.array([np.dot(slopes, list(row.values())) for row in rows])

    swept = fingers(rows, answers)

    assert is_one_at_a_time(swept)
    effects = single_effects(swept)
    assert [each.parameter for each in effects] == list(base)
    for effect, slope in zip(effects, slopes, strict=True):
        span = effect.high - effect.low
        assert (effect.low, effect.high) == (rows[1]["p0"], rows[2]["p0"])
        assert effect.change == pytest.approx(slope * span, abs=1e-9)
        assert effect.at_base == answers[0]
        if answers[0]:
            expected = 100 * effect.change / answers[0]
            assert effect.percent == pytest.approx(expected)


def test_an_answer_that_comes_back_is_not_monotone_though_the_change_is_0():
    rows = one_at_a_time({"p": 1.0, "q": 1.0}, {"p": Range(0, 2), "q": Range(0, 2)})
    [p, q] = single_effects(fingers(rows, np.array([5.0, 3.0, 3.0, 4.0, 5.0])))

    assert (p.change, p.is_monotone) == (0.0, False)
    assert (q.change, q.is_monotone) == (1.0, True)


def test_more_than_two_levels_are_compared_from_end_to_end():
    rows = [{"p": 2.0, "q": 0.0}, *({"p": x, "q": 0.0} for x in (4.0, 1.0, 3.0))]
    rows.append({"p": 2.0, "q": 1.0})
    effects = single_effects(fingers(rows, np.array([20.0, 41.0, 9.0, 30.0, 20.0])))

    assert (effects[0].low, effects[0].base, effects[0].high) == (1.0, 2.0, 4.0)
    assert (effects[0].at_low, effects[0].at_base, effects[0].at_high) == (9, 20, 41)
    assert effects[0].is_monotone


def test_a_silent_base_has_no_percentage():
    rows = one_at_a_time({"p": 1.0}, {"p": Range(0, 2)})
    [effect] = single_effects(fingers(rows, np.array([0.0, 0.0, 4.0])))

    assert effect.change == 4.0
    assert math.isnan(effect.percent)


def test_the_strongest_comes_first_and_stress_parts_what_rates_do_not():
    rows = one_at_a_time({"p": 1.0, "q": 1.0, "r": 1.0}, {n: Range(0, 2) for n in "pqr"})
    rates = np.array([10.0, 10, 10, 10, 10, 10, 12])
    stress = np.array([100.0, 99, 101, 90, 110, 100, 100])

    assert effects_in_order(single_effects(fingers(rows, rates, stress))) == ["r", "q", "p"]


def test_two_changes_at_once_are_no_one_at_a_time():
    two = [{"p": 0.0, "q": 0.0}, {"p": 1.0, "q": 1.0}]
    assert not is_one_at_a_time(fingers(two, np.array([0.0, 1.0])))


RATE = Output("SA", "rate_ips", "all")
STRESS = Output("SA", "peak_stress_pa", "all")


def swept(value, *answers, outputs=None):
    names = tuple(f"skin.part_{k}" for k in range(value.shape[1]))
    outputs = outputs or tuple(Output("SA", "rate_ips", f"sine_{k}") for k in range(len(answers)))
    return SweptFingers(names, value, outputs, np.stack(answers, axis=1))


def orthogonal(parameters, levels=5):
    """Every combination of evenly spaced levels: ranks that do not go together."""
    grid = np.meshgrid(*[np.arange(levels, dtype=float)] * parameters, indexing="ij")
    return np.stack([each.ravel() for each in grid], axis=1)


@given(st.lists(st.floats(-3, 3), min_size=2, max_size=2))
def test_one_strictly_monotone_cause_has_coefficient_1_whatever_its_shape(ends):
    low, high = sorted(ends)
    if high - low < 0.01:
        return
    value = np.stack([np.linspace(low, high, 40), np.random.default_rng(0).permutation(40)], axis=1)
    [up, down] = rank_regressions(
        swept(value, np.exp(value[:, 0]), -(value[:, 0] ** 3)), resamples=50
    )

    np.testing.assert_allclose(up.coefficient, [1, 0], atol=1e-12)
    np.testing.assert_allclose(down.coefficient, [-1, 0], atol=1e-12)
    assert up.r_squared == pytest.approx(1) == down.r_squared
    np.testing.assert_allclose([up.low[0], up.high[0]], 1, atol=1e-12)


def test_an_answer_that_is_its_causes_ranks_has_the_coefficients_of_the_plane():
    """Answers are a permutation of 0…N−1 here, so ranking them changes nothing."""
    value = orthogonal(2, 7)
    answer = 7 * value[:, 0] + value[:, 1]  # each of 0…48 once

    [fit] = rank_regressions(swept(value, answer), resamples=20)

    spread = answer.std()
    expected = np.array([7, 1]) * value[:, 0].std() / spread
    np.testing.assert_allclose(fit.coefficient, expected, rtol=1e-12)
    assert fit.r_squared == pytest.approx((expected**2).sum(), rel=1e-12) == 1
    assert fit.adjusted_r_squared == pytest.approx(1)


@given(seed=st.integers(0, 2**32 - 1))
def test_it_is_least_squares_of_standardised_ranks(seed):
    """A plain loop beside the fast path: ranks with ties shared, then lstsq."""
    rng = np.random.default_rng(seed)
    value = rng.normal(size=(30, 3)).round(1)
    answer = (value @ [1.0, -0.5, 0.0] + rng.normal(size=30)).round(1)

    [fit] = rank_regressions(swept(value, answer), resamples=5)

    def standard(column):
        below = np.array([(column < each).sum() for each in column])
        ties = np.array([(column == each).sum() for each in column])
        ranks = below + (ties + 1) / 2
        return (ranks - ranks.mean()) / ranks.std()

    along = np.stack([standard(column) for column in value.T], axis=1)
    expected, residue, *_ = np.linalg.lstsq(along, standard(answer), rcond=None)
    np.testing.assert_allclose(fit.coefficient, expected, atol=1e-9)
    assert fit.r_squared == pytest.approx(1 - residue[0] / 30, abs=1e-9)


def test_a_cause_of_nothing_is_near_0_and_its_interval_holds_0():
    value = np.array(hypercube_shares(3, 60, 4))
    answer = 5 * value[:, 0] - 2 * value[:, 1]

    [fit] = rank_regressions(swept(value, answer))

    assert abs(fit.coefficient[2]) < 0.1
    assert [fit.is_sure(k) for k in range(3)] == [True, True, False]
    assert (fit.low <= fit.coefficient).all() and (fit.coefficient <= fit.high).all()
    assert fit.r_squared > 0.95


def test_what_is_not_monotone_shows_as_a_small_r_squared():
    value = np.array(hypercube_shares(2, 60, 4))
    [fit] = rank_regressions(swept(value, (value[:, 0] - 0.5) ** 2))

    assert fit.r_squared < 0.15
    assert fit.adjusted_r_squared < 0.1


def test_chance_alone_has_a_large_r_squared_and_an_adjusted_one_near_0():
    rng = np.random.default_rng(1)
    value = np.array(hypercube_shares(14, 50, 1))
    noise = rng.normal(size=(50, 40))
    fits = rank_regressions(swept(value, *noise.T), resamples=5)

    assert np.mean([fit.r_squared for fit in fits]) == pytest.approx(14 / 49, abs=0.05)
    assert np.mean([fit.adjusted_r_squared for fit in fits]) < 0.1


def test_an_answer_that_never_changes_is_told_and_warns_of_nothing():
    value = orthogonal(2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        still, moving = rank_regressions(swept(value, np.full(25, 7.0), value[:, 0]), resamples=50)

    assert not still.varies and moving.varies
    assert not still.coefficient.any() and still.r_squared == 0
    assert np.isfinite([still.low, still.high]).all()


def test_an_answer_that_hardly_ever_changes_gives_numbers_in_every_resample():
    """Most resamples leave out the one finger that fires."""
    value = orthogonal(2)
    answer = np.zeros(25)
    answer[-1] = 1.0

    [fit] = rank_regressions(swept(value, answer), resamples=200)

    assert np.isfinite([*fit.low, *fit.high, *fit.coefficient]).all()


def test_the_same_seed_gives_the_same_intervals_and_another_one_others():
    value = np.array(hypercube_shares(2, 20, 0))
    fingers = swept(value, value[:, 0] + 0.5 * value[:, 1] ** 2)
    one, same, other = (
        rank_regressions(fingers, resamples=100, seed=seed)[0] for seed in (1, 1, 2)
    )

    np.testing.assert_array_equal(one.low, same.low)
    assert (one.low != other.low).any()
    np.testing.assert_array_equal(one.coefficient, other.coefficient)


def test_too_few_fingers_for_the_parameters_are_refused():
    value = np.random.default_rng(0).normal(size=(9, 4))
    with pytest.raises(UsageError, match="9 fingers for 4 parameters, expected 10 or"):
        rank_regressions(swept(value, value[:, 0]))


def test_parameters_that_rise_together_are_refused_by_name():
    value = np.random.default_rng(0).normal(size=(20, 2))
    value = np.column_stack([value, -(value[:, 0] ** 3)])

    with pytest.raises(UsageError, match=r"part_0 and skin\.part_2 rise and fall"):
        rank_regressions(swept(value, value[:, 1]))


def test_order_goes_by_the_mean_rate_and_by_stress_where_rates_are_equal():
    value = orthogonal(3, 3)
    outputs = (RATE, STRESS)
    rate = value[:, 2]
    stress = value[:, 1] + 0.5 * value[:, 0]
    fits = rank_regressions(swept(value, rate, stress, outputs=outputs), resamples=5)

    assert regressions_in_order(fits) == [2, 1, 0]
    assert not math.isnan(fits[0].r_squared)


DOCS = Path(__file__).parents[3] / "docs"
PAGE = (DOCS / "sensitivity.md").read_text("utf-8")
STUDIES = ("sensitivity_one_at_a_time", "sensitivity_hypercube")


@pytest.fixture
def stored(request):
    return read_swept(DOCS / "studies" / f"{request.param}.csv")


@pytest.mark.parametrize("stored", STUDIES[:1], indirect=True)
def test_the_one_at_a_time_tables_are_those_of_the_stored_fingers(stored):
    assert effects_markdown(stored, single_effects(stored)).strip() in PAGE


@pytest.mark.parametrize("stored", STUDIES[1:], indirect=True)
def test_the_tables_of_ranks_are_those_of_the_stored_fingers(stored):
    assert regressions_markdown(stored, rank_regressions(stored)).strip() in PAGE


@pytest.mark.parametrize("name", STUDIES)
def test_the_stored_fingers_are_those_of_the_study(name):
    study = read_study(DOCS / "studies" / f"{name}.toml")
    swept = read_swept(DOCS / "studies" / f"{name}.csv")

    assert swept.names == tuple(study.variants[0].changes)
    for values, variant in zip(swept.value, study.variants, strict=True):
        expected = [float(value) for value in variant.changes.values()]
        assert values.tolist() == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("name", STUDIES)
def test_the_page_names_the_study_the_command_and_the_picture(name):
    assert f"fembridge sweep docs/studies/{name}.toml" in PAGE
    assert f"docs/studies/{name}.csv" in PAGE
    assert f"(images/{name}.png)" in PAGE
    assert (DOCS / "images" / f"{name}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("stored", STUDIES[:1], indirect=True)
def test_stress_goes_up_as_all_moduli_together(stored):
    """Euler: the probe's way is given, so stress is of degree 1 in the moduli.

    The exponents of stress for each modulus, d ln σ / d ln E, add up to 1, but for
    what bone, nail and the contact's springs hold.
    """
    effects = [
        effect
        for effect in single_effects(stored)
        if effect.parameter.endswith("young_mpa")
        and (effect.output.quantity, effect.output.group) == ("peak_stress_pa", "all")
    ]
    exponents = {
        (effect.output.afferent, effect.parameter): math.log(effect.at_high / effect.at_low)
        / math.log(effect.high / effect.low)
        for effect in effects
    }

    assert len(exponents) == 3 * 4
    for afferent in stored.afferents:
        mine = [each for (name, _), each in exponents.items() if name == afferent]
        assert sum(mine) == pytest.approx(1, abs=0.01)
        told = ", ".join(signed(each, 2) for each in mine)
        assert f"{afferent} {told}" in " ".join(PAGE.split())
