"""A relaxing pad: force falls at a depth that is kept, depth grows under a force that is kept.

A pad has the instantaneous moduli of its finger. All of the skin then relaxes by one function,

    g(t) = 1 - sum g_k (1 - exp(-t / tau_k)),

so that displacement and force obey superposition in time (Lee & Radok 1960)::

    w(t) = C P(t),    f(t) = integral of g(t - s) dP(s)

C is the pad's compliance. P are the forces that would give the same displacement at once, f the
forces themselves: contact is ``f >= 0`` and ``w`` no less than where the shape is. Stress in a
layer is the elastic stress of ``integral of h(t - s) dP(s)``, with a function h of that layer: in
an epidermis that does not relax it falls less than the force does, in the tissue more.

P is even between two samples, so that each exponential is exact, as are the Maxwell branches of
`decks.calculix`. In a step f is ``share P + remembered``, where the second part is known from
the past; the remainder to solve is the contact of a shape whose gaps are larger by
``C remembered / share``. Skin that a shape has left keeps its dent and recovers.

The layers of a finger relax each in its own way. `shared_relaxation` finds g and h from the
section in plane strain under a flat pin of 1 mm, with the moduli of each time: g is its
stiffness, h the von Mises stress where afferents sit.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from decks.finger import LAYERS, Finger, Material, PronyTerm
from decks.unit_loads import PadMesh, Prism, prism_of, smooth
from fembridge.errors import UsageError
from fembridge.solver.analysis import load_finger
from fembridge.touching.contact import ContactSolver
from fembridge.touching.pad import Pad
from fembridge.touching.prism_pad import PrismPad
from fembridge.typing import FloatArray, IntArray, SingleArray, Table

if TYPE_CHECKING:
    from scipy.sparse import csc_array

    from fembridge.touching.grid_contact import GridContactSolver

_LOGGER = logging.getLogger(__name__)

_MS_PER_S = 1.0e3
# The pin of `shared_relaxation`, and the grid under it.
_PIN_MM = 1.0
_GRID = PadMesh(spacing_mm=0.125, reach_mm=1.0, plane=True)
# Times at which the section's stiffness is solved, around all time constants.
_TIMES, _BEFORE, _AFTER = 60, 0.05, 20.0
_FORCE = "force"
_SAME = 1e-9  # relative difference of two moduli
_GAUSS = 1 / np.sqrt(3)
_QUAD = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Relaxation:
    """The function by which all of the skin relaxes.

    Parameters
    ----------
    g
        Shares of the instantaneous stiffness, ``(K,)``, with a sum below 1.
    tau_ms
        Their time constants in ms, ``(K,)``.
    layers
        By layer, shares of the stress at a displacement that is kept, ``(K,)``; negative where
        stress grows. Default: none, stress relaxes as the force does.
    """

    g: FloatArray
    tau_ms: FloatArray
    layers: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def lasting_share(self) -> float:
        """Share of the stiffness that does not relax."""
        return float(1 - self.g.sum())

    def at(self, time_ms: FloatArray) -> FloatArray:
        """Stiffness at times after a step in ms, as a share of the instantaneous one."""
        relaxed = -np.expm1(-np.asarray(time_ms)[..., None] / self.tau_ms)
        left: FloatArray = 1 - relaxed @ self.g
        return left

    def to_table(self) -> Table:
        """Shares and time constants, for a record."""
        layers = {layer: shares.tolist() for layer, shares in self.layers.items()}
        return {"g": self.g.tolist(), "tau_ms": self.tau_ms.tolist(), "layers": layers}

    @classmethod
    def from_table(cls, table: Table) -> "Relaxation":
        """The function of a record that `to_table` made."""
        layers = {layer: np.array(shares) for layer, shares in table["layers"].items()}
        return cls(np.array(table["g"]), np.array(table["tau_ms"]), layers)

    def layer_forces_n(
        self, forces_n: FloatArray | SingleArray, dt_ms: float, *, rested: bool
    ) -> dict[str, SingleArray]:
        """Forces ``(S, node)`` whose elastic stress is that in each of `layers`.

        `forces_n` ``(S, node)`` are those on the skin every `dt_ms`; `rested` is whether the
        skin has rested under the first ones for long.
        """
        step = dt_ms / self.tau_ms
        fade, rise = np.exp(-step)[:, None], (-np.expm1(-step) / step)[:, None]
        share = self.lasting_share + float(self.g @ rise[:, 0])
        first = self.lasting_share if rested else 1.0
        at_once = np.asarray(forces_n[0], dtype=np.float64) / first
        fading = np.zeros((self.g.size, 1)) if rested else np.ones((self.g.size, 1))
        fading = fading * at_once
        by_layer = {layer: np.empty(forces_n.shape, dtype=np.float32) for layer in self.layers}
        for sample, force_n in enumerate(forces_n):
            if sample:
                faded = fade * fading - rise * at_once
                at_once = (force_n - self.g @ faded) / share
                fading = faded + rise * at_once
            for layer, shares in self.layers.items():
                by_layer[layer][sample] = (1 - shares.sum()) * at_once + shares @ fading
        return by_layer


class RelaxingContact:
    """Contact of `solver` over time, on skin that relaxes; one `press_by` a sample of `dt_ms`.

    `rested` is whether the skin has rested at the first level for long before it.
    """

    def __init__(
        self,
        solver: "ContactSolver | GridContactSolver",
        relaxation: Relaxation,
        dt_ms: float,
        *,
        rested: bool,
    ) -> None:
        self._solver, self._relaxation = solver, relaxation
        step = dt_ms / relaxation.tau_ms
        self._fade = np.exp(-step)
        self._rise = relaxation.g * -np.expm1(-step) / step
        self._share = relaxation.lasting_share + self._rise.sum()
        self._rested = rested
        # Of each term, the part of the forces that still fades; and P.
        self._fading: FloatArray | None = None
        self._at_once = np.zeros(0)

    def press_by(
        self, gap_mm: FloatArray, level: float, *, by_force: bool
    ) -> tuple[FloatArray, float]:
        """Forces ``(n,)`` in N and depth in mm, as those of `ContactSolver.press_by`."""
        relaxation = self._relaxation
        if self._fading is None:
            share = relaxation.lasting_share if self._rested else 1.0
            scaled_n, depth_mm = self._solver.press_by(
                gap_mm, level / share if by_force else level, by_force=by_force
            )
            self._at_once = scaled_n
            first = np.zeros_like(relaxation.g) if self._rested else relaxation.g
            self._fading = first[:, None] * scaled_n
            return share * scaled_n, depth_mm
        faded = self._fade[:, None] * self._fading
        remembered = (faded - self._rise[:, None] * self._at_once).sum(axis=0)
        scaled = remembered / self._share
        farther_mm = self._solver.moved_mm(scaled)
        gap_in_dent_mm = gap_mm - farther_mm
        if by_force and level <= 0:  # the shape rests on the dent that it left
            scaled_n = np.zeros(gap_mm.size)
            depth_mm = max(float(gap_in_dent_mm.min() - gap_mm.min()), 0.0)
        elif by_force:
            scaled_n, depth_mm = self._solver.press_with(gap_in_dent_mm, level / self._share)
        else:
            scaled_n, depth_mm = self._solver.press_by(gap_in_dent_mm, level, by_force=False)
        at_once = scaled_n - scaled
        self._fading = faded + self._rise[:, None] * (at_once - self._at_once)
        self._at_once = at_once
        return self._share * scaled_n, depth_mm


def relaxation_of(pad: Pad) -> Relaxation | None:
    """The function by which `pad` relaxes; None if its finger does not, or for any mesh."""
    if not isinstance(pad, PrismPad) or not pad.finger.relaxing_s:
        return None
    return shared_relaxation(pad.finger)


def relaxing_pad(pad: Pad, finger: str | Path | Finger) -> Pad:
    """`pad` with the Prony terms of `finger`, which has the same instantaneous moduli.

    Raises
    ------
    UsageError
        A pad of a mesh, or sizes or instantaneous moduli of the finger that are not those of the
        pad.
    """
    pad = _checked_prism(pad)
    skin = load_finger(str(finger) if isinstance(finger, Path) else finger)
    for name in ("outline", "skin", "bone", "nail"):
        if getattr(skin, name) != getattr(pad.finger, name):
            raise UsageError(
                f"differs from the pad's finger in [{name}]: expected the finger of the pad, with "
                "Prony terms; `fembridge pad` makes the pad of another",
                argument="finger",
                found=skin.name,
            )
    materials = {}
    for layer in LAYERS:
        ours, theirs = skin.materials[layer], pad.finger.materials[layer]
        if not np.allclose(ours.engineering_constants, theirs.engineering_constants, rtol=_SAME):
            raise UsageError(
                f"differs from the pad's finger in [materials.{layer}]: expected its instantaneous "
                f"moduli, young_mpa = {theirs.young_mpa:g}, poisson = {theirs.poisson:g}",
                argument="finger",
                found=skin.name,
            )
        materials[layer] = replace(theirs, prony=ours.prony)
    return _with_materials(pad, materials)


def pad_with_prony(pad: Pad, prony: Mapping[str, Sequence[Mapping[str, float]]]) -> Pad:
    """`pad` with the Prony terms of a record, by layer; see `prony_table`.

    Raises
    ------
    UsageError
        A pad of a mesh.
    """
    pad = _checked_prism(pad)
    materials = {
        layer: replace(material, prony=tuple(PronyTerm(**term) for term in prony.get(layer, ())))
        for layer, material in pad.finger.materials.items()
    }
    return _with_materials(pad, materials)


def prony_table(finger: Finger) -> Table:
    """Prony terms by layer, for a record."""
    return {
        layer: [{"g": term.g, "tau_s": term.tau_s} for term in material.prony]
        for layer, material in finger.materials.items()
        if material.prony
    }


def _checked_prism(pad: Pad) -> PrismPad:
    """`pad`, which must be that of a finger."""
    if not isinstance(pad, PrismPad):
        raise UsageError("is for the pad of a finger, not of a mesh", argument="finger")
    return pad


def _with_materials(pad: PrismPad, materials: Mapping[str, Material]) -> Pad:
    return replace(pad, finger=replace(pad.finger, materials=materials))


@lru_cache(maxsize=8)
def _relaxation_of_section(key: "_Key") -> Relaxation:
    finger = key.finger
    terms = [term for material in finger.materials.values() for term in material.prony]
    tau_s = np.unique([term.tau_s for term in terms])
    time_s = np.geomspace(_BEFORE * tau_s[0], _AFTER * tau_s[-1], _TIMES)
    section = _Section(prism_of(smooth(finger.at_once()), _GRID))
    solved = [section.solve(_shear_mpa(finger, at_s)) for at_s in (0.0, *time_s.tolist())]
    names = list(solved[0])
    left = np.array([[values[name] for name in names] for values in solved])
    lost = 1 - left[1:] / left[0]
    relaxed = -np.expm1(-time_s[:, None] / tau_s)
    from scipy.optimize import nnls

    shares = {name: np.linalg.lstsq(relaxed, lost[:, n])[0] for n, name in enumerate(names)}
    shares[_FORCE], _ = nnls(relaxed, lost[:, names.index(_FORCE)])
    error = max(
        float(np.abs(relaxed @ shares[name] - lost[:, n]).max()) for n, name in enumerate(names)
    )
    g = shares.pop(_FORCE)
    parts = ", ".join(
        f"{share:.3g} at {1e3 * tau:g} ms" for share, tau in zip(g, tau_s, strict=True)
    )
    _LOGGER.info(f"relaxation of the skin: {parts}; fitted within {100 * error:.2g} %")
    return Relaxation(g, _MS_PER_S * tau_s, shares)


@dataclass(frozen=True, slots=True, eq=False)
class _Key:
    """A finger as a key of a cache: by its text, since its materials are a dict."""

    finger: Finger

    def __hash__(self) -> int:
        return hash(repr(self.finger))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self.finger == other.finger


def shared_relaxation(finger: Finger) -> Relaxation:
    """The function by which the skin of `finger` relaxes, and those of stress in its layers.

    Notes
    -----
    The section in plane strain, its bone and the outer side of its nail fixed, under a flat pin
    of 1 mm without friction. It is solved with the shear moduli of 60 times (the bulk moduli do
    not relax), and Prony series with the time constants of the layers are fitted to its
    stiffness and to the von Mises stress in the elements where afferents sit.
    """
    return _relaxation_of_section(_Key(finger))


def _shear_mpa(finger: Finger, time_s: float) -> FloatArray:
    """Shear modulus of each layer of `LAYERS`, so long after a step."""
    return np.array(
        [
            material.shear_mpa
            * (1 + sum(term.g * np.expm1(-time_s / term.tau_s) for term in material.prony))
            for material in (finger.materials[layer] for layer in LAYERS)
        ]
    )


class _Section:
    """Half a section in plane strain, four-node elements; volume change at their middle."""

    def __init__(self, prism: Prism) -> None:
        rows, columns, _ = prism.point_mm.shape
        number = np.arange(rows * columns).reshape(rows, columns)
        quad = np.stack(
            [number[1:, :-1], number[1:, 1:], number[:-1, 1:], number[:-1, :-1]], -1
        ).reshape(-1, 4)
        layer = np.repeat(prism.row_layer[:, None], columns - 1, axis=1)
        corneum = layer == LAYERS.index("stratum_corneum")
        corneum[:, : prism.nail_column] = False
        layer[corneum] = LAYERS.index("nail")
        point_mm = prism.point_mm.reshape(-1, 2)
        bulk_mpa = np.array([prism.finger.materials[name].bulk_mpa for name in LAYERS])
        shape, volume = _element_matrices(point_mm[quad])
        degree = (2 * quad[:, :, None] + np.arange(2)).reshape(-1, 8)
        size = 2 * point_mm.shape[0]
        self._shape = [
            _assembled(shape[layer.ravel() == n], degree[layer.ravel() == n], size)
            for n in range(len(LAYERS))
        ]
        self._volume = _assembled(bulk_mpa[layer.ravel()][:, None, None] * volume, degree, size)
        bone, outside = number[-1], number[0, prism.nail_column :]
        fixed = 2 * np.concatenate([bone, outside])
        axis = 2 * np.concatenate([number[:, 0], number[:, -1]])
        surface = number[0, : prism.contact_columns]
        self._pressed = 2 * surface[point_mm[surface, 0] <= 0.5 * _PIN_MM + 1e-9] + 1
        self._sites = _site_elements(prism, point_mm[quad].mean(axis=1), layer.ravel())
        self._strain = _strain(point_mm[quad], 0.0, 0.0)[0]
        self._degree, self._layer = degree, layer.ravel()
        self._free = np.setdiff1d(
            np.arange(size), np.concatenate([fixed, fixed + 1, axis, self._pressed])
        )

    def solve(self, shear_mpa: FloatArray) -> dict[str, float]:
        """Force per depth, and by layer von Mises stress per depth, but for a constant factor."""
        from scipy.sparse.linalg import spsolve

        matrix = self._volume
        for modulus, part in zip(shear_mpa.tolist(), self._shape, strict=True):
            matrix = matrix + modulus * part
        moved = np.zeros(matrix.shape[0])
        moved[self._pressed] = -1.0
        force = -(matrix @ moved)[self._free]
        moved[self._free] = spsolve(matrix[self._free][:, self._free].tocsc(), force)
        values = {_FORCE: float(-(matrix @ moved)[self._pressed].sum())}
        for layer, elements in self._sites.items():
            strain = np.einsum("eia,ea->ei", self._strain[elements], moved[self._degree[elements]])
            normal = strain[:, :3] - strain[:, :3].mean(axis=1, keepdims=True)
            squared = (normal**2).sum(axis=1) + 0.5 * strain[:, 3] ** 2
            stress = shear_mpa[self._layer[elements]] * np.sqrt(squared)
            values[layer] = float(stress.mean())
        return values


def _site_elements(prism: Prism, middle_mm: FloatArray, layer: IntArray) -> dict[str, list[int]]:
    """By layer, the elements of it that are nearest to its afferents."""
    nearest: dict[str, list[int]] = {}
    for site in prism.finger.afferents.values():
        away_mm = np.linalg.norm(middle_mm - [site.x_mm, -site.depth_mm], axis=1)
        away_mm[layer != LAYERS.index(site.layer)] = np.inf
        nearest.setdefault(site.layer, []).append(int(away_mm.argmin()))
    return nearest


def _element_matrices(corner_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Stiffness ``(E, 8, 8)`` per shear modulus, and per bulk modulus."""
    deviator = np.eye(4) - np.array([1, 1, 1, 0])[:, None] * np.array([1, 1, 1, 0]) / 3
    per_shear = 2 * deviator * np.array([1, 1, 1, 0.5])
    middle, area_mm2 = _strain(corner_mm, 0.0, 0.0)
    dilatation = middle[:, :3].sum(axis=1)
    volume = 4 * area_mm2[:, None, None] * dilatation[:, :, None] * dilatation[:, None, :]
    shape = np.zeros_like(volume)
    for s in (-_GAUSS, _GAUSS):
        for t in (-_GAUSS, _GAUSS):
            strain, weight_mm2 = _strain(corner_mm, s, t)
            shape += weight_mm2[:, None, None] * np.einsum(
                "eia,ij,ejb->eab", strain, per_shear, strain
            )
    return shape, volume


def _strain(corner_mm: FloatArray, s: float, t: float) -> tuple[FloatArray, FloatArray]:
    """Strain xx, yy, zz, 2 xy of each displacement ``(E, 4, 8)``, and area per unit square."""
    slope = 0.25 * np.stack(
        [_QUAD[:, 0] * (1 + t * _QUAD[:, 1]), _QUAD[:, 1] * (1 + s * _QUAD[:, 0])], -1
    )
    jacobian = np.einsum("ka,ekb->eab", slope, corner_mm)
    across = np.einsum("eba,ka->ekb", np.linalg.inv(jacobian), slope)
    strain = np.zeros((len(corner_mm), 4, 8))
    strain[:, 0, 0::2] = across[..., 0]
    strain[:, 1, 1::2] = across[..., 1]
    strain[:, 3, 0::2] = across[..., 1]
    strain[:, 3, 1::2] = across[..., 0]
    return strain, np.linalg.det(jacobian)


def _assembled(matrices: FloatArray, degree: IntArray, size: int) -> "csc_array":
    from scipy.sparse import coo_array

    rows, columns = np.repeat(degree, 8, axis=1).ravel(), np.tile(degree, 8).ravel()
    return coo_array((matrices.ravel(), (rows, columns)), shape=(size, size)).tocsc()
