"""The profile of the skin's surface under a probe that was pressed in."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fembridge.errors import ResponseError
from fembridge.typing import FloatArray

# Ishizuka et al., 3.1: "the deflection of the skin surface was obtained with an
# interval of 0.5 mm".
PAPER_STEP_MM = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Deflection:
    """How far the skin went down, `deflection_mm` ``(N,)`` at `distance_mm` ``(N,)``.

    Both are of points of the skin: the distance is the one from the probe's middle,
    across the finger, before anything moved; down is into the finger. Distances
    ascend from 0. The probe stands `depth_mm` below its first touch. On its way it
    met `loading_n_per_mm` ``(K,)`` at `loading_mm` ``(K,)``, from 0 to `depth_mm`.
    `elements` are those of the mesh called `name`; `origin` tells what it was made
    from.

    Raises
    ------
    ResponseError
        Shapes that do not belong together, what is not finite, distances or depths
        that do not ascend from 0.
    """

    name: str
    elements: int
    distance_mm: FloatArray
    deflection_mm: FloatArray
    depth_mm: float
    loading_mm: FloatArray
    loading_n_per_mm: FloatArray
    origin: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for along, value in (("distance_mm", "deflection_mm"), ("loading_mm", "loading_n_per_mm")):
            self._check(along, value)
        if self.elements < 1:
            raise ResponseError(f"{self.name}: {self.elements} elements, expected 1 or more")
        if not self.depth_mm > 0 or self.loading_mm[-1] != self.depth_mm:
            raise ResponseError(
                f"{self.name}: loading ends at {self.loading_mm[-1]:g} mm, expected "
                f"the depth, {self.depth_mm:g} mm, which is more than 0"
            )
        object.__setattr__(self, "origin", dict(self.origin))

    @property
    def force_n_per_mm(self) -> float:
        """Force of the skin on the probe at its full depth, per mm of its length."""
        return float(self.loading_n_per_mm[-1])

    def at(self, distance_mm: FloatArray | float) -> FloatArray:
        """Deflection in mm at distances in mm, straight between the skin's nodes.

        Raises
        ------
        ResponseError
            A distance that is negative, or beyond the last that is known.
        """
        wanted_mm = np.asarray(distance_mm, dtype=np.float64)
        last_mm = float(self.distance_mm[-1])
        if not ((wanted_mm >= 0) & (wanted_mm <= last_mm)).all():
            raise ResponseError(
                f"{self.name}: asked for {wanted_mm.min():g} to {wanted_mm.max():g} mm "
                f"from the probe, the profile has 0 to {last_mm:g} mm"
            )
        found: FloatArray = np.asarray(np.interp(wanted_mm, self.distance_mm, self.deflection_mm))
        return found

    def _check(self, along: str, value: str) -> None:
        pair = []
        for name in (along, value):
            array = np.array(getattr(self, name), dtype=np.float64)
            if array.ndim != 1 or array.size < 2 or not np.isfinite(array).all():
                raise ResponseError(
                    f"{self.name}: {name} is {array.shape}, expected two or more "
                    "finite numbers in a row"
                )
            array.flags.writeable = False
            object.__setattr__(self, name, array)
            pair.append(array)
        if pair[0].size != pair[1].size:
            raise ResponseError(
                f"{self.name}: {pair[0].size} of {along} but {pair[1].size} of {value}"
            )
        if pair[0][0] != 0 or not (np.diff(pair[0]) > 0).all():
            raise ResponseError(f"{self.name}: {along} does not ascend from 0")
