"""Peri-stimulus time histograms and inter-spike intervals, against plain loops."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from fembridge.errors import UsageError
from fembridge.plots.isi import intervals_ms, isi_figure
from fembridge.plots.psth import bins, histogram, psth, psth_figure
from fembridge.plots.style import AFFERENT_COLOURS
from fembridge.stimulus import Stimulus
from fembridge.tables import SpikeTrain


def train(times_ms, repeat=0, stimulus="sine_20_250", afferent="SA"):
    return SpikeTrain(stimulus, afferent, np.array(times_ms, dtype=float), repeat)


@given(
    steps=st.lists(st.integers(0, 500), max_size=40),
    width=st.sampled_from([1, 2, 3, 10, 25]),
    dt_ms=st.sampled_from([0.5, 0.1, 0.05]),
)
def test_a_spike_is_in_the_bin_that_its_step_is_in(steps, width, dt_ms):
    """In whole steps no rounding decides; times are their products, which are rounded."""
    edges_ms = bins(0.0, 500 * dt_ms, width * dt_ms)
    expected = [0] * (edges_ms.size - 1)
    for step in steps:
        expected[min(step // width, len(expected) - 1)] += 1

    counts = histogram(np.array([step * dt_ms for step in steps]), edges_ms)

    assert counts.tolist() == expected
    assert edges_ms[-1] >= 500 * dt_ms * (1 - 1e-9)


def test_a_rate_is_the_mean_over_all_cells_the_silent_one_too():
    trains = [train([1, 2, 12], 1), train([11], 2), train([], 3), train([1], 1, afferent="PC")]

    rate_ips = psth(trains, "sine_20_250", "SA", bins(0.0, 20.0, 10.0))

    assert_allclose(rate_ips, [2 / 3 / 0.010, 2 / 3 / 0.010], rtol=1e-12)
    assert psth(trains, "sine_20_250", "RA", bins(0.0, 20.0, 10.0)).tolist() == [0.0, 0.0]


def test_intervals_are_within_a_cell_and_never_between_two():
    trains = [train([1, 3, 10], 1), train([100, 104], 2), train([7], 3)]

    assert intervals_ms(trains, "sine_20_250", "SA").tolist() == [2.0, 7.0, 4.0]
    assert intervals_ms(trains, "sine_20_250", "PC").size == 0


def heights(panel):
    """Height of each row's histogram, in shares of the row."""
    tops = []
    for part in panel.collections:
        corners = [path.vertices for path in part.get_paths()]
        tops.append(float(np.ptp(np.concatenate(corners)[:, 1])) if corners else 0.0)
    return tops


def test_rows_of_a_class_share_a_scale_that_stands_below_its_name():
    trains = [train([1, 2, 3, 4]), train([6, 8], stimulus="weak"), train([1], afferent="PC")]

    sa, pc = psth_figure(trains, bin_ms=5.0).axes

    strong, weak = heights(sa)
    assert weak == pytest.approx(strong / 2)
    assert sa.texts[0].get_text() == "row height: 800 impulses/s"
    assert pc.texts[0].get_text() == "row height: 200 impulses/s"
    assert sa.collections[0].get_facecolor()[0].tolist() == pytest.approx(
        [int(AFFERENT_COLOURS["SA"][k : k + 2], 16) / 255 for k in (1, 3, 5)] + [1.0]
    )
    assert [label.get_text() for label in sa.get_yticklabels()] == ["sine_20_250", "weak"]


def test_a_waveform_and_its_window_are_drawn_and_the_ground_is_explained():
    wave = Stimulus("sine_20_250", 75 + np.sin(np.arange(100) / 9), 0.5, (5.0, 40.0), 75.0)

    figure = psth_figure([train([10, 20])], window_ms=wave.window_ms, waveform=wave)

    above, below = figure.axes
    assert above.lines[0].get_ydata()[0] == 75.0
    assert [patch.get_x() for patch in below.patches] == [0.0, 40.0]
    [legend] = figure.legends
    assert "5 to 40 ms" in legend.get_texts()[0].get_text()


def test_shares_are_of_all_intervals_also_of_those_beyond_the_axis():
    trains = [train([0, 2, 4, 6, 106])]

    [panel] = isi_figure(trains, longest_ms=50.0).axes

    assert [text.get_text() for text in panel.texts] == ["row height: 75 % of intervals", "n = 4"]
    assert panel.get_xlim()[1] < 75


def test_silence_is_drawn_where_it_is_named():
    for figure in (
        psth_figure([], stimuli=["a"], afferents=["SA"]),
        isi_figure([], stimuli=["a"], afferents=["SA"]),
    ):
        [panel] = figure.axes
        assert heights(panel) == [0.0]


@pytest.mark.parametrize("bin_ms", [0.0, -1.0, float("nan"), float("inf"), 1e-9])
def test_bins_that_are_none_or_too_many_are_misuse(bin_ms):
    for draw in (psth_figure, isi_figure):
        with pytest.raises(UsageError, match="expected"):
            draw([train([1, 200])], bin_ms=bin_ms)
