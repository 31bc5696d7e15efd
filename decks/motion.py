"""The motion of the probe, increment by increment, with the approach to the pre-indentation.

If stress depends on depth only, equal increments of one step suffice. If the skin relaxes,
the probe is first ramped in statically and held until the skin has relaxed; then the waveform
begins. With inertia, the ramp is smooth and in the same step, and increments are half a sample
long: the error of the force was an eighth with whole samples and a sixtieth with half (100 Hz).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fembridge.errors import DeckError
from fembridge.stimulus import Stimulus
from fembridge.typing import FloatArray

# Increments of the ramp to a pre-indentation.
RAMP_INCREMENTS = 20
# A hold has few long increments: solvers relax by backward Euler, which leaves 1/(1 + 5) of a
# branch in each of them, after four 0.8 per thousand.
HOLD_INCREMENTS = 4
_HOLD_TIME_CONSTANTS = 5.0
# An increment is at most so many of the shortest time constant: ccx 2.20 converged at 500 of 1 ms
# and diverged at 5000. A hold for a much longer constant then has more increments.
_MOST_SHORTEST = 400.0
# With inertia: samples of the smooth ramp, and increments per sample.
SMOOTH_RAMP = 40
SUBSTEPS = 2
_MM_PER_UM = 1.0e-3
# Tolerance: depths are written to a picometre.
_SAME_UM = 1.0e-6
_S_PER_MS = 1.0e-3


@dataclass(frozen=True, slots=True)
class Phase:
    """A step of the solver: equal increments of `dt_s`.

    `procedure` is ``static``, ``viscous`` or ``dynamic``. A sample is `sample_increments` long;
    results are written at each sample.
    """

    procedure: str
    dt_s: float
    increments: int
    sample_increments: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """The motion of the probe: `depth_mm` ``(T,)`` at the solver times `time_s` ``(T,)``.

    `phases` are the solver's steps, with one increment for each interval of `time_s`. The first
    `ramp` increments lead to the pre-indentation; then samples of the stimulus follow every
    `dt_s`, one or two increments of the last phase each. A base deck has its own steps and
    ignores `phases`. `aside_mm` ``(T,)`` is the displacement along x, None without sliding.
    """

    time_s: FloatArray
    depth_mm: FloatArray
    dt_s: float
    ramp: int
    phases: tuple[Phase, ...] = ()
    aside_mm: FloatArray | None = None

    @property
    def increments(self) -> int:
        """Number of increments the solver takes."""
        return len(self.time_s) - 1

    @property
    def start_s(self) -> float:
        """Solver time at which the stimulus begins."""
        return float(self.time_s[self.ramp])


def motion_of(
    stimulus: Stimulus, procedure: str = "static", relaxing_s: Sequence[float] = ()
) -> Motion:
    """The motion of `stimulus`, with the approach to its pre-indentation before it.

    `relaxing_s` are the time constants of the skin in s, none without relaxation; the probe is
    held at the pre-indentation until the slowest branch has relaxed.

    Raises
    ------
    DeckError
        The first sample is not the pre-indentation: the probe would jump.
    """
    start_um = float(stimulus.displacement_um[0])
    if abs(start_um - stimulus.preindent_um) > _SAME_UM:
        raise DeckError(
            f"{stimulus.id} begins at {start_um:g} um, expected {stimulus.preindent_um:g} um, the "
            "depth of the probe before time 0",
            found=start_um,
            expected=f"{stimulus.preindent_um:g} um",
        )
    dt_s = stimulus.dt_ms * _S_PER_MS
    ramp = RAMP_INCREMENTS if stimulus.preindent_um > 0 else 0
    depth_mm = stimulus.displacement_um * _MM_PER_UM
    aside_mm = None if stimulus.aside_um is None else stimulus.aside_um * _MM_PER_UM
    if procedure == "dynamic":
        return _dynamic_motion(depth_mm, aside_mm, dt_s, SMOOTH_RAMP if ramp else 0)
    way_mm = np.linspace(0.0, depth_mm[0], ramp + 1)[:-1]
    samples = len(depth_mm) - 1
    if procedure == "static":
        time_s = np.arange(ramp + samples + 1, dtype=np.float64) * dt_s
        phases: tuple[Phase, ...] = (Phase(procedure, dt_s, ramp + samples),)
    else:
        # A static ramp, a hold of relaxing skin, and the waveform.
        hold = _hold(relaxing_s) if ramp and len(relaxing_s) else ()
        stages = (Phase("static", dt_s, ramp), *hold, Phase(procedure, dt_s, samples))
        phases = tuple(phase for phase in stages if phase.increments)
        steps_s = [np.full(phase.increments, phase.dt_s) for phase in phases]
        time_s = np.concatenate([[0.0], np.cumsum(np.concatenate(steps_s))])
    before = len(time_s) - 1 - samples
    held_mm = np.full(before - ramp, depth_mm[0])
    if aside_mm is not None:
        aside_mm = np.concatenate([np.zeros(before), aside_mm])
    return Motion(
        time_s, np.concatenate([way_mm, held_mm, depth_mm]), dt_s, before, phases, aside_mm
    )


def _hold(relaxing_s: Sequence[float]) -> tuple[Phase, ...]:
    """The hold after which the slowest branch has relaxed as after `HOLD_INCREMENTS` long ones."""
    longest_s = max(relaxing_s)
    step_s = min(_HOLD_TIME_CONSTANTS * longest_s, _MOST_SHORTEST * min(relaxing_s))
    relaxed = HOLD_INCREMENTS * math.log1p(_HOLD_TIME_CONSTANTS)
    increments = math.ceil(relaxed / math.log1p(step_s / longest_s) - 1e-9)
    return (Phase("viscous", step_s, increments),)


def _dynamic_motion(
    depth_mm: FloatArray, aside_mm: FloatArray | None, dt_s: float, ramp: int
) -> Motion:
    """One dynamic step: a smooth ramp, then the waveform, in increments of half a sample."""
    share = 0.5 * (1 - np.cos(np.pi * np.arange(ramp) / SMOOTH_RAMP))
    ramp_mm = np.concatenate([share * depth_mm[0], depth_mm[:1]])
    fine_mm = np.concatenate([_halve_steps(ramp_mm)[:-1], _halve_steps(depth_mm)])
    if aside_mm is not None:
        aside_mm = np.concatenate([np.zeros(SUBSTEPS * ramp), _halve_steps(aside_mm)])
    fine_s, count = dt_s / SUBSTEPS, len(fine_mm)
    time_s = np.arange(count, dtype=np.float64) * fine_s
    steps = (Phase("dynamic", fine_s, count - 1, SUBSTEPS),)
    return Motion(time_s, fine_mm, dt_s, SUBSTEPS * ramp, steps, aside_mm)


def _halve_steps(samples: FloatArray) -> FloatArray:
    """Samples at half the time step: each new one is on the cubic through four neighbours.

    Linear interpolation would change the speed of the probe at each sample. Beyond both ends
    the samples are extrapolated linearly.
    """
    if len(samples) == 1:
        return samples
    first, last = 2 * samples[:1] - samples[1:2], 2 * samples[-1:] - samples[-2:-1]
    ends = np.concatenate([first, samples, last])
    middle = (9 * (ends[1:-2] + ends[2:-1]) - ends[:-3] - ends[3:]) / 16
    fine = np.empty(2 * len(samples) - 1)
    fine[::2], fine[1::2] = samples, middle
    return fine
