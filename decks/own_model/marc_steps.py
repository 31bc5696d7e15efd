"""The load case that an own Marc deck's waveform runs in, made even increments."""

from dataclasses import dataclass

from decks.marc_grammar.deck import MarcDeck
from decks.marc_grammar.history import ADAPTIVE, FIXED, LoadCase, load_cases
from decks.marc_grammar.layout import fields
from decks.marc_grammar.option import Option
from decks.motion import Motion
from decks.own_model.marc_drive import Use
from decks.own_model.marc_edits import (
    Edits,
    integers_line,
    reals_line,
    set_integer,
    with_first_real,
)
from fembridge.errors import DeckError

# What Mentat writes as the largest count of increments.
MANY_INCREMENTS = 99999
_CUT_BACKS = 10  # Mentat's default
_NEWER_VERSION = 14  # of those seen, the first with five numbers in `auto load`


@dataclass(frozen=True, slots=True)
class ChosenCase:
    """A load case, when it starts, in s, and what there is before and after."""

    case: LoadCase
    start_s: float
    before: tuple[LoadCase, ...]
    after: tuple[LoadCase, ...]

    @property
    def told(self) -> str:
        """The load case in words."""
        named = f" {self.case.name!r}" if self.case.name else ""
        return f"load case {self.case.number}{named}"


def choose_case(deck: MarcDeck, wanted: str | None, drives: tuple[Use, ...]) -> ChosenCase:
    """Give the load case that is wanted, or the only one in which there is motion.

    Raises
    ------
    DeckError
        None or several are possible, or the time before it is not known.
    """
    cases = load_cases(deck)
    possible = [case for case in cases if case.stepping is not None]
    if wanted is not None:
        possible = _wanted(cases, possible, wanted, deck)
    moving = [case for case in possible if _acting(case, drives)]
    if len(moving) != 1:
        raise _unclear(deck, cases, possible, moving, drives)
    case = moving[0]
    before = tuple(each for each in cases if each.number < case.number)
    start_s = 0.0
    for each in before:
        if each.period is None:
            raise each.line.refuse(
                f"load case {each.number} {each.name!r} comes before the waveform, but "
                "how long it takes is not told by `auto load` or `auto step`"
            )
        start_s += each.period
    after = tuple(each for each in cases if each.number > case.number and each.stepping)
    return ChosenCase(case, start_s, before, after)


def acting_drives(chosen: ChosenCase, drives: tuple[Use, ...]) -> tuple[Use, ...]:
    """Those of `drives` that act in the load case."""
    return _acting(chosen.case, drives)


def set_increments(edits: Edits, deck: MarcDeck, chosen: ChosenCase, motion: Motion) -> list[str]:
    """Make the load case `motion.increments` of `motion.dt_s`; tell what was done.

    Raises
    ------
    DeckError
        It steps in a way that is not changed here.
    """
    option = chosen.case.stepping
    assert option is not None
    counted = f"{motion.increments} increments of {motion.dt_s:g} s"
    if option.keyword == FIXED:
        set_integer(edits, option.data[0], option.layout, 0, motion.increments)
        _set_time_step(edits, chosen.case, option, motion)
        told = f"{option.head.place}: {chosen.told}: {counted}"
    elif option.keyword == ADAPTIVE:
        _replace_adaptive(edits, deck, chosen.case, option, motion)
        told = f"{option.head.place}: {chosen.told}: `{ADAPTIVE}` became `{FIXED}`, {counted}"
    else:
        raise option.head.refuse(
            f"{chosen.told} steps by `{option.keyword}`, which is not changed here; "
            f"expected `{FIXED}` or `{ADAPTIVE}`"
        )
    return [told, *_raise_limits(edits, deck, chosen, motion)]


def _wanted(
    cases: tuple[LoadCase, ...], possible: list[LoadCase], wanted: str, deck: MarcDeck
) -> list[LoadCase]:
    named = [each for each in cases if each.name.lower() == wanted.strip().lower()]
    if not named and wanted.strip().isdecimal():
        named = [each for each in cases if each.number == int(wanted)]
    if not named:
        listed = _listed(cases) or "none"
        raise _refuse(deck, f"no load case {wanted!r}; there: {listed}")
    found = [each for each in possible if each in named]
    if not found:
        raise named[0].line.refuse(f"load case {wanted!r} has no increments")
    return found


def _acting(case: LoadCase, drives: tuple[Use, ...]) -> tuple[Use, ...]:
    return tuple(u for u in drives if not u.condition or u.condition in case.active)


def _unclear(
    deck: MarcDeck,
    cases: tuple[LoadCase, ...],
    possible: list[LoadCase],
    moving: list[LoadCase],
    drives: tuple[Use, ...],
) -> DeckError:
    if len(moving) > 1:
        return moving[1].line.refuse(
            f"{len(moving)} load cases have increments and this motion; name one: {_listed(moving)}"
        )
    if not possible:
        return _refuse(deck, f"no load case has increments; there: {_listed(cases)}")
    return possible[0].line.refuse(
        f"{drives[0].what} ({drives[0].line.place}) does not act in {_listed(possible)}"
    )


def _set_time_step(edits: Edits, case: LoadCase, option: Option, motion: Motion) -> None:
    step = case.time_step
    if step is None:
        like = option.data[0].text
        edits.replace(
            option.head,
            "time step",
            reals_line((motion.dt_s,), option.layout, like),
            option.head.text,
        )
        return
    line = step.data[0]
    try:
        edits.replace(line, with_first_real(line.text, step.layout, motion.dt_s))
    except ValueError:
        raise line.refuse(
            f"{motion.dt_s!r} does not fit into ten columns; put a comma behind the number"
        ) from None


def _replace_adaptive(
    edits: Edits, deck: MarcDeck, case: LoadCase, option: Option, motion: Motion
) -> None:
    """Write ``auto load`` and ``time step`` where ``auto step`` was."""
    rows = option.data
    layout, like = option.layout, rows[0].text
    # The second and third number: 0, and how often an increment may be cut.
    numbers = [motion.increments, 0, _CUT_BACKS]
    if (deck.version or 0) >= _NEWER_VERSION:
        numbers += [0, 0]
    lines = [FIXED, integers_line(numbers, layout, like)]
    if case.time_step is None:
        lines += ["time step", reals_line((motion.dt_s,), layout, like)]
    else:
        _set_time_step(edits, case, option, motion)
    if option.head.text.isupper():
        lines = [line.upper() for line in lines]
    edits.replace(option.head, *lines)
    for row in rows:
        edits.replace(row)


def _raise_limits(edits: Edits, deck: MarcDeck, chosen: ChosenCase, motion: Motion) -> list[str]:
    """Let ``control`` allow all increments; whether it counts a case or all is open."""
    needed = motion.increments + sum(each.increments or 0 for each in chosen.before)
    told = []
    for option in deck.find("control"):
        if option.case > chosen.case.number or not option.data:
            continue
        line = option.data[0]
        most = _first_integer(option)
        if 0 < most < needed:
            set_integer(edits, line, option.layout, 0, MANY_INCREMENTS)
            told.append(f"{line.place}: `control` allowed {most} increments, now {MANY_INCREMENTS}")
    return told


def _first_integer(option: Option) -> int:
    (found,) = fields(option.data[0], option.layout, "i")
    return int(found)


def _listed(cases: tuple[LoadCase, ...] | list[LoadCase]) -> str:
    return ", ".join(f"{case.number} {case.name} ({case.line.place})" for case in cases)


def _refuse(deck: MarcDeck, problem: str) -> DeckError:
    return DeckError(problem if deck.path is None else f"{deck.path}: {problem}")
