"""Stress tensors and the quantities derived from them.

A tensor has six components in the order of a ``.frd``: xx, yy, zz, xy, yz, zx. A ``.dat`` prints
xx, yy, zz, xy, xz, yz; its reader reorders them. Von Mises stress is the same for both orders, all
other quantities are not.

The shears of a strain are tensor components, half the engineering angle, as CalculiX prints them
(measured: a shear u = 0.002 y gives EXY 0.001, and the energy below equals ENER of the same file).
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fembridge.typing import FloatArray

TENSOR = ("xx", "yy", "zz", "xy", "yz", "zx")
_NORMAL = 3
_ROWS_AT_ONCE = 1 << 15  # matrices in memory
_IN_ROWS = ((0, 3, 5), (3, 1, 4), (5, 4, 2))  # component at row and column


def von_mises_pa(tensor_pa: FloatArray) -> FloatArray:
    """Von Mises stress, ``(...)`` in Pa, of tensors ``(..., 6)`` in Pa.

    Notes
    -----
    ``sqrt(((xx-yy)² + (yy-zz)² + (zz-xx)²)/2 + 3(xy² + yz² + zx²))``: |s| in
    uniaxial stress s, sqrt(3) τ in pure shear τ, 0 under hydrostatic pressure.
    """
    xx, yy, zz, xy, yz, zx = np.moveaxis(np.asarray(tensor_pa, dtype=np.float64), -1, 0)
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
    stress s; unlike von Mises stress it depends on pressure, ``√(3(1 − 2ν)) p``.
    """
    if not -1.0 <= poisson <= 0.5:
        raise ValueError(f"poisson is {poisson}, expected -1 to 0.5")
    xx, yy, zz, xy, yz, zx = np.moveaxis(np.asarray(tensor_pa, dtype=np.float64), -1, 0)
    normal = xx**2 + yy**2 + zz**2 - 2.0 * poisson * (xx * yy + yy * zz + zz * xx)
    shear = xy**2 + yz**2 + zx**2
    twice_ew = normal + 2.0 * (1.0 + poisson) * shear
    # Below 0 only by rounding: pressure in a material of ν = 0.5.
    stress: FloatArray = np.sqrt(np.maximum(twice_ew, 0.0))
    return stress


def principal_stresses_pa(tensor_pa: FloatArray) -> FloatArray:
    """Principal stresses, ``(..., 3)`` in Pa, largest first, of ``(..., 6)`` in Pa.

    Notes
    -----
    Eigenvalues of the symmetric matrix, by LAPACK: the closed form loses half its digits if two
    eigenvalues are close, as in a compressed layer.
    """
    tensor = np.asarray(tensor_pa, dtype=np.float64)
    rows = tensor.reshape(-1, len(TENSOR))
    values = np.empty((len(rows), 3), dtype=np.float64)
    for first in range(0, len(rows), _ROWS_AT_ONCE):
        some = slice(first, first + _ROWS_AT_ONCE)
        values[some] = np.linalg.eigvalsh(rows[some][:, _IN_ROWS])[:, ::-1]
    return values.reshape(*tensor.shape[:-1], 3)


def max_shear_pa(tensor_pa: FloatArray) -> FloatArray:
    """Greatest shear stress on any plane, ``(...)`` in Pa, as in Tresca's criterion.

    Half the difference of the largest and the smallest principal stress.
    """
    principal = principal_stresses_pa(tensor_pa)
    shear: FloatArray = 0.5 * (principal[..., 0] - principal[..., 2])
    return shear


def mean_stress_pa(tensor_pa: FloatArray) -> FloatArray:
    """Mean normal stress, ``(...)`` in Pa, negative under pressure."""
    mean: FloatArray = np.asarray(tensor_pa)[..., :_NORMAL].mean(axis=-1)
    return mean


def strain_energy_density_pa(tensor_pa: FloatArray, strain: FloatArray) -> FloatArray:
    """Density of elastic energy, ``(...)`` in Pa, which is J/m³.

    Parameters
    ----------
    tensor_pa, strain
        ``(..., 6)`` each, at the same positions and times; strain with tensor shears.

    Notes
    -----
    ``σ:ε/2``, with each shear counted twice: the energy of a linear elastic material at small
    strain. With NLGEOM a ``.frd`` has Cauchy stress and Lagrange strain, whose product is not
    energy: request ENER from the solver.
    """
    product = np.asarray(tensor_pa) * np.asarray(strain)
    normal = product[..., :_NORMAL].sum(axis=-1)
    energy: FloatArray = 0.5 * normal + product[..., _NORMAL:].sum(axis=-1)
    return energy


def clear_shear(tensor: FloatArray, nodes: Sequence[int], on_axis: Collection[int]) -> None:
    """Set the shear xy of ``(T, node, 6)`` to 0 at those of `nodes` that are `on_axis`.

    On the symmetry axis of a half section the shear is 0; the solver's value is a mean over one
    half, and the other half has the opposite sign.
    """
    tensor[:, [node in on_axis for node in nodes], TENSOR.index("xy")] = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class OneSidedStress:
    """Stress at `node` in one material: `tensor_pa` ``(T, 6)`` in Pa at `times_ms` ``(T,)``.

    Components are ordered xx yy zz xy yz zx. The stress is the mean over the `elements` of the
    material at the node.
    """

    node: int
    material: int
    name: str
    elements: tuple[int, ...]
    times_ms: FloatArray
    tensor_pa: FloatArray

    @property
    def von_mises_pa(self) -> FloatArray:
        """Von Mises stress on this side, ``(T,)`` in Pa."""
        return von_mises_pa(self.tensor_pa)


# By name: the quantities it needs, and its function of them.
DERIVED: Mapping[str, tuple[tuple[str, ...], Callable[..., FloatArray]]] = {
    "von_mises": (("STRESS",), von_mises_pa),
    "principal": (("STRESS",), principal_stresses_pa),
    "max_shear": (("STRESS",), max_shear_pa),
    "mean_stress": (("STRESS",), mean_stress_pa),
    "strain_energy_density": (("STRESS", "TOSTRAIN"), strain_energy_density_pa),
}
