"""The waveform of a probe on the skin: what a deck prescribes and a map answers."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from fembridge.errors import StimulusError
from fembridge.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Stimulus:
    """Probe displacement `displacement_um` ``(T,)``, every `dt_ms` from time 0.

    Positive is into the skin, 0 is first touch. `window_ms` is the time in
    which spikes are counted: start excluded, end included. `preindent_um` is
    how deep the probe is before time 0; the samples hold the whole depth,
    so the first of them equals it. `origin` says how the samples were made
    (family, frequencies, amplitudes, seed). `aside_um` ``(T,)`` is the probe's way
    across the finger, along the skin, from where it is before time 0; None, as
    in all stimuli of the paper, where it does not slide.
    """

    id: str
    displacement_um: FloatArray
    dt_ms: float
    window_ms: tuple[float, float]
    preindent_um: float = 0.0
    origin: Mapping[str, object] = field(default_factory=dict)
    aside_um: FloatArray | None = None

    def __post_init__(self) -> None:
        depth = np.array(self.displacement_um, dtype=np.float64)
        if depth.ndim != 1 or depth.size < 2:
            raise StimulusError(f"{self.id}: expected (T,), got {depth.shape}")
        bad = np.flatnonzero(~np.isfinite(depth))
        if bad.size:
            raise StimulusError(f"{self.id}: sample {bad[0]} is {depth[bad[0]]}")
        if not (np.isfinite(self.dt_ms) and self.dt_ms > 0):
            raise StimulusError(f"{self.id}: dt_ms must be > 0, got {self.dt_ms}")
        start, end = self.window_ms
        if not 0 <= start < end <= (depth.size - 1) * self.dt_ms + 1e-9:
            raise StimulusError(
                f"{self.id}: window {start:g} to {end:g} ms is not inside "
                f"0 to {(depth.size - 1) * self.dt_ms:g} ms"
            )
        if not (np.isfinite(self.preindent_um) and self.preindent_um >= 0):
            raise StimulusError(f"{self.id}: preindent_um must be >= 0, got {self.preindent_um}")
        depth.flags.writeable = False
        object.__setattr__(self, "displacement_um", depth)
        if self.aside_um is not None:
            aside = np.array(self.aside_um, dtype=np.float64)
            if aside.shape != depth.shape or not np.isfinite(aside).all() or aside[0] != 0:
                raise StimulusError(
                    f"{self.id}: the way aside must be {depth.shape} finite numbers from 0 on, "
                    f"got {aside.shape}"
                )
            aside.flags.writeable = False
            object.__setattr__(self, "aside_um", aside)
        object.__setattr__(self, "origin", dict(self.origin))

    def __repr__(self) -> str:
        samples = self.displacement_um
        return (
            f"Stimulus({self.id!r}, {samples.size} samples every {self.dt_ms:g} ms, "
            f"{samples.min():g} to {samples.max():g} um)"
        )

    def sliding(self, speed_mm_per_s: float) -> "Stimulus":
        """The same stimulus while the probe also slides along x from time 0 on.

        Raises
        ------
        StimulusError
            A speed that is 0 or not finite.
        """
        if not (np.isfinite(speed_mm_per_s) and speed_mm_per_s):
            raise StimulusError(
                f"{self.id}: slides at {speed_mm_per_s:g} mm/s, expected a speed other than 0"
            )
        return replace(
            self,
            id=f"{self.id}_slide_{speed_mm_per_s:g}",
            aside_um=speed_mm_per_s * self.times_ms,  # 1 mm/s is 1 um/ms
            origin={**self.origin, "slide_mm_per_s": float(speed_mm_per_s)},
        )

    @property
    def times_ms(self) -> FloatArray:
        """Time of each sample, ``(T,)`` in ms."""
        steps: FloatArray = np.arange(self.displacement_um.size, dtype=np.float64)
        return steps * self.dt_ms

    @property
    def deepest_um(self) -> float:
        """How deep the probe goes."""
        return float(self.displacement_um.max())
