"""What a fit minimises: groups, levels, windows, and the stress of the class."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.fitting.fit import JudgedRates
from fembridge.fitting.problem import fit_problem, group_of
from neural.models import model_named


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
    names, rate_ips = observed.of("SA")
    kept = [k for k, name in enumerate(names) if not name.startswith("diharm")]
    assert_array_equal(problem.observed_ips, rate_ips[kept])
    for column, k in enumerate(kept):
        [entry] = resolve(names[k])
        stimulus = make_stimulus(entry, preindent_um=75.0)
        trace = response.traces(stimulus)[0]
        assert trace.afferent == "SA"
        assert_array_equal(problem.stress_pa[:, column], trace.stress_pa)
        assert problem.windows_ms[column] == stimulus.window_ms
        assert problem.groups[column] == group_of(entry)


def test_agreement_is_said_of_each_group_each_family_and_all():
    entries = resolve(["sine_20_250,sine_20_128,sine_50_250,noise_5_25_30"])
    judged = JudgedRates(entries, np.array([1, 2, 3, 4]), np.array([1, 4, 3, 4]), True)
    shown = [(row["family"], row["group"], row["rmse_ips"]) for row in judged.rows()]
    assert shown == [
        ("sine", "20 Hz", pytest.approx(np.sqrt(2.0))),
        ("sine", "50 Hz", 0.0),
        ("sine", "all", pytest.approx(np.sqrt(4 / 3))),
        ("noise", "5-25 Hz", 0.0),
        ("noise", "all", 0.0),
        ("all", "all", 1.0),
    ]
    assert_array_equal(judged.of_group("20 Hz").predicted_ips, [1, 4])
