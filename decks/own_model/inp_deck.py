"""A user's own keyword deck with another waveform: all but three places is kept.

The data of the amplitude that moves the probe, the increments of the step that it
moves in, and the output of that step are put in; all else keeps its bytes, comments,
case and line ends included. What is missing or can be meant in two ways is refused,
with its line.
"""

from decks.motion import Motion
from decks.own_model.inp_blocks import Blocks, Resolver, read_blocks
from decks.own_model.inp_dialect import dialect_of, sign_of_abaqus
from decks.own_model.inp_drive import find_drive
from decks.own_model.inp_edits import edited
from decks.own_model.inp_increments import increment_edits
from decks.own_model.inp_nodes import Place, find_nodes, scopes_of
from decks.own_model.inp_output import output_edits
from decks.own_model.inp_text import Card
from decks.own_model.inp_waveform import waveform_edits
from decks.own_model.request import Rebased, Request
from fembridge.errors import DeckError

__all__ = ["DIALECTS", "dialect_of", "rebase_inp"]

DIALECTS = ("calculix", "abaqus")


def rebase_inp(
    data: bytes,
    motion: Motion,
    request: Request,
    *,
    dialect: str | None = None,
    resolver: Resolver | None = None,
) -> Rebased:
    """Put `motion` into the deck `data`.

    Parameters
    ----------
    data
        The deck's bytes.
    motion
        The probe's depth, in mm, at times in s from the start of the step.
    request
        Which amplitude and step, which nodes, the deck's unit of length.
    dialect
        ``"calculix"`` or ``"abaqus"``; None: as `dialect_of` finds it.
    resolver
        Gives the bytes of a file by the name that the deck includes it under, or
        None; without it no included file is looked into.

    Returns
    -------
    Rebased
        The deck. Rebased again with the same request, it does not change.

    Raises
    ------
    DeckError
        Something is missing, ambiguous, or would make of the waveform another one;
        the message begins with the line, or the file and the line.
    """
    sign = sign_of_abaqus(data) if dialect is None else None
    kind = dialect or ("calculix" if sign is None else "abaqus")
    if kind not in DIALECTS:
        raise DeckError(f"dialect {kind!r}, expected {' or '.join(DIALECTS)}")
    if request.results == "both":
        raise DeckError("results both are Marc's, expected binary or text")
    abaqus, binary = kind == "abaqus", request.results != "text"
    blocks = read_blocks(data, abaqus=abaqus, resolver=resolver)
    drive = find_drive(blocks, request.amplitude, request.step)
    scopes = scopes_of(blocks)
    places: dict[str, Place] = {}
    if request.afferents:
        nodes = list(request.afferents.values())
        found = find_nodes(blocks, scopes, nodes)
        places = dict(zip(request.afferents, found, strict=True))
    edits, remarks = waveform_edits(drive, motion, request.length_mm)
    for more_edits, more_remarks in (
        increment_edits(drive, motion, abaqus=abaqus),
        output_edits(blocks, drive, scopes, places, abaqus=abaqus, binary=binary),
    ):
        edits += more_edits
        remarks += more_remarks
    return Rebased(
        deck=edited(data, edits),
        remarks=(_read_as(kind, sign), *remarks, *_unread(blocks)),
        place_mm={
            name: (place.x * request.length_mm, place.y * request.length_mm)
            for name, place in places.items()
        },
        needs=tuple(dict.fromkeys(one.name for one in blocks.inclusions)),
        before_s=drive.start_s or 0.0,
    )


def _read_as(kind: str, sign: Card | None) -> str:
    if sign is not None:
        return f"line {sign.line}: *{sign.title}: read as a deck for Abaqus"
    return f"read as a deck for {'Abaqus' if kind == 'abaqus' else 'CalculiX'}"


def _unread(blocks: Blocks) -> list[str]:
    return [
        f"{one.where}: {one.name} was not read, and what it holds is not known"
        for one in blocks.inclusions
        if not one.read
    ]
