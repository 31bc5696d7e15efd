"""Output that a deck for ccx asks for: at nodes, in the waveform's step and before it.

The last card decides how often and whether binary, for all of them, so ours stand
last in their step. ccx writes nothing when a step begins: what a trace has at the
waveform's start is the last increment of the step before.
"""

from decks.own_model.inp_blocks import Block
from decks.own_model.inp_drive import Drive
from decks.own_model.inp_sets import OUTPUT_SET
from decks.own_model.inp_steps import MOVABLE, Step

# What ccx takes for requests of results at nodes.
_REQUESTS = ("NODEFILE", "ELFILE", "NODEOUTPUT", "ELEMENTOUTPUT")
# More increments than any step has: what is written is its last one.
_AT_END = 100000


def calculix_requests(step: Step) -> list[Block]:
    """Give the step's requests of results at nodes."""
    return step.of(*_REQUESTS)


def calculix_request(drive: Drive, step: Step, *, on_set: bool, binary: bool) -> list[str]:
    """Give the cards for U and S in `step`: every increment, or its last one.

    They are for the nodes of the set or for all. The last one is for the step before
    the waveform's.

    Raises
    ------
    DeckError
        A card that stays does not go with fixed increments or a set of nodes.
    """
    stay = [block for block in step.block if block.keyword not in _REQUESTS]
    timed = [block for block in stay if block.option("TIMEPOINTS") is not None]
    often = ", FREQUENCY=1"
    if step is not drive.step:  # points in time come before a number of increments
        often = "" if timed else f", FREQUENCY={_AT_END}"
    elif timed:
        raise timed[0].error(
            f"{timed[0].title}, TIME POINTS: ccx refuses it with fixed increments; take it out"
        )
    kind, double = ("OUTPUT", ", DOUBLE") if binary else ("FILE", "")
    nodes = f", NSET={OUTPUT_SET}" if on_set else ""
    flat = _flat(drive, step) if on_set else ""
    options = f"{nodes}{often}{flat}{double}"
    element = "ELEMENT" if binary else "EL"
    return [f"*NODE {kind}{options}", "U", f"*{element} {kind}{options}", "S"]


def steps_to_write(drive: Drive) -> list[Step]:
    """Give the waveform's step and, where it has one before it in time, that one."""
    before = drive.steps[: drive.step.number - 1][-1:]
    return [*(step for step in before if step.of(*MOVABLE)), drive.step]


def _flat(drive: Drive, step: Step) -> str:
    """Give ``OUTPUT=2D`` where something asks for 3D, which has no sets of nodes.

    Expanded nodes have numbers of their own, and results on a set of the deck's nodes
    are then empty. ccx 2.20 takes the word in the first step alone.
    """
    written = steps_to_write(drive)
    for one in drive.steps[: drive.step.number]:
        for block in one.block:
            gone = one in written and block.keyword in _REQUESTS
            if gone or block.word("OUTPUT") != "3D":
                continue
            if one.number > 1 or one not in written:
                raise block.error(
                    f"{block.title}, OUTPUT=3D: ccx then writes nothing for a set of "
                    "the deck's nodes; take it out"
                )
            return ", OUTPUT=2D" if step is one else ""
    return ""
