"""Fixed increments in an own deck: one a sample, in the step that the waveform moves.

*STEP, NLGEOM, INC=501
*STATIC, DIRECT
0.0005, 0.25
"""

from decks.inp.lines import fixed
from decks.motion import Motion
from decks.own_model.inp_blocks import Block
from decks.own_model.inp_drive import Drive
from decks.own_model.inp_edits import Edit, in_place_of
from decks.own_model.inp_numbers import whole
from decks.own_model.inp_steps import MOVABLE, Step

_DEFAULT_MOST = 100  # increments of a step without INC=, in ccx and in Abaqus


def increment_edits(drive: Drive, motion: Motion, *, abaqus: bool) -> tuple[list[Edit], list[str]]:
    """Make the step's increments those of `motion`; also remarks on what was done.

    Raises
    ------
    DeckError
        The step is of a kind that has no such increments.
    """
    step = drive.step
    procedure = _procedure(step, abaqus)
    edits, remarks = _limit(step, motion.increments)
    edits += _direct(procedure, abaqus)
    rows = procedure.rows()
    line = ", ".join(fixed(time_s, 7) for time_s in (motion.dt_s, motion.increments * motion.dt_s))
    text, card = procedure.text, procedure.card
    edits += in_place_of(text, card, rows[:1], [line])
    was = text.data[rows[0].start : rows[0].stop].strip() if rows else b"nothing"
    remarks.append(
        f"{procedure.where}: {procedure.title}, DIRECT takes {motion.increments} "
        f"increments: {line} (was: {was.decode('latin-1')})"
    )
    if procedure.keyword == "DYNAMIC" and abaqus:
        smooth = drive.amplitude.option("SMOOTH")
        if smooth is None or smooth.word.strip("0.") != "":
            raise drive.amplitude.error(
                "in *DYNAMIC Abaqus rounds an amplitude's corners by SMOOTH, 0.25 "
                "without it, and the waveform with them; write SMOOTH=0"
            )
    return edits, remarks


def _procedure(step: Step, abaqus: bool) -> Block:
    found = step.of(*MOVABLE)
    if len(found) != 1:
        kinds = ", ".join(f"*{name}" for name in MOVABLE)
        there = "; ".join(f"{block.title}, {block.where}" for block in found)
        raise step.head.error(
            f"a waveform needs one of {kinds} in its step, found {there or 'none'}"
        )
    (procedure,) = found
    if step.head.option("PERTURBATION") is not None:
        raise step.head.error("a PERTURBATION step has no increments in time")
    for name in ("RIKS", "EXPLICIT", "SUBSPACE"):
        if procedure.option(name) is not None:
            raise procedure.error(
                f"{procedure.title}, {name} chooses its increments itself; the "
                "waveform needs fixed ones"
            )
    if procedure.keyword == "VISCO" and abaqus and procedure.option("CETOL"):
        raise procedure.error(
            "*VISCO, CETOL chooses its increments itself; take CETOL out for fixed ones"
        )
    for block in (step.head, procedure):
        if not block.own:
            raise block.error(
                f"{block.title} of the waveform's step is in an included file; put it into the deck"
            )
    return procedure


def _limit(step: Step, increments: int) -> tuple[list[Edit], list[str]]:
    """Raise ``INC`` of the step where it is too small."""
    text, option = step.head.text, step.head.option("INC")
    most = _DEFAULT_MOST
    if option is not None:
        most = whole(option.value or "", text, step.head.card.line)
    if most >= increments:
        return [], []
    remark = f"{step.head.where}: INC raised from {most} to {increments}"
    if option is not None:
        new = f"INC={increments}".encode()
        return [Edit(option.start, option.stop, new)], [remark]
    return [_appended(step.head, f"INC={increments}")], [remark]


def _direct(procedure: Block, abaqus: bool) -> list[Edit]:
    option = procedure.option("DIRECT")
    if option is None:
        if procedure.keyword == "VISCO" and abaqus:  # fixed without CETOL
            return []
        return [_appended(procedure, "DIRECT")]
    if option.word.startswith("NO") and not (abaqus and option.word == "NOSTOP"):
        return [Edit(option.start, option.stop, b"DIRECT")]  # to ccx, NO STOP is a no
    return []


def _appended(block: Block, option: str) -> Edit:
    head = block.card.head
    comma = " " if block.text.data[head - 1 : head] == b"," else ", "
    return Edit(head, head, f"{comma}{option}".encode())
