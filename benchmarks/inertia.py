"""What inertia, which touches leave out, changes: ``python -m benchmarks.inertia``.

Closed form of a half-space under a vibrating disc (Lamb's problem, solved wave number by wave
number with Hankel transforms): stress on the axis for one micrometre of motion of the disc, and
motion of the surface beside it, at a frequency and at rest. The half-space is subcutaneous tissue
of the reference finger; its shear modulus has a loss factor.

The potentials are u = grad phi + grad d(psi)/dz + ks^2 psi e_z with phi = A exp(-alpha z) J0(k r),
psi = B exp(-beta z) J0(k r), alpha^2 = k^2 - kp^2 and beta^2 = k^2 - ks^2 (Graff 1975, *Wave Motion
in Elastic Solids*, chapter 6). No shear and the pressure P(k) on the surface give B = -2 alpha P /
(mu F) and A = -(2 k^2 - ks^2) P / (mu F) with F = (2 k^2 - ks^2)^2 - 4 k^2 alpha beta.
"""

import numpy as np
from scipy.special import j0, j1

YOUNG_PA, POISSON, DENSITY_KG_PER_M3 = 24e3, 0.48, 1000.0
LOSS = 0.3
RADIUS_MM = 0.5
DEPTHS_MM = {"SA": 0.6, "RA": 0.5, "PC": 2.0}
FREQUENCIES_HZ = (20, 50, 100, 200, 300, 500, 800)
DISTANCES_MM = (3.0, 6.0, 10.0)
AT_REST_HZ = 0.2
_STEPS, _LARGEST_WAVE_NUMBER = 200_000, 120.0  # times 1 / radius


def response(
    frequency_hz: float, depth_mm: float = 0.0, distance_mm: float = 0.0, loss: float = LOSS
) -> tuple[complex, complex, complex]:
    """Motion of the disc (mean) and of the surface at a distance, and stress below its middle.

    Per pascal of pressure on the disc: motions in m, the stress sigma_zz - sigma_rr, of which the
    von Mises stress is the size, in Pa.
    """
    radius_m, depth_m = 1e-3 * RADIUS_MM, 1e-3 * depth_mm
    mu = YOUNG_PA / (2 * (1 + POISSON)) * (1 + 1j * loss)
    modulus = 2 * mu * (1 - POISSON) / (1 - 2 * POISSON)
    omega = 2 * np.pi * frequency_hz
    ks2, kp2 = omega**2 * DENSITY_KG_PER_M3 / mu, omega**2 * DENSITY_KG_PER_M3 / modulus
    step = _LARGEST_WAVE_NUMBER / radius_m / _STEPS
    k = (np.arange(_STEPS) + 0.5) * step
    alpha, beta = np.sqrt(k**2 - kp2 + 0j), np.sqrt(k**2 - ks2 + 0j)
    pressure = radius_m * j1(k * radius_m) / k
    rayleigh = (2 * k**2 - ks2) ** 2 - 4 * k**2 * alpha * beta
    b = -2 * alpha * pressure / (mu * rayleigh)
    a = -(2 * k**2 - ks2) * pressure / (mu * rayleigh)
    surface = -alpha * a + k**2 * b
    mean_over_disc = 2 * j1(k * radius_m) / (k * radius_m)
    disc = np.sum(surface * mean_over_disc * k) * step
    beside = np.sum(surface * j0(1e-3 * distance_mm * k) * k) * step
    in_depth, sheared = np.exp(-alpha * depth_m), np.exp(-beta * depth_m)
    stretch = alpha**2 * a * in_depth - k**2 * beta * b * sheared
    across = 0.5 * k * (-k * a * in_depth + k * beta * b * sheared)
    stress = np.sum(2 * mu * (stretch - across) * k) * step
    return complex(disc), complex(beside), complex(stress)


def static_stress_share(depth_mm: float) -> float:
    """(sigma_zz - sigma_rr) / pressure on the axis of a disc at rest, in closed form.

    Timoshenko & Goodier, *Theory of Elasticity*, section 139.
    """
    ratio = depth_mm / RADIUS_MM
    root = np.sqrt(1 + ratio**2)
    sigma_zz = -1 + ratio**3 / root**3
    sigma_rr = 0.5 * (-(1 + 2 * POISSON) + 2 * (1 + POISSON) * ratio / root - ratio**3 / root**3)
    return float(sigma_zz - sigma_rr)


def main() -> None:
    """Print the tables of ``docs/science/touch_mechanics.md``."""
    print("stress for a motion of the disc, relative to that at rest\n")
    print(f"| Hz | {' | '.join(f'{name}, {mm:g} mm' for name, mm in DEPTHS_MM.items())} |")
    print("|---|" + "---|" * len(DEPTHS_MM))
    at_rest = {}
    for name, depth_mm in DEPTHS_MM.items():
        disc, _, stress = response(AT_REST_HZ, depth_mm)
        at_rest[name] = abs(stress / disc)
    for frequency_hz in FREQUENCIES_HZ:
        cells = []
        for name, depth_mm in DEPTHS_MM.items():
            disc, _, stress = response(frequency_hz, depth_mm)
            cells.append(f"{abs(stress / disc) / at_rest[name]:.2f}")
        print(f"| {frequency_hz} | {' | '.join(cells)} |")
    print("\nmotion of the surface beside the disc, as a share of that of the disc\n")
    print(f"| Hz | {' | '.join(f'{mm:g} mm' for mm in DISTANCES_MM)} |")
    print("|---|" + "---|" * len(DISTANCES_MM))
    for frequency_hz in (AT_REST_HZ, *FREQUENCIES_HZ):
        cells = []
        for distance_mm in DISTANCES_MM:
            disc, beside, _ = response(frequency_hz, distance_mm=distance_mm)
            cells.append(f"{abs(beside / disc):.3f}")
        title = "at rest" if frequency_hz == AT_REST_HZ else str(frequency_hz)
        print(f"| {title} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
