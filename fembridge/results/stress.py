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
