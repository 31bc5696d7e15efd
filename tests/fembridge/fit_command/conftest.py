"""Fixtures of the verb ``fit``: made-up rates, and a call that gives its summary."""

import argparse

import pytest

from fembridge.commands import fit
from fembridge.tables import Rate, write_rates

# Of nobody: SA and RA.
RATES = {
    "sine_20_67.07": (3.0, 30.0),
    "sine_20_129.49": (6.0, 55.0),
    "sine_20_250": (12.0, 100.0),
    "sine_50_113.6": (7.0, 45.0),
    "sine_50_250": (14.0, 95.0),
    "sine_100_85.98": (5.0, 40.0),
    "sine_100_200": (11.0, 90.0),
    "noise_5_25_50": (2.0, 10.0),
}
SHORT = ("--evaluations", "40", "--population", "20")


@pytest.fixture
def parse():
    """Parse words as the command line does."""

    def parsed(*words):
        parser = argparse.ArgumentParser(prog="fembridge fit")
        fit.add_arguments(parser)
        parser.add_argument("--json", action="store_true")
        return parser.parse_args([str(word) for word in words])

    return parsed


@pytest.fixture
def observed(tmp_path):
    """Write rates of SA and RA that someone may have observed."""
    path = tmp_path / "rates.csv"
    write_rates(
        path,
        [
            Rate(stimulus, name, rate)
            for stimulus, both in RATES.items()
            for name, rate in zip(("SA", "RA"), both, strict=True)
        ],
    )
    return path


@pytest.fixture
def stimuli():
    """Give the stimuli that ``observed`` has."""
    return list(RATES)


@pytest.fixture
def call(tmp_path, observed, parse):
    """Run the verb on these rates into a folder ``out``; give its summary."""

    def run(*words):
        args = parse("--observed", observed, "-o", tmp_path / "out", *SHORT, *words)
        return fit.run(args)

    return run


@pytest.fixture
def undrawn(monkeypatch):
    """Put an empty figure in the place of the picture: drawing takes seconds."""
    from matplotlib.figure import Figure

    from fembridge.plots import tradeoffs

    monkeypatch.setattr(tradeoffs, "tradeoffs_figure", lambda run: Figure(figsize=(1, 1)))
