"""When a contact model is to be trusted: cases with a known closure."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.response.indentation import CLOSURE_PERCENT, indentation, judge

DEPTH_UM = indentation().displacement_um
DEEPEST = int(DEPTH_UM.argmax())


def stress_at(depth_um):
    """Stress of two afferents that rises with depth, ``(T, 2)`` in Pa."""
    return np.stack([30.0 * depth_um, 0.01 * depth_um**2], -1)


def run(depth_um=DEPTH_UM, **changes):
    found = {
        "stress_pa": stress_at(depth_um),
        "force_n_per_mm": 1e-4 * depth_um,
        "apex_um": 0.9 * depth_um,
    }
    return judge(depth_um, **(found | changes))


def test_a_run_that_comes_back_exactly_is_accepted_with_a_closure_of_0():
    found = run()

    assert found.problem is None
    assert found.closure_percent == 0.0


@given(
    percent=st.floats(-50, 50),
    row=st.integers(DEEPEST + 1, DEPTH_UM.size - 1),
    column=st.integers(0, 1),
)
def test_the_closure_is_the_one_worst_sample_of_all(percent, row, column):
    stress_pa = stress_at(DEPTH_UM)
    stress_pa[row, column] *= 1 + percent / 100
    compared = DEPTH_UM[row] >= 0.05 * DEPTH_UM[DEEPEST]

    found = run(stress_pa=stress_pa)

    expected = abs(percent) if compared else 0.0
    assert found.closure_percent == pytest.approx(expected, abs=1e-9)
    if abs(expected - CLOSURE_PERCENT) > 1e-9:
        assert (found.problem is None) is (expected < CLOSURE_PERCENT)


@pytest.mark.parametrize(
    ("changes", "shown"),
    [
        ({"apex_um": 0.0 * DEPTH_UM}, "at 400 um the skin moved 0 um"),
        ({"apex_um": 0.49 * DEPTH_UM}, "the skin moved 196 um"),
        ({"force_n_per_mm": 0.0 * DEPTH_UM}, "the force is 0 N/mm"),
        ({"force_n_per_mm": -1e-4 * DEPTH_UM}, "the force is -0.04 N/mm"),
        ({"force_n_per_mm": np.nan * DEPTH_UM}, "the force is nan N/mm"),
        ({"apex_um": np.nan * DEPTH_UM}, "the skin moved nan um"),
    ],
)
def test_a_probe_that_slips_between_the_nodes_is_refused(changes, shown):
    """The other trap: the run ends well, closes exactly, and nothing was pushed."""
    found = run(**changes)
    assert shown in found.problem
    assert not found.hysteresis


@pytest.mark.parametrize("row", [5, DEEPEST, DEPTH_UM.size - 3])
@pytest.mark.parametrize("column", [0, 1])
def test_stress_that_is_no_number_is_refused_wherever_it_stands(row, column):
    stress_pa = stress_at(DEPTH_UM)
    stress_pa[row, column] = np.nan
    assert run(stress_pa=stress_pa).problem == "stress is not finite everywhere"


def test_an_afferent_that_feels_nothing_is_refused():
    stress_pa = stress_at(DEPTH_UM)
    stress_pa[:, 1] = 0.0
    assert run(stress_pa=stress_pa).problem == (
        "an afferent feels nothing: its stress at 400 um is 0"
    )


@pytest.mark.parametrize(
    "depth_um",
    [
        DEPTH_UM[: DEEPEST + 1],
        np.array([0.0, 100.0, 200.0, 300.0, 250.0, 150.0]),
        np.array([0.0, 1.0, 200.0, 300.0, 1.0]),
    ],
)
def test_a_run_that_compares_nothing_proves_nothing(depth_um):
    """No way back, no depth that was loaded to, or first touch alone."""
    found = run(depth_um)
    assert np.isnan(found.closure_percent)
    assert found.problem == "the run does not come back over depths that it loaded to"
