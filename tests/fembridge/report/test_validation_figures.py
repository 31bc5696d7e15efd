"""Figures of the report: words apart from each other, every point where it belongs."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fembridge.plots.spikes import raster_figure
from fembridge.report.rates import FAMILIES, OBSERVED, SINES, TOUCHSIM
from fembridge.report.validate import RASTER_STIMULI, repeated_trains
from fembridge.report.validation_page import rasters_figure, regression_figure
from fembridge.tables import AFFERENTS

# Points a figure of 7.2 inches may have at least, so that on the page, where it is
# 8.1 inches wide or more, no letter is below 8 points.
LEAST_PT = 7.0


def regression(study):
    family = FAMILIES[2]
    reference = study.rates.reference(family.stimuli)
    return regression_figure(study.rates, study.agreement, family, reference, "own")


def raster(study):
    """The model's spikes, and the first train of each stimulus again as a recorded one."""
    simulation = study.simulations["own"]
    strongest = next(one for one in simulation.stimuli if one.id == RASTER_STIMULI[-1])
    trains = repeated_trains(simulation)
    return rasters_figure(trains, strongest, trains[::5])


def ramp(study):
    return raster_figure(study.evidence.ramp, waveform=study.evidence.ramp_stimulus)


@pytest.mark.parametrize("figure_of", [regression, raster, ramp])
def test_no_words_overlap_none_leave_the_page_and_all_can_be_read(study, figure_of, check_words):
    check_words(figure_of(study), LEAST_PT)


def test_the_dashed_line_is_the_regression_and_the_grey_one_is_equality(study):
    figure = regression_figure(study.rates, study.agreement, SINES, OBSERVED, "own")
    sources = study.rates.compared(OBSERVED)
    assert sources[-1] == TOUCHSIM
    panels = np.array(figure.axes).reshape(len(sources), len(AFFERENTS))
    for row, source in zip(panels, sources, strict=True):
        for panel, afferent in zip(row, AFFERENTS, strict=True):
            observed = study.rates.of(OBSERVED, afferent, SINES.stimuli)
            predicted = study.rates.of(source, afferent, SINES.stimuli)
            line = next(one for one in panel.lines if one.get_linestyle() == "--")
            slope, intercept = np.polyfit(observed, predicted, 1)
            assert_allclose(line.get_ydata(), slope * line.get_xdata() + intercept, atol=1e-9)
            assert panel.get_xlim() == panel.get_ylim()


def test_recorded_spikes_have_rows_of_their_own_below_the_model_s(study):
    first, *_ = raster(study).axes[3:]
    names = [label.get_text() for label in first.get_yticklabels()]
    assert names == [word for one in RASTER_STIMULI for word in (one, f"{one}, observed")]
