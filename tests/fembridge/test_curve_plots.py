"""Pictures of curves: responses, stress traces, waveforms, rates against amplitude."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from decks.stimuli import resolve
from decks.synthesis import make_stimulus
from fembridge.errors import UsageError
from fembridge.io.run_folder import AfferentNode
from fembridge.io.spike_table import Rate
from fembridge.plots.rate_comparison import placed, rates_figure
from fembridge.plots.response import response_figure
from fembridge.plots.stress_history import MAX_PANELS, trace_figure
from fembridge.plots.style import AFFERENT_COLOURS, INK
from fembridge.plots.waveform_overview import scale_ticks, waveform_figure
from fembridge.response.response_map import ResponseMap
from fembridge.trace import StressTrace

DEPTH_UM = np.array([0.0, 50.0, 150.0, 400.0])
SLOPE_PA_PER_UM = {"SA": 150.0, "RA": 90.0, "PC": 4.0}


def response_of(*afferents, closure_percent=0.031):
    """Make a map of uniaxial stress, whose von Mises stress is itself."""
    tensor_pa = np.zeros((DEPTH_UM.size, len(afferents), 6))
    for column, name in enumerate(afferents):
        tensor_pa[:, column, 1] = -SLOPE_PA_PER_UM[name] * DEPTH_UM
    return ResponseMap(
        depth_um=DEPTH_UM,
        tensor_pa=tensor_pa,
        force_n_per_mm=3e-5 * DEPTH_UM,
        places=tuple(
            AfferentNode(name, 7 + k, "epidermis", 0.0, -0.5, 0.5)
            for k, name in enumerate(afferents)
        ),
        closure_percent=closure_percent,
    )


def words_of(figure):
    from matplotlib.text import Text

    return [text.get_text() for text in figure.findobj(Text)]


def test_a_response_shows_stress_in_kpa_pc_apart_and_force_in_mn():
    shallow, deep, force = response_figure(response_of("SA", "RA", "PC")).axes
    sa_line, sa_dots, ra_line, ra_dots = shallow.get_lines()
    pc_line, pc_dots = deep.get_lines()
    for name, line, dots in (
        ("SA", sa_line, sa_dots),
        ("RA", ra_line, ra_dots),
        ("PC", pc_line, pc_dots),
    ):
        assert line.get_color() == dots.get_color() == AFFERENT_COLOURS[name]
        assert_array_equal(dots.get_xdata(), DEPTH_UM)
        kpa = SLOPE_PA_PER_UM[name] / 1000
        assert_allclose(dots.get_ydata(), kpa * DEPTH_UM, rtol=1e-12)
        assert_allclose(line.get_ydata(), kpa * line.get_xdata(), atol=1e-9)
    assert_allclose(force.get_lines()[0].get_ydata(), 0.03 * DEPTH_UM, rtol=1e-12)
    assert force.get_ylabel() == "Force on the probe (mN/mm)"
    assert shallow.get_ylabel() == deep.get_ylabel() == "Von Mises stress (kPa)"


@pytest.mark.parametrize(("peak_pa", "unit"), [(999.0, "Pa"), (1000.0, "kPa")])
def test_traces_are_in_kpa_unless_none_reaches_one(peak_pa, unit):
    loud = StressTrace(np.array([0.0, peak_pa, 0.0]), 0.5, 3, "SA", start_ms=0.5)
    faint = StressTrace(np.array([0.0, 2.0, 1.0]), 0.5, 4)
    figure = trace_figure([loud, faint])
    upper, lower = figure.axes
    assert upper.get_ylabel() == lower.get_ylabel() == f"Stress\n({unit})"
    share = 1000.0 if unit == "kPa" else 1.0
    (line,) = upper.get_lines()
    assert_allclose(line.get_ydata(), loud.stress_pa / share)
    assert_allclose(line.get_xdata(), [0.5, 1.0, 1.5])
    assert line.get_color() == AFFERENT_COLOURS["SA"]
    assert lower.get_lines()[0].get_color() == INK
    assert {"SA", "node 4"} <= set(words_of(figure))
    assert lower.get_xlim() == (0.0, 1.5)


@pytest.mark.parametrize("count", [0, MAX_PANELS + 1])
def test_no_trace_and_too_many_are_refused(count):
    trace = StressTrace(np.zeros(2), 0.5, 1)
    with pytest.raises(UsageError, match=rf"\b{count}\b.*\b{MAX_PANELS}\b"):
        trace_figure([trace] * count)


@pytest.mark.parametrize("word", ["sine_20_250", "noise_25_250", "sine_20"])
def test_each_stimulus_has_a_panel_with_its_samples_and_its_id(word):
    stimuli = [make_stimulus(entry) for entry in resolve(word)]
    panels = [panel for panel in waveform_figure(stimuli).axes if panel.axison]
    assert [panel.get_title() for panel in panels] == [each.id for each in stimuli]
    for panel, stimulus in zip(panels, stimuli, strict=True):
        assert_array_equal(panel.get_lines()[0].get_ydata(), stimulus.displacement_um)


def test_time_that_is_not_counted_has_a_ground():
    stimulus = make_stimulus(*resolve("sine_300_50"))
    (panel,) = waveform_figure([stimulus]).axes
    spans = [(patch.get_x(), patch.get_width()) for patch in panel.patches]
    assert spans == [(0.0, 100.0), (200.0, 50.0)]


def test_a_scale_names_its_ends_and_a_first_touch_that_is_clear_of_them():
    assert scale_ticks(-0.7218, 0.7463) == pytest.approx([-0.72, 0.0, 0.75], abs=1e-12)
    assert scale_ticks(-0.1, 5.0) == [-0.1, 5.0]


@given(low=st.floats(-1e4, 1e4), span=st.floats(1e-3, 2e4))
def test_numbers_on_a_scale_are_near_its_ends_and_rise(low, span):
    ticks = scale_ticks(low, low + span)
    assert ticks == sorted(set(ticks))
    assert abs(ticks[0] - low) <= 0.006 * span
    assert abs(ticks[-1] - (low + span)) <= 0.006 * span


OWN = [
    Rate("sine_20_250", "SA", 30.0),
    Rate("sine_20_25", "SA", 3.0),
    Rate("sine_300_50", "SA", 5.0),
    Rate("noise_25_250_10", "SA", 2.0),
]


def panels(figure):
    return {panel.get_title(): panel for panel in figure.axes if panel.get_title()}


def test_a_panel_a_frequency_has_levels_in_order_and_a_family_one_scale():
    figure = rates_figure(OWN)
    shown = panels(figure)
    assert list(shown) == ["20 Hz", "300 Hz", "25–250 Hz"]
    assert_allclose(shown["20 Hz"].lines[0].get_xydata(), [[25, 3], [250, 30]])
    assert shown["20 Hz"].lines[0].get_color() == AFFERENT_COLOURS["SA"]
    assert shown["20 Hz"].get_ylim() == shown["300 Hz"].get_ylim()
    assert shown["20 Hz"].get_xlim() == shown["300 Hz"].get_xlim()
    assert shown["25–250 Hz"].get_ylim()[1] < 3
    words = [text.get_text() for panel in figure.axes for text in panel.texts]
    assert words == ["SA", "Amplitude (µm)", "SA", "RMS amplitude (µm)"]


def test_what_is_beside_is_of_the_same_frequencies_and_the_legend_names_it():
    observed = [Rate("sine_20_100", "SA", 12.0), Rate("sine_50_100", "SA", 99.0)]
    touchsim = [Rate("sine_20_100", "SA", 14.0), Rate("sine_20_100", "PC", 500.0)]

    published = [Rate("sine_20_100", "SA", 13.0)]

    figure = rates_figure(OWN, observed=observed, published=published, touchsim=touchsim)

    lines = panels(figure)["20 Hz"].lines
    found = sorted(line.get_xydata().tolist() for line in lines)
    assert found == [[[25, 3], [250, 30]], [[100, 12]], [[100, 13]], [[100, 14]]]
    [legend] = figure.legends
    *words, other = (text.get_text() for text in legend.get_texts())
    assert words == ["these rates", "observed", "published model"]
    assert other.startswith("TouchSim (fitted to recordings of the same experiments")
    assert panels(figure)["20 Hz"].get_ylim()[1] < 40


def test_stimuli_without_an_amplitude_are_listed_and_not_drawn():
    entries, strange = placed([*OWN, Rate("my own", "SA", 1.0)])
    assert (len(entries), strange) == (4, ["my own"])
    with pytest.raises(UsageError):
        rates_figure([Rate("my own", "SA", 1.0)])
