"""The closed form of a vibrating half-space, on which the statement on inertia rests."""

import numpy as np
import pytest

from benchmarks import inertia


@pytest.mark.parametrize("depth_mm", [0.5, 2.0, 5.0])
def test_slow_motion_gives_the_stress_of_a_disc_at_rest(depth_mm):
    _, _, stress = inertia.response(inertia.AT_REST_HZ, depth_mm, loss=1e-4)
    assert stress.real == pytest.approx(inertia.static_stress_share(depth_mm), rel=1e-4)


def test_slow_motion_gives_the_mean_displacement_of_a_disc_at_rest():
    disc, _, _ = inertia.response(inertia.AT_REST_HZ, loss=1e-4)
    radius_m = 1e-3 * inertia.RADIUS_MM
    closed = 16 * (1 - inertia.POISSON**2) * radius_m / (3 * np.pi * inertia.YOUNG_PA)
    assert disc.real == pytest.approx(closed, rel=1e-3)


def test_far_away_the_surface_moves_with_the_phase_of_a_surface_wave():
    """Seven to ten wavelengths away body waves have faded; the speed is that of Rayleigh waves."""
    frequency_hz = 500.0
    phases = [
        np.angle(inertia.response(frequency_hz, distance_mm=distance_mm, loss=0.05)[1])
        for distance_mm in np.arange(40.0, 60.0, 2.0)
    ]
    slope_per_m = -np.polyfit(1e-3 * np.arange(0, 20, 2), np.unwrap(phases), 1)[0]
    speed = 2 * np.pi * frequency_hz / slope_per_m
    shear = np.sqrt(inertia.YOUNG_PA / (2 * (1 + inertia.POISSON) * inertia.DENSITY_KG_PER_M3))
    assert speed / shear == pytest.approx(0.95, abs=0.03)  # 0.862 + 1.14 nu over 1 + nu
