"""What follows from stress and strain at a point: one number, or three.

Tensors are six components in the order of a ``.frd``: xx, yy, zz, xy, yz, zx.
The shears of a strain are tensor components, half the engineering angle: so
CalculiX prints them (measured: a shear u = 0.002 y gives EXY 0.001, and the energy
below then is the ENER of the same file).
"""

from collections.abc import Callable, Mapping

import numpy as np

from fembridge.errors import UsageError
from fembridge.results.frd_format.field import Field
from fembridge.results.stress import TENSOR, von_mises_pa
from fembridge.typing import FloatArray

STRESS, STRAIN = "STRESS", "TOSTRAIN"
_NORMAL = 3
_ROWS_AT_ONCE = 1 << 15  # matrices in memory
_IN_ROWS = ((0, 3, 5), (3, 1, 4), (5, 4, 2))  # component at row and column


def principal_stresses_pa(tensor_pa: FloatArray) -> FloatArray:
    """Principal stresses, ``(..., 3)`` in Pa, largest first, of ``(..., 6)`` in Pa.

    Notes
    -----
    Eigenvalues of the symmetric matrix, by LAPACK and not by the closed form: that
    one loses half its digits where two of them are close, as in a layer pressed
    flat.
    """
    tensor = _checked(tensor_pa)
    rows = tensor.reshape(-1, len(TENSOR))
    values = np.empty((len(rows), 3), dtype=np.float64)
    for first in range(0, len(rows), _ROWS_AT_ONCE):
        some = slice(first, first + _ROWS_AT_ONCE)
        values[some] = np.linalg.eigvalsh(rows[some][:, _IN_ROWS])[:, ::-1]
    return values.reshape(*tensor.shape[:-1], 3)


def max_shear_pa(tensor_pa: FloatArray) -> FloatArray:
    """Greatest shear stress on any plane, ``(...)`` in Pa: half of largest less least.

    It is what Tresca's rule compares.
    """
    principal = principal_stresses_pa(tensor_pa)
    shear: FloatArray = 0.5 * (principal[..., 0] - principal[..., 2])
    return shear


def mean_stress_pa(tensor_pa: FloatArray) -> FloatArray:
    """Mean normal stress, ``(...)`` in Pa: less than 0 under pressure."""
    mean: FloatArray = _checked(tensor_pa)[..., :_NORMAL].mean(axis=-1)
    return mean


def strain_energy_density_pa(tensor_pa: FloatArray, strain: FloatArray) -> FloatArray:
    """Elastic energy in a volume, ``(...)`` in Pa, which is J/m³.

    Parameters
    ----------
    tensor_pa, strain
        ``(..., 6)`` each, of one place and time; strain with tensor shears.

    Notes
    -----
    ``σ:ε/2``, each shear counted twice. It is the energy of a linear elastic
    material at small strain. With NLGEOM a ``.frd`` has Cauchy stress and Lagrange
    strain, whose product is not energy: ask the solver for ENER then.
    """
    product = _checked(tensor_pa) * _checked(strain)
    normal = product[..., :_NORMAL].sum(axis=-1)
    energy: FloatArray = 0.5 * normal + product[..., _NORMAL:].sum(axis=-1)
    return energy


def tensor_of(field: Field) -> FloatArray:
    """Give a stress or strain field as ``(N, 6)`` in the order of this module.

    Raises
    ------
    UsageError
        The field is no tensor.
    """
    letter = field.components[0][:1]
    wanted = tuple(f"{letter}{place.upper()}" for place in TENSOR)
    absent = [name for name in wanted if name not in field.components]
    if absent:
        raise UsageError(
            f"{field.name} has no component {absent[0]}: it is no tensor, it has "
            f"{', '.join(field.components)}"
        )
    if field.components == wanted:
        return field.values
    columns = [field.components.index(name) for name in wanted]
    tensor: FloatArray = field.values[:, columns]
    return tensor


def derived_of(name: str, fields: Mapping[str, Field]) -> FloatArray:
    """Compute the quantity `name` of `DERIVED` from fields of one increment.

    Raises
    ------
    UsageError
        There is no such quantity; or a field it takes is not there, or is at other
        nodes.
    """
    if name not in DERIVED:
        raise UsageError(f"no quantity {name!r}; there are {', '.join(DERIVED)}")
    takes, function = DERIVED[name]
    absent = [quantity for quantity in takes if quantity not in fields]
    if absent:
        raise UsageError(f"{name} takes {absent[0]}, which is not there")
    first = fields[takes[0]]
    for quantity in takes[1:]:
        if not np.array_equal(fields[quantity].nodes, first.nodes):
            raise UsageError(f"{name}: {takes[0]} and {quantity} are at other nodes")
    return function(*(tensor_of(fields[quantity]) for quantity in takes))


# By name: the quantities it takes, and what is computed of them.
DERIVED: Mapping[str, tuple[tuple[str, ...], Callable[..., FloatArray]]] = {
    "von_mises": ((STRESS,), von_mises_pa),
    "principal": ((STRESS,), principal_stresses_pa),
    "max_shear": ((STRESS,), max_shear_pa),
    "mean_stress": ((STRESS,), mean_stress_pa),
    "strain_energy_density": ((STRESS, STRAIN), strain_energy_density_pa),
}


def _checked(tensor: FloatArray) -> FloatArray:
    checked = np.asarray(tensor, dtype=np.float64)
    if checked.shape[-1:] != (len(TENSOR),):
        raise ValueError(f"expected (..., 6), got {checked.shape}")
    return checked
