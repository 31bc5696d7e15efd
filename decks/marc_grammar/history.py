"""Load cases of a Marc deck: what acts, in how many increments, for how long.

loadcase            press
         2
held
indent
auto load
       500         0        10         0         0
time step
 5.000000000000000-4
continue
"""

from dataclasses import dataclass

from decks.marc_grammar.deck import MarcDeck
from decks.marc_grammar.layout import fields, integers
from decks.marc_grammar.line import Line
from decks.marc_grammar.option import Option, Section

FIXED = "auto load"
ADAPTIVE = "auto step"
# What else can make increments; how long they take is not read from these.
_OTHER_STEPS = (
    "auto creep",
    "auto increment",
    "auto therm",
    "auto time",
    "buckle",
    "creep increment",
    "dynamic change",
    "harmonic",
    "modal increment",
    "modal shape",
    "steady state",
    "transient",
)
_AUTO_STEP = "rrrrrriiii"


@dataclass(frozen=True, slots=True)
class LoadCase:
    """A load case; `number` from 1, `name` as ``loadcase`` or ``title`` says it.

    `stepping` is the option that makes increments, None where there are none;
    `increments` is their count where it is fixed, `period` their time together in
    the deck's unit, None where the deck does not tell.
    """

    number: int
    name: str
    active: tuple[str, ...]
    stepping: Option | None
    time_step: Option | None
    increments: int | None
    period: float | None
    line: Line


def load_cases(deck: MarcDeck) -> tuple[LoadCase, ...]:
    """Read all load cases.

    Raises
    ------
    DeckError
        A load case with fewer conditions than it says, or two ways of stepping.
    """
    return tuple(_case(deck, number) for number in deck.cases)


def initial_conditions(deck: MarcDeck) -> tuple[str, ...]:
    """Names of the conditions that act before the first load case."""
    found = deck.find("loadcase", Section.MODEL)
    return _active(found[-1]) if found else ()


def _case(deck: MarcDeck, number: int) -> LoadCase:
    options = [option for option in deck.options if option.case == number]
    named = [option for option in options if option.keyword == "loadcase"]
    titled = [option for option in options if option.keyword == "title"]
    steps = [o for o in options if o.keyword in (FIXED, ADAPTIVE, *_OTHER_STEPS)]
    if len(steps) > 1:
        first = steps[0]
        raise steps[1].head.refuse(
            f"a second way of stepping, `{steps[1].keyword}`, beside "
            f"`{first.keyword}` on {first.head.place}"
        )
    stepping = steps[0] if steps else None
    times = [option for option in options if option.keyword == "time step"]
    increments, period = _stepping(stepping, times[-1] if times else None)
    return LoadCase(
        number,
        (named or titled)[-1].name if named or titled else "",
        _active(named[-1]) if named else (),
        stepping,
        times[-1] if times else None,
        increments,
        period,
        options[0].head,
    )


def _active(option: Option) -> tuple[str, ...]:
    rows = option.data
    if not rows:
        return ()
    count = (integers(rows[0], option.layout) or [0])[0]
    if len(rows) - 1 < count:
        raise rows[0].refuse(f"{count} conditions announced, but {len(rows) - 1} named")
    return tuple(line.text.strip().rstrip(",").strip() for line in rows[1 : 1 + count])


def _stepping(stepping: Option | None, time_step: Option | None) -> tuple[int | None, float | None]:
    """Count the increments of a load case and add up their time."""
    if stepping is None:
        return 0, 0.0
    rows = stepping.data
    if not rows:
        raise stepping.head.refuse(f"`{stepping.keyword}` without numbers")
    if stepping.keyword == ADAPTIVE:
        return None, float(fields(rows[0], stepping.layout, _AUTO_STEP)[1])
    if stepping.keyword != FIXED:
        return None, None
    count = (integers(rows[0], stepping.layout) or [0])[0]
    if time_step is None:
        return count, None
    if not time_step.data:
        raise time_step.head.refuse("`time step` without a number")
    return count, count * float(fields(time_step.data[0], time_step.layout, "r")[0])
