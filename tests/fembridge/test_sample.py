"""The samples that travel with the package, and the commands that are printed for them."""

import shlex

import pytest

import fembridge as fb
from fembridge import cli
from fembridge.errors import UsageError
from fembridge.simulation.sample import RUN, SAMPLES


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def printed_commands(out):
    return [shlex.split(line) for line in out.splitlines() if line.startswith("  fembridge ")]


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] * (name in ("touches", "rates", "press")))
        for name in SAMPLES
    ],
)
def test_the_commands_printed_for_a_sample_work_as_printed(here, capsys, monkeypatch, name):
    """Without a solver."""
    monkeypatch.setenv("PATH", str(here))
    assert cli.main(["sample", name, "-o", "a sample"]) == 0
    commands = printed_commands(capsys.readouterr().out)
    assert len(commands) == len(SAMPLES[name].commands)
    for words in commands:
        assert cli.main(words[1:]) == 0, capsys.readouterr().err


def test_the_sample_results_have_the_three_classes_and_fire_all_of_them(here):
    traces = fb.read(fb.sample("frd"))
    rates = fb.encode(traces).rates
    assert sorted(trace.afferent for trace in traces) == ["PC", "RA", "SA"]
    assert (rates["rate_ips"] > 20).all()


def test_the_sample_results_are_small():
    assert RUN.stat().st_size < 200_000


def test_an_unknown_sample_is_refused_with_the_near_one(here):
    with pytest.raises(UsageError) as caught:
        fb.sample("fdr")
    assert (caught.value.argument, caught.value.found) == ("name", "fdr")
    assert not list(here.iterdir())


def test_without_a_name_every_sample_is_listed(here, capsys):
    assert cli.main(["sample"]) == 0
    out = capsys.readouterr().out
    for name, item in SAMPLES.items():
        assert f"{name} " in out
        assert item.contents in out
    assert not list(here.iterdir())
