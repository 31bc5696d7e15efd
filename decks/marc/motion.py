"""Motion of a Marc deck: the waveform's table, and what is held or moved by it.

A table's value multiplies the number that names it: the table holds the depth in mm,
the number is `INTO_SKIN_MM`.
"""

from collections.abc import Iterator, Sequence

from decks.marc.layout import Layout
from decks.marc.lines import comment, integers, named, reals
from decks.marc.mesh import HELD, PROBE_NODES
from fembridge.typing import FloatArray

WAVEFORM = 1
WAVEFORM_NAME = "waveform"
# y points out of the pad.
INTO_SKIN_MM = -1.0

HELD_CONDITION = "held"
PROBE_CONDITION = "probe_motion"

_TIME = 1
_POINTS_FOLLOW = 2
_EXTRAPOLATE = 2
_UNUSED_VARIABLE = (0, 0, 2)
_NODE_SET = 2
_RELATIVE = 1


def waveform(layout: Layout) -> Iterator[str]:
    """Write the table: a line a sample, time in s and depth in mm."""
    motion = layout.model.motion
    yield from comment("the probe's way into the skin: time in s, depth in mm from first touch")
    if motion.ramp:
        start_s = motion.time_s[motion.ramp]
        yield from comment(f"up to {start_s:g} s: the ramp to the pre-indentation")
    yield from time_table(WAVEFORM_NAME, motion.time_s, motion.depth_mm)


def time_table(name: str, time_s: FloatArray, value: FloatArray) -> Iterator[str]:
    """Write table 1, of time alone: a line a sample; both arrays are ``(T,)``."""
    yield named("table", name)
    yield integers([WAVEFORM, 1, 0, 0, _POINTS_FOLLOW])
    yield integers([_TIME, len(time_s), _EXTRAPOLATE, *_UNUSED_VARIABLE * 3, *[0] * 4])
    for sample in zip(time_s.tolist(), value.tolist(), strict=True):
        yield reals(sample)


def conditions(layout: Layout) -> Iterator[str]:
    """Write what is held and, of a meshed probe, how all its nodes move."""
    if layout.meshed:
        yield from comment("every node of the probe is moved: it is as stiff as if it were rigid")
    yield named("fixed disp")
    yield ""
    yield from _fixed(HELD_CONDITION, (0.0, 0.0), (0, 0), HELD)
    if layout.meshed:
        yield from _fixed(PROBE_CONDITION, (0.0, INTO_SKIN_MM), (0, WAVEFORM), PROBE_NODES)


def active(layout: Layout, name: str) -> Iterator[str]:
    """Write which conditions hold in the load case `name`."""
    names = [HELD_CONDITION, *[PROBE_CONDITION] * layout.meshed]
    yield named("loadcase", name)
    yield integers([len(names)])
    yield from names


def _fixed(name: str, value_mm: Sequence[float], table: Sequence[int], nodes: str) -> Iterator[str]:
    yield integers([1, 0, 0, 0, _RELATIVE, 0]) + name
    yield reals(value_mm)
    yield integers(table)
    yield integers(range(1, len(value_mm) + 1))
    yield integers([_NODE_SET])
    yield nodes
