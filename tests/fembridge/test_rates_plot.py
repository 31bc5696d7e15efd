"""Rates against amplitude, by frequency, beside those observed and TouchSim's."""

import pytest
from numpy.testing import assert_allclose

from fembridge.errors import UsageError
from fembridge.plots.rates import placed, rates_figure
from fembridge.plots.style import AFFERENT_COLOURS
from fembridge.tables import Rate

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


def test_stimuli_without_an_amplitude_are_said_and_not_drawn():
    entries, strange = placed([*OWN, Rate("my own", "SA", 1.0)])

    assert (len(entries), strange) == (4, ["my own"])
    with pytest.raises(UsageError, match="no rate"):
        rates_figure([Rate("my own", "SA", 1.0)])
