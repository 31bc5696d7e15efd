"""One validation and one report for all tests: own parameters against made-up rates."""

from functools import partial

import numpy as np
import pytest

from fembridge.evidence import THRESHOLDS, Facts, published, touchsim_rates
from fembridge.fitting.problem import stored_source
from fembridge.observed import read_observed
from fembridge.plots.rates import rates_figure
from fembridge.report import recorded, validation_page
from fembridge.report.rates import FAMILIES
from fembridge.report.validate import judged_models, validate
from fembridge.report.validation_page import write_report
from fembridge.tables import Rate, write_rates

OWN = "base = 'published'\n[SA]\nalpha_mv_per_ms = 1.2\n[RA]\ntau_ms = 40.0\n"
COMMAND = "fembridge validate -o report --observed rates.csv --parameters own.toml"


def made_up_rates():
    """Rates near TouchSim's of all sinusoids, and of SA under diharmonics."""
    rng = np.random.default_rng(5)
    return [
        Rate(rate.stimulus, rate.afferent, max(0.0, rate.rate_ips + rng.normal(0, 3)))
        for rate in touchsim_rates()
        if rate.stimulus.startswith("sine")
        or (rate.stimulus.startswith("diharm_10_50_") and rate.afferent == "SA")
    ]


@pytest.fixture(scope="session")
def observed_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("observed") / "rates.csv"
    write_rates(path, made_up_rates())
    return path


@pytest.fixture(scope="session")
def own_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("parameters") / "own.toml"
    path.write_text(OWN, encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def study(observed_file, own_file):
    """Thresholds at few frequencies and distances at few amplitudes: those take the time."""
    observed = read_observed(observed_file, complete=False)
    response, models = stored_source("quick").response, judged_models(str(own_file))
    table, source = published(THRESHOLDS).table, published(THRESHOLDS).source
    few = Facts(table[table.frequency_hz.between(70, 80)], source)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorded, "CURVE_HZ", (200.0,))
        patch.setattr(recorded, "_PIN_UM", recorded._PIN_UM[::4])
        return validate(response, models, observed, facts={THRESHOLDS: few})


def computed_already(patch, study):
    """Put what `study` has in the place of what takes most of a validation."""
    patch.setattr("fembridge.report.validate.gather", lambda *_: study.evidence)
    known = study.simulations
    patch.setattr("fembridge.report.validate._simulated", lambda model, response: known[model.name])


@pytest.fixture(scope="session")
def unobserved(study):
    with pytest.MonkeyPatch.context() as patch:
        computed_already(patch, study)
        return validate(stored_source("quick").response, judged_models("published"))


@pytest.fixture
def computed(study, monkeypatch):
    """Neither gathered nor simulated again: as in `study`."""
    computed_already(monkeypatch, study)


@pytest.fixture
def undrawn(monkeypatch):
    """Leave out the figures of a page, which take most of its time."""
    names = ["skin_deflection", "rasters", "tuning", "phases", "man", "distance", "ramp"]
    names += ["fingertip_rates", "fingertip_tuning"]
    names += [f"{kind}_{one.name}" for kind in ("rates", "regression") for one in FAMILIES]
    monkeypatch.setattr(validation_page, "_figures", lambda study: [(n, None) for n in names])
    monkeypatch.setattr(validation_page, "_inline_svg", lambda figure, path: "")


@pytest.fixture(scope="session")
def report(study, tmp_path_factory):
    """The figures of rates have SA alone: 78 panels were most of the time."""
    folder = tmp_path_factory.mktemp("report")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(validation_page, "rates_figure", partial(rates_figure, afferents=["SA"]))
        write_report(folder, study, COMMAND)
    return folder
