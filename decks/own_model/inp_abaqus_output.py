"""Output that a deck for Abaqus asks for, and what of it the waveform's step gives up.

Abaqus writes the state at the start of each step by itself. Positions ``NODES`` are
values of each element by itself, so that nothing is averaged over layers.
"""

from decks.own_model.inp_blocks import Block
from decks.own_model.inp_sets import OUTPUT_SET
from decks.own_model.inp_steps import Step

# What belongs to the *OUTPUT card before it.
_PARTS = (
    "CONTACTOUTPUT",
    "ELEMENTOUTPUT",
    "ENERGYOUTPUT",
    "INCREMENTATIONOUTPUT",
    "INTEGRATEDOUTPUT",
    "MODALOUTPUT",
    "NODEOUTPUT",
    "RADIATIONOUTPUT",
    "SURFACEOUTPUT",
)


def abaqus_request(on_set: bool) -> list[str]:
    """Give the cards for U and S on the sets, or everywhere, every increment."""
    nodes, elements = "", ""
    if on_set:
        nodes, elements = f", NSET={OUTPUT_SET}", f", ELSET={OUTPUT_SET}"
    return [
        "*OUTPUT, FIELD, FREQUENCY=1",
        f"*NODE OUTPUT{nodes}",
        "U,",
        f"*ELEMENT OUTPUT{elements}, POSITION=NODES",
        "S,",
    ]


def abaqus_requests(step: Step) -> list[Block]:
    """Give the field requests of nodes and elements, with an ``*OUTPUT`` left empty.

    History requests, contact and energy stay, and so do ``.fil`` and printed tables.
    """
    gone: list[Block] = []
    group: list[Block] = []
    for block in step.block:
        if block.keyword == "OUTPUT":
            gone += _of_field(group)
            group = [block]
        elif group and block.keyword in _PARTS:
            group.append(block)
    return gone + _of_field(group)


def _of_field(group: list[Block]) -> list[Block]:
    if not group or group[0].option("FIELD") is None:
        return []
    parts = [one for one in group if one.keyword in ("NODEOUTPUT", "ELEMENTOUTPUT")]
    return group if len(parts) == len(group) - 1 else parts
