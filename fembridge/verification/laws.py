"""Study: from which depth on the law of the materials matters.

Decks take the second Piola–Kirchhoff stress to be linear in Green's strain, with
Table 1's moduli; a neo-Hookean skin has the same moduli at rest.
"""

import numpy as np

from decks.presets import QUICK
from fembridge.build import model_of
from fembridge.typing import FloatArray
from fembridge.verification.bench import Bench
from fembridge.verification.finding import Chart, Check, Finding, Line, NumberTable, Panel
from fembridge.verification.indent import AFFERENTS, down, indent
from fembridge.verification.plane_deck import NEO_HOOKEAN

NAME = "laws"
TITLE = "Linear law against neo-Hookean"

DEPTH_UM, STEPS, STEPS_QUICK = 400.0, 16, 8
_TABLED_UM = (50.0, 100.0, 200.0, 300.0, 400.0)
_BOUND_PERCENT = 0.5


def study(bench: Bench) -> Finding:
    """Press with both laws."""
    model, steps = model_of(QUICK), STEPS_QUICK if bench.quick else STEPS
    stimulus = down(DEPTH_UM, steps)
    found = {}
    for law in ("linear", NEO_HOOKEAN):
        bench.tell(f"{NAME}: {law}")
        found[law] = indent(bench, f"{NAME}/{law}", model, stimulus, law=law)
    linear, other = found["linear"], found[NEO_HOOKEAN]
    off = 100 * (other.stress_pa[1:] / linear.stress_pa[1:] - 1)
    force_off = 100 * (other.force_n_per_mm[1:] / linear.force_n_per_mm[1:] - 1)
    depth_um = linear.depth_um[1:]
    rows = [int(np.abs(depth_um - one).argmin()) for one in _TABLED_UM]
    return Finding(
        name=NAME,
        title=TITLE,
        question=(
            f"The `quick` finger to {DEPTH_UM:g} µm with either law for skin and "
            "tissue. Both decks are large-strain, and the same for small strain."
        ),
        words=_words(depth_um, off, force_off),
        checks=(
            Check(
                "difference of stress, extrapolated to depth 0",
                float(np.abs(_at_rest(depth_um, off)).max()),
                _BOUND_PERCENT,
                "%",
            ),
        ),
        tables=(
            NumberTable(
                name="laws",
                caption="Linear law: von Mises stress in kPa; neo-Hookean: difference "
                "from it in percent",
                columns=(
                    *("depth_um", *AFFERENTS, *(f"{n}_percent" for n in AFFERENTS)),
                    "force_percent",
                ),
                rows=tuple(
                    (
                        float(depth_um[row]),
                        *(linear.stress_pa[row + 1] / 1000).tolist(),
                        *off[row].tolist(),
                        float(force_off[row]),
                    )
                    for row in rows
                ),
                formats=("g", ".2f", ".2f", ".4f", *["+.2f"] * 4),
            ),
        ),
        charts=(
            Chart(
                name="laws",
                caption="Neo-Hookean against linear law over depth.",
                panels=(
                    Panel(
                        along="depth (µm)",
                        up="neo-Hookean / linear − 1 (%)",
                        lines=(
                            *(
                                _line(name, depth_um, off[:, column])
                                for column, name in enumerate(AFFERENTS)
                            ),
                            _line("force", depth_um, force_off),
                        ),
                    ),
                ),
            ),
        ),
        reduced=f"{STEPS_QUICK} increments instead of {STEPS}" if bench.quick else "",
        cost=bench.spent,
    )


def _at_rest(depth_um: FloatArray, off: FloatArray) -> FloatArray:
    """Extrapolate differences ``(T, afferent)`` from the first two depths to 0."""
    slope = (off[1] - off[0]) / (depth_um[1] - depth_um[0])
    at_rest: FloatArray = off[0] - slope * depth_um[0]
    return at_rest


def _line(name: str, depth_um: FloatArray, off: FloatArray) -> Line:
    return Line(name, tuple(depth_um.tolist()), tuple(off.tolist()), "line")


def _words(depth_um: FloatArray, off: FloatArray, force_off: FloatArray) -> tuple[str, ...]:
    told = ", ".join(f"{name} {each:+.1f} %" for name, each in zip(AFFERENTS, off[-1], strict=True))
    beyond = [
        f"{name} from {depth_um[over.argmax()]:g} µm on"
        for name, over in zip(AFFERENTS, (np.abs(off) > 5.0).T, strict=True)
        if over.any()
    ]
    return (
        f"At {depth_um[-1]:g} µm: {told}, force {force_off[-1]:+.1f} %.",
        f"More than 5 %: {'; '.join(beyond) or 'nowhere'}. The difference grows in "
        "proportion to depth from nothing: small strain is the same for both.",
        "Stimuli of the catalogue go to 250 µm. The paper's finger is linear "
        "elastic, so that is the default; PC, deep in the softest layer, is the one "
        "that a fit with the other law would change.",
    )
