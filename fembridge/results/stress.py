"""Stress tensors and the one number an afferent feels.

A tensor is six components in the order of a ``.frd``: xx, yy, zz, xy, yz, zx.
The trap: a ``.dat`` prints xx, yy, zz, xy, xz, yz. Von Mises stress does not
tell the two apart (the shears enter alike), everything else does; the ``.dat``
reader reorders, so that downstream there is one order.
"""

import numpy as np

from fembridge.typing import FloatArray

TENSOR = ("xx", "yy", "zz", "xy", "yz", "zx")


def von_mises_pa(tensor_pa: FloatArray) -> FloatArray:
    """Von Mises stress, ``(...)`` in Pa, of tensors ``(..., 6)`` in Pa.

    Notes
    -----
    ``sqrt(((xx-yy)² + (yy-zz)² + (zz-xx)²)/2 + 3(xy² + yz² + zx²))``: |s| in
    uniaxial stress s, sqrt(3) τ in pure shear τ, 0 under hydrostatic pressure.
    """
    tensor = np.asarray(tensor_pa, dtype=np.float64)
    if tensor.shape[-1:] != (len(TENSOR),):
        raise ValueError(f"expected (..., 6), got {tensor.shape}")
    xx, yy, zz, xy, yz, zx = np.moveaxis(tensor, -1, 0)
    normal = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    shear = xy**2 + yz**2 + zx**2
    stress: FloatArray = np.sqrt(0.5 * normal + 3.0 * shear)
    return stress


def energy_stress_pa(tensor_pa: FloatArray, poisson: float) -> FloatArray:
    """Uniaxial stress of equal strain energy, ``(...)`` in Pa, of ``(..., 6)`` in Pa.

    Parameters
    ----------
    tensor_pa
        Stress tensors of one linear elastic, isotropic material.
    poisson
        Its Poisson's ratio, from -1 to 0.5.

    Notes
    -----
    A bar under the stress s stores ``s²/2E``, so s is ``√(2EW)`` of the energy
    density W: ``2EW = Σ σii² − 2ν Σ_{i<j} σii σjj + 2(1 + ν)(xy² + yz² + zx²)``,
    Hooke's law put into ``W = σ:ε/2``. Young's modulus drops out. |s| in uniaxial
    stress s; unlike von Mises stress it feels pressure, ``√(3(1 − 2ν)) p``.
    """
    tensor = np.asarray(tensor_pa, dtype=np.float64)
    if tensor.shape[-1:] != (len(TENSOR),):
        raise ValueError(f"expected (..., 6), got {tensor.shape}")
    if not -1.0 <= poisson <= 0.5:
        raise ValueError(f"poisson is {poisson}, expected -1 to 0.5")
    xx, yy, zz, xy, yz, zx = np.moveaxis(tensor, -1, 0)
    normal = xx**2 + yy**2 + zz**2 - 2.0 * poisson * (xx * yy + yy * zz + zz * xx)
    shear = xy**2 + yz**2 + zx**2
    twice_ew = normal + 2.0 * (1.0 + poisson) * shear
    # Never below 0, but for rounding: pressure in a material of ν = 0.5.
    stress: FloatArray = np.sqrt(np.maximum(twice_ew, 0.0))
    return stress
