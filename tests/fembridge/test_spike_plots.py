"""Pictures of spikes, read back from the figure itself; histograms against plain loops."""

import sys
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from fembridge.errors import UsageError
from fembridge.io.spike_table import SpikeTrain
from fembridge.plots.spike_figures import (
    bin_edges,
    histogram,
    intervals_ms,
    isi_figure,
    psth,
    psth_figure,
    raster_figure,
)
from fembridge.plots.style import AFFERENT_COLOURS, save_figure
from fembridge.stimulus import Stimulus


def timed(times_ms=(10.0, 60.0), trial=0, stimulus="sine_20_250", afferent="SA"):
    return SpikeTrain(stimulus, afferent, np.array(times_ms, dtype=float), trial=trial)


def spikes_drawn(panel):
    """Give ``(time, top, bottom)`` of each line in a panel."""
    segments = [part for each in panel.collections for part in each.get_segments()]
    return sorted((float(a[0]), float(a[1]), float(b[1])) for a, b in segments)


def test_each_class_has_a_panel_in_its_colour_and_each_stimulus_a_row():
    figure = raster_figure(
        [
            timed([5.0], afferent="PC"),
            timed([7.0, 9.0], stimulus="noise_25_250_10"),
            timed([30.0]),
        ]
    )

    sa, pc = figure.axes
    assert [panel.get_title() for panel in (sa, pc)] == ["SA", "PC"]
    assert sa.title.get_color() == AFFERENT_COLOURS["SA"]
    names = [label.get_text() for label in sa.get_yticklabels()]
    assert names == ["sine_20_250", "noise_25_250_10"]
    assert [(time, round((a + b) / 2)) for time, a, b in spikes_drawn(sa)] == [
        (7.0, 1),
        (9.0, 1),
        (30.0, 0),
    ]
    assert [(time, round((a + b) / 2)) for time, a, b in spikes_drawn(pc)] == [(5.0, 0)]
    assert sa.get_ylim() == (1.5, -0.5)


def test_trials_lie_under_one_another_inside_their_row():
    figure = raster_figure([timed([10.0 * k], k) for k in range(5)])
    drawn = spikes_drawn(figure.axes[0])
    assert [time for time, _, _ in drawn] == [0.0, 10.0, 20.0, 30.0, 40.0]
    assert all(
        -0.5 < upper < lower < 0.5 and lower < next_upper
        for (_, upper, lower), (_, next_upper, _) in pairwise(drawn)
    )


def test_the_time_axis_covers_every_spike_unless_span_ms_is_set():
    trains = [timed([40.0, 180.0])]
    assert raster_figure(trains).axes[0].get_xlim() == (0.0, 180.0)
    assert raster_figure(trains, window_ms=(5, 250)).axes[0].get_xlim() == (0.0, 250.0)
    shown = raster_figure(trains, span_ms=(0.0, 100.0)).axes[0]
    assert shown.get_xlim() == (0.0, 100.0)


def test_a_name_is_shown_as_it_is():
    """Endless ones are cut: `test_plots`."""
    figure = raster_figure([timed(stimulus="cost_$5_$6")])
    figure.draw_without_rendering()
    [label] = figure.axes[0].get_yticklabels()
    assert (label.get_text(), label.get_parse_math()) == ("cost_$5_$6", False)


@pytest.mark.parametrize("suffix", ["png", "svg", pytest.param("pdf", marks=pytest.mark.slow)])
def test_the_same_spikes_give_the_same_file(tmp_path, suffix):
    first, second = tmp_path / f"first.{suffix}", tmp_path / f"second.{suffix}"
    for path in (first, second):
        save_figure(raster_figure([timed()]), path)
    assert first.read_bytes() == second.read_bytes()
    assert first.stat().st_size > 1000
    assert sorted(tmp_path.iterdir()) == [first, second]


def test_nothing_to_draw_is_refused():
    with pytest.raises(UsageError):
        raster_figure([])


def test_drawing_leaves_pyplot_and_its_global_state_alone(tmp_path, monkeypatch):
    monkeypatch.delitem(sys.modules, "matplotlib.pyplot", raising=False)
    save_figure(raster_figure([timed()]), tmp_path / "raster.png")
    assert "matplotlib.pyplot" not in sys.modules


@given(
    steps=st.lists(st.integers(0, 500), max_size=40),
    width=st.sampled_from([1, 2, 3, 10, 25]),
    dt_ms=st.sampled_from([0.5, 0.1, 0.05]),
)
def test_a_spike_is_in_the_bin_that_its_step_is_in(steps, width, dt_ms):
    """In whole steps no rounding decides; times are their products, which are rounded."""
    edges_ms = bin_edges(500 * dt_ms, width * dt_ms)
    expected = [0] * (edges_ms.size - 1)
    for step in steps:
        expected[min(step // width, len(expected) - 1)] += 1
    counts = histogram(np.array([step * dt_ms for step in steps]), edges_ms)
    assert counts.tolist() == expected
    assert edges_ms[-1] >= 500 * dt_ms * (1 - 1e-9)


def test_a_rate_is_the_mean_over_all_cells_the_silent_one_too():
    trains = [timed([1, 2, 12], 1), timed([11], 2), timed([], 3), timed([1], 1, afferent="PC")]
    rate_ips = psth(trains, "sine_20_250", "SA", bin_edges(20.0, 10.0))
    assert_allclose(rate_ips, [2 / 3 / 0.010, 2 / 3 / 0.010], rtol=1e-12)
    assert psth(trains, "sine_20_250", "RA", bin_edges(20.0, 10.0)).tolist() == [0.0, 0.0]


def test_intervals_are_within_a_cell_and_never_between_two():
    trains = [timed([1, 3, 10], 1), timed([100, 104], 2), timed([7], 3)]
    assert intervals_ms(trains, "sine_20_250", "SA").tolist() == [2.0, 7.0, 4.0]
    assert intervals_ms(trains, "sine_20_250", "PC").size == 0


def heights(panel):
    """Height of each row's histogram, in shares of the row."""
    tops = []
    for part in panel.collections:
        corners = [path.vertices for path in part.get_paths()]
        tops.append(float(np.ptp(np.concatenate(corners)[:, 1])) if corners else 0.0)
    return tops


def test_rows_of_a_class_share_a_scale_which_is_an_axis_of_round_numbers():
    trains = [timed([1, 2, 3, 4]), timed([6, 8], stimulus="weak"), timed([1], afferent="PC")]
    sa, pc = psth_figure(trains, bin_ms=5.0).axes
    strong, weak = heights(sa)
    assert weak == pytest.approx(strong / 2)
    texts = [[text.get_text() for text in panel.texts] for panel in (sa, pc)]
    assert texts[0] == ["impulses/s", *["0", "500"] * 2]
    assert texts[1] == ["impulses/s", *["0", "200"] * 2]
    floor, end = next(line.get_ydata() for line in sa.lines if np.ptp(line.get_ydata()))
    assert floor - end == pytest.approx(strong * 500 / 800)
    assert sa.collections[0].get_facecolor()[0].tolist() == pytest.approx(
        [int(AFFERENT_COLOURS["SA"][k : k + 2], 16) / 255 for k in (1, 3, 5)] + [1.0]
    )
    assert [label.get_text() for label in sa.get_yticklabels()] == ["sine_20_250", "weak"]


def test_a_waveform_and_its_window_are_drawn_and_the_ground_is_explained():
    wave = Stimulus("sine_20_250", 75 + np.sin(np.arange(100) / 9), 0.5, (5.0, 40.0), 75.0)
    figure = psth_figure([timed([10, 20])], window_ms=wave.window_ms, waveform=wave)
    above, below = figure.axes
    assert above.lines[0].get_ydata()[0] == 75.0
    assert [patch.get_x() for patch in below.patches] == [0.0, 40.0]
    [legend] = figure.legends
    assert "5 to 40 ms" in legend.get_texts()[0].get_text()


def test_shares_are_of_all_intervals_also_of_those_beyond_the_axis():
    trains = [timed([0, 2, 4, 6, 106])]
    [panel] = isi_figure(trains, longest_ms=50.0).axes
    assert [text.get_text() for text in panel.texts] == ["% of intervals", "0", "50", "n = 4"]
    assert panel.get_xlim()[1] < 75


@pytest.mark.parametrize("bin_ms", [0.0, -1.0, float("nan"), float("inf"), 1e-9])
def test_bins_that_are_none_or_too_many_are_misuse(bin_ms):
    for draw in (psth_figure, isi_figure):
        with pytest.raises(UsageError) as caught:
            draw([timed([1, 200])], bin_ms=bin_ms)
        assert (caught.value.argument, caught.value.found) == ("bin_ms", bin_ms)
