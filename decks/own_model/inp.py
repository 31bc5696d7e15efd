"""A user's own keyword deck with another waveform: all but three places is kept.

The data of the amplitude that moves the probe, the increments of the step that it
moves in, and the output of that step are put in; all else keeps its bytes, comments,
case and line ends included. What is missing or can be meant in two ways is refused,
with its line.
"""

from decks.inp import (
    Block,
    Edit,
    Option,
    Resolver,
    Text,
    blocks_in,
    edited,
    in_place_of,
    read_inp,
    whole,
)
from decks.keyword_deck import fixed, pair_lines
from decks.motion import Motion
from decks.own_model.inp_drive import MOVABLE, Drive, find_drive
from decks.own_model.inp_output import Change, Place, find_nodes, output_edits, scopes_of
from decks.own_model.request import Rebased, Request
from fembridge.errors import DeckError

DIALECTS = ("calculix", "abaqus")

# Keywords that Abaqus alone has, and that Abaqus/CAE or its users write often.
_ABAQUS = (
    *("ASSEMBLY", "ENDASSEMBLY", "ENDINSTANCE", "ENDPART", "INSTANCE", "PART", "SYSTEM"),
    *("MONITOR", "PARAMETER", "PREPRINT", "RIGIDSURFACE"),
)
_PLANE_OR_SOLID = ("C3D", "CAX", "CPE", "CPS", "CPEG", "CGAX")
# As our own decks have them: times to 0.1 us, depths to a picometre where that is
# exact, and in the shortest exact text where it is not.
_TIME_DIGITS = 7
_VALUE_DIGITS = 9
_AXES = " xyz"
_DEFAULT_MOST = 100  # increments of a step without INC=, in ccx and in Abaqus


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
    sign = _sign_of_abaqus(data) if dialect is None else None
    kind = dialect or ("calculix" if sign is None else "abaqus")
    if kind not in DIALECTS:
        raise DeckError(f"dialect {kind!r}, expected {' or '.join(DIALECTS)}")
    if request.results == "both":
        raise DeckError("results both are Marc's, expected binary or text")
    abaqus, binary = kind == "abaqus", request.results != "text"
    deck = read_inp(data, abaqus=abaqus, resolver=resolver)
    drive = find_drive(deck, request.amplitude, request.step)
    scopes = scopes_of(deck)
    places: dict[str, Place] = {}
    if request.afferents:
        found = find_nodes(deck, scopes, list(request.afferents.values()))
        places = dict(zip(request.afferents, found, strict=True))
    edits: list[Edit] = []
    remarks = [f"read as a deck for {'Abaqus' if abaqus else 'CalculiX'}"]
    if sign is not None:
        remarks = [f"line {sign.line}: {sign.title}: {remarks[0]}"]
    for more_edits, more_remarks in (
        _waveform_edits(drive, motion, request.length_mm),
        _increment_edits(drive, motion, abaqus=abaqus),
        output_edits(deck, drive, scopes, places, abaqus=abaqus, binary=binary),
    ):
        edits += more_edits
        remarks += more_remarks
    unread = [
        f"{one.where}: {one.name} was not read, and what it holds is not known"
        for one in deck.inclusions
        if not one.read
    ]
    return Rebased(
        deck=edited(data, edits),
        remarks=(*remarks, *unread),
        place_mm={
            name: (place.x * request.length_mm, place.y * request.length_mm)
            for name, place in places.items()
        },
        needs=tuple(dict.fromkeys(one.name for one in deck.inclusions)),
        before_s=drive.start_s or 0.0,
    )


def dialect_of(data: bytes) -> str:
    """Whose deck `data` is: ``"abaqus"`` or ``"calculix"``.

    ccx reads much of what Abaqus does and drops the rest with a warning, so a deck is
    taken for ccx unless something in it has no sense there.
    """
    return "calculix" if _sign_of_abaqus(data) is None else "abaqus"


def _sign_of_abaqus(data: bytes) -> Block | None:
    """The first block that only Abaqus reads; None in a deck for ccx."""
    for block in blocks_in(Text(data)):
        kind = block.word("TYPE")
        if (
            block.keyword in _ABAQUS
            # ccx continues no keyword line, has *OUTPUT, FREQUENCY= alone, and no hybrid
            # elements (CPE4H, C3D8RH)
            or b"\n" in data[block.start : block.head]
            or (block.keyword == "OUTPUT" and any(map(block.option, ("FIELD", "HISTORY"))))
            or (block.keyword == "ELEMENT" and kind.startswith(_PLANE_OR_SOLID) and kind[-1] == "H")
        ):
            return block
    return None


# ---- The waveform: an amplitude that counts total time begins where the step does, and
# holds 0 before.


def _waveform_edits(drive: Drive, motion: Motion, length_mm: float) -> Change:
    """`motion` as the amplitude's data, with remarks on what was done."""
    rows = drive.amplitude.own_rows()
    values = (motion.depth_mm / (length_mm * drive.factor) + 0.0).tolist()
    start_s = (drive.start_s or 0.0) if drive.total_time else 0.0
    times_s = (motion.time_s + start_s).tolist()
    if start_s > 0:
        times_s, values = [0.0, *times_s], [0.0, *values]
    lines = pair_lines(
        (fixed(time_s, _TIME_DIGITS), fixed(value, _VALUE_DIGITS))
        for time_s, value in zip(times_s, values, strict=True)
    )
    curve, first, head = drive.amplitude, drive.push[0], drive.step.head
    clock = "total time" if drive.total_time else "step time"
    remarks = [
        f"{curve.where}: amplitude {curve.word('NAME')} ({clock}) holds the waveform, "
        f"{len(motion.time_s)} samples in place of {len(rows)} data lines"
    ]
    signs = {push.magnitude > 0 for push in drive.push}
    for push in drive.push if len(signs) > 1 else (first,):
        sign = "+" if push.magnitude > 0 else "-"
        remarks.append(f"{push.where}: depth moves {push.what} along {sign}{_AXES[push.axis]}")
    if drive.factor != 1:
        remarks.append(
            f"{first.where}: magnitude {first.magnitude:g}: the waveform is divided by "
            f"{drive.factor:g}"
        )
    if length_mm != 1:
        remarks.append(f"one length unit of the deck is {length_mm:g} mm")
    if drive.start_s is None:
        remarks.append(f"{head.where}: at what total time the step begins is not known")
    elif drive.start_s > 0:
        before = "; the amplitude is 0 before" if drive.total_time else ""
        remarks.append(
            f"{head.where}: the step begins at {drive.start_s:g} s of total "
            f"time, and the waveform with it{before}"
        )
    for later in drive.steps[drive.step.number :][:1]:
        remarks.append(
            f"{later.head.where}: the steps after the waveform's hold its last "
            "depth unless they say otherwise, and end the run later than it ends"
        )
    return in_place_of(curve, rows, list(lines)), remarks


# ---- Increments: fixed ones, one a sample


def _increment_edits(drive: Drive, motion: Motion, *, abaqus: bool) -> Change:
    """``*STATIC, DIRECT`` and its line in the waveform's step, with remarks."""
    step, count, edits, remarks = drive.step, motion.increments, list[Edit](), list[str]()
    procedure = _procedure(drive, abaqus)
    option = step.head.option("INC")
    most = _DEFAULT_MOST if option is None else whole(option.value or "", step.head.where)
    if most < count:
        remarks.append(f"{step.head.where}: INC raised from {most} to {count}")
        edits.append(_with_option(step.head, option, f"INC={count}"))
    direct = procedure.option("DIRECT")
    no_stop = abaqus and direct is not None and direct.word == "NOSTOP"
    if direct is None:
        if not (procedure.keyword == "VISCO" and abaqus):  # fixed there without CETOL
            edits.append(_with_option(procedure, None, "DIRECT"))
    elif direct.word.startswith("NO") and not no_stop:  # to ccx, NO STOP is a no
        edits.append(_with_option(procedure, direct, "DIRECT"))
    rows = procedure.own_rows()
    line = ", ".join(fixed(time_s, _TIME_DIGITS) for time_s in (motion.dt_s, count * motion.dt_s))
    edits += in_place_of(procedure, rows[:1], [line])
    was = procedure.text.data[rows[0].start : rows[0].stop].strip() if rows else b"nothing"
    remarks.append(
        f"{procedure.where}: {procedure.title}, DIRECT takes {count} "
        f"increments: {line} (was: {was.decode('latin-1')})"
    )
    return edits, remarks


def _procedure(drive: Drive, abaqus: bool) -> Block:
    """The procedure of the waveform's step, which leaves the increments to us."""
    step, found = drive.step, drive.step.of(*MOVABLE)
    if len(found) != 1:
        kinds = ", ".join(f"*{name}" for name in MOVABLE)
        there = "; ".join(f"{block.title}, {block.where}" for block in found)
        raise step.head.error(
            f"a waveform needs one of {kinds} in its step, found {there or 'none'}"
        )
    (procedure,) = found
    if step.head.option("PERTURBATION") is not None:
        raise step.head.error("a PERTURBATION step has no increments in time")
    own_ways = ["RIKS", "EXPLICIT", "SUBSPACE"]
    if procedure.keyword == "VISCO" and abaqus:
        own_ways.append("CETOL")
    for name in own_ways:
        if procedure.option(name) is not None:
            raise procedure.error(
                f"{procedure.title}, {name} chooses its increments itself; the "
                "waveform needs fixed ones"
            )
    for block in (step.head, procedure):
        if not block.own:
            raise block.error(
                f"{block.title} of the waveform's step is in an included file; put it into the deck"
            )
    smooth = drive.amplitude.option("SMOOTH")
    sharp = smooth is not None and smooth.word.strip("0.") == ""
    if procedure.keyword == "DYNAMIC" and abaqus and not sharp:
        raise drive.amplitude.error(
            "in *DYNAMIC Abaqus rounds an amplitude's corners by SMOOTH, 0.25 "
            "without it, and the waveform with them; write SMOOTH=0"
        )
    return procedure


def _with_option(block: Block, there: Option | None, new: str) -> Edit:
    """`new` in the place of an option of the keyword line, or behind the last one."""
    if there is not None:
        return Edit(there.start, there.stop, new.encode())
    comma = " " if block.text.data[block.head - 1 : block.head] == b"," else ", "
    return Edit(block.head, block.head, f"{comma}{new}".encode())
