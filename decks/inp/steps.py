"""The waveform and the steps of a keyword deck.

Stress that depends on depth alone takes one static step. Where it depends on time,
what leads up to the waveform is a step, or two, of its own.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain

from decks.analysis import Analysis
from decks.inp.lines import fixed, pair_lines
from decks.motion import Phase
from fembridge.typing import FloatArray

_WORDS = {
    "static": "no inertia, no viscosity",
    "viscous": "the skin relaxes, no inertia",
    "dynamic": "inertia counts",
}


@dataclass(frozen=True, slots=True)
class Moved:
    """The set that the waveform moves, and what else is said in each step."""

    name: str = "PROBE"
    controls: tuple[str, ...] = ()
    held: tuple[str, ...] = ()
    loads: tuple[str, ...] = ()


_PROBE = Moved()


def waveform(model: Analysis) -> Iterator[str]:
    """Give the probe's way as an amplitude over total time; two where it slides."""
    motion = model.motion
    yield "**"
    yield "** ---- The probe's way into the skin: time in s, depth in mm"
    if motion.ramp:
        words = "the ramp to" if len(motion.phases) == 1 else "the way to"
        yield f"** up to {motion.start_s:g} s: {words} the pre-indentation"
    yield from _amplitude("DEPTH", motion.time_s, motion.depth_mm)
    if motion.aside_mm is not None:
        yield "** ---- and its way across the finger, along x, in mm"
        yield from _amplitude("ASIDE", motion.time_s, motion.aside_mm)


def _amplitude(name: str, time_s: FloatArray, way_mm: FloatArray) -> Iterator[str]:
    yield f"*AMPLITUDE, NAME={name}, TIME=TOTAL TIME"
    yield from pair_lines(
        (fixed(at_s, 7), f"{mm:.9f}")
        for at_s, mm in zip(time_s.tolist(), (way_mm + 0.0).tolist(), strict=True)
    )


def steps(
    model: Analysis,
    cards: Mapping[str, str],
    large_strain: str,
    output: Callable[[Analysis], Iterator[str]],
    moved: Moved = _PROBE,
) -> Iterator[str]:
    """Give each phase of the motion as a step with the same conditions and output.

    `cards` are the solver's words for `decks.motion.PROCEDURES`, `large_strain` its
    word for that, with its comma, or "".
    """
    return chain.from_iterable(
        chain(_step(model, phase, cards, large_strain, moved), output(model), ["*END STEP"])
        for phase in model.motion.phases
    )


def _step(
    model: Analysis, phase: Phase, cards: Mapping[str, str], large_strain: str, moved: Moved
) -> Iterator[str]:
    phases = model.motion.phases
    which = "One step" if len(phases) == 1 else f"Step {phases.index(phase) + 1}"
    yield "**"
    yield f"** ---- {which} of equal increments: {_WORDS[phase.procedure]}"
    yield f"*STEP{large_strain}, INC=100000"
    yield cards[phase.procedure]
    yield f"{fixed(phase.dt_s, 7)}, {fixed(phase.length_s, 7)}"
    yield from moved.controls
    yield "*BOUNDARY"
    yield "HELD, 1, 2"
    yield from moved.held
    if model.motion.aside_mm is None:
        yield f"{moved.name}, 1, 1"
    else:
        yield "*BOUNDARY, AMPLITUDE=ASIDE"
        yield f"{moved.name}, 1, 1, 1.0"
    yield "** into the skin is -y"
    yield "*BOUNDARY, AMPLITUDE=DEPTH"
    yield f"{moved.name}, 2, 2, -1.0"
    yield from moved.loads
