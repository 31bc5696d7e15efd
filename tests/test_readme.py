"""What the README shows works as it stands there."""

import re
import tomllib
from pathlib import Path

import pytest

from decks.presets import finger_from
from fembridge.cli import VERBS

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def test_the_python_shown_runs_and_gives_the_rates_shown(tmp_path, monkeypatch):
    (tmp_path / "fixtures").symlink_to(ROOT / "fixtures")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", "")  # the stored response, also where ccx is
    (tmp_path / "rates.csv").write_text("stimulus,afferent,rate_ips\nsine_20_250,SA,24\n")
    names = {}

    for code in blocks("python"):
        exec(compile(code, "README.md", "exec"), names)

    rates = names["result"].rates
    shown = re.findall(r"^# (sine_\S+) +(\S+) +(\S+) +(\S+)$", README, flags=re.MULTILINE)
    for stimulus, *numbers in shown:
        of_one = rates[rates["stimulus"] == stimulus].set_index("afferent")["rate_ips"]
        assert [f"{of_one[name]:.1f}" for name in ("PC", "RA", "SA")] == numbers
    assert len(shown) == 2
    assert (tmp_path / "raster.png").stat().st_size > 10_000
    assert {run.name for run in (tmp_path / "runs").iterdir()} == {
        f"noise_25_250_{level}" for level in ("0.25", "1", "5", "10", "20")
    }
    assert set(names["spikes"]["afferent"]) == {"SA", "RA", "PC"}
    assert names["spikes_ms"].size > 3


@pytest.mark.parametrize("table", blocks("toml"))
def test_the_finger_shown_is_one(table):
    finger = finger_from(tomllib.loads(table), name="mine")
    assert finger.skin.epidermis_mm == 0.5
    assert finger.afferents["SA"].depth_mm == 0.70


def test_every_verb_stands_in_the_readme_and_no_other():
    shown = set(re.findall(r"`fembridge ([a-z-]+)", README))
    assert shown == set(VERBS)


def test_pictures_and_pages_that_the_readme_names_are_there():
    for name in re.findall(r"\]\((docs/[^)]+)\)", README):
        assert (ROOT / name).is_file(), name
    for name in re.findall(r"`((?:docs|tests|fixtures)/[\w./]+)`", README):
        assert (ROOT / name).exists(), name
