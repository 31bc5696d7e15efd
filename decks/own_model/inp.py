"""A user's own keyword deck with another waveform: all but three places is kept.

The data of the amplitude that moves the probe, the increments of the step that it
moves in, and the output of that step are put in; all else keeps its bytes, comments,
case and line ends included. A probe without such an amplitude gets one. What is missing
or can be meant in two ways is refused, with its line.

In Abaqus a node's number counts in its part alone, the part stands where its instance
puts it, and a set of the assembly names its instance. A deck without parts has all its
nodes in one scope.
"""

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass

from decks.inp import (
    Block,
    Deck,
    Option,
    Piece,
    Resolver,
    Row,
    Text,
    blocks_in,
    members,
    read_inp,
    squeezed,
    whole,
)
from decks.keyword_deck import fixed, list_lines, pair_lines
from decks.motion import Motion
from decks.own_model import Edit, Rebased, Request, edited, too_far
from decks.own_model.inp_drive import MOVABLE, OWN_AMPLITUDE, Drive, Push, Step, find_drive
from decks.unit_system import LENGTH_UNITS, MM, UnitSystem, unit_system_in
from fembridge.errors import DeckError

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
_OUTPUT_SET = "FEMBRIDGE_OUTPUT"
# Of automatic increments: the samples, at which results are written.
_TIMES = "FEMBRIDGE_TIMES"
_SET_NAME = re.compile(r"[A-Za-z0-9_-]+")
_OPENING = ("PART", "INSTANCE")
_NODE_MAKERS = ("NCOPY", "NFILL", "NGEN", "NMAP")
# Elements of a solid model, where z counts.
_SOLID = ("C3D", "M3D", "SC", "S3", "S4", "S6", "S8")
_SAMPLED = 20_000  # nodes that show how big a model is
# What ccx takes for requests of results at nodes.
_CALCULIX_REQUESTS = ("NODEFILE", "ELFILE", "NODEOUTPUT", "ELEMENTOUTPUT")
# More increments than any step has: what is written is its last one.
_AT_END = 100000

# Numbers by instance; "" where there are none.
_Members = Mapping[str, list[int]]


@dataclass(frozen=True, slots=True)
class Place:
    """A node `at` (x, y), in a solid model (x, y, z), in the deck's unit.

    `instance` is "" without instances.
    """

    node: int
    at: tuple[float, ...]
    instance: str
    where: str


@dataclass(frozen=True, slots=True, eq=False)
class Scope:
    """Blocks whose numbers count together: a part as an instance puts it, or all."""

    instance: str
    blocks: tuple[Block, ...]
    shift: tuple[float, ...] = (0.0, 0.0, 0.0)
    rotated: str = ""


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
        ``"calculix"`` or ``"abaqus"``; None: `solver_of` the deck.
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
    if request.results == "both":
        raise DeckError("results both are Marc's, expected binary or text")
    abaqus = (dialect or solver_of(data)) == "abaqus"
    deck = read_inp(data, abaqus=abaqus, resolver=resolver)
    drive = find_drive(deck, request)
    units, stated = _units(deck, request)
    scopes = _scopes_of(deck)
    places: dict[str, Place] = {}
    if request.afferents:
        found = _find_nodes(deck, scopes, list(request.afferents.values()))
        places = dict(zip(request.afferents, found, strict=True))
    own = _OwnDeck(deck, drive, motion, request, abaqus)
    own.remarks += [f"read as a deck for {'Abaqus' if abaqus else 'CalculiX'}", *stated]
    by_heading = bool(stated) and request.length_unit is None
    own.remarks += too_far(motion, _size_of(deck) * units.length_mm, units, by_heading)
    if not abaqus:
        own.remarks += _path_dependent(deck)
    own.put_waveform(units.length_mm)
    own.put_increments()
    own.put_output(scopes, places)
    own.remarks += [
        f"{one.where}: {one.name} was not read, and what it holds is not known"
        for one in deck.inclusions
        if not one.read
    ]
    return Rebased(
        deck=edited(data, own.edits),
        remarks=tuple(own.remarks),
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


def solver_of(data: bytes) -> str:
    """Whose deck `data` is: ``"abaqus"`` or ``"calculix"``.

    ccx reads much of what Abaqus does and drops the rest with a warning, so a deck is
    taken for ccx unless something in it has no sense there.
    """
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
            return "abaqus"
    return "calculix"


class _OwnDeck:
    """What is changed of a deck, for `abaqus` or ccx: `edits`, and `remarks` on them, grow."""

    def __init__(
        self, deck: Deck, drive: Drive, motion: Motion, request: Request, abaqus: bool
    ) -> None:
        self.deck, self.drive, self.motion, self.abaqus = deck, drive, motion, abaqus
        self.request, self.automatic = request, request.increments == "automatic"
        self.edits = list[Edit]()
        self.remarks = list[str]()

    def remark(self, at: Block | Push, words: str) -> None:
        """Say what was chosen or changed at a place."""
        self.remarks.append(f"{at.where}: {words}")

    # ---- The waveform: an amplitude that counts total time begins where the step does.

    def put_waveform(self, length_mm: float) -> None:
        """The motion as the amplitude's data."""
        drive, motion, curve = self.drive, self.motion, self.drive.amplitude
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
        samples = f"holds the waveform, {len(motion.time_s)} samples"
        if curve is None:
            self._put_amplitude(lines)
            first, instead = drive.push[0], ""
            if first.amplitude not in ("", OWN_AMPLITUDE):
                instead = f" ({first.amplitude} has other users, or cannot hold a waveform)"
            self.remark(
                first, f"{first.name} gets an amplitude, {OWN_AMPLITUDE}{instead}, which {samples}"
            )
        else:
            rows = list(curve.rows())
            self._in_place_of(curve, rows, lines)
            clock = "total time" if drive.total_time else "step time"
            words = f"amplitude {curve.word('NAME')} ({clock}) {samples} in place of"
            self.remark(curve, f"{words} {len(rows)} data lines")
            if drive.step.number == 1 and rows and (began := rows[0].number(1, blank=0.0)):
                words = f"it began at {began:g}; the waveform begins where the mesh has the probe"
                self.remark(curve, words)
        self._say_way(length_mm)
        for later in drive.steps[drive.step.number :]:
            text = later.head.text if later.head.text.name else later.end.text
            self.remark(later.head, "left out to *END STEP, the run ends with the waveform")
            self._edit(text, later.head.start, later.end.body)

    def _say_way(self, length_mm: float) -> None:
        """Where the waveform leads, from where, in which unit, and from when."""
        drive, first = self.drive, self.drive.push[0]
        signs = {push.magnitude > 0 for push in drive.push}
        for push in drive.push if len(signs) > 1 else (first,):
            sign = "+" if push.magnitude > 0 else "-"
            self.remark(push, f"depth moves {push.what} along {sign}{_AXES[push.axis]}")
        if drive.stands:
            words = f"the steps before leave {first.what} {drive.stands * length_mm:g} mm deep"
            self.remark(first, f"{words}; the waveform begins there")
        if drive.factor != 1:
            words = f"magnitude {first.magnitude:g}: the waveform is divided by {drive.factor:g}"
            self.remark(first, words)
        if length_mm != 1:
            self.remarks.append(f"one length unit of the deck is {length_mm:g} mm")
        if drive.start_s is None:
            self.remark(drive.step.head, "at what total time the step begins is not known")
        elif drive.start_s > 0:
            words = (
                f"the step begins at {drive.start_s:g} s of total time, and the waveform with it"
            )
            self.remark(drive.step.head, words)

    def _put_amplitude(self, lines: list[str]) -> None:
        """An amplitude before the first step, and on the lines that move the probe."""
        use = f"AMPLITUDE={OWN_AMPLITUDE}"
        head = self.drive.steps[0].head
        self._insert(head.text, head.start, [f"*AMPLITUDE, NAME={OWN_AMPLITUDE}", *lines])
        for start in dict.fromkeys(push.block.start for push in self.drive.push):
            mine = [push for push in self.drive.push if push.block.start == start]
            block, rows = mine[0].block, list(mine[0].block.rows())
            ours = {push.row.start for push in mine}
            moved = [row for row in rows if row.start in ours]
            said = [
                f"{mine[0].what}, {mine[0].axis}, {mine[0].axis}, {mine[0].magnitude:g}."
                if mine[0].by_request
                else block.text.data[row.start : row.stop].strip().decode("latin-1")
                for row in moved
            ]
            if len(moved) == len(rows):
                self._set_option(block, block.option("AMPLITUDE"), use)
                if mine[0].by_request:
                    self._in_place_of(block, moved, said)
                continue
            for row in moved:
                self._edit(row.text, row.start, row.stop)
            again = block.option("OP")
            op = f", OP={again.word}" if again is not None else ""
            self._insert(block.text, rows[-1].stop, [f"*BOUNDARY, {use}{op}", *said])

    # ---- Increments: fixed ones, one a sample, or automatic ones of a sample at most. Solvers
    # end an increment at each time point, so results come at the samples either way.

    def put_increments(self) -> None:
        """The procedure's line and options in the waveform's step."""
        motion, count, procedure = self.motion, self.motion.increments, self._procedure()
        creeping = procedure.keyword == "VISCO" and self.abaqus
        self._allow(procedure, count * (_CUTS if self.automatic else 1))
        dt, period = fixed(motion.dt_s, _TIME_DIGITS), fixed(count * motion.dt_s, _TIME_DIGITS)
        direct = procedure.option("DIRECT")
        if self.automatic:
            if creeping:
                raise procedure.error(
                    "*VISCO has automatic increments with CETOL, which is not set"
                )
            if direct is not None:
                self._drop_option(procedure, direct)
            self._put_time_points(f"{dt}, {period}, {dt}")
            line = f"{dt}, {period}, {fixed(_SMALLEST * motion.dt_s, 9)}, {dt}"
            takes = f" takes increments of {motion.dt_s:g} s or less, with results at {count} time"
            takes += " points"
        else:
            line, takes = f"{dt}, {period}", f", DIRECT takes {count} increments"
            if direct is None:
                if not creeping:  # whose increments are fixed without CETOL
                    self._set_option(procedure, None, "DIRECT")
            elif direct.word.startswith("NO") and not (self.abaqus and direct.word == "NOSTOP"):
                self._set_option(procedure, direct, "DIRECT")  # to ccx, NO STOP is a no
        rows = list(procedure.rows())[:1]
        was = procedure.text.data[rows[0].start : rows[0].stop].strip() if rows else b"nothing"
        self._in_place_of(procedure, rows, [line])
        words = f"{procedure.title}{takes}: {line} (was: {was.decode('latin-1')})"
        self.remark(procedure, words)

    def _procedure(self) -> Block:
        """The procedure of the waveform's step, which leaves the increments to us."""
        step, curve = self.drive.step, self.drive.amplitude
        found = step.of(*MOVABLE)
        if len(found) != 1:
            kinds = ", ".join(f"*{name}" for name in MOVABLE)
            there = "; ".join(f"{block.title}, {block.where}" for block in found)
            raise step.head.error(
                f"a waveform needs one of {kinds} in its step, found {there or 'none'}"
            )
        (procedure,) = found
        own_ways = [(step.head, "PERTURBATION")]
        own_ways += [(procedure, name) for name in ("RIKS", "EXPLICIT", "SUBSPACE")]
        if procedure.keyword == "VISCO" and self.abaqus:
            own_ways.append((procedure, "CETOL"))
        for block, name in own_ways:
            if block.option(name) is not None:
                raise block.error(
                    f"{block.title}, {name} has no increments in time or chooses them itself; the "
                    "waveform needs its own"
                )
        smooth = curve.option("SMOOTH") if curve is not None else None
        sharp = smooth is not None and smooth.word.strip("0.") == ""
        if procedure.keyword == "DYNAMIC" and self.abaqus and not sharp:
            raise (curve or step.head).error(
                "in *DYNAMIC Abaqus rounds an amplitude's corners by SMOOTH, 0.25 "
                "without it, and the waveform with them; write SMOOTH=0"
            )
        return procedure

    def _allow(self, procedure: Block, needed: int) -> None:
        """Let a solver take `needed` increments: INC, for ccx NLGEOM and a solver it has."""
        head, up_to_here = self.drive.step.head, self.drive.steps[: self.drive.step.number]
        option = head.option("INC")
        most = _DEFAULT_MOST if option is None else whole(option.value or "", head.where)
        if most < needed:
            self.remark(head, f"INC raised from {most} to {needed}")
            self._set_option(head, option, f"INC={needed}")
        if self.abaqus:
            return
        linear = procedure.keyword != "DYNAMIC" and not self.deck.of(*_NONLINEAR)
        if linear and not any(one.head.option("NLGEOM") for one in up_to_here):
            words = "NLGEOM put in: without it, contact or a nonlinear material ccx makes one"
            self.remark(head, f"{words} increment of a step")
            self._set_option(head, None, "NLGEOM")
        for one in (each for step in up_to_here for each in step.of(*MOVABLE)):
            solver = one.option("SOLVER")
            if solver is not None and solver.word not in _SOLVERS and not one.text.name:
                words = f"SOLVER={solver.word} left out: not every ccx has it, and each takes the"
                self.remark(one, f"{words} best of its own")
                self._drop_option(one, solver)

    def _put_time_points(self, line: str) -> None:
        """The samples as points in time, before the first step or where the deck has them."""
        for block in self.deck.of("TIMEPOINTS"):
            if block.word("NAME") == _TIMES:
                self._in_place_of(block, list(block.rows()), [line])
                return
        head = self.drive.steps[0].head
        self._insert(head.text, head.start, [f"*TIME POINTS, NAME={_TIMES}, GENERATE", line])

    # ---- What the step writes: displacement and stress, in every increment, on the afferents'
    # nodes or on all; in a deck for ccx the step before writes its last increment too.
    #
    #     *NSET, NSET=AFFERENT_SA
    #     118,
    #     *NSET, NSET=FEMBRIDGE_OUTPUT
    #     118, 140, 163,
    #
    # A set of that name that the deck has already must hold the same, since solvers add to a
    # set that is defined again.

    def put_output(self, scopes: list[Scope], places: Mapping[str, Place]) -> None:
        """What is to be written at `places`, or at all nodes."""
        on_set = bool(places) and not self.request.all_nodes
        what = f"the nodes of {', '.join(places)}" if on_set else "all nodes"
        if places:
            self._put_sets(scopes, places)
        for step in [self.drive.step] if self.abaqus else self._steps_to_write():
            if self.abaqus:
                gone, lines = _abaqus_requests(step), self._abaqus_request(on_set)
            else:
                gone = step.of(*_CALCULIX_REQUESTS)
                lines = self._calculix_request(step, on_set)
            every = "every time point" if self.automatic else "every increment"
            when = every if step is self.drive.step else "its last increment"
            for block in gone:  # keyword line and data; comments under it stay
                self._edit(block.text, block.start, block.body)
                for row in block.rows():
                    self._edit(row.text, row.start, row.stop)
            self._insert(step.end.text, step.end.start, lines)
            removed = ", ".join(f"{block.title} ({block.where})" for block in gone)
            instead = f", in place of {removed}" if removed else ""
            self.remark(step.end, f"U and S at {what}, {when}{instead}")

    # ---- CalculiX: the last request decides how often and whether binary, for all of them, so
    # ours come last in their step. ccx writes nothing when a step begins: what a trace has at
    # the waveform's start is the last increment of the step before.

    def _calculix_request(self, step: Step, on_set: bool) -> list[str]:
        """Request of U and S in `step`: every sample or, before the waveform's, its last."""
        stay = [block for block in step.blocks if block.keyword not in _CALCULIX_REQUESTS]
        timed = [block for block in stay if block.option("TIMEPOINTS") is not None]
        often = ", FREQUENCY=1"
        if step is not self.drive.step:  # points in time come before a number of increments
            often = "" if timed else f", FREQUENCY={_AT_END}"
        elif self.automatic:
            often = f", TIME POINTS={_TIMES}"
        elif timed:
            raise timed[0].error(
                f"{timed[0].title}, TIME POINTS: ccx refuses it with fixed increments; take it "
                "out, or let increments be automatic"
            )
        nodes = f", NSET={_OUTPUT_SET}{often}{self._flat(step)}" if on_set else often
        if self.request.results == "text":
            return [f"*NODE FILE{nodes}", "U", f"*EL FILE{nodes}", "S"]
        return [f"*NODE OUTPUT{nodes}, DOUBLE", "U", f"*ELEMENT OUTPUT{nodes}, DOUBLE", "S"]

    def _steps_to_write(self) -> list[Step]:
        """The waveform's step and, where it has one before it in time, that one."""
        before = self.drive.steps[: self.drive.step.number - 1][-1:]
        return [*(step for step in before if step.of(*MOVABLE)), self.drive.step]

    def _flat(self, step: Step) -> str:
        """``OUTPUT=2D`` where something asks for 3D, which has no sets of nodes.

        Expanded nodes have numbers of their own, and results on a set of the deck's nodes
        are then empty. ccx 2.20 takes the word in the first step alone.
        """
        written = self._steps_to_write()
        for one in self.drive.steps[: self.drive.step.number]:
            for block in one.blocks:
                gone = one in written and block.keyword in _CALCULIX_REQUESTS
                if gone or block.word("OUTPUT") != "3D":
                    continue
                if one.number > 1 or one not in written:
                    raise block.error(
                        f"{block.title}, OUTPUT=3D: ccx then writes nothing for a set of "
                        "the deck's nodes; take it out"
                    )
                return ", OUTPUT=2D" if step is one else ""
        return ""

    # ---- Abaqus writes the state at the start of each step by itself. Positions ``NODES`` are
    # values of each element by itself, so that nothing is averaged over layers.

    def _abaqus_request(self, on_set: bool) -> list[str]:
        often = f"TIME POINTS={_TIMES}" if self.automatic else "FREQUENCY=1"
        nodes, elements = (f", {kind}={_OUTPUT_SET}" * on_set for kind in ("NSET", "ELSET"))
        return [
            f"*OUTPUT, FIELD, {often}",
            f"*NODE OUTPUT{nodes}",
            "U,",
            f"*ELEMENT OUTPUT{elements}, POSITION=NODES",
            "S,",
        ]

    # ---- Sets: one an afferent, one for all

    def _put_sets(self, scopes: list[Scope], places: Mapping[str, Place]) -> None:
        """Those sets that the deck has not yet, before its first step or the assembly's end."""
        wanted: dict[tuple[str, str], _Members] = {}
        together: dict[str, dict[int, Place]] = {}
        for name, place in places.items():
            key = "NSET", f"AFFERENT_{name.upper()}"
            if not _SET_NAME.fullmatch(name) or key in wanted:
                raise DeckError(
                    f"afferent {name!r}: its name becomes that of a set, and may have letters, "
                    "digits, - and _, and be there once"
                )
            wanted[key] = {place.instance: [place.node]}
            together.setdefault(place.instance, {})[place.node] = place
        wanted["NSET", _OUTPUT_SET] = {instance: list(some) for instance, some in together.items()}
        if self.abaqus:
            wanted["ELSET", _OUTPUT_SET] = _elements_around(scopes, together)
        lines, names = list[str](), dict[str, None]()
        for (keyword, name), numbers in wanted.items():
            makers = (keyword, "NODE", "ELEMENT")
            outside = [one for one in scopes[0].blocks if one.keyword in makers]
            there = [one for one in outside if one.word(keyword) == name]
            if there and not _holds(there, numbers):
                raise there[0].error(
                    f"set {name} is there already and holds something else than the output "
                    "asked for; rename or remove it"
                )
            for instance, some in () if there else numbers.items():
                of = f", INSTANCE={instance}" if instance else ""
                lines += [f"*{keyword}, {keyword}={name}{of}", *list_lines(some).splitlines()]
                names[name] = None  # a node set and an element set may share it
        if not lines:
            return
        ends = self.deck.of("ENDASSEMBLY") if any(together) else [self.drive.steps[0].head]
        if len(ends) != 1:
            raise DeckError(f"{len(ends)} *END ASSEMBLY, expected one to put sets before")
        text, start = ends[0].text, ends[0].start
        self._insert(text, start, lines)
        line = text.data.count(b"\n", 0, start) + 1
        self.remarks.append(f"line {line}: before it, sets {', '.join(names)}")

    # ---- Edits

    def _edit(self, text: Text, start: int, stop: int, new: bytes = b"") -> None:
        """`new` in the place of the deck's bytes; of a file that it includes none is changed."""
        if text.name:
            line = text.data.count(b"\n", 0, start) + 1
            raise DeckError(
                f"{text.place(line)}: would have to change, and an included file is not "
                "changed; put this line and its data into the deck itself"
            )
        self.edits.append(Edit(start, stop, new))

    def _insert(self, text: Text, place: int, lines: list[str]) -> None:
        """`lines` where a line begins, with line ends as the deck has them."""
        new = b"".join(line.encode("latin-1") + text.newline for line in lines)
        if place and text.data[place - 1 : place] != b"\n":  # after a last line without end
            new = text.newline + new.removesuffix(text.newline)
        self._edit(text, place, place, new)

    def _in_place_of(self, block: Block, rows: list[Row], lines: list[str]) -> None:
        """`lines` where the first of a block's `rows` is; the others go.

        Comments between them stay. Without rows the lines follow the keyword line.
        """
        if not rows:
            self._insert(block.text, block.body, lines)
            return
        first, *others = rows
        text = first.text
        said = text.data[first.start : first.stop]
        end = said[len(said.rstrip(b"\r\n")) :]
        joined = (end or text.newline).join(line.encode("ascii") for line in lines) + end
        if rows[-1].stop == len(text.data) and not text.data.endswith(b"\n"):
            joined = joined.removesuffix(end)  # the deck's last line had no end
        self._edit(text, first.start, first.stop, joined)
        for row in others:
            self._edit(row.text, row.start, row.stop)

    def _drop_option(self, block: Block, there: Option) -> None:
        """Take an option out of the keyword line, with the comma before it."""
        comma = block.text.data.rindex(b",", block.start, there.start)
        self._edit(block.text, comma, there.stop)

    def _set_option(self, block: Block, there: Option | None, new: str) -> None:
        """`new` in the place of an option of the keyword line, or behind the last one."""
        if there is not None:
            self._edit(block.text, there.start, there.stop, new.encode())
            return
        comma = " " if block.text.data[block.head - 1 : block.head] == b"," else ", "
        self._edit(block.text, block.head, block.head, f"{comma}{new}".encode())


def _abaqus_requests(step: Step) -> list[Block]:
    """The field requests of nodes and elements, with an ``*OUTPUT`` left empty.

    History requests, contact and energy stay, and so do ``.fil`` and printed tables.
    """
    groups: list[list[Block]] = []
    for block in step.blocks:
        if block.keyword == "OUTPUT":
            groups.append([block])
        elif groups and block.keyword.endswith("OUTPUT"):
            groups[-1].append(block)
    gone: list[Block] = []
    for head, *others in groups:
        parts = [one for one in others if one.keyword in ("NODEOUTPUT", "ELEMENTOUTPUT")]
        if head.option("FIELD") is not None:
            gone += [head, *others] if len(parts) == len(others) else parts
    return gone


def _holds(blocks: list[Block], wanted: _Members) -> bool:
    """Whether a set holds just that; not where that takes more than reading."""
    expected = {(squeezed(name), number) for name, some in wanted.items() for number in some}
    found: set[tuple[str, int]] = set()
    try:
        for block in blocks:
            for run in members(block, {}):
                if len(run) > len(expected):
                    return False
                found.update((block.word("INSTANCE"), number) for number in run)
    except DeckError:
        return False
    return found == expected


def _elements_around(scopes: list[Scope], nodes: Mapping[str, Mapping[int, Place]]) -> _Members:
    """Numbers of the elements at `nodes`, by instance and in deck order."""
    found: dict[str, list[int]] = {}
    for scope in scopes:
        wanted = nodes.get(scope.instance, {})
        reached: set[int] = set()
        for block in scope.blocks if wanted else ():
            for number, corners in _elements(block) if block.keyword == "ELEMENT" else ():
                if here := wanted.keys() & corners:
                    found.setdefault(scope.instance, []).append(number)
                    reached |= here
        for node in wanted.keys() - reached:
            raise DeckError(
                f"{wanted[node].where}: no *ELEMENT of the deck has node {node}, so it "
                "has no stress"
            )
    return found


def _elements(block: Block) -> Iterator[tuple[int, set[int]]]:
    """Number and nodes of each element; a line ending in a comma goes on."""
    words: list[str] = []
    for row in (*block.rows(), None):
        if row is not None:
            words += row.words
            if not words[-1]:
                words.pop()
                continue
        # In an assembly a node may be named with its instance; such an element is no skin.
        if words and all(word.isascii() and word.isdigit() for word in words):
            yield int(words[0]), set(map(int, words[1:]))
        words = []


# ---- Nodes


def _scopes_of(deck: Deck) -> list[Scope]:
    """The scopes of a deck: one, or the assembly's own and one an instance."""
    parts: dict[str, list[Block]] = {}
    scopes: list[Scope] = []
    outside: list[Block] = []
    inside: list[Block] = []
    opened: Block | None = None
    for block in deck.blocks:
        if opened is not None and block.keyword in (*_OPENING, "ENDASSEMBLY", "STEP"):
            raise opened.error(f"this {opened.title} has no *END {opened.title[1:]}")
        if block.keyword in _OPENING:
            opened, inside = block, []
        elif opened is not None and block.keyword == f"END{opened.keyword}":
            if opened.keyword == "PART":
                parts[opened.word("NAME")] = inside
            else:
                scopes.append(_instance(opened, parts, inside))
            opened = None
        else:
            (outside if opened is None else inside).append(block)
    return [Scope("", tuple(outside)), *scopes]


def _instance(block: Block, parts: dict[str, list[Block]], own: list[Block]) -> Scope:
    part = block.word("PART")
    if part and part not in parts:
        raise block.error(f"*INSTANCE of part {part}, which is nowhere before it")
    option = block.option("NAME")
    if option is None:
        raise block.error(f"{block.title} without NAME=")
    # With its case and quotes, which Abaqus heeds together.
    said = block.text.data[option.start : option.stop].partition(b"=")[2]
    name = said.strip().decode("latin-1")
    rows = list(block.rows())
    shift = tuple(rows[0].number(one, blank=0.0) for one in range(3)) if rows else (0.0,) * 3
    rotated = rows[1].where if len(rows) > 1 else ""
    return Scope(name, (*parts.get(part, ()), *own), shift, rotated)


def _find_nodes(deck: Deck, scopes: list[Scope], nodes: list[int]) -> list[Place]:
    """Find each of `nodes`, in that order."""
    found: dict[int, list[Place]] = {node: [] for node in nodes}
    solid = any(block.word("TYPE").startswith(_SOLID) for block in deck.of("ELEMENT"))
    for scope in scopes:
        for node, place in _nodes_in(scope, nodes, 3 if solid else 2).items():
            found[node].append(place)
    for node, places in found.items():
        if not places:
            made = deck.of(*_NODE_MAKERS)
            hint = f"; {made[0].title}, {made[0].where}, is not followed" if made else ""
            raise DeckError(f"no *NODE of the deck defines node {node}{hint}{deck.unread}")
        if len(places) > 1:
            listed = ", ".join(f"{one.instance or 'the assembly'} ({one.where})" for one in places)
            raise DeckError(
                f"node {node} is in several instances: {listed}; give one of them another number"
            )
    return [found[node][0] for node in nodes]


def _nodes_in(scope: Scope, nodes: list[int], axes: int) -> dict[int, Place]:
    """Those of `nodes` that the scope defines."""
    found: dict[int, Place] = {}
    for block in scope.blocks:
        for row in _rows_of(block, nodes) if block.keyword == "NODE" else ():
            if block.word("SYSTEM") not in ("", "R"):
                raise block.error(
                    f"*NODE, SYSTEM={block.word('SYSTEM')}: node {row.words[0]} is not in "
                    "rectangular coordinates"
                )
            node = row.whole(0)
            at = tuple(row.number(1 + k, blank=0.0) + scope.shift[k] for k in range(axes))
            found[node] = Place(node, at, scope.instance, row.where)  # the last one counts
    moved = [block.where for block in scope.blocks if block.keyword == "SYSTEM"]
    if found and (moved or scope.rotated):
        raise DeckError(
            f"{(moved or [scope.rotated])[0]}: rotates or moves the nodes of "
            f"{scope.instance or 'the deck'}, and where they come to lie is not worked out; "
            "write them in global coordinates"
        )
    return found


def _rows_of(block: Block, nodes: list[int]) -> Iterator[Row]:
    """Data lines that begin with one of `nodes`: found by a search of the bytes."""
    numbers = "|".join(map(str, nodes)).encode()
    wanted = re.compile(rb"^[ \t]*0*(?:" + numbers + rb")[ \t]*[,\r\n]", re.MULTILINE)
    for piece in block.pieces:
        data = piece.text.data
        for match in wanted.finditer(data, piece.start, piece.stop):
            line = piece.line + data.count(b"\n", piece.start, match.start())
            end = data.find(b"\n", match.start(), piece.stop) + 1 or piece.stop
            yield from Piece(piece.text, match.start(), end, line).rows()


def _size_of(deck: Deck) -> float:
    """The longest side of the box around the nodes, in the deck's unit; of many, a sample."""
    lines = [
        line
        for block in deck.of("NODE")
        for piece in block.pieces
        for line in piece.text.data[piece.start : piece.stop].splitlines()
    ]
    box = [[math.inf, -math.inf] for _ in range(3)]
    for line in lines[:: len(lines) // _SAMPLED + 1]:
        for side, word in zip(box, line.split(b",")[1:4], strict=False):
            with suppress(ValueError):
                value = float(word)
                side[:] = min(side[0], value), max(side[1], value)
    return max(0.0, *(last - first for first, last in box))
