import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from fembridge.errors import ParameterError, TraceError
from neural import counts as counting
from neural import lif
from neural.counts import candidate_counts
from neural.lif import Membrane, fire
from neural.models import Coefficients

DT_MS, GAP_MV = 0.5, 10.0
LINEAR = Coefficients(1.0, weights=(1.0,))
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module", params=["NumPy", "plain loops", "compiled"])
def kernel(request):
    """Each way of stepping the membranes of `candidate_counts`."""
    compiled = counting.compiled()
    if request.param == "compiled" and not compiled:
        pytest.skip("numba is not installed")
    step = {"NumPy": None, "plain loops": counting._step_each, "compiled": compiled}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(counting, "compiled", lambda: step[request.param])
        yield request.param


def plain_run(
    current_mv_per_ms,
    *,
    tau_ms,
    dt_ms=DT_MS,
    gap_mv=GAP_MV,
    refractory_ms=0.0,
    clamped=False,
    jump_mv=0.0,
    recovery_ms=math.inf,
    until_turn=False,
    fatigue_mv=0.0,
    fatigue_ms=math.inf,
):
    """Equation (7) as a reader would write it; the rows that end in a spike."""
    potential_mv, raised_mv, tired_mv, quiet_rows, rows = 0.0, 0.0, 0.0, 0, []
    for row, fed in enumerate(current_mv_per_ms):
        potential_mv = potential_mv * (1.0 - dt_ms / tau_ms) + dt_ms * fed
        if quiet_rows > 0:
            quiet_rows -= 1
            potential_mv = 0.0
        if until_turn and potential_mv < 0:
            raised_mv = 0.0
        if clamped:
            potential_mv = max(potential_mv, 0.0)
        raised_mv *= 1.0 - dt_ms / recovery_ms
        tired_mv *= 1.0 - dt_ms / fatigue_ms
        if potential_mv > gap_mv + raised_mv + tired_mv:
            rows.append(row)
            raised_mv += jump_mv
            tired_mv = fatigue_mv
            potential_mv, quiet_rows = 0.0, round(refractory_ms / dt_ms)
    return rows


def membrane(tau_ms, dt_ms=DT_MS, gap_mv=GAP_MV, **others):
    return Membrane.from_times(dt_ms, tau_ms=tau_ms, gap_mv=gap_mv, **others)


def fired_rows(current, tau_ms, **others):
    """The same of the fast kernel, one membrane."""
    return fire(np.asarray(current)[:, np.newaxis], membrane(tau_ms, **others))[0].tolist()


@given(tau_ms=st.floats(5, 700), current=st.floats(0.1, 15))
def test_constant_current_fires_with_the_period_of_the_recurrence(tau_ms, current):
    """Under forward Euler sample k is Iτ(1 − (1 − dt/τ)^k), exactly."""
    steady_mv = current * tau_ms
    assume(steady_mv > 1.05 * GAP_MV)
    period = math.log1p(-GAP_MV / steady_mv) / math.log1p(-DT_MS / tau_ms)
    assume(abs(period - round(period)) > 1e-6)  # a tie is for rounding to break
    rows = fired_rows(np.full(500, current), tau_ms)
    assert rows == list(range(math.ceil(period) - 1, 500, math.ceil(period)))


def test_a_potential_at_the_threshold_is_not_above_it(kernel):
    """dt = τ forgets all but the last row, so v = dt I' = 10 mV exactly."""
    at, above = np.full((6, 1), 20.0), np.full((6, 1), np.nextafter(20.0, 21.0))
    assert fired_rows(at[:, 0], 0.5) == []
    assert fired_rows(above[:, 0], 0.5) == list(range(6))
    for current, spikes in ((at, 0), (above, 6)):
        counts = candidate_counts([current], LINEAR, membrane(0.5))
        assert counts.tolist() == [[spikes]]


@pytest.mark.parametrize("recovery_ms", [20.0, 60.0])
def test_the_period_of_an_adaptive_cell_grows_to_a_steady_one(recovery_ms):
    """Steady at n rows: a jump θ* = jump + θ* q^n just passed by the n-th row.

    Without leak the n-th row has c n dt; q is 1 − dt/recovery. So n is the first
    with c n dt > gap + jump q^n / (1 − q^n).
    """
    current, jump_mv = 0.8, 6.0
    rows = fired_rows(np.full(6000, current), 1e15, jump_mv=jump_mv, recovery_ms=recovery_ms)
    periods = np.diff(rows)

    left = (1.0 - DT_MS / recovery_ms) ** np.arange(1, 1000)
    passed = current * DT_MS * np.arange(1, 1000) > GAP_MV + jump_mv * left / (1 - left)
    steady = int(np.flatnonzero(passed)[0]) + 1
    assert rows[0] == 25  # 26 rows of 0.4 mV, as from rest
    assert (np.diff(periods[:4]) >= 0).all()
    assert np.abs(periods[-20:] - steady).max() <= 1  # rows are whole


@pytest.mark.parametrize("fatigue_ms", [20.0, 60.0])
def test_fatigue_makes_all_periods_but_the_first_equally_longer(fatigue_ms):
    """Each spike sets it, so that nothing adds up: the first n with c n dt > gap + F q^n."""
    current, fatigue_mv = 0.8, 6.0
    rows = fired_rows(np.full(2000, current), 1e15, fatigue_mv=fatigue_mv, fatigue_ms=fatigue_ms)
    number = np.arange(1, 1000)
    left_mv = fatigue_mv * (1.0 - DT_MS / fatigue_ms) ** number
    period = int(number[current * DT_MS * number > GAP_MV + left_mv][0])
    assert period > 26 == rows[0] + 1  # 26 rows of 0.4 mV from rest
    assert set(np.diff(rows).tolist()) == {period}


@pytest.mark.parametrize("few", [0, 20])
@given(
    seed=seeds,
    rows=st.integers(1, 150),
    count=st.integers(1, 6),
    adaptive=st.booleans(),
    tires=st.booleans(),
)
def test_all_membranes_together_fire_as_plain_loops(few, seed, rows, count, adaptive, tires):
    """One by one where they are few, else at once."""
    rng = np.random.default_rng(seed)
    current = rng.normal(2.0, 12.0, (rows, count))
    values = {
        "tau_ms": rng.uniform(1, 200, count),
        "gap_mv": rng.uniform(1, 20, count),
        "refractory_ms": DT_MS * rng.integers(0, 5, count),
        "clamped": rng.integers(0, 2, count).astype(bool),
        "jump_mv": rng.uniform(0, 5, count) * adaptive,
        "recovery_ms": rng.uniform(1, 90, count),
        "until_turn": rng.integers(0, 2, count).astype(bool),
        "fatigue_mv": rng.uniform(0, 9, count) * tires,
        "fatigue_ms": rng.uniform(1, 90, count),
    }

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lif, "_MAX_ONE_BY_ONE", few)
        fired, membranes = fire(current, membrane(**values))

    assert (np.diff(membranes) >= 0).all()
    for k in range(count):
        own = {name: each[k] for name, each in values.items()}
        assert fired[membranes == k].tolist() == plain_run(current[:, k], **own)


@given(
    seed=seeds,
    sizes=st.tuples(st.integers(1, 5), st.integers(1, 4)),
    scale=st.sampled_from([3.0, 30.0, 200.0]),
    dt_ms=st.sampled_from([0.25, 0.5, 1.0]),
    refractory_rows=st.integers(0, 3),
    flags=st.tuples(*[st.booleans()] * 5),
    fatigue_mv=st.sampled_from([0.0, 7.0]),
)
def test_a_batch_counts_what_plain_loops_count(
    kernel, seed, sizes, scale, dt_ms, refractory_rows, flags, fatigue_mv
):
    rng, (candidates, conditions) = np.random.default_rng(seed), sizes
    clamped, adaptive, until_turn, saturates, two = flags
    drives = rng.uniform(-0.6, 1.0, (1 + two, 90, conditions))
    alpha = scale * rng.uniform(0.5, 2.0, candidates)
    each = tuple(rng.uniform(0.1, 2.0, (1 + two, candidates)))
    shared = {
        "dt_ms": dt_ms,
        "refractory_ms": dt_ms * refractory_rows,
        "clamped": clamped,
        "until_turn": until_turn,
        "fatigue_mv": fatigue_mv,
        "fatigue_ms": 25.0,
    }
    own = {
        "tau_ms": rng.uniform(1, 60, candidates),
        "jump_mv": rng.uniform(0, 9, candidates) * adaptive,
        "recovery_ms": rng.uniform(1, 90, candidates),
    }
    edges = np.sort(rng.integers(0, 91, (2, conditions)), axis=0)
    kind = "halves" if saturates else "weights"

    counts = candidate_counts(
        drives,
        Coefficients(alpha, **{kind: each}),
        membrane(**own, **shared),
        window=(edges[0], edges[1]),
    )

    for k, condition in np.ndindex(counts.shape):
        one = Coefficients(alpha[k], **{kind: tuple(values[k] for values in each)})
        mine = {name: values[k] for name, values in own.items()}
        spikes = plain_run(one.current(drives[:, :, condition]), **mine, **shared)
        first, end = edges[:, condition]
        assert counts[k, condition] == sum(first <= row < end for row in spikes)


def test_blocks_do_not_show_in_the_batch(monkeypatch):
    monkeypatch.setattr(counting, "compiled", lambda: None)
    rng = np.random.default_rng(2)
    drives, half = [rng.uniform(0, 9, (80, 4))], rng.uniform(1, 9, 11)
    coefficients = Coefficients(20.0, halves=(half,))
    whole = candidate_counts(drives, coefficients, membrane(50.0), window=(7, 71))

    monkeypatch.setattr(counting, "BLOCK", 9)

    blocked = candidate_counts(drives, coefficients, membrane(50.0), window=(7, 71))
    np.testing.assert_array_equal(blocked, whole)
    assert whole.min() > 0


def test_counts_above_a_byte_and_shared_windows(kernel):
    current = [np.full((1000, 2), 50.0)]  # a spike every row
    assert candidate_counts(current, LINEAR, membrane(1e6)).tolist() == [[1000, 1000]]
    part = candidate_counts(current, LINEAR, membrane(1e6), window=(10, 30))
    assert part.tolist() == [[20, 20]]


def test_single_precision_does_not_see_a_grazed_threshold_and_double_does(kernel):
    """τ = dt forgets all but the last row, so v = dt I', 10 mV and a trillionth."""
    grazing = [np.full((6, 2), 20.0 * (1 + 1e-12))]
    for coefficients in (
        Coefficients(1.0, weights=(1.0,)),
        Coefficients(40.0 * (1 + 1e-12), halves=(20.0 * (1 + 1e-12),)),
    ):
        single = candidate_counts(grazing, coefficients, membrane(DT_MS), single=True)
        double = candidate_counts(grazing, coefficients, membrane(DT_MS))
        assert (single.tolist(), double.tolist()) == ([[0, 0]], [[6, 6]])


@given(seed=seeds, scale=st.floats(0.1, 20.0))
def test_membranes_that_are_left_out_would_not_have_fired(kernel, seed, scale):
    """Near the threshold, of either sign: where the largest rise just reaches it or not."""
    rng = np.random.default_rng(seed)
    drives = rng.normal(0.0, scale, (2, 60, 3))
    weights = tuple(rng.uniform(-1.0, 1.0, (2, 5)))
    tau_ms = rng.uniform(0.3, 1e6, 5)
    counts = candidate_counts(drives, Coefficients(1.0, weights=weights), membrane(tau_ms))
    for k, condition in np.ndindex(counts.shape):
        current = sum(w[k] * drive[:, condition] for w, drive in zip(weights, drives, strict=True))
        assert counts[k, condition] == len(plain_run(current, tau_ms=tau_ms[k]))


def test_part_of_a_refractory_step_is_a_step():
    some = Membrane.from_times(0.1, tau_ms=1.0, gap_mv=1.0, refractory_ms=[0.0, 0.3, 0.31])
    assert some.refractory.tolist() == [0, 3, 4]


def test_a_window_outside_the_rows_is_refused():
    with pytest.raises(ParameterError, match="11"):
        candidate_counts([np.zeros((10, 2))], LINEAR, membrane(20.0), window=([0, 0], [5, 11]))


@pytest.mark.parametrize("bad", [math.nan, -math.inf])
def test_a_current_that_is_not_finite_is_refused(kernel, bad):
    current = np.zeros((10, 2))
    current[3, 1] = bad
    with pytest.raises(TraceError):
        candidate_counts([current], LINEAR, membrane(20.0))
    with pytest.raises(TraceError):
        fired_rows(current[:, 1], 20.0)


def test_every_layout_of_drives_is_one_machine_code(kernel):
    if kernel != "compiled":
        pytest.skip("nothing is compiled")
    step, rows = counting.compiled(), np.ones((20, 4))
    before = set(step.signatures)
    for drive in (rows, np.asfortranarray(rows), np.repeat(rows, 2, axis=1)[:, ::2]):
        for halves in (None, (1.0,)):
            coefficients = Coefficients(1.0, halves=halves) if halves else LINEAR
            candidate_counts([drive, drive] if halves else [drive], coefficients, membrane(20.0))
    assert len(set(step.signatures) - before) <= 1
