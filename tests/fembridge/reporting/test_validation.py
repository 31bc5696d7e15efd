"""Results of a validation for rates and spikes of known agreement, and its report.

All tests share one validation and one report: own parameters against made-up rates.
"""

import csv
import hashlib
import json
import math
import re
import shlex
import tomllib
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from numpy.testing import assert_allclose, assert_array_equal
from pandas.testing import assert_frame_equal

import fembridge
import fembridge as fb
from decks.stimuli import CATALOGUE
from fembridge.cli import main
from fembridge.errors import FembridgeWarning, MissingError, UsageError
from fembridge.evidence import (
    DISTANCE,
    PHASES,
    THRESHOLDS,
    TIMING,
    Facts,
    published,
    touchsim_rates,
)
from fembridge.fitting.response_source import stored_source
from fembridge.fitting.thresholds import vibration
from fembridge.io.observed_rates import read_observed
from fembridge.io.spike_table import Rate, SpikeTrain, write_rates
from fembridge.plots.rate_comparison import rates_figure
from fembridge.reporting import fingertip_responses, recorded, validation_page
from fembridge.reporting.rate_tables import (
    ALL_SETS,
    FAMILIES,
    OBSERVED,
    SINES,
    TOUCHSIM,
    RateTable,
    agreement_table,
    held_out_table,
    locking_table,
    row_of,
    threshold_table,
)
from fembridge.reporting.recorded import ModelOnResponse, gather, phases_of
from fembridge.reporting.shortfalls import fingertip_shortfalls, shortfalls
from fembridge.reporting.validation_data import (
    RASTER_STIMULI,
    compute_validation,
    judged_models,
    repeated_trains,
    response_of,
)
from fembridge.reporting.validation_page import (
    PAGE,
    page_text,
    rasters_figure,
    regression_figure,
    write_report,
)
from fembridge.response.response_map import FOLDER
from fembridge.trace import AFFERENTS
from neural import parameter_set
from neural.encoder import encode_cells

SINES_OBSERVED = Path(fembridge.__file__).parents[2] / "shared/data/observed_sine_rates.csv"
TRUE = touchsim_rates()
STIMULI = ("sine_20_250", "sine_50_250", FAMILIES[2].stimuli[0])
KEYS = [(stimulus, afferent) for stimulus in STIMULI for afferent in AFFERENTS]


OWN = "base = 'published'\n[SA]\nalpha_mv_per_ms = 1.2\n[RA]\ntau_ms = 40.0\n"
COMMAND = "fembridge validate -o report --observed rates.csv --parameters own.toml"


def made_up_rates():
    """Rates near TouchSim's of all sinusoids, and of SA under diharmonics."""
    rng = np.random.default_rng(5)
    return [
        Rate(rate.stimulus, rate.afferent, max(0.0, rate.rate_ips + rng.normal(0, 3)))
        for rate in touchsim_rates()
        if rate.stimulus.startswith("sine")
        or (rate.stimulus.startswith("diharm_10_50_") and rate.afferent == "SA")
    ]


@pytest.fixture(scope="module")
def observed_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("observed") / "rates.csv"
    write_rates(path, made_up_rates())
    return path


@pytest.fixture(scope="module")
def own_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("parameters") / "own.toml"
    path.write_text(OWN, encoding="utf-8")
    return path


@pytest.fixture(scope="module", autouse=True)
def _few_touches():
    """Coarse receptive fields and few amplitudes of a pin, to save time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorded, "_PIN_UM", recorded._PIN_UM[::8])
        coarse = partial(fingertip_responses.receptive_field, step_mm=1.5, units=2)
        patch.setattr(fingertip_responses, "receptive_field", coarse)
        yield


@pytest.fixture(scope="module")
def study(observed_file, own_file):
    """Own parameters against made-up rates; few frequencies and amplitudes, to save time."""
    observed = read_observed(observed_file, complete=False)
    response, models = stored_source("quick").response, judged_models(str(own_file))
    table, source = published(THRESHOLDS).table, published(THRESHOLDS).source
    few = Facts(table[table.frequency_hz.between(70, 80)], source)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorded, "CURVE_HZ", (200.0,))
        return compute_validation(response, models, observed, facts={THRESHOLDS: few})


@pytest.fixture
def computed(study, monkeypatch):
    """Reuse the evidence and simulations of `study`, which take most of a validation's time."""
    simulations = study.simulations
    module = "fembridge.reporting.validation_data"
    monkeypatch.setattr(f"{module}.gather", lambda *_: study.evidence)
    monkeypatch.setattr(f"{module}._simulated", lambda model, response: simulations[model.name])


@pytest.fixture
def undrawn(monkeypatch):
    """Leave out the figures of a page, which take most of the time."""
    names = ["skin_deflection", "rasters", "tuning", "phases", "human", "distance", "ramp"]
    names += ["fingertip_rates", "fingertip_tuning"]
    names += [f"{kind}_{family.name}" for kind in ("rates", "regression") for family in FAMILIES]
    monkeypatch.setattr(validation_page, "_figures", lambda study: [(n, None) for n in names])
    monkeypatch.setattr(validation_page, "inline_svg", lambda figure, path: "")


DRAWN = ("phases", "human", "distance")
"""Figures that no other test draws."""


@pytest.fixture(scope="module")
def report(study, tmp_path_factory):
    """A written report; it draws few figures, and rates of SA only, to save time."""
    folder = tmp_path_factory.mktemp("report")
    inline_svg = validation_page.inline_svg

    def drawn(figure, path):
        return inline_svg(figure if path.stem in DRAWN else Figure(figsize=(1, 1)), path)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(validation_page, "rates_figure", partial(rates_figure, afferents=["SA"]))
        patch.setattr(validation_page, "inline_svg", drawn)
        write_report(folder, study, COMMAND)
    return folder


@pytest.fixture(scope="module")
def on_pad(observed_file):
    """`fitted_pad` under a pin at two positions on the ridged pad."""
    probe = fb.PadProbe(positions=2)
    observed = read_observed(observed_file, complete=False)
    table, source = published(THRESHOLDS).table, published(THRESHOLDS).source
    few = Facts(table[table.frequency_hz.between(70, 80)], source)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorded, "CURVE_HZ", (200.0,))
        patch.setattr(recorded, "_PIN_UM", recorded._PIN_UM[::8])
        models = judged_models("fitted_pad")
        return compute_validation(
            probe.response, models, observed, {THRESHOLDS: few}, skin=probe.skin()
        )


@pytest.mark.slow
def test_a_page_on_a_pad_has_the_rates_of_the_pad_alone(on_pad, tmp_path, undrawn):
    assert on_pad.on_pad
    simulated = fb.simulate(
        "sine_20_250", response=fb.PadProbe(positions=2), parameters="fitted_pad"
    ).rates.groupby("afferent")["rate_ips"]
    for name in AFFERENTS:
        [rate_ips] = on_pad.rates.rates_ips("fitted_pad", name, ["sine_20_250"])
        assert_allclose(rate_ips, [simulated.mean()[name]])
    assert "fingertip" not in set(on_pad.rates.frame["source"])
    assert fingertip_shortfalls(on_pad) == ()
    tables = validation_page.csv_tables(on_pad)
    assert not [name for name in tables if name.startswith("fingertip")]
    assert len(tables["distance"]) == len(published(DISTANCE).table)
    page = page_text(on_pad, COMMAND, tmp_path)
    assert "ridges 0.44 mm apart" in page
    assert page.count('id="fingertip-section"') == 1
    assert "fingertip_rates" not in page
    assert not [name for name in validation_page.figure_functions(on_pad) if "fingertip" in name]


@pytest.mark.slow
def test_cells_of_all_positions_are_in_order_of_their_sensitivity(on_pad):
    """Each of ten cells at both positions, then the next: the first fire most."""
    trains = [
        train
        for train in on_pad.simulations["fitted_pad"].trains
        if (train.stimulus, train.afferent) == ("sine_20_250", "RA")
    ]
    assert sorted(train.cell for train in trains) == list(range(1, 21))
    assert {train.unit for train in trains} == {""}
    spikes = [train.times_ms.size for train in sorted(trains, key=lambda train: train.cell)]
    assert spikes[0::2] == sorted(spikes[0::2], reverse=True)
    assert spikes[1::2] == sorted(spikes[1::2], reverse=True)
    on_response = ModelOnResponse(on_pad.response, on_pad.judged)
    wave = next(s for s in on_pad.simulations["fitted_pad"].stimuli if s.id == "sine_20_250")
    assert [times_ms.size for times_ms in on_response.spikes_ms("RA", wave)] == spikes


def test_every_stimulus_of_the_catalogue_is_in_one_set_of_one_family():
    assert [id_ for family in FAMILIES for id_ in family.stimuli] == [e.id for e in CATALOGUE]
    for group in (group for family in FAMILIES for group in family.sets):
        assert all(id_.startswith(f"{group.name}_") for id_ in group.stimuli)
        assert list(group.level_um) == sorted(set(group.level_um))
    assert FAMILIES[1].sets[0].title == "10 + 50 Hz"
    assert FAMILIES[2].sets[-1].title == "50–500 Hz"


@given(
    rates=st.dictionaries(
        st.tuples(st.sampled_from(["first", "second"]), st.sampled_from(KEYS)), st.floats(0, 500)
    )
)
def test_each_rate_is_found_under_its_source_class_and_stimulus_only(rates):
    sources = {
        source: [
            Rate(*key, rate_ips) for (owner, key), rate_ips in rates.items() if owner == source
        ]
        for source in ("first", "second")
    }
    table = RateTable(sources)
    for source in sources:
        for stimulus, afferent in KEYS:
            [rate_ips] = table.rates_ips(source, afferent, [stimulus])
            assert_array_equal(rate_ips, rates.get((source, (stimulus, afferent)), np.nan))
    assert list(table.sources_with_rates(STIMULI)) == [
        source for source in sources if sources[source]
    ]


def test_the_reference_is_the_observed_rates_of_these_stimuli_or_else_touchsim():
    table = RateTable({OBSERVED: [Rate("sine_20_250", "SA", 4.0)], TOUCHSIM: TRUE})
    assert table.reference(STIMULI) == OBSERVED
    assert table.reference(STIMULI[1:]) == TOUCHSIM


def scaled(factor, offset_ips=0.0):
    return [Rate(r.stimulus, r.afferent, factor * r.rate_ips + offset_ips) for r in TRUE]


@pytest.fixture(scope="module")
def scaled_rates():
    sources = {
        OBSERVED: [rate for rate in TRUE if rate.stimulus in SINES.stimuli],
        "equal": scaled(1.0),
        "double": scaled(2.0, 3.0),
        "silent": scaled(0.0),
        TOUCHSIM: scaled(1.1),
    }
    return RateTable(sources)


@pytest.fixture(scope="module")
def cells(scaled_rates):
    return agreement_table(scaled_rates)


def of_sines(cells, source, reference=OBSERVED):
    return row_of(cells, reference, source, "sine", ALL_SETS, "RA")


def test_equal_rates_agree_fully_and_meet_both_goals(cells):
    cell = of_sines(cells, "equal")
    assert cell["count"] == 37
    assert_allclose(cell.r_squared, 1.0)
    assert cell.rmse_ips == 0.0
    assert (cell.meets_paper, cell.meets_goal) == (True, True)


def test_doubled_rates_are_on_a_line_and_worse_than_those_a_tenth_too_high(cells, scaled_rates):
    cell = of_sines(cells, "double")
    assert_allclose([cell.slope, cell.intercept_ips, cell.r_squared], [2, 3, 1])
    assert_allclose(
        cell.bias_ips, (scaled_rates.rates_ips(OBSERVED, "RA", SINES.stimuli) + 3).mean()
    )
    assert (cell.meets_paper, cell.meets_goal) == (True, False)


def test_agreement_with_touchsim_or_without_a_common_stimulus_is_no_goal(cells):
    for cell in (
        of_sines(cells, "equal", TOUCHSIM),
        row_of(cells, OBSERVED, "equal", "noise", ALL_SETS, "SA"),
    ):
        assert cell.meets_paper is cell.meets_goal is None
    assert cell["count"] == 0


def test_a_threshold_is_read_off_the_curve_of_its_frequency():
    """The rate rises from 0 to 50 ips between 113.6 and 168.52 um, log scale."""
    steps = {"sine_50_113.6": 0.0, "sine_50_168.52": 50.0, "sine_50_250": 50.0}
    rates = [Rate(stimulus, "RA", rate) for stimulus, rate in steps.items()]
    [row] = threshold_table(RateTable({"own": rates})).itertuples(index=False)
    share = 1000 / 245 / 50
    assert_allclose(row.threshold_um, 113.6 ** (1 - share) * 168.52**share)
    assert_allclose(row.entrainment_threshold_um, 168.52)
    assert_allclose(row.plateau_high_um, 250.0)
    assert (row.lowest_tried_um, row.highest_tried_um) == (113.6, 250.0)
    assert (row.afferent, row.frequency_hz) == ("RA", 50.0)


def locked(trains, rates_ips):
    rates = [Rate("sine_50_250", a, r) for a, r in zip(AFFERENTS, rates_ips, strict=False)]
    return locking_table(RateTable({"own": rates}), {"own": trains})


def test_spikes_at_one_phase_are_locked_and_those_outside_the_window_do_not_count():
    """50 Hz is counted from 100 to 200 ms: five cycles."""
    trains = [
        SpikeTrain("sine_50_250", "SA", np.array([3.0, 104, 124, 144, 164, 184, 207])),
        SpikeTrain("sine_50_250", "RA", np.array([110.0, 115.0, 120.0, 125.0])),
        SpikeTrain("sine_50_250", "PC", np.empty(0)),
    ]
    table = locked(trains, (50.0, 40.0, 0.0))
    assert table.afferent.tolist() == list(AFFERENTS)
    assert_allclose(table.impulses_per_cycle, [1.0, 0.8, 0.0])
    assert_allclose(table.vector_strength, [1.0, 0.0, np.nan], atol=1e-12)


def test_the_phase_of_a_population_is_that_of_its_cells_not_of_their_sum():
    """Two cells in opposite phase are each locked; together they would cancel."""
    early, late = np.array([105.0, 125.0]), np.array([115.0, 135.0])
    trains = [SpikeTrain("sine_50_250", "SA", ms, trial=k) for k, ms in ((1, early), (2, late))]
    assert_allclose(locked(trains, (20.0,)).vector_strength, [1.0])


@pytest.mark.usefixtures("computed", "undrawn")
def test_without_observed_rates_no_goal_is_marked_and_the_reference_is_touchsim(tmp_path):
    unobserved = compute_validation(stored_source("quick").response, judged_models("published"))
    text = page_text(unobserved, "fembridge validate", tmp_path)
    assert 'class="note"' in text
    assert 'class="met"' not in text
    assert 'class="missed"' not in text
    assert set(unobserved.agreement.reference) == {TOUCHSIM}
    table = text.partition('id="fingertip_agreement"')[2].partition("</table>")[0]
    assert table.count("RMSE") == 2  # fingertip and section: none of TouchSim against itself


def test_each_family_with_a_low_r_squared_or_a_large_error_is_a_shortfall(study):
    """Against observed rates: R² below 0.9, or an error above TouchSim's or half the rate."""
    entries = [entry for entry in shortfalls(study) if entry.topic == "rates"]
    for family in FAMILIES:
        reference = study.rates.reference(family.stimuli)
        for afferent in AFFERENTS:
            cell = row_of(study.agreement, reference, "own", family.name, ALL_SETS, afferent)
            matches = [e for e in entries if (e.afferents, e.family) == ((afferent,), family.name)]
            short = False
            if cell["count"]:
                rate_ips = study.rates.rates_ips(reference, afferent, family.stimuli)
                short = cell.rmse_ips > 0.5 * np.nanmean(rate_ips) or not cell.r_squared > 0.8
                if reference == OBSERVED:
                    key = (OBSERVED, TOUCHSIM, family.name, ALL_SETS, afferent)
                    touchsim_ips = row_of(study.agreement, *key).rmse_ips
                    short |= cell.r_squared < 0.9 or cell.rmse_ips >= touchsim_ips
            assert len(matches) == short, (family.name, afferent)
            assert all(f"{cell.rmse_ips:.1f}" in entry.message for entry in matches)


@pytest.mark.usefixtures("computed")
def test_stimuli_outside_the_paper_are_only_recorded_sets_and_logged(tmp_path, logged):
    rates = [Rate("sine_20_250", "SA", 25.0), Rate("sine_40_100", "SA", 20.0)]
    write_rates(tmp_path / "rates.csv", rates)
    observed = read_observed(tmp_path / "rates.csv")
    study = compute_validation(
        stored_source("quick").response, judged_models("published"), observed
    )
    assert study.left_out == ("sine_40_100",)
    [other] = study.points[study.points["set"] == "sine_other"].to_dict("records")
    assert (other["condition"], other["recorded"]) == ("sine_40_100", 20.0)
    assert other["judged"] > 0 and other["fingertip"] > 0
    assert ["sine_40_100" in line for line in logged] == [True]


def test_touchsim_against_the_observed_sinusoids_is_as_published():
    """R² and RMSE (ips) of TouchSim as found when its rates were computed."""
    if not SINES_OBSERVED.is_file():
        pytest.skip("the observed rates may not be redistributed")
    observed = read_observed(SINES_OBSERVED).rates()
    table = agreement_table(RateTable({OBSERVED: observed, TOUCHSIM: TRUE}))
    for afferent, numbers in {"SA": (0.94, 7.3), "RA": (0.60, 32.4), "PC": (0.98, 38.7)}.items():
        cell = row_of(table, OBSERVED, TOUCHSIM, "sine", ALL_SETS, afferent)
        assert cell.r_squared == pytest.approx(numbers[0], abs=0.005)
        assert cell.rmse_ips == pytest.approx(numbers[1], abs=0.05)


def test_a_file_is_judged_under_its_name_and_the_published_model_comes_after(own_file):
    own, published = judged_models(str(own_file))
    assert (own.name, published.name) == ("own", "published")
    assert own.parameters["SA"].alpha_mv_per_ms == 1.2
    assert own_file.name in own.source


@pytest.mark.parametrize("name", [OBSERVED, TOUCHSIM, "published"])
def test_a_file_cannot_take_the_name_of_another_source(tmp_path, name):
    path = tmp_path / f"{name}.toml"
    path.write_text("base = 'published'\n[SA]\ntau_ms = 30.0\n", encoding="utf-8")
    with pytest.raises(UsageError, match=name):
        judged_models(str(path))


def held_out_results(stimuli, errors_ips):
    """Result of a fit whose predictions are above TouchSim's rates by `errors_ips`."""
    true = {(rate.stimulus, rate.afferent): rate.rate_ips for rate in TRUE}
    rates = {id_: true[id_, "RA"] + error for id_, error in zip(stimuli, errors_ips, strict=True)}
    return {"RA": {"rmse_ips": 9.0, "rates_ips": rates}}


def test_rates_of_a_frequency_that_was_left_out_are_judged_by_frequency_and_together():
    """TouchSim's rates serve as observed rates: its error is 0, that of the model 3 ips."""
    of_model = [replace(rate, rate_ips=rate.rate_ips + 3.0) for rate in TRUE]
    table = RateTable({OBSERVED: TRUE, "own": of_model, TOUCHSIM: TRUE})
    stimuli = [*SINES.sets[0].stimuli[:2], *SINES.sets[1].stimuli[:2]]

    errors = held_out_table(held_out_results(stimuli, [1, 7, -5, -5]), table, "own")

    assert errors.frequency_hz.tolist()[:2] == [20.0, 50.0]
    assert np.isnan(errors.frequency_hz.iloc[2])
    assert errors["count"].tolist() == [2, 2, 4]
    assert_allclose(errors.held_out_rmse_ips, [5.0, 5.0, 5.0])
    assert_allclose(errors.held_out_bias_ips, [4.0, -5.0, -0.5])
    assert_allclose(errors.fitted_rmse_ips, 3.0)
    assert_allclose(errors.touchsim_rmse_ips, 0.0, atol=1e-12)


@pytest.mark.slow
def test_a_user_s_response_is_judged_and_a_fit_on_another_finger_is_a_warning(
    tmp_path, undrawn, monkeypatch
):
    """The paper's finger as a user's response: the shipped set was fitted on another finger."""
    file = tmp_path / "response.toml"
    file.write_bytes((FOLDER / "paper.toml").read_bytes())
    models = judged_models()
    with pytest.warns(FembridgeWarning) as caught:
        of_file = compute_validation(response_of("quick", file, models), models)
    assert of_file.finger == "paper"
    [mismatch] = [str(entry.message) for entry in caught]
    assert "'quick'" in mismatch and "paper" in mismatch
    text = page_text(of_file, "fembridge validate --response response.toml", tmp_path)
    assert mismatch[1:].replace("'", "&#39;") in text
    monkeypatch.setattr("fembridge.reporting.validation_data.gather", lambda *_: of_file.evidence)
    with pytest.warns(FembridgeWarning):
        of_paper = compute_validation(response_of("paper", None, models), models)
    rates = [study.rates.rates_ips("fitted", "SA", SINES.stimuli) for study in (of_file, of_paper)]
    assert_array_equal(*rates)


def test_a_user_s_finger_requires_a_solver_or_a_response(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "")
    finger = tmp_path / "mine.toml"
    finger.write_text("name = 'mine'\n", encoding="utf-8")
    with pytest.raises(MissingError, match="--response"):
        response_of(str(finger), None, judged_models("published"))


def test_recorded_spikes_replace_the_published_timing(study, monkeypatch):
    """Two trains of 20 Hz: 2 ms and 27 ms into each cycle; the phases of the strongest two."""
    times_ms = np.array([102.0, 127.0, 152.0])
    trains = [
        SpikeTrain(f"sine_20_{um}", "RA", times_ms, trial=k)
        for um in ("34.74", "129.49", "250")
        for k in (1, 2)
    ]
    phases = phases_of(trains)
    assert sorted(set(phases.amplitude_um)) == [129.49, 250.0]
    strongest = phases[phases.amplitude_um == 250.0]
    assert strongest.phase_ms.tolist() == [5.0 * k for k in range(10)]
    assert strongest.spikes.tolist() == [4, 0, 0, 0, 0, 2, 0, 0, 0, 0]
    monkeypatch.setattr(recorded, "_distance", lambda *_: None)
    monkeypatch.setattr(recorded, "CURVE_HZ", (20.0,))
    few = Facts(published(THRESHOLDS).table[:1], "")
    model = ModelOnResponse(stored_source("quick").response, study.judged)
    evidence = gather(model, model, {THRESHOLDS: few}, trains)
    assert set(evidence.judged.timing.afferent) == set(evidence.phases.afferent) == {"RA"}
    for name in (TIMING, PHASES):
        assert evidence.sources[name] != published(name).source


@pytest.mark.slow
def test_a_recorded_unit_is_compared_with_the_cell_closest_to_it(monkeypatch):
    """The unit is a cell of the model: its rank is between the ranks of the ten cells."""
    fitted = parameter_set("fitted")
    model = ModelOnResponse(stored_source("quick").response, fitted)
    cells = replace(fitted.parameters["RA"], cells=40)
    trains = []
    for amplitude_um in (34.74, 129.49, 250):
        stimulus = vibration(20.0, amplitude_um, fitted.preindent_um)
        stress_pa = model.response.stress_pa(cells, [stimulus])[:, 0]
        [trains_ms] = encode_cells(stress_pa, stimulus.dt_ms, cells)
        trains.append(SpikeTrain(f"sine_20_{amplitude_um}", "RA", trains_ms[5]))
    monkeypatch.setattr(recorded, "_distance", lambda *_: None)
    monkeypatch.setattr(recorded, "CURVE_HZ", (20.0,))
    few = Facts(published(THRESHOLDS).table[:1], "")
    timing = gather(model, model, {THRESHOLDS: few}, trains).judged.timing
    # A recorded window begins a few ms later: a spike less in five cycles.
    assert_allclose(timing.model_unit_impulses, timing.impulses_per_cycle, atol=0.21)
    assert timing.impulses_near.all()
    assert set(timing.model_unit_place) == {timing.model_unit_place[0]}
    assert_allclose(timing.model_unit_place[0], 5.5 / 40, atol=0.05)


def test_human_units_and_distance_are_shortfalls_where_the_model_is_off(study):
    human = pd.DataFrame(
        [("SA", 8.0, 100.0, 0.5, 1.0), ("SA", 8.0, 200.0, 1.0, 2.5), ("RA", 8.0, 100.0, 1.0, 1.4)],
        columns=["afferent", "frequency_hz", "amplitude_um", "impulses_per_cycle", "model"],
    )
    distance = pd.DataFrame({"amplitude_um": [10.0] * 3, "model_um": [20.0, 5.0, math.nan]})
    off, near = (
        replace(study, evidence=replace(study.evidence, human=table, distance=amplitudes))
        for table, amplitudes in ((human, distance), (human[2:], distance.assign(model_um=12.0)))
    )
    for entries_of, topic, afferent, numbers in (
        (shortfalls, "human_impulses", "SA", ("2.5", "1.0", "8 Hz", "200 µm")),
        (fingertip_shortfalls, "distance", "RA", ("2.0",)),
    ):
        accepted = entries_of(near)
        [entry] = [entry for entry in entries_of(off) if entry not in accepted]
        assert (entry.topic, entry.afferents) == (topic, (afferent,))
        assert all(number in entry.message for number in numbers)
        assert entry.sentence.startswith(f"{afferent}, ")


@pytest.fixture
def no_page(here, monkeypatch, computed):
    """An empty page, to save time: tests of `write_report` read the page."""
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr(validation_page, "page_text", lambda *arguments: "")


@pytest.mark.usefixtures("no_page")
def test_a_table_on_the_screen_and_a_page_in_the_folder(here, capsys, observed_file, own_file):
    options = ["--observed", str(observed_file), "--parameters", str(own_file)]
    assert main(["validate", *options]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "own" in lines[0] and "observed" in lines[0]
    assert lines[1].split() == ["SA", "RA", "PC"]
    assert lines[2].startswith("sine ")
    assert lines[4].startswith("noise") and not re.search(r"\d", lines[4])
    assert "report/index.html" in lines[-1]
    assert (here / "report/index.html").is_file()
    assert (here / "report/validation.toml").is_file()


@pytest.mark.usefixtures("no_page")
def test_with_json_stdout_has_only_the_summary(here, capsys):
    assert main(["validate", "-o", "out", "--parameters", "published", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["page"], summary["reference"]) == ("out/index.html", "TouchSim")
    assert summary["models"] == ["published", "fingertip"]
    assert len(summary["agreement"]) == 2 * 3 * 3
    assert {row["meets_paper"] for row in summary["agreement"]} == {None}
    assert set(summary["files"]) == {path.name for path in (here / "out").iterdir()}


@pytest.mark.parametrize(
    ("options", "code", "shown"),
    [
        (["--parameters", "absent.toml"], 2, "absent.toml"),
        (["--finger", "mine.toml"], 2, "mine.toml"),
        (["-o", ""], 2, "-o"),
        (["-o", "out"], 1, "out"),
    ],
)
def test_a_missing_input_is_one_line_before_anything_is_computed(
    refused, file, monkeypatch, options, code, shown
):
    monkeypatch.setattr("fembridge.reporting.validation_data.compute_validation", None)
    file("out", "mine")
    refused(["validate", "--parameters", "published", *options], shown, code)


@pytest.mark.slow
@pytest.mark.usefixtures("no_page")
def test_a_validation_has_its_tables_and_comes_back_from_its_files(tmp_path, study):
    made = fb.validate(tmp_path / "first", parameters="published")
    read = fb.Validation.read(tmp_path / "first")
    assert (read.judged, read.finger, read.reference) == ("published", "quick", "TouchSim")
    assert read.tables.keys() == made.tables.keys()
    read.write(tmp_path / "second")
    assert_array_equal(read.agreement["rmse_ips"], made.agreement["rmse_ips"])
    assert fb.Validation.read(tmp_path / "second").tables.keys() == made.tables.keys()
    for name, table in made.tables.items():
        assert_frame_equal(read.tables[name], table, rtol=1e-14, check_dtype=False)
    assert read.provenance == made.provenance
    assert fb.Validation.read(tmp_path / "second").provenance == made.provenance
    with pytest.raises(UsageError) as refused:
        made.plot("nothing")
    for kind in refused.value.expected.split(", "):
        panels = [panel for panel in made.plot(kind).axes if panel.get_label() != "<colorbar>"]
        figure = Figure()
        for count in range(1, len(panels) + 1):
            with suppress(UsageError):
                assert made.plot(kind, ax=figure.subplots(1, count, squeeze=False)) is figure
                break
            figure.clear()
        assert figure.axes, kind
    with pytest.raises(UsageError):
        read.plot()


def test_a_folder_of_recorded_tables_adds_rates_and_touches(tmp_path, observed_file, monkeypatch):
    taken = {}

    def compute(response, models, rates, facts, trains, skin, touches):
        taken.update(touches, rates=rates)
        raise KeyboardInterrupt

    module = "fembridge.reporting.validation_data"
    monkeypatch.setattr(f"{module}.compute_validation", compute)
    write_rates(tmp_path / "more.csv", [Rate("sine_30_100", "SA", 9.0)])
    (tmp_path / "areas.csv").write_text("afferent,area_mm2\nPC,80\n", encoding="utf-8")
    with pytest.raises(KeyboardInterrupt):
        fb.validate(observed=observed_file, recorded=tmp_path)
    assert taken["fields"]["area_mm2"].tolist() == [80]
    assert {"sine_30_100", "sine_20_250"} <= set(taken["rates"].stimuli)


@pytest.mark.usefixtures("no_page")
def test_evidence_is_taken_as_a_frame_and_an_unknown_name_is_refused(monkeypatch):
    taken = {}
    module = "fembridge.reporting.validation_data"
    monkeypatch.setattr(f"{module}.compute_validation", lambda *_: pytest.fail("computed"))
    table = published(DISTANCE).table
    with pytest.raises(UsageError) as caught:
        fb.validate(evidence={"distances": table})
    assert (caught.value.argument, caught.value.found) == ("evidence", "distances")

    def compute(response, models, rates, facts, trains, skin, touches):
        taken.update(facts)
        taken.update(touches)
        raise KeyboardInterrupt

    monkeypatch.setattr(f"{module}.compute_validation", compute)
    bars = pd.DataFrame({"shape": ["gap"], "width_mm": 1, "position_mm": 0.5, "rate_ips": 9.0})
    with pytest.raises(KeyboardInterrupt):
        fb.validate(evidence={"distance": table, "bars": bars})
    assert_array_equal(taken[DISTANCE].table, table)
    assert_frame_equal(taken["bars"], bars, check_dtype=False)


LEAST_PT = 7.0
"""In a figure of 7.2 inches; the page scales it to 8.1, so no letter is below 8 points."""


@pytest.fixture(scope="module")
def page(report):
    """The page as a tree: every tag is closed."""
    return ElementTree.fromstring((report / PAGE).read_text(encoding="utf-8"))


def text_of(element):
    return "".join(element.itertext())


@pytest.fixture(scope="module")
def tables(page):
    """Rows of cells of each table, by the id of its figure."""
    return {
        figure.get("id"): [[text_of(cell) for cell in row] for row in figure.iter("tr")]
        for figure in page.iter("figure")
    }


def rows_of(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_page_loads_nothing_and_its_links_lead_somewhere(page, report):
    assert not [e for e in page.iter() if {"src", "srcset", "data"} & set(e.attrib)]
    text = (report / PAGE).read_text(encoding="utf-8")
    assert "@import" not in text
    assert not re.findall(r"url\((?!#)", text)
    ids = [element.get("id") for element in page.iter() if element.get("id")]
    for link in (element.get("href") for element in page.iter("a")):
        assert link[1:] in ids if link.startswith("#") else (report / link).is_file(), link
    assert len(set(ids)) == len(ids)


def test_every_figure_and_table_has_a_valid_command_and_a_file(page, report):
    from fembridge.cli import _parser

    figures, linked = list(page.iter("figure")), set()
    assert len(figures) > 15
    for figure in figures:
        [line] = map(text_of, figure.iterfind(".//pre/code"))
        program, *rest = shlex.split(line)
        assert program == "fembridge"
        parser, command = _parser(rest)
        assert command is not None
        parser.parse_args(rest)
        files = [link.get("href") for link in figure.iter("a")]
        assert files
        linked.update(files)
    assert linked == {path.name for path in report.iterdir()} - {PAGE}


def test_names_of_a_user_do_not_become_markup(study, undrawn, tmp_path):
    judged = replace(study.judged, name="own", source="file <b>&amp;.toml")
    text = page_text(replace(study, models=(judged, *study.models[1:])), "a < b & c", tmp_path)
    assert "own: file &lt;b&gt;&amp;amp;.toml" in text
    assert "<code>a &lt; b &amp; c" in text


def cells_by_key(rows):
    """Cells of a table by family and class, without its two heading rows."""
    family, cells = None, {}
    for row in rows[2:]:
        if row[0] not in AFFERENTS:
            family, row = row[0].partition(" (")[0], row[1:]
        cells[family, row[0]] = row[1:]
    return cells


@pytest.mark.parametrize(
    ("table", "sources"),
    [
        ("summary", ("own", "published", "TouchSim")),
        ("fingertip_agreement", ("own", "fingertip", "TouchSim")),
    ],
)
def test_a_table_of_agreement_shows_the_numbers_of_its_csv_file(tables, report, table, sources):
    """Reference: observed rates; in the second table TouchSim's for a family without any."""
    rows = {
        (row["reference"], row["source"], row["family"], row["afferent"]): row
        for row in rows_of(report / "agreement.csv")
        if row["set"] == ALL_SETS
    }
    shown, compared = cells_by_key(tables[table]), 0
    assert len(shown) == 9
    for family, afferent in product(FAMILIES, AFFERENTS):
        reference = (
            "TouchSim" if (family.name, table) == ("noise", "fingertip_agreement") else OBSERVED
        )
        for number, source in enumerate(sources):
            texts = shown[family.title, afferent][4 * number : 4 * number + 4]
            row = rows.get((reference, source, family.name, afferent))
            if row is None or row["count"] == "0":
                assert texts == ["none" if row else "", "", "", ""]
                continue
            compared += 1
            numbers = [float(text.replace("−", "-").strip("<")) for text in texts]
            names = ("r_squared", "p_value", "rmse_ips", "bias_ips")
            expected = [float(row[name]) for name in names]
            expected[1] = max(expected[1], 0.001)
            for half, *pair in zip((5e-3, 5e-4, 0.05, 0.05), numbers, expected, strict=True):
                assert_allclose(*pair, rtol=0, atol=half * 1.001)
    assert compared == 3 * (3 + 1) + (2 * 3 if reference == "TouchSim" else 0)


def test_the_rows_of_recorded_sets_are_those_of_the_csv_file(tables, report):
    rows = [row for row in rows_of(report / "recorded_sets.csv") if not row["missing"]]
    shown = [row for row in tables["recorded_sets"] if row[-1] != "ratio" and row[0] != ""]
    keys = list(dict.fromkeys((row["set"], row["afferent"]) for row in rows))
    body = tables["recorded_sets"][2:]
    assert len(body) == len(keys)
    assert shown
    for (name, afferent), cells in zip(keys, body, strict=True):
        assert afferent in cells[:2]
        of_set = [row for row in rows if (row["set"], row["afferent"]) == (name, afferent)]
        assert of_set[0]["recorded"] in cells[:3]
        for row in of_set:
            if row["ratio"]:
                assert any(cell.startswith(f"{float(row['ratio']):.2f}") for cell in cells)


def test_sets_without_data_name_the_table_that_fills_them(page):
    text = text_of(page)
    assert "unit,depth_mm,speed_mm_per_s,impulses" in text
    assert "shape,width_mm,position_mm,rate_ips" in text


def test_goals_are_marked_where_rates_were_observed_and_nowhere_else(tables):
    judged = {("Sinusoids", afferent) for afferent in AFFERENTS} | {("Diharmonics", "SA")}
    for key, cells in cells_by_key(tables["summary"]).items():
        assert set(cells[-2:]) <= ({"met", "not met"} if key in judged else {"–"}), key


def test_the_record_names_the_inputs_and_seals_the_files(report, study):
    record = tomllib.loads((report / "validation.toml").read_text(encoding="utf-8"))
    assert record["judged"] == "own"
    assert record["reference"] == "observed"
    assert record["models"]["own"]["parameters"]["RA"]["tau_ms"] == 40.0
    assert record["observed"]["sha256"] == study.observed.sha256
    assert record["observed"]["file"] == "rates.csv"
    assert record["response"]["finger"]["name"] == "quick"
    others = {path.name for path in report.iterdir()} - {"validation.toml"}
    assert set(record["files"]) == others
    for name, digest in record["files"].items():
        assert hashlib.sha256((report / name).read_bytes()).hexdigest() == digest


def regression(study):
    family = FAMILIES[2]
    reference = study.rates.reference(family.stimuli)
    return regression_figure(study.rates, study.agreement, family, reference, "own")


def raster(study):
    """Raster of the model's spikes, with the first train of each stimulus also as recorded."""
    simulation = study.simulations["own"]
    strongest = next(s for s in simulation.stimuli if s.id == RASTER_STIMULI[-1])
    trains = repeated_trains(simulation)
    return rasters_figure(trains, strongest, trains[::5])


@pytest.mark.parametrize("figure_of", [regression, raster])
def test_no_labels_overlap_none_leave_the_page_and_all_are_legible(study, figure_of, check_words):
    check_words(figure_of(study), LEAST_PT)


def test_the_dashed_line_is_the_regression_and_the_grey_one_is_equality(study):
    figure = regression_figure(study.rates, study.agreement, SINES, OBSERVED, "own")
    sources = study.rates.compared_with(OBSERVED)
    assert sources[-1] == TOUCHSIM
    panels = np.array(figure.axes).reshape(len(sources), len(AFFERENTS))
    for row, source in zip(panels, sources, strict=True):
        for panel, afferent in zip(row, AFFERENTS, strict=True):
            observed = study.rates.rates_ips(OBSERVED, afferent, SINES.stimuli)
            predicted = study.rates.rates_ips(source, afferent, SINES.stimuli)
            line = next(line for line in panel.lines if line.get_linestyle() == "--")
            slope, intercept = np.polyfit(observed, predicted, 1)
            assert_allclose(line.get_ydata(), slope * line.get_xdata() + intercept, atol=1e-9)
            assert panel.get_xlim() == panel.get_ylim()


def test_recorded_spikes_have_separate_rows_below_the_model_s(study):
    first, *_ = raster(study).axes[3:]
    names = [label.get_text() for label in first.get_yticklabels()]
    assert len(names) == 2 * len(RASTER_STIMULI)
    assert names[::2] == list(RASTER_STIMULI)
    assert all(OBSERVED in name for name in names[1::2])
