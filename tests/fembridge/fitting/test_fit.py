"""A fit finds again what the rates were made with, and can be stopped."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from fembridge.errors import ResponseError, UsageError
from fembridge.fitting.fit import FitRun, FitSettings, fit_afferents
from fembridge.observed import ObservedRates
from neural.models import model_named
from neural.search import Front, choose

SHORT = {"evaluations": 200, "population": 20, "preindent_um": 75.0}


@pytest.fixture(scope="module")
def ra_run(observed, response):
    settings = FitSettings(evaluations=1200, population=60, preindent_um=75.0)
    return fit_afferents(observed, response, drives("RA"), settings)


def drives(*names, drive="rising"):
    return {name: model_named(drive, name) for name in names}


def test_rates_of_known_parameters_are_found_again(ra_run):
    [fit] = ra_run.fits
    assert ra_run.finished
    assert fit.fitted.observed_ips.max() > 100.0
    assert fit.fitted.total.rmse_ips < 2.0
    assert_allclose(fit.parameters.step_pa, 7000.0, rtol=0.1)


def test_stimuli_that_were_not_fitted_are_judged_as_unseen(ra_run):
    [fit] = ra_run.fits
    families = {entry.family for entry in fit.unseen.entries}
    assert families == {"diharm", "noise"}
    assert not fit.unseen.seen
    assert fit.fitted.seen
    assert {entry.family for entry in fit.fitted.entries} == {"sine"}
    assert fit.unseen.total.rmse_ips < 5.0
    assert [judged.seen for judged in fit.judged] == [True, False]


def test_the_chosen_candidate_has_the_smallest_error_of_all_rates(ra_run):
    [fit] = ra_run.fits
    away = fit.problem.rates_ips(fit.front.values) - fit.problem.observed_ips
    rmse_ips = np.sqrt((away**2).mean(axis=1))
    assert rmse_ips.argmin() == fit.choice.row
    assert_allclose(rmse_ips.min(), fit.fitted.total.rmse_ips, rtol=1e-12)


def test_rates_made_by_table_2_are_its_own_without_any_pre_indentation(table, response):
    from fembridge.observed import read_observed

    made = read_observed(table(0.0))
    settings = FitSettings(**SHORT)
    [fit] = fit_afferents(made, response, drives("SA"), settings).fits
    assert_allclose(fit.published.predicted_ips, fit.published.observed_ips, rtol=1e-12)
    assert fit.published.total.rmse_ips == 0.0


def test_the_same_seed_gives_the_same_front_and_another_one_another(observed, response):
    def front(seed):
        settings = FitSettings(seed=seed, **SHORT)
        return fit_afferents(observed, response, drives("RA"), settings).fits[0].front

    first, again, other = front(3), front(3), front(4)
    assert_array_equal(first.values, again.values)
    assert_array_equal(first.errors_ips2, again.errors_ips2)
    assert first.values.tolist() != other.values.tolist()


def test_an_interrupt_keeps_the_best_so_far_and_leaves_later_classes_out(observed, response):
    heard = []

    def stop(afferent, progress):
        heard.append((afferent, progress.evaluations))
        if len(heard) == 2:
            raise KeyboardInterrupt

    run = fit_afferents(
        observed, response, drives("RA", "SA"), FitSettings(**SHORT), on_progress=stop
    )
    assert heard == [("RA", 20), ("RA", 40)]
    assert [fit.afferent for fit in run.fits] == ["RA"]
    assert run.fits[0].front.evaluations == 40
    assert not run.fits[0].front.finished
    assert not run.finished
    assert run.asked == ("RA", "SA")


def test_an_interrupt_of_a_later_class_before_it_began_keeps_the_first(
    observed, response, monkeypatch
):
    from fembridge.fitting import fit as module

    search = module.search_front

    def searched(problem, **options):
        if problem.model.afferent == "SA":
            raise KeyboardInterrupt
        return search(problem, **options)

    monkeypatch.setattr(module, "search_front", searched)
    run = fit_afferents(observed, response, drives("RA", "SA"), FitSettings(**SHORT))
    assert [fit.front.finished for fit in run.fits] == [True]
    assert not run.finished


def test_an_interrupt_before_anything_was_found_stays_one(observed, response, monkeypatch):
    from fembridge.fitting import fit as module

    def searched(problem, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "search_front", searched)
    with pytest.raises(KeyboardInterrupt):
        fit_afferents(observed, response, drives("RA"), FitSettings(**SHORT))


def test_every_fit_is_told_of_when_it_is_made(observed, response):
    heard = []
    run = fit_afferents(
        observed, response, drives("RA", "SA"), FitSettings(**SHORT), on_fit=heard.append
    )
    assert heard == list(run.fits)


def test_the_rule_decides_which_candidate_of_a_front_is_taken(ra_run):
    """A front made by hand: its errors say one thing, the rates say another."""
    problem = ra_run.fits[0].problem
    assert [one.field for one in problem.free] == ["tau_ms", "step_pa", "spread"]
    off, known = [90.0, 9000.0, 0.4], [90.0, 7000.0, 0.4]
    errors_ips2 = np.array([[100.0] * 4, [101.0] * 4])
    front = Front(
        free=problem.free,
        groups=problem.group_names,
        values=np.array([off, known]),
        errors_ips2=errors_ips2,
        evaluations=2,
        seed=1,
        finished=True,
    )
    assert choose(problem, front, "smallest_error").row == 0
    assert choose(problem, front, "frequency_response").row == 1


def test_a_class_that_the_response_lacks_is_refused(observed, response):
    from dataclasses import replace

    alone = replace(response, places=response.places[:1], tensor_pa=response.tensor_pa[:, :1])
    with pytest.raises(ResponseError, match="no RA in the response, only SA"):
        fit_afferents(observed, alone, drives("RA"), FitSettings(**SHORT))


def test_a_family_without_observed_rates_is_refused(observed, response):
    sines = observed.family("sine")
    with pytest.raises(UsageError, match="of RA of family noise, only of sine"):
        fit_afferents(sines, response, drives("RA"), FitSettings(families=("noise",), **SHORT))


def test_a_stimulus_deeper_than_the_response_is_refused_by_name(observed, response, tmp_path):
    deep = ObservedRates(("sine_20_500",), ("RA",), [[30.0]], tmp_path, "0" * 64)
    with pytest.raises(ResponseError, match=r"sine_20_500 goes 5.* um deep"):
        fit_afferents(deep, response, drives("RA"), FitSettings(**SHORT))


def test_nothing_to_fit_is_refused(observed, response):
    with pytest.raises(UsageError, match="no class to fit"):
        fit_afferents(observed, response, {}, FitSettings(**SHORT))


def test_a_run_without_all_its_classes_is_not_finished(ra_run):
    assert not FitRun(ra_run.fits, ("RA", "PC"), ra_run.settings).finished


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"preindent_um": -1.0}, "preindent_um is -1"),
        ({"preindent_um": float("nan")}, "preindent_um is nan"),
        ({"cells": 0}, "cells is 0, expected 1 to 1000"),
        ({"cells": 1001}, "cells is 1001"),
        ({"population": 3}, "population is 3"),
        ({"evaluations": 50, "population": 60}, "50 evaluations, expected at least one"),
        ({"seed": -1}, "seed is -1"),
    ],
)
def test_settings_that_no_fit_can_be_made_with_are_refused(wrong, told):
    with pytest.raises(UsageError, match=told):
        FitSettings(**wrong)
