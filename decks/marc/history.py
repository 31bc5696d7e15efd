"""History of a Marc deck: one load case of equal increments, and their solution."""

from collections.abc import Iterator

from decks.marc.contact import contact_table
from decks.marc.layout import Layout
from decks.marc.lines import comment, integers, named, real, reals, zeros
from decks.marc.motion import active

PRESS = "press"

_MOST_INCREMENTS = 99_999
_MOST_RECYCLES = 40
_RESIDUAL_AND_DISPLACEMENT = 5
_FULL_NEWTON = 1
# Of the force left over, relative to the largest reaction, and of the last
# correction, relative to the increment's displacement.
TOLERANCE = 1.0e-3

# What Mentat writes for every job; Marc's listing names most numbers: predictor,
# penalties, dynamic operators, sharp angles, physical constants, limits. It leaves out
# the one that is -2 before the first load case and -1 in each.
_BEFORE, _WITHIN = -2.0, -1.0
_PARAMETERS = (
    (1.0, 1.0e9, 1.0e2, 1.0e6, 0.25, 0.5, 1.5, -0.5),
    (8.625, 20.0, 1.0e-4, 1.0e-6, 1.0, 1.0e-4),
    (8.314, 273.15, 0.5, 0.0, 5.67051e-8, 1.438769e-2, 2.9979e8, 1.0e30),
    (0.0, 0.0, 100.0, 0.0, 1.0, None, 1.0e6, 3.0),
    (0.0, 0.0, 1.256637061e-6, 8.854187817e-12, 120.0, 1.0e-3, 160.0, 0.0),
    (3.0, 0.4),
)


def history(layout: Layout) -> Iterator[str]:
    """Write the load case in which the probe moves."""
    motion = layout.model.motion
    yield from comment(f"start of loadcase {PRESS}")
    yield named("title", PRESS)
    yield from active(layout, PRESS)
    yield from contact_table()
    yield from comment(
        f"full Newton until force and displacement are within {TOLERANCE:g}; Marc "
        "tests one alone where the other is too small, as with the probe off the skin"
    )
    yield named("control", "structural")
    yield integers(
        [
            _MOST_INCREMENTS,
            _MOST_RECYCLES,
            0,
            _RESIDUAL_AND_DISPLACEMENT,
            0,
            _FULL_NEWTON,
            *[0, 0, 1, 0, 1, 0, 0, 0, 0],
        ]
    )
    for _ in ("force", "displacement"):
        yield reals(zeros(8, f1=TOLERANCE, f7=-1.0))
    yield from parameters(within_load_case=True)
    yield from comment("an increment a sample, none cut back: results are wanted at these times")
    yield named("auto load")
    yield integers([motion.increments, 0, 0, 0, 0])
    yield named("time step")
    yield real(motion.dt_s)
    yield named("continue")
    yield from comment(f"end of loadcase {PRESS}")


def parameters(*, within_load_case: bool) -> Iterator[str]:
    """Write the numbers that Mentat writes twice, before and in a load case."""
    state = _WITHIN if within_load_case else _BEFORE
    yield named("parameters")
    for numbers in _PARAMETERS:
        yield reals(state if number is None else number for number in numbers)
