"""Observed rates that were made of known parameters, so that a fit has an answer."""

import numpy as np
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
    """Rates of `KNOWN`, worked out apart from the fit."""

    def rates(preindent_um, words=SINES + OTHERS, known=KNOWN):
        classes = [place.afferent for place in response.places]
        found = {}
        for entry in resolve(words):
            stimulus = make_stimulus(entry, preindent_um=preindent_um)
            traces = response.traces(stimulus)
            for name, parameters in known.items():
                stress_pa = traces[classes.index(name)].stress_pa[:, None]
                cells = encode_cells(stress_pa, 0.5, parameters)[0]
                window = stimulus.window_ms
                found[entry.id, name] = np.mean([rate_ips(x, window) for x in cells])
        return found

    return rates


@pytest.fixture(scope="session")
def table(tmp_path_factory, known_rates):
    """Writes a table of rates of `KNOWN`."""

    def write(preindent_um=0.0, **options):
        path = tmp_path_factory.mktemp("observed") / "rates.csv"
        rows = [
            f"{stimulus},{name},{float(rate)!r}\n"
            for (stimulus, name), rate in known_rates(preindent_um, **options).items()
        ]
        path.write_text("stimulus,afferent,rate_ips\n" + "".join(rows))
        return path

    return write


@pytest.fixture(scope="session")
def observed(table):
    """Rates of `KNOWN` as observed ones, at 75 um of pre-indentation."""
    return read_observed(table(75.0))
