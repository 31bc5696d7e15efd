"""A user's own keyword deck with another waveform: all but three places is kept.

The data of the amplitude that moves the probe, the increments of the step that it
moves in, and the output of that step are put in; all else keeps its bytes, comments,
case and line ends included. A probe without such an amplitude gets one. What is missing
or can be meant in two ways is refused, with its line.
"""

from decks.inp import (
    Block,
    Deck,
    Edit,
    Resolver,
    Text,
    blocks_in,
    edited,
    gone,
    in_place_of,
    inserted,
    read_inp,
    whole,
    with_option,
    without_option,
)
from decks.keyword_deck import fixed, pair_lines
from decks.motion import Motion
from decks.own_model import Rebased, Request, too_far
from decks.own_model.inp_drive import MOVABLE, OWN_AMPLITUDE, Drive, find_drive
from decks.own_model.inp_output import (
    TIMES,
    Change,
    Place,
    find_nodes,
    output_edits,
    scopes_of,
    size_of,
)
from decks.unit_system import LENGTH_UNITS, MM, UnitSystem, unit_system_in
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
# Automatic increments: the smallest, as a part of a sample, and how many to allow for one.
_SMALLEST = 1.0e-4
_CUTS = 20
# Equation solvers that every ccx has; PrePoMax asks for PARDISO.
_SOLVERS = ("SPOOLES", "ITERATIVESCALING", "ITERATIVECHOLESKY")
# What makes ccx take increments at all; without any of it a step is one.
_NONLINEAR = (
    *("CONTACTPAIR", "CREEP", "DEFORMATIONPLASTICITY", "HYPERELASTIC", "HYPERFOAM"),
    *("MOHRCOULOMB", "PLASTIC", "USERMATERIAL"),
)


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
    drive = find_drive(deck, request)
    units, stated = _units(deck, request)
    scopes = scopes_of(deck)
    places: dict[str, Place] = {}
    if request.afferents:
        found = find_nodes(deck, scopes, list(request.afferents.values()))
        places = dict(zip(request.afferents, found, strict=True))
    edits: list[Edit] = []
    remarks = [f"read as a deck for {'Abaqus' if abaqus else 'CalculiX'}"]
    if sign is not None:
        remarks = [f"line {sign.line}: {sign.title}: {remarks[0]}"]
    remarks += stated
    by_heading = bool(stated) and request.length_unit is None
    remarks += too_far(motion, size_of(deck) * units.length_mm, units, by_heading)
    automatic = request.increments == "automatic"
    if not abaqus:
        remarks += _path_dependent(deck)
    for more_edits, more_remarks in (
        _waveform_edits(drive, motion, units.length_mm),
        _increment_edits(deck, drive, motion, abaqus=abaqus, automatic=automatic),
        output_edits(deck, drive, scopes, places, request, abaqus=abaqus, binary=binary),
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
            name: tuple(units.length_mm * value for value in place.at)
            for name, place in places.items()
        },
        needs=tuple(dict.fromkeys(one.name for one in deck.inclusions)),
        before_s=drive.start_s or 0.0,
        stands_mm=drive.stands * units.length_mm,
        units=units,
    )


def _units(deck: Deck, request: Request) -> tuple[UnitSystem, list[str]]:
    """Units of the request, else of the heading, else mm; and what was found."""
    asked = request.length_unit and LENGTH_UNITS[request.length_unit]
    for block in deck.of("HEADING"):
        text = b"".join(one.text.data[one.start : one.stop] for one in block.pieces)
        said = unit_system_in(text.decode("latin-1"))
        if said is not None:
            remark = f"{block.where}: *HEADING: unit system {said}"
            if asked and asked.length_unit != said.length_unit:
                return asked, [f"{remark}; it is taken to be in {asked.length_unit} all the same"]
            return said, [remark]
    return asked or MM, []


def _path_dependent(deck: Deck) -> list[str]:
    """A hint on contact whose stress depends on how the probe came to its depth."""
    return [
        f"{block.where}: {block.title}, TYPE={block.word('TYPE')} is path-dependent in CalculiX: "
        "on the way back stress at one depth is another (1.7 % of it on a block, up to 20 %); "
        "TYPE=NODE TO SURFACE is not"
        for block in deck.of("CONTACTPAIR")
        if block.word("TYPE") == "SURFACETOSURFACE"
    ]


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


# ---- The waveform: an amplitude that counts total time begins where the step does.


def _waveform_edits(drive: Drive, motion: Motion, length_mm: float) -> Change:
    """`motion` as the amplitude's data, with remarks on what was done."""
    depth = drive.stands + motion.depth_mm / length_mm
    values = (depth / drive.factor + 0.0).tolist()
    start_s = (drive.start_s or 0.0) if drive.total_time else 0.0
    times_s = (motion.time_s + start_s).tolist()
    if start_s > 0:
        times_s, values = [0.0, *times_s], [values[0], *values]
    lines = pair_lines(
        (fixed(time_s, _TIME_DIGITS), fixed(value, _VALUE_DIGITS))
        for time_s, value in zip(times_s, values, strict=True)
    ).splitlines()
    curve, first, head = drive.amplitude, drive.push[0], drive.step.head
    samples = f"holds the waveform, {len(motion.time_s)} samples"
    if curve is None:
        edits, remarks = _new_amplitude(drive, lines)
        remarks = [f"{remarks[0]} {samples}"]
    else:
        rows = list(curve.rows())
        edits = in_place_of(curve, rows, lines)
        clock = "total time" if drive.total_time else "step time"
        remarks = [
            f"{curve.where}: amplitude {curve.word('NAME')} ({clock}) {samples} in place of "
            f"{len(rows)} data lines"
        ]
        if drive.step.number == 1 and rows and (began := rows[0].number(1, blank=0.0)):
            remarks.append(
                f"{curve.where}: it began at {began:g}; the waveform begins where the mesh has "
                "the probe"
            )
    signs = {push.magnitude > 0 for push in drive.push}
    for push in drive.push if len(signs) > 1 else (first,):
        sign = "+" if push.magnitude > 0 else "-"
        remarks.append(f"{push.where}: depth moves {push.what} along {sign}{_AXES[push.axis]}")
    if drive.stands:
        remarks.append(
            f"{first.where}: the steps before leave {first.what} {drive.stands * length_mm:g} mm "
            "deep; the waveform begins there"
        )
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
        remarks.append(
            f"{head.where}: the step begins at {drive.start_s:g} s of total "
            "time, and the waveform with it"
        )
    for later in drive.steps[drive.step.number :]:
        text = later.head.text if later.head.text.name else later.end.text
        remarks.append(f"{later.head.where}: left out to *END STEP, the run ends with the waveform")
        edits.append(Edit(text, later.head.start, later.end.body))
    return edits, remarks


def _new_amplitude(drive: Drive, lines: list[str]) -> Change:
    """An amplitude before the first step, and on the lines that move the probe."""
    use = f"AMPLITUDE={OWN_AMPLITUDE}"
    head = drive.steps[0].head
    edits = [inserted(head.text, head.start, [f"*AMPLITUDE, NAME={OWN_AMPLITUDE}", *lines])]
    for start in dict.fromkeys(push.block.start for push in drive.push):
        mine = [push for push in drive.push if push.block.start == start]
        block, rows = mine[0].block, list(mine[0].block.rows())
        ours = {push.row.start for push in mine}
        moved = [row for row in rows if row.start in ours]
        said = [
            f"{push.what}, {push.axis}, {push.axis}, {push.magnitude:g}."
            if push.by_request
            else block.text.data[row.start : row.stop].strip().decode("latin-1")
            for row in moved
            for push in mine[:1]
        ]
        if len(moved) == len(rows):
            edits.append(with_option(block, block.option("AMPLITUDE"), use))
            if mine[0].by_request:
                edits += in_place_of(block, moved, said)
            continue
        edits += map(gone, moved)
        again = block.option("OP")
        op = f", OP={again.word}" if again is not None else ""
        edits.append(inserted(block.text, rows[-1].stop, [f"*BOUNDARY, {use}{op}", *said]))
    first, instead = drive.push[0], ""
    if first.amplitude not in ("", OWN_AMPLITUDE):
        instead = f" ({first.amplitude} has other users, or cannot hold a waveform)"
    words = f"{first.where}: {first.name} gets an amplitude, {OWN_AMPLITUDE}{instead}, which"
    return edits, [words]


# ---- Increments: fixed ones, one a sample, or automatic ones of a sample at most. Solvers
# end an increment at each time point, so results come at the samples either way.


def _increment_edits(
    deck: Deck, drive: Drive, motion: Motion, *, abaqus: bool, automatic: bool
) -> Change:
    """The procedure's line and options in the waveform's step, with remarks."""
    step, count, edits, remarks = drive.step, motion.increments, list[Edit](), list[str]()
    procedure = _procedure(drive, abaqus)
    option = step.head.option("INC")
    most = _DEFAULT_MOST if option is None else whole(option.value or "", step.head.where)
    needed = count * (_CUTS if automatic else 1)
    if most < needed:
        remarks.append(f"{step.head.where}: INC raised from {most} to {needed}")
        edits.append(with_option(step.head, option, f"INC={needed}"))
    before = drive.steps[: step.number]
    linear = procedure.keyword != "DYNAMIC" and not deck.of(*_NONLINEAR)
    if not abaqus and linear and not any(one.head.option("NLGEOM") for one in before):
        remarks.append(
            f"{step.head.where}: NLGEOM put in: without it, contact or a nonlinear material ccx "
            "makes one increment of a step"
        )
        edits.append(with_option(step.head, None, "NLGEOM"))
    for one in () if abaqus else [each for step in before for each in step.of(*MOVABLE)]:
        solver = one.option("SOLVER")
        if solver is not None and solver.word not in _SOLVERS and not one.text.name:
            remarks.append(
                f"{one.where}: SOLVER={solver.word} left out: not every ccx has it, and each "
                "takes the best of its own"
            )
            edits.append(without_option(one, solver))
    direct = procedure.option("DIRECT")
    period = fixed(count * motion.dt_s, _TIME_DIGITS)
    rows = list(procedure.rows())
    was = procedure.text.data[rows[0].start : rows[0].stop].strip() if rows else b"nothing"
    words = f"(was: {was.decode('latin-1')})"
    if automatic:
        if procedure.keyword == "VISCO" and abaqus:
            raise procedure.error("*VISCO has automatic increments with CETOL, which is not set")
        dt, least = fixed(motion.dt_s, _TIME_DIGITS), fixed(_SMALLEST * motion.dt_s, 9)
        line = f"{dt}, {period}, {least}, {dt}"
        if direct is not None:
            edits.append(without_option(procedure, direct))
        edits += in_place_of(procedure, rows[:1], [line])
        points = next((one for one in deck.of("TIMEPOINTS") if one.word("NAME") == TIMES), None)
        new = [f"*TIME POINTS, NAME={TIMES}, GENERATE", f"{dt}, {period}, {dt}"]
        if points is None:
            edits.append(inserted(drive.steps[0].head.text, drive.steps[0].head.start, new))
        else:
            edits += in_place_of(points, list(points.rows()), new[1:])
        remarks.append(
            f"{procedure.where}: {procedure.title} takes increments of {motion.dt_s:g} s or less, "
            f"with results at {count} time points: {line} {words}"
        )
        return edits, remarks
    no_stop = abaqus and direct is not None and direct.word == "NOSTOP"
    if direct is None:
        if not (procedure.keyword == "VISCO" and abaqus):  # fixed there without CETOL
            edits.append(with_option(procedure, None, "DIRECT"))
    elif direct.word.startswith("NO") and not no_stop:  # to ccx, NO STOP is a no
        edits.append(with_option(procedure, direct, "DIRECT"))
    line = f"{fixed(motion.dt_s, _TIME_DIGITS)}, {period}"
    edits += in_place_of(procedure, rows[:1], [line])
    remarks.append(
        f"{procedure.where}: {procedure.title}, DIRECT takes {count} increments: {line} {words}"
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
    own_ways = [(step.head, "PERTURBATION")]
    own_ways += [(procedure, name) for name in ("RIKS", "EXPLICIT", "SUBSPACE")]
    if procedure.keyword == "VISCO" and abaqus:
        own_ways.append((procedure, "CETOL"))
    for block, name in own_ways:
        if block.option(name) is not None:
            raise block.error(
                f"{block.title}, {name} has no increments in time or chooses them itself; the "
                "waveform needs its own"
            )
    curve = drive.amplitude
    smooth = curve.option("SMOOTH") if curve is not None else None
    sharp = smooth is not None and smooth.word.strip("0.") == ""
    if procedure.keyword == "DYNAMIC" and abaqus and not sharp:
        raise (curve or step.head).error(
            "in *DYNAMIC Abaqus rounds an amplitude's corners by SMOOTH, 0.25 "
            "without it, and the waveform with them; write SMOOTH=0"
        )
    return procedure
