"""The waveform of a probe on the skin: what a deck prescribes and a map answers."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from fembridge.errors import StimulusError
from fembridge.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Stimulus:
    """Displacement of the probe over time, in even steps from time 0.

    Parameters
    ----------
    id
        Name of the stimulus in tables, and of its run folder.
    displacement_um
        Depth of the probe in um, ``(T,)``, T at least 2. Positive is into the skin, 0 is first
        touch; the depth before time 0 is included.
    dt_ms
        Time step in ms, more than 0.
    window_ms
        Start and end in ms of the window in which spikes count, the start excluded.
    preindent_um
        Depth of the probe in um before time 0; the first sample has the same depth.
        Default: 0.
    origin
        How the samples were made: family, frequencies, amplitudes, seed. Default: empty.
    aside_um
        Displacement of the probe across the finger in um, along the skin, ``(T,)`` from 0 on.
        Default: None, the probe does not slide.

    Raises
    ------
    StimulusError
        Samples that are not finite or not ``(T,)``, or a window outside the samples.

    Examples
    --------
    >>> import numpy as np
    >>> import fembridge as fb
    >>> ramp_um = np.minimum(np.arange(401), 200.0)
    >>> fb.Stimulus("ramp", ramp_um, dt_ms=0.5, window_ms=(0, 200))
    Stimulus('ramp', 401 samples every 0.5 ms, 0 to 200 um)
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
            problem = (
                f"of {self.id} has shape {depth.shape}, expected (T,) with two or more samples"
            )
            raise StimulusError(problem, argument="displacement_um", found=depth.shape)
        bad = np.flatnonzero(~np.isfinite(depth))
        if bad.size:
            problem = f"of {self.id} is {depth[bad[0]]} at sample {bad[0]}"
            raise StimulusError(problem, argument="displacement_um", found=float(depth[bad[0]]))
        if not (np.isfinite(self.dt_ms) and self.dt_ms > 0):
            raise StimulusError(argument="dt_ms", found=self.dt_ms, expected="more than 0")
        if np.shape(self.window_ms) != (2,):
            raise StimulusError(
                argument="window_ms", found=self.window_ms, expected="a pair (start, end)"
            )
        start, end = self.window_ms
        if not 0 <= start < end <= (depth.size - 1) * self.dt_ms + 1e-9:
            expected = f"inside 0 to {(depth.size - 1) * self.dt_ms:g} ms"
            raise StimulusError(
                f"of {self.id} is {start:g} to {end:g} ms, expected {expected}",
                argument="window_ms",
                found=(start, end),
                expected=expected,
            )
        if not (np.isfinite(self.preindent_um) and self.preindent_um >= 0):
            raise StimulusError(
                argument="preindent_um", found=self.preindent_um, expected="0 or more"
            )
        depth.flags.writeable = False
        object.__setattr__(self, "displacement_um", depth)
        if self.aside_um is not None:
            aside = np.array(self.aside_um, dtype=np.float64)
            if aside.shape != depth.shape or not np.isfinite(aside).all() or aside[0] != 0:
                expected = f"{depth.shape} finite numbers that begin at 0"
                raise StimulusError(
                    f"of {self.id} has shape {aside.shape}, expected {expected}",
                    argument="aside_um",
                    found=aside.shape,
                    expected=expected,
                )
            aside.flags.writeable = False
            object.__setattr__(self, "aside_um", aside)
        object.__setattr__(self, "origin", dict(self.origin))

    def _error(self, argument: str, finding: str, expected: str) -> StimulusError:
        return StimulusError(
            f"of {self.id} {finding}, expected {expected}",
            argument=argument,
            found=getattr(self, argument),
            expected=expected,
        )

    def __repr__(self) -> str:
        samples = self.displacement_um
        return (
            f"Stimulus({self.id!r}, {samples.size} samples every {self.dt_ms:g} ms, "
            f"{samples.min():g} to {samples.max():g} um)"
        )

    def sliding(self, slide_mm_per_s: float) -> "Stimulus":
        """The same stimulus while the probe also slides along x from time 0 on.

        Parameters
        ----------
        slide_mm_per_s
            Speed in mm/s across the finger, negative to the left.

        Raises
        ------
        StimulusError
            A speed that is 0 or not finite.
        """
        if not (np.isfinite(slide_mm_per_s) and slide_mm_per_s):
            raise StimulusError(
                argument="slide_mm_per_s",
                found=slide_mm_per_s,
                expected="a finite number other than 0",
            )
        return replace(
            self,
            id=f"{self.id}_slide_{slide_mm_per_s:g}",
            aside_um=slide_mm_per_s * self.times_ms,  # 1 mm/s is 1 um/ms
            origin={**self.origin, "slide_mm_per_s": float(slide_mm_per_s)},
        )

    @property
    def times_ms(self) -> FloatArray:
        """Time of each sample, ``(T,)`` in ms."""
        steps: FloatArray = np.arange(self.displacement_um.size, dtype=np.float64)
        return steps * self.dt_ms

    @property
    def deepest_um(self) -> float:
        """Largest depth of the probe in um."""
        return float(self.displacement_um.max())
