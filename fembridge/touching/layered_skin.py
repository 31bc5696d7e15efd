"""Compliance of layered skin on a rigid base, from a closed form in wavenumbers.

A pressure ``exp(i k x)`` on the surface of elastic layers, each bonded to the next and the last one
to a rigid base, moves the surface by ``G(k)`` times itself. In a layer the displacement is a sum of
four functions, ``exp(-k z)``, ``k z exp(-k z)`` and the same from below (Burmister 1945, J. Appl.
Phys. 16:89); they give the stiffness of a layer between its two faces (Kausel & Roësset 1981,
Bull. Seismol. Soc. Am. 71:1743, here at rest), and the stiffnesses are added up where layers meet.
G depends on the length of the wavenumber alone, so one table holds for all directions.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fembridge.typing import FloatArray

# The least wavenumber in 1/mm that is computed; below it G is that of an even pressure.
_LEAST_PER_MM = 1e-2
# Wavenumbers of the table of G.
_TABLE = 600
# The kernel is computed on a square of this side, which repeats; skin on a base 6 mm below moves
# by less than 1e-4 of the largest displacement half of that away.
_PERIOD_MM = 64.0
# ... and on a grid so many times finer than its nodes: what is beyond is folded back.
_FINER = 4


@dataclass(frozen=True, slots=True)
class ElasticLayer:
    """A layer: thickness in mm, Young's modulus in MPa and Poisson's ratio."""

    thickness_mm: float
    young_mpa: float
    poisson: float


def surface_compliance(layers: Sequence[ElasticLayer], wavenumber_per_mm: FloatArray) -> FloatArray:
    """Displacement of the surface in mm under a pressure of 1 MPa of each wavenumber, ``(k,)``.

    Parameters
    ----------
    layers
        Layers from the surface to the rigid base.
    wavenumber_per_mm
        Wavenumbers >= 0 in 1/mm, ``(k,)``.
    """
    k = np.maximum(np.asarray(wavenumber_per_mm, dtype=np.float64), _LEAST_PER_MM)
    degrees = 2 * len(layers)  # along the surface and into it, of the upper face of each layer
    stiffness = np.zeros((k.size, degrees + 2, degrees + 2))
    for number, layer in enumerate(layers):
        faces = slice(2 * number, 2 * number + 4)
        stiffness[:, faces, faces] += _layer_stiffness(layer, k)
    pressure = np.zeros((k.size, degrees, 1))
    pressure[:, 1] = 1.0
    moved = np.linalg.solve(stiffness[:, :degrees, :degrees], pressure)
    return np.asarray(moved[:, 1, 0], dtype=np.float64)


def _layer_stiffness(layer: ElasticLayer, k: FloatArray) -> FloatArray:
    """Tractions on both faces under their displacements, ``(k, 4, 4)``: x, z above, x, z below."""
    depth = layer.thickness_mm
    above = [*_fields(layer, k, 0.0, 1), *_fields(layer, k, -depth, -1)]
    below = [*_fields(layer, k, depth, 1), *_fields(layer, k, 0.0, -1)]
    moved = np.stack(
        [np.stack([*up[:2], *low[:2]], -1) for up, low in zip(above, below, strict=True)], -1
    )
    # The outward normal is up at the upper face.
    traction = np.stack(
        [
            np.stack([-up[2], -up[3], low[2], low[3]], -1)
            for up, low in zip(above, below, strict=True)
        ],
        -1,
    )
    stiffness: FloatArray = np.linalg.solve(
        moved.transpose(0, 2, 1), traction.transpose(0, 2, 1)
    ).transpose(0, 2, 1)
    return stiffness


def _fields(
    layer: ElasticLayer, k: FloatArray, z_mm: float, sign: int
) -> list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
    """Two solutions that decay away from a face: displacements x and z, shear and normal stress.

    z points into the skin and is counted from that face; `sign` is 1 for the upper face. What is
    along the surface is a quarter of a wave ahead of what is into it.
    """
    shear = layer.young_mpa / (2 + 2 * layer.poisson)
    lame = 2 * shear * layer.poisson / (1 - 2 * layer.poisson)
    kappa = 3 - 4 * layer.poisson
    decay = np.exp(-sign * k * z_mm)
    kz = k * z_mm

    def with_stress(
        x: FloatArray, z: FloatArray, slope_x: FloatArray, slope_z: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        normal = (lame + 2 * shear) * slope_z - lame * k * x
        return x, z, shear * (slope_x + k * z), normal

    return [
        with_stress(decay, -sign * decay, -sign * k * decay, k * decay),
        with_stress(
            -kz * decay,
            (kappa + sign * kz) * decay,
            (sign * kz - 1) * k * decay,
            (sign - sign * kappa - kz) * k * decay,
        ),
    ]


def surface_kernel(
    layers: Sequence[ElasticLayer],
    spacing_mm: float,
    counts: tuple[int, int],
    *,
    band_limited: bool = False,
) -> FloatArray:
    """Displacement in mm under 1 N, ``(counts)``, of nodes of a square grid by their distance.

    A node's force is an even pressure on its cell, and its displacement the mean over the cell, so
    a matrix of such entries is symmetric and positive definite. With `band_limited` force and
    displacement are what the grid can hold, up to its shortest wave.

    Parameters
    ----------
    layers
        Layers from the surface to the rigid base.
    spacing_mm
        Distance of two nodes in mm.
    counts
        Numbers of distances along both axes, from 0.
    band_limited
        Whether to cut at the shortest wave. Default: False.
    """
    from scipy import fft

    nodes = max(round(_PERIOD_MM / spacing_mm), 2 * max(counts))
    points = _FINER * nodes
    step_mm = spacing_mm / _FINER
    across = 2 * np.pi * fft.fftfreq(points, step_mm)
    along = 2 * np.pi * fft.rfftfreq(points, step_mm)
    length = np.hypot(across[:, None], along)
    table = np.append(0.0, np.geomspace(_LEAST_PER_MM, 1.001 * length.max(), _TABLE))
    # k G is smooth: 2 (1 - nu^2) / E for short waves.
    scaled = np.maximum(table, _LEAST_PER_MM) * surface_compliance(layers, table)
    response = np.interp(length, table, scaled) / np.maximum(length, _LEAST_PER_MM)
    shortest = np.pi / spacing_mm

    def cell(k: FloatArray) -> FloatArray:
        if band_limited:
            return np.where(np.abs(k) < shortest * (1 - 1e-9), 1.0, 0.0)
        return np.sinc(k * spacing_mm / (2 * np.pi)) ** 2

    response *= cell(across)[:, None]
    response *= cell(along)
    kernel = fft.irfft2(response, (points, points))[::_FINER, ::_FINER] / step_mm**2
    return np.ascontiguousarray(kernel[: counts[0], : counts[1]])
