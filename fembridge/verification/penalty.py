"""Study: how much of the indentation the springs of the contact take.

The stress at each afferent against the springs' stiffness K. What they give goes with
1/K, so a straight line in 1/K through the stiffest ends at springs that give nothing.
"""

from dataclasses import replace

import numpy as np

from decks.analysis import Contact
from decks.presets import QUICK
from fembridge.build import model_of
from fembridge.response.solve import LADDER
from fembridge.verification.bench import Bench
from fembridge.verification.finding import Chart, Check, Finding, Line, NumberTable, Panel
from fembridge.verification.indent import AFFERENTS, DEPTH_UM, indent

NAME = "penalty"
TITLE = "Stiffness of the contact"

STIFFNESS = (25.0, 50.0, 100.0, 200.0, 400.0, 800.0, 1600.0)
STIFFNESS_QUICK = (50.0, 100.0, 200.0, 400.0)
_BOUND_PERCENT = 3.0


def study(bench: Bench) -> Finding:
    """Press with each stiffness and extrapolate."""
    stiffness = np.array(STIFFNESS_QUICK if bench.quick else STIFFNESS)
    base = model_of(QUICK)
    found = []
    for one in stiffness.tolist():
        bench.tell(f"{NAME}: {one:g} MPa/mm")
        model = replace(base, contact=Contact(stiffness_mpa_per_mm=one))
        found.append(indent(bench, f"{NAME}/{one:g}", model))
    stress_pa = np.array([each.last_pa for each in found])
    rigid_pa, loss = _endless(stiffness, stress_pa)
    default = float(LADDER[0].stiffness_mpa_per_mm)
    at_default = 100 * (stress_pa[stiffness == default][0] / rigid_pa - 1)
    lag = [100 * (1 - float(each.apex_um[-1]) / DEPTH_UM) for each in found]
    told = ", ".join(
        f"{name} {off:+.2f} %" for name, off in zip(AFFERENTS, at_default, strict=True)
    )
    return Finding(
        name=NAME,
        title=TITLE,
        question=(
            f"The `quick` finger at {DEPTH_UM:g} µm with springs of {stiffness[0]:g} "
            f"to {stiffness[-1]:g} MPa/mm between probe and skin; {default:g} is the "
            "default."
        ),
        words=(
            f"With the default the stress is off by {told} against springs that give "
            "nothing: much the same for all afferents, so it acts as an indentation "
            "that is smaller by what the skin stays behind the probe.",
            "From 100 MPa/mm on the loss is inversely proportional to K, as that of a "
            "spring in series; with 25 MPa/mm the skin stays so far behind that more "
            "nodes touch. On the way down stiffer springs cost no more "
            "iterations. What speaks against them is the way back (study `contact`) "
            "and the shock when a transient comes back from the air (decision 0003).",
        ),
        checks=(
            Check(
                f"{default:g} MPa/mm: stress furthest from rigid contact",
                float(np.abs(at_default).max()),
                _BOUND_PERCENT,
                "%",
            ),
        ),
        tables=(
            NumberTable(
                name="penalty",
                caption=f"Von Mises stress at {DEPTH_UM:g} µm in kPa, its difference "
                "from the limit in percent, and the share of the depth by which the "
                "skin under the probe stays behind",
                columns=(
                    *("stiffness", *AFFERENTS, *(f"{n}_percent" for n in AFFERENTS)),
                    *("behind_percent", "iterations"),
                ),
                rows=(
                    *(
                        (
                            one,
                            *(row / 1000).tolist(),
                            *(100 * (row / rigid_pa - 1)).tolist(),
                            behind,
                            each.cost.iterations,
                        )
                        for one, row, behind, each in zip(
                            stiffness.tolist(), stress_pa, lag, found, strict=True
                        )
                    ),
                    ("limit", *(rigid_pa / 1000).tolist(), 0.0, 0.0, 0.0, 0.0, "–"),
                ),
                formats=("g", ".3f", ".3f", ".4f", *["+.2f"] * 3, ".2f", "d"),
            ),
        ),
        charts=(
            Chart(
                name="penalty",
                caption="Stress against 1/K; lines go through the three stiffest.",
                panels=(
                    Panel(
                        along="1 / K (mm/MPa)",
                        up="stress / limit − 1 (%)",
                        lines=tuple(
                            line
                            for column, name in enumerate(AFFERENTS)
                            for line in (
                                Line(
                                    name,
                                    tuple((1 / stiffness).tolist()),
                                    tuple(
                                        (
                                            100 * (stress_pa[:, column] / rigid_pa[column] - 1)
                                        ).tolist()
                                    ),
                                    "dots",
                                ),
                                Line(
                                    name,
                                    (0.0, float(1 / stiffness[0])),
                                    (
                                        0.0,
                                        float(100 * loss[column] / rigid_pa[column] / stiffness[0]),
                                    ),
                                    "dashed",
                                ),
                            )
                        ),
                    ),
                ),
            ),
        ),
        reduced="four stiffnesses, 4 increments" if bench.quick else "",
        cost=bench.spent,
    )


def _endless(stiffness: np.ndarray, stress_pa: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stress ``(afferent,)`` for 1/K = 0, and the slope, from the three stiffest."""
    slope, start = np.polyfit(1 / stiffness[-3:], stress_pa[-3:], 1)
    return start, slope
