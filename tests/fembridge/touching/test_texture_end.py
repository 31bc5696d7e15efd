"""Height maps that slide away, and maps that repeat."""

import numpy as np
import pytest

import fembridge as fb
from fembridge.errors import FembridgeWarning
from fembridge.touching.contact_history import _middle_mm
from fembridge.touching.contact_warnings import texture_end_ms

HEIGHTS = np.random.default_rng(1).uniform(0, 0.3, (40, 60))
SLIDE = fb.Trajectory.slide(40.0, press_um=300, duration_ms=200)


def texture(**words):
    return fb.Shape.from_heights(HEIGHTS, 0.25, **words)


def test_a_map_ends_when_its_edge_passes_the_middle_of_the_contact():
    """10 mm long, moved by 40 mm/s: its edge is over the middle after 5 mm, 125 ms."""
    assert texture_end_ms(texture(), SLIDE, (0.0, 0.0)) == pytest.approx(125.0, abs=SLIDE.dt_ms)
    ahead = texture().moved(0.0, 2.0)
    assert texture_end_ms(ahead, SLIDE, (0.0, 0.0)) == pytest.approx(175.0, abs=SLIDE.dt_ms)
    short = fb.Trajectory.slide(40.0, press_um=300, duration_ms=100)
    assert texture_end_ms(texture(), short, (0.0, 0.0)) is None


def test_a_map_that_repeats_does_not_end_and_is_the_map_where_that_is():
    tiled = texture(tile=True)
    assert texture_end_ms(tiled, SLIDE, (0.0, 0.0)) is None
    x, z = np.random.default_rng(2).uniform(-4, 4, (2, 200))
    np.testing.assert_allclose(tiled.height_mm(x, z), texture().height_mm(x, z))
    np.testing.assert_allclose(tiled.height_mm(x + 15.0, z - 30.0), tiled.height_mm(x, z))


def test_the_end_of_a_texture_reaches_the_user_and_the_record():
    with pytest.warns(FembridgeWarning):
        ended = fb.touch(texture(), SLIDE, population="one_each")
    end_ms = texture_end_ms(texture(), SLIDE, _middle_mm(ended.contact))
    assert 100 < end_ms < 150
    assert sum(f"{end_ms:g} ms" in text for text in ended.provenance["warnings"]) == 1
