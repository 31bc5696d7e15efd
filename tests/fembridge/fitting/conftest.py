"""Observed rates that were made of known parameters, so that a fit has an answer."""

import numpy as np
import pandas as pd
import pytest

from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.observed import read_observed
from fembridge.response.response_map import FOLDER, read_map
from neural import PUBLISHED, encode_cells, rate_ips
from neural.parameters import RisingRaParameters

SINES = (
    *("sine_20_35.08", "sine_20_67.01", "sine_20_128", "sine_20_250"),
    *("sine_50_48.31", "sine_50_113.6", "sine_50_250"),
    *("sine_100_36.39", "sine_100_85.98", "sine_100_200"),
    *("sine_300_10", "sine_300_25"),
)
OTHERS = ("diharm_10_50_50_20", "noise_5_25_30", "noise_25_250_10")
KNOWN = {
    "RA": RisingRaParameters(tau_ms=90.0, step_pa=7000.0, spread=0.4, cells=5),
    "SA": PUBLISHED["SA"],
}


@pytest.fixture(scope="session")
def response():
    """The stored response of the quick finger."""
    return read_map(FOLDER / "quick.toml")


@pytest.fixture(scope="session")
def known_rates(response):
    """A function that gives rates of `KNOWN` as observed ones, worked out apart from the fit."""

    def rates(preindent_um):
        classes, rows = [place.afferent for place in response.places], []
        for entry in resolve(SINES + OTHERS):
            stimulus = make_stimulus(entry, preindent_um=preindent_um)
            traces = response.traces(stimulus)
            for name, parameters in KNOWN.items():
                stress_pa = traces[classes.index(name)].stress_pa[:, None]
                cells = encode_cells(stress_pa, 0.5, parameters)[0]
                rate = np.mean([rate_ips(x, stimulus.window_ms) for x in cells])
                rows.append((entry.id, name, rate))
        return read_observed(pd.DataFrame(rows, columns=["stimulus", "afferent", "rate_ips"]))

    return rates


@pytest.fixture(scope="session")
def observed(known_rates):
    return known_rates(75.0)
