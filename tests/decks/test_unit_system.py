"""Units of a model by the name that its heading gives."""

import pytest

from decks.unit_system import LENGTH_UNITS, UNIT_SYSTEMS, unit_system_in

_METRES = {"mm": 1e-3, "m": 1.0, "in": 0.0254}


@pytest.mark.parametrize("name", UNIT_SYSTEMS)
def test_stress_is_force_over_length_squared(name):
    found = unit_system_in(f"Hash: wQ2k, Date: 04/23/2022, Unit system: {name}\n")
    assert found is not None and found.name == name
    metre = _METRES[found.length_unit]
    assert found.length_mm == pytest.approx(1e3 * metre, rel=1e-15)
    assert found.stress_pa == pytest.approx(found.force_n / metre**2, rel=1e-14)


@pytest.mark.parametrize(
    "heading",
    ["", "Unit system: UNIT_LESS", "Unit system: Undefined", "in M_KG_S_C", "Unit system"],
)
def test_a_heading_that_names_no_units_says_nothing(heading):
    assert unit_system_in(heading) is None


def test_a_length_alone_means_newton_or_pound_force():
    forces_n = {name: one.force_n for name, one in LENGTH_UNITS.items()}
    assert forces_n == {"mm": 1.0, "m": 1.0, "in": 4.4482216152605}
