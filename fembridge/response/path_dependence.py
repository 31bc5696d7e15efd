"""Where stress depends on more than the probe's depth, and no map can answer.

A response map is one indentation, read at the depth of each sample. Time and place
must not matter: no layer relaxes, no mass is accelerated, the probe does not slide.
That is known before anything is solved. Friction is not: skin that slips under the
probe on its way in does not slip back on the same way out, and only an indentation
tells whether that moves the stress.
"""

from collections.abc import Sequence

from fembridge.build import Model
from fembridge.errors import ResponseError
from fembridge.response.acceptance import CLOSURE_PERCENT
from fembridge.stimulus import Stimulus


class RemembersError(ResponseError):
    """Unloading differs from loading; `closure_percent` tells by how much."""

    def __init__(self, words: str, closure_percent: float) -> None:
        super().__init__(words, closure_percent)
        self.words, self.closure_percent = words, closure_percent

    def __str__(self) -> str:
        return self.words


class FrictionSlipError(RemembersError):
    """Friction is what unloading differs by: without it the same contact comes back.

    The contact model is sound, the one of number `rung` on the ladder, from 1; the
    stress of a waveform takes the whole way of the probe, a transient.
    """

    def __init__(self, words: str, closure_percent: float, rung: int) -> None:
        super().__init__(words, closure_percent)
        self.args = (words, closure_percent, rung)  # these rebuild it after pickling
        self.rung = rung


def why_no_map(model: Model, stimuli: Sequence[Stimulus]) -> str | None:
    """Tell why stress is no function of depth alone; None: nothing is known.

    Friction is not judged here: see `fembridge.response.solve.solve_response`.
    """
    relaxing = [layer for layer, one in model.finger.materials.items() if one.prony]
    if relaxing:
        verb = "relaxes" if len(relaxing) == 1 else "relax"
        return f"{', '.join(relaxing)} {verb}: stress depends on time, not on depth alone"
    if model.inertia:
        return "inertia counts: stress depends on acceleration, not on depth alone"
    sliding = [stimulus.id for stimulus in stimuli if stimulus.aside_um is not None]
    if sliding:
        return (
            f"{sliding[0]}: the probe slides across the skin: stress depends on its "
            "place, not on depth alone"
        )
    return None


def slip_words(contact: object, closure_percent: float, without: float) -> str:
    """Say that friction slip matters: with friction, and without."""
    return (
        f"skin slips under the probe: with {contact}, unloading differs from loading "
        f"by {closure_percent:.3g} % at the same depth, without friction by "
        f"{without:.2g} %, expected at most {CLOSURE_PERCENT} %: stress depends on the "
        "probe's way, not on depth alone"
    )
