"""The batch of a fit against one run at a time."""

from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fembridge.errors import ParameterError, TraceError
from neural.candidates import candidate_counts
from neural.coefficients import Coefficients
from neural.drive_table import drive_of
from neural.encoder import afferent_drives, encode
from neural.lif import spike_counts
from neural.parameters import PUBLISHED
from neural.rate import spikes_inside, window_rows


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    rows=st.integers(1, 300),
    candidates=st.integers(1, 6),
    conditions=st.integers(1, 5),
    two=st.booleans(),
)
def test_a_batch_counts_what_current_and_kernel_count(seed, rows, candidates, conditions, two):
    rng = np.random.default_rng(seed)
    drives = rng.uniform(0, 5e3, (2, rows, conditions))
    halves = rng.uniform(10, 1e4, (2, candidates))
    alpha, tau_ms = rng.uniform(1, 40, candidates), rng.uniform(1, 300, candidates)
    edges = tuple(np.sort(rng.integers(0, rows + 1, (2, conditions)), axis=0))
    if not two:
        drives, halves = drives[:1], halves[:1]
    current = np.stack(
        [
            Coefficients(alpha[k], halves=tuple(halves[:, k])).current(drives)
            for k in range(candidates)
        ],
        axis=1,
    )

    counts = candidate_counts(
        drives,
        Coefficients(alpha, halves=tuple(halves)),
        tau_ms,
        dt_ms=0.5,
        gap_mv=10.0,
        refractory_ms=1.0,
        window=edges,
    )

    assert counts.shape == (candidates, conditions)
    np.testing.assert_array_equal(counts, spike_counts(current, tau_ms, 0.5, 10.0, 1.0, edges))


@pytest.mark.parametrize("afferent", PUBLISHED)
def test_the_published_candidate_counts_the_spikes_of_encode(afferent):
    published = PUBLISHED[afferent]
    times_ms = 0.5 * np.arange(501)
    stress_pa = 2e4 * np.maximum(np.sin(2e-3 * np.pi * np.outer(times_ms, [20, 50, 100, 300])), 0)
    windows_ms = [(5.0, 250.0), (100.0, 200.0), (100.0, 200.0), (0.0, 250.0)]
    rows = [window_rows(window_ms, 0.5) for window_ms in windows_ms]

    counts = candidate_counts(
        afferent_drives(afferent, stress_pa, 0.5),
        drive_of(published).coefficients(asdict(published)),
        published.tau_ms,
        dt_ms=0.5,
        gap_mv=published.gap_mv,
        refractory_ms=published.refractory_ms,
        window=([each.start for each in rows], [each.stop for each in rows]),
    )

    runs = encode(stress_pa, 0.5, published)
    expected = [
        spikes_inside(run, window_ms) for run, window_ms in zip(runs, windows_ms, strict=True)
    ]
    assert counts.tolist() == [expected]
    assert sum(expected) > 0


def test_blocks_do_not_show_in_the_batch(monkeypatch):
    rng = np.random.default_rng(2)
    drives, half = [rng.uniform(0, 9, (80, 4))], rng.uniform(1, 9, 11)
    coefficients = Coefficients(20.0, halves=(half,))
    arguments = {"dt_ms": 0.5, "gap_mv": 10.0, "window": slice(7, 71)}
    whole = candidate_counts(drives, coefficients, 50.0, **arguments)

    monkeypatch.setattr("neural.tally.BLOCK", 9)

    blocked = candidate_counts(drives, coefficients, 50.0, **arguments)
    np.testing.assert_array_equal(blocked, whole)
    assert whole.min() > 0


@pytest.mark.parametrize(
    ("drives", "halves", "error", "words"),
    [
        ([], [], TraceError, "shape none"),
        ([np.zeros(5)], [1.0], TraceError, r"expected one \(T, condition\)"),
        ([np.zeros((5, 2)), np.zeros((4, 2))], [1.0, 1.0], TraceError, "expected one"),
        ([np.full((5, 2), np.nan)], [1.0], TraceError, "not finite"),
        ([np.zeros((5, 2))], [1.0, 1.0], ParameterError, "2 coefficients for 1 drives"),
        ([np.zeros((5, 2))], [[1.0, 0.0, 1.0, 1.0]], ParameterError, "must be > 0, got 0"),
        ([np.zeros((5, 2))], [[1.0, 2.0, 3.0]], ParameterError, "expected a number"),
    ],
)
def test_arrays_that_do_not_go_together_are_refused(drives, halves, error, words):
    with pytest.raises(error, match=words):
        candidate_counts(
            drives, Coefficients([1.0] * 4, halves=tuple(halves)), 20.0, dt_ms=0.5, gap_mv=10.0
        )


def test_two_drives_are_the_most():
    with pytest.raises(ParameterError, match="3 drives, expected one or two"):
        candidate_counts(
            [np.zeros((5, 2))] * 3,
            Coefficients(1.0, halves=(1.0,) * 3),
            20.0,
            dt_ms=0.5,
            gap_mv=10.0,
        )
