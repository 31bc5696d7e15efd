"""Steps of a keyword deck: what lies between ``*STEP`` and ``*END STEP``."""

from dataclasses import dataclass

from decks.own_model.inp_blocks import Block, Blocks
from decks.own_model.inp_numbers import number
from decks.own_model.inp_text import squeezed
from fembridge.errors import DeckError

# Procedures that a waveform can run in.
MOVABLE = ("STATIC", "DYNAMIC", "VISCO")
# These lengthen the total time by their second number, or by 1 without one.
_TIMED = (
    *MOVABLE,
    "HEATTRANSFER",
    "COUPLEDTEMPERATURE-DISPLACEMENT",
    "UNCOUPLEDTEMPERATURE-DISPLACEMENT",
)


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """Step number `number`, from 1: its ``*STEP``, the cards in it, its end."""

    number: int
    head: Block
    block: tuple[Block, ...]
    end: Block

    @property
    def name(self) -> str:
        """Number and, where it has one, name."""
        option = self.head.option("NAME")
        named = f" ({option.value})" if option is not None and option.value else ""
        return f"step {self.number}{named}, {self.head.where}"

    def of(self, *keywords: str) -> list[Block]:
        """Give the step's cards that have one of `keywords`."""
        return [block for block in self.block if block.keyword in keywords]

    def period_s(self) -> float:
        """Give what the step adds to the total time.

        Raises
        ------
        DeckError
            It is no step in time, or sets the clock.
        """
        procedures = self.of(*_TIMED)
        if len(procedures) != 1:
            raise self.head.error(
                "how long this step takes is not known (no *STATIC, *DYNAMIC, *VISCO), "
                "and the waveform's amplitude counts total time; let it count step time"
            )
        (procedure,) = procedures
        for name in ("TIMERESET", "TOTALTIMEATSTART"):
            if procedure.option(name) is not None:
                raise procedure.error(
                    f"{name} sets the clock, and the waveform's amplitude counts "
                    "total time; let it count step time"
                )
        for text, row in procedure.placed_rows():
            period = row.words[1] if len(row.words) > 1 else ""
            return number(period, text, row.line, blank=0.0) or 1.0
        return 1.0


def steps_of(blocks: Blocks) -> list[Step]:
    """Give the steps of a deck, in order.

    Raises
    ------
    DeckError
        A step begins inside another one or does not end.
    """
    steps: list[Step] = []
    head: Block | None = None
    inside: list[Block] = []
    for block in blocks.block:
        if block.keyword == "STEP":
            if head is not None:
                raise block.error(f"*STEP inside the step of {head.where}")
            head, inside = block, []
        elif block.keyword == "ENDSTEP":
            if head is None:
                raise block.error("*END STEP without a *STEP")
            steps.append(Step(len(steps) + 1, head, tuple(inside), block))
            head = None
        elif head is not None:
            inside.append(block)
    if head is not None:
        raise head.error("this *STEP has no *END STEP")
    return steps


def step_named(steps: list[Step], wanted: str) -> Step:
    """Give the step that has the number or the name `wanted`.

    Raises
    ------
    DeckError
        There is none.
    """
    for step in steps:
        if wanted.strip() == str(step.number):
            return step
        if (word := step.head.word("NAME")) and word == squeezed(wanted):
            return step
    known = "; ".join(step.name for step in steps) or "none"
    raise DeckError(f"no step {wanted!r} in the deck; it has: {known}")
