"""The probe's way into the skin, increment by increment, and what leads up to it.

Stress that depends on depth alone needs no more than equal increments of one step.
Where the skin relaxes, the probe first takes its place: a static ramp, then a hold
until nothing relaxes any more. Only then the waveform begins. Where inertia counts,
the ramp is a smooth one in the same step, and increments are half a sample long:
with whole ones force was off by an eighth, with half ones by a sixtieth (100 Hz).
"""

from dataclasses import dataclass

import numpy as np

from fembridge.errors import DeckError
from fembridge.stimulus import Stimulus
from fembridge.typing import FloatArray

# A pre-indentation is reached in this many increments before the stimulus.
RAMP_INCREMENTS = 20
# A hold has few long increments: backward Euler, by which solvers relax, leaves
# 1/(1 + 5) of a branch in each of them, together 0.8 per thousand.
HOLD_INCREMENTS = 4
_HOLD_TIME_CONSTANTS = 5.0
# Of a smooth ramp, in samples; and increments to a sample, where inertia counts.
SMOOTH_RAMP = 40
SUBSTEPS = 2
_MM_PER_UM = 1.0e-3
# Depths are written to a picometre.
_SAME_UM = 1.0e-6
_S_PER_MS = 1.0e-3


@dataclass(frozen=True, slots=True)
class Phase:
    """A step of the solver: equal increments of `dt_s`.

    `procedure` is ``static``, ``viscous`` or ``dynamic``. Every so many increments, `every`, are
    a sample, and written.
    """

    procedure: str
    dt_s: float
    increments: int
    every: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """The probe's way into the skin: `depth_mm` ``(T,)`` at `time_s` ``(T,)``.

    The solver takes the increments of `phases`, one a time; `ramp` of them lie before
    the stimulus and lead to its pre-indentation. From there on a sample of the
    stimulus comes every `dt_s`, an increment or two of the last phase. Someone's own deck
    has its own steps, and takes no phases. `aside_mm` ``(T,)`` is the way along x, None where
    there is none.
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


def motion_of(stimulus: Stimulus, procedure: str = "static", relaxing_s: float = 0.0) -> Motion:
    """Put the way to the pre-indentation in front of `stimulus`.

    `relaxing_s` is the longest time constant of the skin, 0 where none relaxes: the
    probe is held at the pre-indentation until that is over.

    Raises
    ------
    DeckError
        The first sample is not the pre-indentation: the probe would jump.
    """
    start_um = float(stimulus.displacement_um[0])
    if abs(start_um - stimulus.preindent_um) > _SAME_UM:
        raise DeckError(
            f"{stimulus.id}: starts at {start_um:g} um, expected "
            f"{stimulus.preindent_um:g} um, where the probe stands before time 0"
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
        hold_s = _HOLD_TIME_CONSTANTS * relaxing_s
        stages = (
            Phase("static", dt_s, ramp),
            Phase("viscous", hold_s, HOLD_INCREMENTS if ramp and hold_s else 0),
            Phase(procedure, dt_s, samples),
        )
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


def _dynamic_motion(
    depth_mm: FloatArray, aside_mm: FloatArray | None, dt_s: float, ramp: int
) -> Motion:
    """One step for where inertia counts: a smooth ramp, and more than a time a sample."""
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
    """Put a value between each two samples: on the cubic through the four around it.

    On a straight line between two samples the probe would change its speed at each.
    Beyond the ends the samples are taken to go straight on.
    """
    if len(samples) == 1:
        return samples
    first, last = 2 * samples[:1] - samples[1:2], 2 * samples[-1:] - samples[-2:-1]
    ends = np.concatenate([first, samples, last])
    middle = (9 * (ends[1:-2] + ends[2:-1]) - ends[:-3] - ends[3:]) / 16
    fine = np.empty(2 * len(samples) - 1)
    fine[::2], fine[1::2] = samples, middle
    return fine
