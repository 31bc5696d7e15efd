"""The response map: stress at each afferent against depth of the probe."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from fembridge.errors import ResponseError
from fembridge.results.stress import TENSOR, von_mises_pa
from fembridge.run_folder import AfferentNode
from fembridge.stimulus import Stimulus
from fembridge.trace import StressTrace
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator

# Components of a tensor that plane strain has: xx, yy, zz, xy.
IN_PLANE = 4


@dataclass(frozen=True, slots=True, eq=False)
class ResponseMap:
    """Stress tensors `tensor_pa` ``(K, afferent, 6)`` at `depth_um` ``(K,)``.

    Depths ascend from 0, where stress is 0; a probe that is lifted off leaves the
    skin at rest. Plane strain: the shears yz and zx are 0 throughout.
    `force_n_per_mm` ``(K,)`` is the force of the skin on the probe.
    `closure_percent` is what the load–unload run showed, NaN where none was
    compared; `origin` tells what the map was made from.

    Raises
    ------
    ResponseError
        Shapes that do not belong together, depths that do not ascend from 0, stress
        that plane strain has not.
    """

    depth_um: FloatArray
    tensor_pa: FloatArray
    force_n_per_mm: FloatArray
    places: tuple[AfferentNode, ...]
    closure_percent: float
    origin: Mapping[str, object] = field(default_factory=dict)
    _curve: "PchipInterpolator | None" = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("depth_um", "tensor_pa", "force_n_per_mm"):
            array = np.array(getattr(self, name), dtype=np.float64)
            if not np.isfinite(array).all():
                raise ResponseError(f"response map: {name} is not finite everywhere")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if self.closure_percent < 0:
            raise ResponseError(
                f"response map: closure_percent is {self.closure_percent}, expected 0 or more"
            )
        count = self.depth_um.size
        expected = (count, len(self.places), len(TENSOR))
        if self.tensor_pa.shape != expected or self.force_n_per_mm.shape != (count,):
            raise ResponseError(
                f"response map: tensors {self.tensor_pa.shape} and forces "
                f"{self.force_n_per_mm.shape}, expected {expected} and ({count},)"
            )
        if not self.places:
            raise ResponseError("response map: no afferent, expected one or more")
        if self.depth_um.ndim != 1:
            raise ResponseError(f"response map: depths {self.depth_um.shape}, expected (K,)")
        if count < 3 or self.depth_um[0] != 0 or not (np.diff(self.depth_um) > 0).all():
            raise ResponseError("response map: expected three or more depths, ascending from 0")
        if self.tensor_pa[0].any():
            raise ResponseError("response map: expected no stress at depth 0")
        if self.tensor_pa[..., IN_PLANE:].any():
            raise ResponseError("response map: expected no out-of-plane shear")

    @property
    def deepest_um(self) -> float:
        """How deep a stimulus may go."""
        return float(self.depth_um[-1])

    def traces(self, stimulus: Stimulus) -> list[StressTrace]:
        """Von Mises stress at each afferent while the probe follows `stimulus`.

        The tensor's components are interpolated (PCHIP: no overshoot between two
        depths), then von Mises stress is taken, so that it fits the tensor.

        Raises
        ------
        ResponseError
            The stimulus goes deeper than the map.
        """
        stress_pa = von_mises_pa(self.tensors(stimulus.displacement_um, stimulus.id))
        return [
            StressTrace(column, stimulus.dt_ms, place.node, place.afferent)
            for place, column in zip(self.places, stress_pa.T, strict=True)
        ]

    def tensors(self, displacement_um: FloatArray, name: str = "probe") -> FloatArray:
        """Stress tensors ``(T, afferent, 6)`` in Pa at probe depths ``(T,)``.

        Raises
        ------
        ResponseError
            A depth that is not finite, or deeper than the map.
        """
        if not np.isfinite(displacement_um).all():
            raise ResponseError(f"{name}: a probe depth is not finite")
        deepest_um = float(displacement_um.max())
        if deepest_um > self.deepest_um:
            raise ResponseError(
                f"{name} goes {deepest_um:.9g} um deep, the response map reaches "
                f"{self.deepest_um:g} um"
            )
        tensor_pa: FloatArray = self._interpolator()(np.maximum(displacement_um, 0.0))
        return tensor_pa

    def _interpolator(self) -> "PchipInterpolator":
        """Make it when a first stimulus asks: SciPy is slow to import."""
        if self._curve is None:
            from scipy.interpolate import PchipInterpolator

            curve = PchipInterpolator(self.depth_um, self.tensor_pa, axis=0)
            object.__setattr__(self, "_curve", curve)
        return self._curve
