"""A small finding with everything in it, as a study would give it."""

import pytest

from fembridge.verification.bench import Cost
from fembridge.verification.finding import AT_LEAST, Chart, Check, Finding, Line, NumberTable, Panel


@pytest.fixture
def small_finding():
    return Finding(
        name="small",
        title="A small study, made up",
        question="Is two more than one?",
        words=("It is.", "By one."),
        checks=(Check("difference", 1.0, 1.5, "mm"), Check("ratio", 2.0, 3.0, side=AT_LEAST)),
        tables=(
            NumberTable(
                name="numbers",
                caption="One and two",
                columns=("which_one", "value_kpa", "count"),
                rows=(("one", -1.25, 3), ("two", float("nan"), 4)),
                formats=("", "+.1f", "d"),
            ),
        ),
        charts=(
            Chart(
                name="numbers",
                caption="Both",
                panels=(
                    Panel(
                        along="x",
                        up="y",
                        lines=(
                            Line("SA", (1.0, 2.0, 4.0), (3.0, 4.0, 5.0)),
                            Line("limit", (1.0, 4.0), (0.0, 0.0), "dashed"),
                        ),
                        log="x",
                    ),
                    Panel("x", "", (Line("RA", (1.0,), (2.0,), "dots"),), title="RA"),
                ),
            ),
        ),
        reduced="half of it",
        cost=Cost(10, 23, 4.5, 3.25),
    )
