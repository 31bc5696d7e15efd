"""What is said of map and transients, of comparisons that were made up."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fembridge.stimulus import Stimulus
from fembridge.trace import StressTrace
from fembridge.verification.bench import Cost
from fembridge.verification.map_finding import Compared, MapCost, finding_of

DEPTH_UM = np.array([0.0, 10.0, 20.0, 10.0])
MAPS = {"quick": MapCost(Cost(39, 80, 25.0, 19.0), 1.0)}


@pytest.fixture
def compared():
    stress_pa = np.array([0.0, 100.0, 200.0, 100.0])
    traces = [StressTrace(stress_pa, 0.5, 3, name) for name in ("SA", "RA", "PC")]
    return Compared(
        finger="quick",
        stimulus=Stimulus("diharm_10_50_125", DEPTH_UM, 0.5, (0.0, 1.5)),
        contact="node-to-surface",
        trace_percent={"SA": 0.01, "RA": 0.3, "PC": 0.02},
        drive_percent={"SA": 0.1, "RA": 0.2, "PC": 0.75},
        spikes=120,
        equal=119,
        more=1,
        cost=Cost(3, 6, 2.0, 1.5),
        traces=(traces, traces),
    )


def found_by(finding):
    return [check.found for check in finding.checks]


def test_the_worst_errors_and_every_different_spike_count(compared):
    """119 of 121 spikes that are in either train: the one and the other is missing."""
    other = replace(
        compared, trace_percent={"SA": 0.4, "RA": 0.0, "PC": 0.0}, spikes=0, equal=0, more=0
    )
    finding = finding_of([compared, other], MAPS, spent=Cost(), reduced="")
    trace, drive, equal, *_ = found_by(finding)
    assert (trace, drive) == (0.4, 0.75)
    assert_allclose(equal, 100 * 119 / 121)
    assert [check.passed for check in finding.checks[:3]] == [False, True, False]


def test_82_transients_take_500_increments_each_and_the_time_of_those_solved(compared):
    """0.5 s an increment, against 20 s of the map's solver and Python."""
    finding = finding_of([compared], MAPS, spent=Cost(), reduced="")
    *_, increments, cpu = found_by(finding)
    assert_allclose(increments, 82 * 500 / 39)
    assert_allclose(cpu, 82 * 500 * 0.5 / 20.0)


def test_the_finger_that_gains_least_is_the_one_that_is_told(compared):
    paper = replace(compared, finger="paper", cost=Cost(3, 6, 2.0, 0.3))
    maps = {**MAPS, "paper": MapCost(Cost(41, 80, 25.0, 49.0), 1.0)}
    *_, increments, cpu = found_by(finding_of([compared, paper], maps, spent=Cost(), reduced=""))
    assert_allclose(increments, 82 * 500 / 41)
    assert_allclose(cpu, 82 * 500 * 0.1 / 50.0)


def test_the_page_tells_how_much_of_a_stimulus_was_followed(compared):
    finding = finding_of([compared], MAPS, spent=Cost(), reduced="")
    assert "the first 1.5 ms on `quick`" in finding.words[0]
    row = dict(zip(finding.tables[0].columns, finding.tables[0].rows[0], strict=True))
    assert row["solved_ms"] == 1.5
    assert row["different"] == 2
