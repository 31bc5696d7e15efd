"""What the page says: of a model without data, of its failures, of observed rates."""

import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fembridge
from decks.presets import QUICK
from fembridge.cli import main
from fembridge.errors import UsageError
from fembridge.observed import read_observed
from fembridge.tables import AFFERENTS, Rate, SpikeTrain, read_rates, write_rates
from fembridge.validation.agreement_cell import agreement_cells, cell_of
from fembridge.validation.command_lines import command_lines
from fembridge.validation.compared_rates import OBSERVED, TOUCHSIM, compare_rates
from fembridge.validation.family import FAMILIES
from fembridge.validation.judged_model import judged_models
from fembridge.validation.repeat_raster import cells_of, repeated_trains
from fembridge.validation.shortfall import shortfalls
from fembridge.validation.source_section import source_section
from fembridge.validation.study import validate
from fembridge.validation.summary_section import summary_section

SINES_OBSERVED = Path(fembridge.__file__).parents[2] / "shared/data/observed_sine_rates.csv"


def text_of(section):
    return "".join(section.blocks)


def test_without_observed_rates_the_page_says_that_touchsim_is_no_data(unobserved):
    lines = command_lines(unobserved, "fembridge validate -o report")
    text = text_of(summary_section(unobserved, lines))
    assert "No observed rates were given" in text
    assert "a model, not data" in text
    assert 'class="met"' not in text
    assert 'class="missed"' not in text
    assert all(cell.reference == "TouchSim" for cell in unobserved.cells)


def test_each_cell_with_a_low_r_squared_or_a_large_error_has_its_sentence(study):
    told = shortfalls(study)
    for family in FAMILIES:
        reference = study.compared.reference(family.stimuli)
        for afferent in AFFERENTS:
            cell = cell_of(study.cells, reference, "own", family.name, afferent)
            opening = f"{afferent}, {family.title.lower()}"
            sentences = [one for one in told if one.startswith((f"{opening}:", f"{opening},"))]
            short = False
            if cell.agreement is not None:
                rate_ips = study.compared.of(reference, afferent, family.stimuli)
                far = cell.agreement.rmse_ips > 0.5 * np.nanmean(rate_ips)
                short = far or not cell.agreement.regression.r_squared > 0.8
            assert len(sentences) == short, opening
            assert all(
                ("against TouchSim" in one) == (reference == "TouchSim") for one in sentences
            )


def test_a_silent_class_is_called_silent(study):
    compared = study.compared
    rate_ips = compared.rate_ips.copy()
    rate_ips[compared.sources.index("own"), :, AFFERENTS.index("SA")] = 0.0
    silent = replace(study, compared=replace(compared, rate_ips=rate_ips))
    found = [one for one in shortfalls(silent) if one.startswith("SA, sinusoids")]
    [sentence] = found
    assert "silent throughout, where observed reaches" in sentence


def test_rates_that_are_all_zero_are_a_shortfall_only_of_a_model_that_fires(tmp_path):
    noises = FAMILIES[2].stimuli
    write_rates(
        tmp_path / "rates.csv",
        [Rate(id_, afferent, 0.0) for id_ in noises for afferent in ("SA", "RA")],
    )
    observed = read_observed(tmp_path / "rates.csv")
    study = validate(QUICK, judged_models("published"), observed)
    compared = study.compared
    rate_ips = compared.rate_ips.copy()
    row = compared.sources.index("published")
    rate_ips[row, :, AFFERENTS.index("RA")] = 0.0
    sources = {
        name: [
            Rate(id_, afferent, rate)
            for id_, rates in zip(compared.stimuli, rate_ips[place], strict=True)
            for afferent, rate in zip(AFFERENTS, rates.tolist(), strict=True)
            if rate == rate
        ]
        for place, name in enumerate(compared.sources)
    }
    again = compare_rates(compared.stimuli, sources)
    quiet = replace(study, compared=again, cells=agreement_cells(again, OBSERVED))
    sine_and_diharm = agreement_cells(again, TOUCHSIM)
    told = shortfalls(replace(quiet, cells=quiet.cells + sine_and_diharm))
    openings = [one.partition(":")[0] for one in told]
    assert "SA, band-pass noises" in openings
    assert "RA, band-pass noises" not in openings
    assert any("from TouchSim’s" in one for one in told)  # no observed sinusoid


def test_a_command_of_the_page_makes_the_numbers_of_the_page(study, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = command_lines(study, "whole")
    program, *words = shlex.split(lines.simulations("diharm_50_250")[0])
    assert program == "fembridge"
    assert main([*words, "--no-plot"]) == 0
    rates = read_rates(tmp_path / "own_diharm_50_250/rates.csv")
    assert len(rates) == 15
    for rate in rates:
        [found] = study.compared.of("own", rate.afferent, [rate.stimulus])
        assert found == rate.rate_ips


def test_commands_name_the_model_its_finger_and_its_depth(study):
    deep = replace(study.judged, preindent_um=75.0)
    lines = command_lines(replace(study, models=(deep, study.models[1])), "whole")
    own, published = lines.simulations("sine")
    assert own == (
        f"fembridge simulate --stimulus sine --finger quick --stored "
        f"--parameters {study.judged.word} --preindent-um 75 -o own_sine"
    )
    assert "--parameters published --preindent-um 0 -o published_sine" in published


def test_stimuli_that_the_paper_has_not_are_left_out_and_named(tmp_path):
    rates = [Rate("sine_20_250", "SA", 25.0), Rate("sine_40_100", "SA", 20.0)]
    write_rates(tmp_path / "rates.csv", rates)
    heard = []
    observed = read_observed(tmp_path / "rates.csv")
    study = validate(QUICK, judged_models("published"), observed, heard.append)
    assert study.left_out == ("sine_40_100",)
    [line] = heard
    assert "left out sine_40_100" in line
    lines = command_lines(study, "fembridge validate")
    assert "sine_40_100" in text_of(source_section(study, lines))


def test_observed_rates_of_none_of_the_paper_s_stimuli_are_refused(tmp_path):
    write_rates(tmp_path / "rates.csv", [Rate("sine_40_100", "SA", 20.0)])
    observed = read_observed(tmp_path / "rates.csv")
    with pytest.raises(UsageError, match="no rate of one of the paper's 82 stimuli"):
        validate(QUICK, judged_models("published"), observed)


def test_no_model_is_nothing_to_judge():
    with pytest.raises(UsageError, match="no model"):
        validate(QUICK, [])


def test_a_population_gives_one_row_a_cell(study):
    simulation = study.simulations["own"]
    trains = tuple(
        SpikeTrain(train.stimulus, train.afferent, train.times_ms + cell, repeat=cell)
        for train in simulation.trains
        for cell in (3, 1, 2, 5, 4)
    )
    population = replace(simulation, trains=trains)
    assert cells_of(population) == 5
    single = {(train.stimulus, train.afferent): train.times_ms for train in simulation.trains}
    found = repeated_trains(population)
    assert len(found) == 3 * 3 * 5
    for train in found:
        expected = single[train.stimulus, train.afferent] + train.repeat
        np.testing.assert_array_equal(train.times_ms, expected)


def test_touchsim_against_the_observed_sinusoids_is_as_published():
    """R² and RMSE (ips) that were found of TouchSim when it was computed."""
    if not SINES_OBSERVED.is_file():
        pytest.skip("the observed rates are not ours to pass on")
    observed = read_observed(SINES_OBSERVED)
    study = validate(QUICK, judged_models("published"), observed)
    expected = {"SA": (0.94, 7.3), "RA": (0.60, 32.4), "PC": (0.98, 38.7)}
    for afferent, (r_squared, rmse_ips) in expected.items():
        found = cell_of(study.cells, "observed", "TouchSim", "sine", afferent).agreement
        assert found.regression.r_squared == pytest.approx(r_squared, abs=0.005)
        assert found.rmse_ips == pytest.approx(rmse_ips, abs=0.05)
