"""No words of any picture run out of it, or into other words, however long a name is."""

import numpy as np
import pandas as pd
import pytest

from decks.stimuli import CATALOGUE, resolve
from decks.waveform import make_stimulus
from fembridge.plots.rates import rates_figure
from fembridge.plots.sensitivity import effects_figure, regressions_figure
from fembridge.plots.spikes import isi_figure, psth_figure, raster_figure
from fembridge.plots.trace import trace_figure
from fembridge.plots.waveform import waveform_figure
from fembridge.sensitivity import (
    OUTPUT,
    QUANTITIES,
    SweptFingers,
    rank_regressions,
    single_effects,
)
from fembridge.stimulus import Stimulus
from fembridge.tables import AFFERENTS, Rate, SpikeTrain
from fembridge.trace import StressTrace

ALL = [entry.id for entry in CATALOGUE]
LONG = "an_own_stimulus_of_a_very_long_name_with_W" + "W" * 60 + "_and_$its$_end"
SETS = {"one": [LONG], "five": [*ALL[:2], ALL[40], ALL[70], LONG], "all": ALL}
WAVE_MS = np.arange(501) * 0.5


def wave(name):
    depth_um = 1234.567 + 9876.5 * np.sin(WAVE_MS / 9)
    return Stimulus(name, depth_um, 0.5, (100.0, 200.0), 1234.567, {"family": name[:4]})


def trains(names):
    rng = np.random.default_rng(1)
    return [
        SpikeTrain(name, afferent, 0.5 * np.sort(rng.choice(500, 1 + k % 60, False)), repeat)
        for k, name in enumerate(names)
        for afferent in AFFERENTS
        for repeat in (1, 2, 3)
    ]


def spikes(draw, **options):
    def picture(names):
        alone = {"waveform": wave(names[0])} if len(names) == 1 else {}
        return draw(trains(names), **options, **(alone if draw is not isi_figure else {}))

    return picture


def rates(names):
    own = [Rate(n, a, 123.4 * k) for k, n in enumerate(names) for a in AFFERENTS]
    own += [Rate("sine_999.999999_9999.999999", "PC", 1999.0)]
    return rates_figure(own, observed=own[:3], touchsim=own[:3])


def swept(names):
    rows = np.vstack([np.zeros(len(names)), np.eye(len(names))])
    outputs = [(afferent, quantity, "all") for afferent in AFFERENTS for quantity in QUANTITIES]
    answers = np.arange(1.0, len(rows) + 1)[:, None] * 1234.5 * np.arange(1, len(outputs) + 1)
    columns = pd.MultiIndex.from_tuples(outputs, names=OUTPUT)
    parameters = pd.DataFrame(rows, columns=[f"{k} {name}" for k, name in enumerate(names)])
    return SweptFingers(parameters, pd.DataFrame(answers, columns=columns))


def ranked(names):
    rng = np.random.default_rng(2)
    count = 2 * len(names) + 4
    few = swept(names)
    parameters = pd.DataFrame(rng.random((count, len(names))), columns=few.parameters.columns)
    answers = pd.DataFrame(rng.random((count, 6)), columns=few.answers.columns)
    return regressions_figure(
        rank_regressions(SweptFingers(parameters, answers), resamples=3), count
    )


PICTURES = {
    "raster": spikes(raster_figure, window_ms=(100.0, 200.0)),
    "psth": spikes(psth_figure, window_ms=(100.0, 200.0)),
    "isi": spikes(isi_figure),
    "rates": rates,
    "stimulus": lambda names: waveform_figure([wave(name) for name in names]),
    "trace": lambda names: trace_figure(
        [StressTrace(1e6 + 1e5 * np.sin(WAVE_MS), 0.5, 12345678)] * 3, waveform=wave(names[0])
    ),
    "effects": lambda names: effects_figure(single_effects(swept(names[:20]))),
    "ranks": lambda names: ranked(names[:20]),
}


ROWS = ("raster", "psth", "isi", "stimulus")
CASES = [(picture, "five") for picture in (*ROWS, "rates")]
CASES += [
    pytest.param(picture, names, marks=pytest.mark.slow)
    for picture in PICTURES
    for names in SETS
    if (picture, names) not in CASES and (names != "all" or picture in (*ROWS, "rates"))
]


@pytest.mark.parametrize(("picture", "names"), CASES)
def test_words_stay_on_the_page_and_apart(picture, names, check_words):
    check_words(PICTURES[picture](SETS[names]))


def test_a_probe_that_was_deep_before_time_0_is_drawn_so():
    [stimulus] = [make_stimulus(one, 75.0) for one in resolve("sine_20_250")]
    spike = SpikeTrain(stimulus.id, "SA", np.array([10.0]))
    for figure in (
        raster_figure([spike], waveform=stimulus),
        psth_figure([spike], waveform=stimulus),
        trace_figure([StressTrace(np.ones(501), 0.5, 1)], waveform=stimulus),
    ):
        depth_um = figure.axes[0].lines[0].get_ydata()
        assert (depth_um[0], depth_um.max()) == (75.0, 325.0)
