"""The picture of a fit: what is in each panel, and that nothing is lost."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from fembridge.fitting.fit import FitSettings, fit_afferents
from fembridge.plots.fit import strongest_tradeoff, tradeoffs_figure
from neural.models import model_named


@pytest.fixture(scope="module")
def run(observed, response):
    drives = {"RA": model_named("adaptive", "RA"), "SA": model_named("rising", "SA")}
    settings = FitSettings(evaluations=60, population=20)
    return fit_afferents(observed, response, drives, settings)


@pytest.fixture(scope="module")
def figure(run):
    figure = tradeoffs_figure(run)
    figure.draw_without_rendering()
    return figure


def test_every_candidate_has_a_line_the_chosen_and_table_2_one_more(run, figure):
    panels = figure.axes
    for fit, panel in zip(run.fits, panels[::6], strict=True):
        rmse_ips = np.sqrt(fit.front.errors_ips2)
        *candidates, published, chosen = [line.get_ydata() for line in panel.get_lines()]
        assert_allclose(candidates, rmse_ips)
        assert_allclose(chosen, rmse_ips[fit.choice.row])
        squared = (fit.seen["published_ips"] - fit.seen["observed_ips"]) ** 2
        expected = np.sqrt(squared.groupby(fit.seen["group"], sort=False).mean())
        assert_allclose(published, expected)
        assert panel.get_ylim()[1] > max(rmse_ips.max(), *expected)


def test_rates_stand_over_their_amplitudes(run, figure):
    panels = figure.axes
    for fit, row in zip(run.fits, (panels[2:6], panels[8:12]), strict=True):
        for panel, name in zip(row, fit.problem.group_names, strict=True):
            published, chosen, dots = panel.get_lines()
            mine = fit.seen[fit.seen["group"] == name]
            amplitudes = [float(stimulus.split("_")[2]) for stimulus in mine["stimulus"]]
            assert_array_equal(dots.get_xdata(), amplitudes)
            assert_array_equal(dots.get_ydata(), mine["observed_ips"])
            assert_array_equal(chosen.get_ydata(), mine["predicted_ips"])
            assert_array_equal(published.get_ydata(), mine["published_ips"])
            assert panel.get_ylim()[1] > mine["observed_ips"].max()


def test_classes_with_other_groups_leave_the_panels_of_the_others_empty(observed, response):
    rate_ips = observed.rate_ips.copy()
    column = observed.afferents.index("SA")
    fast = [name.startswith("sine_300") for name in observed.stimuli]
    rate_ips[fast, column] = np.nan
    partial = replace(observed, rate_ips=rate_ips)
    drives = {name: model_named("rising", name) for name in ("SA", "RA")}
    settings = FitSettings(evaluations=20, population=20)
    run = fit_afferents(partial, response, drives, settings)
    panels = tradeoffs_figure(run).axes
    assert [panel.axison for panel in panels[:6]] == [True] * 5 + [False]
    assert all(panel.axison for panel in panels[6:])


def test_the_strongest_trade_off_is_between_the_groups_that_rank_opposite():
    errors = np.array([[1.0, 1.0, 9.0], [2.0, 3.0, 5.0], [3.0, 2.0, 1.0]])
    assert strongest_tradeoff(errors) == (0, 2)
