"""Values that hold nothing sensible are refused in words, each where it is made."""

from dataclasses import replace

import numpy as np
import pytest

from fembridge.errors import ParameterError, TraceError
from neural.candidates import candidate_counts
from neural.coefficients import Coefficients
from neural.cross_validation import cross_validate
from neural.drive_table import drive_named
from neural.encoder import encode
from neural.fit_problem import FitProblem
from neural.lif import spike_counts
from neural.parameter_file import ParameterSet, read_parameter_set
from neural.parameters import PUBLISHED, RaParameters
from neural.search import search_front
from neural.sets import parameter_set, parameter_set_or_file

DRIVE = np.ones((20, 2))


def small_problem():
    rng = np.random.default_rng(0)
    return FitProblem(
        drive=drive_named("published", "RA"),
        stress_pa=np.abs(rng.normal(0, 1e4, (201, 4))),
        observed_ips=np.arange(4.0),
        groups=("a", "a", "b", "b"),
        windows_ms=((0.0, 100.0),) * 4,
        dt_ms=0.5,
    )


@pytest.mark.parametrize(
    "text",
    [
        "[SA]\ntau_ms=" + "1" * 400,
        "preindent_um=" + "1" * 400,
        "preindent_um=" + "1" * 5000,
        "fit=" + "[" * 3000 + "]" * 3000,
        "preindent_um = nan",
        "preindent_um = -1.0",
        "name = [1]",
        "[SA]\nspread = 1000.0",
        "[SA]\ncells = 1e9",
        "[SA]\ndrive = ['rising']",
    ],
)
def test_a_hostile_file_of_parameters_ends_in_one_line(tmp_path, text):
    path = tmp_path / "hostile.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ParameterError, match=r"hostile\.toml: ") as caught:
        read_parameter_set(path)
    assert "\n" not in str(caught.value)


def test_shares_of_three_filters_are_summed():
    filtered = [np.ones(2)] * 3
    saturating = Coefficients(1.0, halves=(1.0,) * 3).current(filtered)
    linear = Coefficients(2.0, weights=(1.0, 2.0, 3.0)).current(filtered)
    assert saturating.tolist() == [1.5, 1.5]
    assert linear.tolist() == [12.0, 12.0]


@pytest.mark.parametrize(
    ("coefficients", "more"),
    [
        (Coefficients([1.0] * 4, halves=(1.0,)), {"jump_mv": [1.0, 2.0, 3.0]}),
        (Coefficients([1.0] * 4, weights=([1.0] * 3,)), {}),
    ],
)
def test_arrays_of_unequal_length_are_refused(coefficients, more):
    with pytest.raises(ParameterError):
        candidate_counts([DRIVE], coefficients, 20.0, dt_ms=0.5, gap_mv=10.0, **more)


def test_an_infinite_current_fires_nothing():
    with pytest.raises(TraceError, match="not finite"):
        spike_counts([0.0, np.inf, 0.0, 0.0], 20.0, 0.5, 10.0)


def test_a_search_tries_whole_populations_and_says_so():
    seen = []
    front = search_front(small_problem(), evaluations=50, population=20, on_progress=seen.append)
    assert front.evaluations == 60
    assert [(now.evaluations, now.of) for now in seen] == [(20, 60), (40, 60), (60, 60)]


def test_an_interrupt_after_the_last_generation_is_none():
    def late(progress):
        if progress.evaluations >= 40:
            raise KeyboardInterrupt

    front = search_front(small_problem(), evaluations=40, population=20, on_progress=late)
    assert front.finished


def test_an_unknown_rule_is_refused_before_anything_is_searched(monkeypatch):
    def search(*_, **__):
        pytest.fail("searched first")

    monkeypatch.setattr("neural.cross_validation.search_front", search)
    with pytest.raises(ParameterError, match="rule 'best', expected one of"):
        cross_validate(small_problem(), 1, rule="best")


def test_a_set_of_parameters_checks_itself():
    with pytest.raises(ParameterError, match="preindent_um must be a number >= 0"):
        ParameterSet("own", PUBLISHED, preindent_um=-5.0)
    with pytest.raises(ParameterError, match="own: parameters of no class"):
        ParameterSet("own", {})
    with pytest.raises(TypeError):
        parameter_set("fitted").origin["more"] = 1


def test_an_empty_word_names_no_set():
    with pytest.raises(ParameterError, match="no parameter set '', expected published"):
        parameter_set_or_file("")


def test_cells_may_be_any_whole_number():
    made = RaParameters(tau_ms=9, a3_pa_per_ms=1, alpha_mv_per_ms=1, cells=np.int64(5))
    assert made.cells == 5
    assert type(made.cells) is int


@pytest.mark.parametrize("keep", [[True], [0, 2], [1, 0, 1, 0]])
def test_a_part_takes_a_flag_a_stimulus(keep):
    with pytest.raises(ParameterError, match="expected a flag for each of 4 stimuli"):
        small_problem().part(keep)


def test_a_rest_of_ages_ends_at_once():
    """It once made the loop count every row of the pause."""
    with pytest.raises(ParameterError, match="refractory_ms must be at most"):
        encode(np.ones(20), 0.5, replace(PUBLISHED["RA"], refractory_ms=1e12))
    long = replace(PUBLISHED["SA"], refractory_ms=1e5)
    [times_ms] = encode(np.full(501, 1e5), 0.5, long)
    assert times_ms.size == 1
