"""Cauchy stress of the materials of a deck, and its change under small further strain.

Linear elasticity is CalculiX' under large strain: second Piola-Kirchhoff stress is linear in
Green's strain. Hyperelastic laws are polynomials of the invariants of isochoric strain
(``NEO HOOKE``, ``MOONEY RIVLIN``, ``YEOH``, ``REDUCED POLYNOMIAL``, ``POLYNOMIAL``) and ``OGDEN``.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from decks.inp import Block
from fembridge.errors import DeckError
from fembridge.typing import FloatArray

# CalculiX takes this Poisson's ratio where a hyperelastic law states no volume term.
_DEFAULT_POISSON = 0.475
_STEP = 1e-5
STRESS_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))  # xx, yy, zz, xy, yz, zx
_POLYNOMIALS = {
    "NEOHOOKE": ((1, 0),),
    "MOONEYRIVLIN": ((1, 0), (0, 1)),
    "YEOH": ((1, 0), (2, 0), (3, 0)),
}
_CONSTANTS_PER_ROW = 8


class Law(Protocol):
    """Stress as a function of the deformation gradient."""

    def cauchy(self, gradient: FloatArray) -> FloatArray:
        """Cauchy stress ``(E, 3, 3)`` in the deck's unit at deformation gradients ``(E, 3, 3)``."""


@dataclass(frozen=True, slots=True)
class LinearElastic:
    """Isotropic elasticity with Young's modulus and Poisson's ratio."""

    young: float
    poisson: float

    def cauchy(self, gradient: FloatArray) -> FloatArray:
        """See `Law`."""
        shear = self.young / (2 * (1 + self.poisson))
        lame = self.young * self.poisson / ((1 + self.poisson) * (1 - 2 * self.poisson))
        strain = 0.5 * (np.swapaxes(gradient, 1, 2) @ gradient - np.eye(3))
        trace = np.trace(strain, axis1=1, axis2=2)[:, None, None]
        second = 2 * shear * strain + lame * trace * np.eye(3)
        stress: FloatArray = gradient @ second @ np.swapaxes(gradient, 1, 2)
        stress /= np.linalg.det(gradient)[:, None, None]
        return stress


@dataclass(frozen=True, slots=True)
class Polynomial:
    """Energy ``sum C_ij (I1 - 3)^i (I2 - 3)^j + sum (J - 1)^(2 k) / D_k``."""

    terms: tuple[tuple[int, int, float], ...]
    volume: tuple[float, ...]

    def cauchy(self, gradient: FloatArray) -> FloatArray:
        """See `Law`."""
        jacobian, isochoric = _isochoric(gradient)
        square = isochoric @ isochoric
        first = np.trace(isochoric, axis1=1, axis2=2)
        second = 0.5 * (first**2 - np.trace(square, axis1=1, axis2=2))
        by_first, by_second = np.zeros_like(first), np.zeros_like(first)
        for i, j, constant in self.terms:
            if i:
                by_first += constant * i * (first - 3) ** (i - 1) * (second - 3) ** j
            if j:
                by_second += constant * j * (first - 3) ** i * (second - 3) ** (j - 1)
        tensor = (by_first + first * by_second)[:, None, None] * isochoric
        tensor = tensor - by_second[:, None, None] * square
        pressure = _volume_stress(jacobian, self.volume)
        stress: FloatArray = 2 / jacobian[:, None, None] * _deviator(tensor)
        return stress + pressure[:, None, None] * np.eye(3)


@dataclass(frozen=True, slots=True)
class Ogden:
    """Energy ``sum 2 mu_k / alpha_k^2 (sum_i l_i^alpha_k - 3) + sum (J - 1)^(2 k) / D_k``."""

    terms: tuple[tuple[float, float], ...]
    volume: tuple[float, ...]

    def cauchy(self, gradient: FloatArray) -> FloatArray:
        """See `Law`."""
        jacobian, isochoric = _isochoric(gradient)
        square, axes = np.linalg.eigh(isochoric)
        principal = np.zeros_like(square)
        for shear, power in self.terms:
            principal += 2 * shear / power * square ** (power / 2)
        tensor = np.einsum("eik,ek,ejk->eij", axes, principal, axes)
        pressure = _volume_stress(jacobian, self.volume)
        stress: FloatArray = _deviator(tensor) / jacobian[:, None, None]
        return stress + pressure[:, None, None] * np.eye(3)


def _isochoric(gradient: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Change of volume ``(E,)`` and left Cauchy-Green tensor without it ``(E, 3, 3)``."""
    jacobian = np.linalg.det(gradient)
    left = gradient @ np.swapaxes(gradient, 1, 2)
    return jacobian, left * jacobian[:, None, None] ** (-2 / 3)


def _deviator(tensor: FloatArray) -> FloatArray:
    deviator: FloatArray = tensor - np.trace(tensor, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(
        3
    )
    return deviator


def _volume_stress(jacobian: FloatArray, volume: Sequence[float]) -> FloatArray:
    stress: FloatArray = np.zeros_like(jacobian)
    for k, constant in enumerate(volume, start=1):
        if constant > 0:
            stress += 2 * k / constant * (jacobian - 1) ** (2 * k - 1)
    return stress


def stress_change(law: Law, gradient: FloatArray) -> FloatArray:
    """Change of Cauchy stress by a gradient of further displacement, ``(E, 6, 3, 3)``.

    Parameters
    ----------
    law
        The material.
    gradient
        Deformation gradients of the state, ``(E, 3, 3)``.

    Returns
    -------
    ndarray
        Derivatives of xx, yy, zz, xy, yz, zx by ``du_i / dx_j``, x in the deformed state; central
        differences.
    """
    change = np.empty((len(gradient), 6, 3, 3))
    for i in range(3):
        for j in range(3):
            step = np.zeros((3, 3))
            step[i, j] = _STEP
            ahead, behind = (
                law.cauchy((np.eye(3) + sign * step) @ gradient) for sign in (1.0, -1.0)
            )
            slope = (ahead - behind) / (2 * _STEP)
            change[:, :, i, j] = np.stack([slope[:, a, b] for a, b in STRESS_PAIRS], axis=1)
    return change


def read_law(material: Block, blocks: Sequence[Block]) -> Law:
    """The law of a ``*MATERIAL`` from the `blocks` after it.

    Raises
    ------
    DeckError
        A material whose stress is not computed here, with its line.
    """
    for block in blocks:
        if block.keyword == "ELASTIC":
            if block.value_of("TYPE") not in ("", "ISO", "ISOTROPIC"):
                raise block.error(f"{block.title}, TYPE={block.value_of('TYPE')}: expected ISO")
            row = next(iter(block.rows()), None)
            if row is None:
                raise block.error(f"{block.title} without data")
            return LinearElastic(row.number(0), row.number(1))
        if block.keyword == "HYPERELASTIC":
            return _hyperelastic(block)
    keywords = ", ".join(block.title for block in blocks) or "nothing"
    problem = f"material {material.value_of('NAME')} has {keywords}, expected *ELASTIC or "
    raise material.error(f"{problem}*HYPERELASTIC for stress at afferents")


def _hyperelastic(block: Block) -> Law:
    options = {option.name for option in block.options}
    order_option = block.option("N")
    order = 1 if order_option is None else int(order_option.normalized or 1)
    constants = list(_constants(block))
    if "OGDEN" in options:
        count = 2 * order
        terms = tuple(zip(constants[:count:2], constants[1:count:2], strict=True))
        law_terms, volume = terms, constants[count : count + order]
        shear = sum(mu for mu, _ in terms)
        return Ogden(law_terms, _volume(volume, shear))
    for name, pairs in _POLYNOMIALS.items():
        if name in options:
            powers: tuple[tuple[int, int], ...] = pairs
            break
    else:
        if "REDUCEDPOLYNOMIAL" in options:
            powers = tuple((i, 0) for i in range(1, order + 1))
        elif "POLYNOMIAL" in options or not options - {"N"}:
            powers = tuple((k - j, j) for k in range(1, order + 1) for j in range(k + 1))
        else:
            raise block.error(f"{block.title}, {', '.join(sorted(options))} is not linearised")
    if len(constants) < len(powers):
        raise block.error(f"{len(constants)} constants, expected {len(powers)} and volume terms")
    polynomial = tuple((i, j, c) for (i, j), c in zip(powers, constants, strict=False))
    shear = 2 * sum(c for i, j, c in polynomial if i + j == 1)
    orders = max(i + j for i, j in powers)
    return Polynomial(polynomial, _volume(constants[len(powers) :][:orders], shear))


def _constants(block: Block) -> Iterator[float]:
    for row in block.rows():
        for column, text in enumerate(row.fields[:_CONSTANTS_PER_ROW]):
            if text:
                yield row.number(column)


def _volume(volume: Sequence[float], shear: float) -> tuple[float, ...]:
    """Volume terms; without any, those of `_DEFAULT_POISSON`."""
    if any(constant > 0 for constant in volume):
        return tuple(volume)
    if shear <= 0:
        raise DeckError(f"a hyperelastic law of shear modulus {shear:g}")
    bulk = 2 * shear * (1 + _DEFAULT_POISSON) / (3 * (1 - 2 * _DEFAULT_POISSON))
    return (2 / bulk,)
