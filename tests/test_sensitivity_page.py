"""``docs/sensitivity.md`` says what its stored fingers give, digit by digit."""

import math
from pathlib import Path

import pytest

from fembridge.sensitivity import rank_regressions, read_swept, single_effects
from fembridge.sensitivity.effects_table import effects_markdown, regressions_markdown
from fembridge.sensitivity.words import signed
from fembridge.sweep import read_study

DOCS = Path(__file__).parents[1] / "docs"
PAGE = (DOCS / "sensitivity.md").read_text("utf-8")
STUDIES = ("sensitivity_one_at_a_time", "sensitivity_hypercube")


@pytest.fixture
def swept(request):
    return read_swept(DOCS / "studies" / f"{request.param}.csv")


@pytest.mark.parametrize("swept", STUDIES[:1], indirect=True)
def test_the_one_at_a_time_tables_are_those_of_the_stored_fingers(swept):
    assert effects_markdown(swept, single_effects(swept)).strip() in PAGE


@pytest.mark.parametrize("swept", STUDIES[1:], indirect=True)
def test_the_tables_of_ranks_are_those_of_the_stored_fingers(swept):
    assert regressions_markdown(swept, rank_regressions(swept)).strip() in PAGE


@pytest.mark.parametrize("name", STUDIES)
def test_the_stored_fingers_are_those_of_the_study(name):
    study = read_study(DOCS / "studies" / f"{name}.toml")
    swept = read_swept(DOCS / "studies" / f"{name}.csv")

    assert swept.names == tuple(study.variants[0].changes)
    for values, variant in zip(swept.value, study.variants, strict=True):
        expected = [float(value) for value in variant.changes.values()]
        assert values.tolist() == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("name", STUDIES)
def test_the_page_names_the_study_the_command_and_the_picture(name):
    assert f"fembridge sweep docs/studies/{name}.toml" in PAGE
    assert f"docs/studies/{name}.csv" in PAGE
    assert f"(images/{name}.png)" in PAGE
    assert (DOCS / "images" / f"{name}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("swept", STUDIES[:1], indirect=True)
def test_stress_goes_up_as_all_moduli_together(swept):
    """Euler: the probe's way is given, so stress is of degree 1 in the moduli.

    The exponents of stress for each modulus, d ln σ / d ln E, add up to 1, but for
    what bone, nail and the contact's springs hold.
    """
    effects = [
        effect
        for effect in single_effects(swept)
        if effect.parameter.endswith("young_mpa")
        and (effect.output.quantity, effect.output.group) == ("peak_stress_pa", "all")
    ]
    exponents = {
        (effect.output.afferent, effect.parameter): math.log(effect.at_high / effect.at_low)
        / math.log(effect.high / effect.low)
        for effect in effects
    }

    assert len(exponents) == 3 * 4
    for afferent in swept.afferents:
        mine = [each for (name, _), each in exponents.items() if name == afferent]
        assert sum(mine) == pytest.approx(1, abs=0.01)
        told = ", ".join(signed(each, 2) for each in mine)
        assert f"{afferent} {told}" in " ".join(PAGE.split())
