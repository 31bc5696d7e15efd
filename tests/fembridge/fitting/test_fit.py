"""What a fit minimises; it finds again what the rates were made with; its picture."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose, assert_array_equal

import fembridge as fb
from decks.stimuli import resolve
from decks.synthesis import make_stimulus
from fembridge.errors import ParameterError, ResponseError, UsageError
from fembridge.fitting.fit import (
    Fit,
    FitSettings,
    FitTargets,
    Search,
    agreement_rows,
    fit_afferents,
)
from fembridge.fitting.problem import fit_problem, group_of
from fembridge.io.observed_rates import ObservedRates, read_observed
from fembridge.plots.fit_result import strongest_tradeoff, tradeoffs_figure
from fembridge.response.response_map import FOLDER, read_map
from neural import PUBLISHED, encode_cells, rate_ips
from neural.models import model_named
from neural.parameters import FINE_DT_MS, RisingRaParameters

SINES = (
    *("sine_20_35.08", "sine_20_67.01", "sine_20_128", "sine_20_250"),
    *("sine_50_48.31", "sine_50_113.6", "sine_50_250"),
    *("sine_100_36.39", "sine_100_85.98", "sine_100_200"),
    *("sine_300_10", "sine_300_25"),
)
OTHERS = ("diharm_10_50_50_20", "noise_5_25_30", "noise_25_250_10")
KNOWN = {
    "RA": RisingRaParameters(tau_ms=90.0, step_pa=7000.0, spread=0.4, cells=5),
    "SA": PUBLISHED["SA"],
}


@pytest.fixture(scope="module")
def response():
    """The stored response of the quick finger."""
    return read_map(FOLDER / "quick.toml")


@pytest.fixture(scope="module")
def known_rates(response):
    """A function that gives rates of `KNOWN` as observed ones, worked out apart from the fit."""

    def rates(preindent_um):
        classes, rows = [place.afferent for place in response.places], []
        for entry in resolve(SINES + OTHERS):
            stimulus = make_stimulus(entry, preindent_um=preindent_um, dt_ms=FINE_DT_MS)
            traces = response.traces(stimulus)
            for name, parameters in KNOWN.items():
                stress_pa = traces[classes.index(name)].stress_pa[:, None]
                cells = encode_cells(stress_pa, FINE_DT_MS, parameters)[0]
                rate = np.mean([rate_ips(x, stimulus.window_ms) for x in cells])
                rows.append((entry.id, name, rate))
        return read_observed(pd.DataFrame(rows, columns=["stimulus", "afferent", "rate_ips"]))

    return rates


@pytest.fixture(scope="module")
def observed(known_rates):
    return known_rates(75.0)


SHORT = FitSettings(search=Search(evaluations=200, population=20), preindent_um=75.0)


def models(*names):
    return {name: model_named("rising", name) for name in names}


def test_rates_of_known_parameters_are_found_again(observed, response):
    settings = FitSettings(search=Search(evaluations=2400, population=60), preindent_um=75.0)
    run = fit_afferents(observed, response, models("RA"), settings)
    [fit] = run.fits.values()
    assert run.finished
    assert fit.seen["observed_ips"].max() > 100.0
    assert fit.agreement().rmse_ips < 2.0
    assert_allclose(fit.parameters.step_pa, 7000.0, rtol=0.1)


def test_rates_made_by_table_2_are_its_own_without_any_pre_indentation(known_rates, response):
    settings = SHORT
    [fit] = fit_afferents(known_rates(0.0), response, models("SA"), settings).fits.values()
    assert_allclose(fit.seen["published_ips"], fit.seen["observed_ips"], rtol=1e-12)
    assert fit.agreement("published_ips").rmse_ips == 0.0


def test_an_interrupt_of_a_later_class_before_it_began_keeps_the_first(
    observed, response, monkeypatch, logged
):
    from fembridge.fitting import fit as module

    search = module.search_front

    def searched(problem, **options):
        if problem.model.afferent == "SA":
            raise KeyboardInterrupt
        return search(problem, **options)

    monkeypatch.setattr(module, "search_front", searched)
    run = fit_afferents(observed, response, models("RA", "SA"), SHORT)
    assert len(logged) == 1
    assert {name: fit.front.finished for name, fit in run.fits.items()} == {"RA": True}
    assert not run.finished


def test_a_stimulus_deeper_than_the_response_is_refused_by_name(observed, response, tmp_path):
    deep = ObservedRates(("sine_20_500",), ("RA",), np.array([[30.0]]), tmp_path, "0" * 64)
    with pytest.raises(ResponseError, match=r"sine_20_500 goes 5.* um deep"):
        fit_afferents(deep, response, models("RA"), SHORT)


@pytest.mark.parametrize(
    ("make", "wrong"),
    [
        (FitSettings, {"preindent_um": float("nan")}),
        (FitSettings, {"cells": 1001}),
        (Search, {"population": 3}),
        (Search, {"evaluations": 50}),
        (Search, {"seed": -1}),
        (Search, {"rule": "best"}),
        (FitTargets, {"spike_distance": "euclidean"}),
    ],
)
def test_settings_that_no_fit_can_be_made_with_are_refused(make, wrong):
    with pytest.raises(UsageError) as caught:
        make(**wrong)
    [(name, value)] = wrong.items()
    assert caught.value.argument == name
    assert str(caught.value.found) == str(value)


def test_a_stimulus_is_in_the_group_of_its_frequencies():
    entries = resolve(["sine_20_250", "diharm_10_50_50_20", "noise_5_25_30"])
    assert [group_of(entry) for entry in entries] == ["20 Hz", "10+50 Hz", "5-25 Hz"]
    assert [entry.level_um for entry in entries] == [250.0, 50.0, 30.0]


def test_stress_rates_and_windows_are_those_of_each_stimulus(observed, response):
    problem = fit_problem(
        observed,
        response,
        model_named("rising", "SA"),
        families=("sine", "noise"),
        preindent_um=75.0,
    )
    names, rate_ips = observed.rates_of("SA")
    kept = [k for k, name in enumerate(names) if not name.startswith("diharm")]
    assert_array_equal(problem.observed_ips, rate_ips[kept])
    for column, k in enumerate(kept):
        [entry] = resolve(names[k])
        stimulus = make_stimulus(entry, preindent_um=75.0, dt_ms=FINE_DT_MS)
        trace = response.traces(stimulus)[0]
        assert trace.afferent == "SA"
        assert_array_equal(problem.stress_pa[:, column, 0], trace.stress_pa)
        assert problem.windows_ms[column] == stimulus.window_ms
        assert problem.groups[column] == group_of(entry)


def test_agreement_is_said_of_each_group_each_family_and_all():
    entries = resolve(["sine_20_250,sine_20_128,sine_50_250,noise_5_25_30"])
    rates = pd.DataFrame(
        {
            "family": [entry.family for entry in entries],
            "group": [group_of(entry) for entry in entries],
            "seen": True,
            "observed_ips": [1, 2, 3, 4],
            "predicted_ips": [1, 4, 3, 4],
        }
    )
    shown = [(row["family"], row["group"], row["rmse_ips"]) for row in agreement_rows(rates)]
    assert shown == [
        ("sine", "20 Hz", pytest.approx(np.sqrt(2.0))),
        ("sine", "50 Hz", 0.0),
        ("sine", "all", pytest.approx(np.sqrt(4 / 3))),
        ("noise", "5-25 Hz", 0.0),
        ("noise", "all", 0.0),
        ("all", "all", 1.0),
    ]


@pytest.fixture(scope="module")
def run(observed, response):
    drives = {"RA": model_named("adaptive", "RA"), "SA": model_named("rising", "SA")}
    settings = FitSettings(search=Search(evaluations=60, population=20))
    return fit_afferents(observed, response, drives, settings)


@pytest.fixture(scope="module")
def figure(run):
    figure = tradeoffs_figure(run)
    figure.draw_without_rendering()
    return figure


def test_every_candidate_has_a_line_the_chosen_and_table_2_one_more(run, figure):
    panels = figure.axes
    for fit, panel in zip(run.fits.values(), panels[::6], strict=True):
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
    for fit, row in zip(run.fits.values(), (panels[2:6], panels[8:12]), strict=True):
        for panel, name in zip(row, fit.front.groups, strict=True):
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
    settings = FitSettings(search=Search(evaluations=20, population=20))
    run = fit_afferents(partial, response, drives, settings)
    panels = tradeoffs_figure(run).axes
    own = Figure().subplots(1, len(panels))
    assert tradeoffs_figure(run, own) is own[0].figure
    assert own[-1].get_xlabel() == "Amplitude (µm)"
    assert [panel.axison for panel in panels[:6]] == [True] * 5 + [False]
    assert all(panel.axison for panel in panels[6:])


def test_the_strongest_trade_off_is_between_the_groups_that_rank_opposite():
    errors = np.array([[1.0, 1.0, 9.0], [2.0, 3.0, 5.0], [3.0, 2.0, 1.0]])
    assert strongest_tradeoff(errors) == (0, 2)


def test_a_fit_comes_back_from_its_files_with_the_same_bytes(observed, tmp_path):
    search = Search(evaluations=60, population=20)
    options = {"afferents": ["RA"], "held_out": True, "preindent_um": 75.0, "search": search}
    made = fb.fit(observed_frame(observed), **options, output=tmp_path / "first")

    read = Fit.read(tmp_path / "first")
    read.write(tmp_path / "second")

    assert read.finished
    assert read.parameters.parameters["RA"] == made.parameters.parameters["RA"]
    assert read.provenance["response"] == made.provenance["response"]
    pd.testing.assert_frame_equal(read.rates, made.rates, check_dtype=False)
    assert_array_equal(read.fits["RA"].front.candidates, made.fits["RA"].front.candidates)
    totals = [pd.read_csv(tmp_path / name / "pareto_RA.csv") for name in ("first", "second")]
    pd.testing.assert_frame_equal(*totals, rtol=1e-14)  # squares of roots
    for path in (tmp_path / "first").iterdir():
        second = (tmp_path / "second" / path.name).read_bytes()
        assert path.name == "pareto_RA.csv" or path.read_bytes() == second, path.name


def observed_frame(observed):
    return pd.DataFrame(
        [(rate.stimulus, rate.afferent, rate.rate_ips) for rate in observed.rates()],
        columns=["stimulus", "afferent", "rate_ips"],
    )


def test_a_fit_is_drawn_into_axes_of_the_caller(run):
    from matplotlib.figure import Figure

    groups = {name for fit in run.fits.values() for name in fit.front.groups}
    axes = Figure().subplots(len(run.fits), 2 + len(groups)).reshape(-1)
    assert run.plot(ax=axes) is axes[0].figure
    assert all(panel.lines for panel in axes[:3])
    with pytest.raises(UsageError) as caught:
        run.plot(ax=axes[:3])
    assert (caught.value.argument, caught.value.found) == ("ax", 3)


def test_a_folder_without_a_fit_is_refused(tmp_path):
    with pytest.raises(ParameterError):
        Fit.read(tmp_path)


def test_rules_may_differ_by_class():
    search = fb.Search(rule="SA=tolerant, RA=balanced")
    assert [search.rule_of(name) for name in ("SA", "RA", "PC")] == [
        "tolerant",
        "balanced",
        "smallest_error",
    ]
    assert fb.Search(rule="tolerant").rule_of("PC") == "tolerant"
    for rule in ("SA=none", "XY=tolerant", "none", "SA=tolerant,balanced"):
        with pytest.raises(UsageError) as refused:
            fb.Search(rule=rule)
        assert refused.value.argument == "rule"
