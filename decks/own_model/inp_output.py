"""What an own deck asks its solver to write: displacement and stress, every increment.

The requests of the waveform's step become one, on the afferents' nodes or on all; in
a deck for ccx, those of the step before it become one of its last increment.
"""

from collections.abc import Mapping

from decks.own_model.inp_abaqus_output import abaqus_request, abaqus_requests
from decks.own_model.inp_around import elements_around
from decks.own_model.inp_blocks import Block, Blocks
from decks.own_model.inp_calculix_output import calculix_request, calculix_requests, steps_to_write
from decks.own_model.inp_drive import Drive
from decks.own_model.inp_edits import Edit, inserted, without
from decks.own_model.inp_nodes import Place, Scope
from decks.own_model.inp_sets import OUTPUT_SET, node_set_lines, set_lines, set_place
from decks.own_model.inp_steps import Step

Change = tuple[list[Edit], list[str]]


def output_edits(
    blocks: Blocks,
    drive: Drive,
    scopes: list[Scope],
    places: Mapping[str, Place],
    *,
    abaqus: bool,
    binary: bool,
) -> Change:
    """Make the request that `places` need, or all nodes; also remarks on it.

    Raises
    ------
    DeckError
        A request cannot be taken out, a set cannot be added, or what stays in the
        step does not go with fixed increments or with a set of nodes.
    """
    on_set = bool(places)
    what = f"the nodes of {', '.join(places)}" if places else "all nodes"
    edits, remarks = _sets(blocks, drive, scopes, places, abaqus)
    for step in [drive.step] if abaqus else steps_to_write(drive):
        if abaqus:
            gone, request = abaqus_requests(step), abaqus_request(on_set)
        else:
            gone = calculix_requests(step)
            request = calculix_request(drive, step, on_set=on_set, binary=binary)
        when = "every increment" if step is drive.step else "its last increment"
        more_edits, more_remarks = _replaced(step, gone, request, f"{what}, {when}")
        edits += more_edits
        remarks += more_remarks
    return edits, remarks


def _replaced(step: Step, gone: list[Block], request: list[str], what: str) -> Change:
    """Put `request` at the end of `step`, and take `gone` out of it."""
    for block in (*gone, step.end):
        if not block.own:
            raise block.error(
                f"{block.title} of {step.name} is in an included file, and its output "
                "has to be changed; put it into the deck"
            )
    edits = [edit for block in gone for edit in without(block.text, block.card, block.rows())]
    edits.append(inserted(step.end.text, step.end.card.start, request))
    removed = ", ".join(f"{block.title} ({block.where})" for block in gone)
    instead = f", in place of {removed}" if removed else ""
    return edits, [f"{step.end.where}: U and S at {what}{instead}"]


def _sets(
    blocks: Blocks, drive: Drive, scopes: list[Scope], places: Mapping[str, Place], abaqus: bool
) -> Change:
    if not places:
        return [], []
    outside = scopes[0].block
    lines = node_set_lines(outside, places)
    if abaqus:
        around = elements_around(scopes, places.values())
        lines += set_lines("ELSET", OUTPUT_SET, around, outside)
    if not lines:
        return [], []
    in_assembly = any(place.instance for place in places.values())
    text, place = set_place(blocks, drive.steps[0].head, in_assembly)
    line = text.data.count(b"\n", 0, place) + 1
    # A node set and an element set may share a name.
    names = dict.fromkeys(each.split("=")[1].split(",")[0] for each in lines if "=" in each)
    told = f"line {line}: before it, sets {', '.join(names)}"
    return [inserted(text, place, lines)], [told]
