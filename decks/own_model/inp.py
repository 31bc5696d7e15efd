"""A base deck with keywords (``.inp``) and a new waveform: edits in three places.

The data of the amplitude that moves the probe, the increments of the step in which it moves,
and the output requests of that step are replaced; all other bytes are kept, comments, case
and line ends included. A probe without such an amplitude gets one. A missing or ambiguous
entry is refused, with its line.

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
    normalized_name,
    parse_integer,
    read_inp,
)
from decks.keyword_deck import fixed, list_lines, pair_lines
from decks.motion import Motion
from decks.own_model import Edit, Rebased, Request, apply_edits, size_warnings
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
_DEFAULT_INCREMENTS = 100  # increments of a step without INC=, in ccx and in Abaqus
# Automatic increments: the smallest, as a part of a sample, and how many to allow for one.
_MIN_INCREMENT_SHARE = 1.0e-4
_INCREMENTS_PER_SAMPLE = 20
# Equation solvers that every ccx has; PrePoMax asks for PARDISO.
_SOLVERS = ("SPOOLES", "ITERATIVESCALING", "ITERATIVECHOLESKY")
# What makes ccx take increments at all; without any of it a step is one.
_NONLINEAR = (
    *("CONTACTPAIR", "CREEP", "DEFORMATIONPLASTICITY", "HYPERELASTIC", "HYPERFOAM"),
    *("MOHRCOULOMB", "PLASTIC", "USERMATERIAL"),
)
_OUTPUT_SET = "FEMBRIDGE_OUTPUT"
# Of automatic increments: the samples, at which results are written.
_TIME_POINTS = "FEMBRIDGE_TIMES"
_SET_NAME = re.compile(r"[A-Za-z0-9_-]+")
_SCOPE_KEYWORDS = ("PART", "INSTANCE")
_NODE_MAKERS = ("NCOPY", "NFILL", "NGEN", "NMAP")
# Elements of a solid model, where z counts.
_SOLID = ("C3D", "M3D", "SC", "S3", "S4", "S6", "S8")
_MAX_SAMPLED_NODES = 20_000  # nodes that show how big a model is
# What ccx takes for requests of results at nodes.
_CALCULIX_REQUESTS = ("NODEFILE", "ELFILE", "NODEOUTPUT", "ELEMENTOUTPUT")
# More increments than any step has: what is written is its last one.
_LAST_INCREMENT_ONLY = 100000

# Numbers by instance; "" where there are none.
_Members = Mapping[str, list[int]]


@dataclass(frozen=True, slots=True)
class NodePosition:
    """A node and its position, (x, y) or, in a solid model, (x, y, z), in the deck's unit.

    `instance` is "" in a deck without instances.
    """

    node: int
    position: tuple[float, ...]
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
    positions: dict[str, NodePosition] = {}
    if request.afferents:
        nodes = _find_nodes(deck, scopes, list(request.afferents.values()))
        positions = dict(zip(request.afferents, nodes, strict=True))
    editor = _DeckEditor(deck, drive, motion, request, abaqus)
    editor.remarks += [f"read as a deck for {'Abaqus' if abaqus else 'CalculiX'}", *stated]
    by_heading = bool(stated) and request.length_unit is None
    editor.remarks += size_warnings(motion, _model_size(deck) * units.length_mm, units, by_heading)
    if not abaqus:
        editor.remarks += _path_dependent(deck)
    editor.write_waveform(units.length_mm)
    editor.write_increments()
    editor.write_output(scopes, positions)
    editor.remarks += [
        f"{inclusion.where}: {inclusion.name} was not read, and what it holds is not known"
        for inclusion in deck.inclusions
        if not inclusion.read
    ]
    return Rebased(
        deck=apply_edits(data, editor.edits),
        remarks=tuple(editor.remarks),
        place_mm={
            name: tuple(units.length_mm * value for value in position.position)
            for name, position in positions.items()
        },
        needs=tuple(dict.fromkeys(inclusion.name for inclusion in deck.inclusions)),
        before_s=drive.start_s or 0.0,
        stands_mm=drive.start_depth * units.length_mm,
        units=units,
    )


def _units(deck: Deck, request: Request) -> tuple[UnitSystem, list[str]]:
    """Units of the request, else of the heading, else mm; and what was found."""
    requested = request.length_unit and LENGTH_UNITS[request.length_unit]
    for block in deck.blocks_of("HEADING"):
        text = b"".join(piece.text.data[piece.start : piece.stop] for piece in block.pieces)
        stated = unit_system_in(text.decode("latin-1"))
        if stated is not None:
            remark = f"{block.where}: *HEADING: unit system {stated}"
            if requested and requested.length_unit != stated.length_unit:
                return requested, [
                    f"{remark}; it is taken to be in {requested.length_unit} all the same"
                ]
            return stated, [remark]
    return requested or MM, []


def _path_dependent(deck: Deck) -> list[str]:
    """Warnings of contact whose stress depends on the history of the depth."""
    return [
        f"{block.where}: {block.title}, TYPE={block.value_of('TYPE')} is path-dependent in "
        "CalculiX: on unloading, stress at a depth differs from that on loading (by 1.7 % on a "
        "block, up to 20 %); TYPE=NODE TO SURFACE is not"
        for block in deck.blocks_of("CONTACTPAIR")
        if block.value_of("TYPE") == "SURFACETOSURFACE"
    ]


def solver_of(data: bytes) -> str:
    """Whose deck `data` is: ``"abaqus"`` or ``"calculix"``.

    ccx reads much of what Abaqus does and drops the rest with a warning, so a deck is
    taken for ccx unless something in it has no sense there.
    """
    for block in blocks_in(Text(data)):
        kind = block.value_of("TYPE")
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


class _DeckEditor:
    """Editor of a deck for Abaqus or ccx: collects `edits` and `remarks`."""

    def __init__(
        self, deck: Deck, drive: Drive, motion: Motion, request: Request, abaqus: bool
    ) -> None:
        self.deck, self.drive, self.motion, self.abaqus = deck, drive, motion, abaqus
        self.request, self.automatic = request, request.increments == "automatic"
        self.edits = list[Edit]()
        self.remarks = list[str]()

    def remark(self, source: Block | Push, message: str) -> None:
        """Add a remark with the line of `source`."""
        self.remarks.append(f"{source.where}: {message}")

    # ---- The waveform: an amplitude that counts total time begins where the step does.

    def write_waveform(self, length_mm: float) -> None:
        """The motion as the amplitude's data."""
        drive, motion, curve = self.drive, self.motion, self.drive.amplitude
        depth = drive.start_depth + motion.depth_mm / length_mm
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
            self._insert_amplitude(lines)
            first, reason = drive.push[0], ""
            if first.amplitude not in ("", OWN_AMPLITUDE):
                reason = f" ({first.amplitude} has other users, or cannot hold a waveform)"
            self.remark(
                first, f"{first.name} gets an amplitude, {OWN_AMPLITUDE}{reason}, which {samples}"
            )
        else:
            rows = list(curve.rows())
            self._replace_rows(curve, rows, lines)
            clock = "total time" if drive.total_time else "step time"
            message = f"amplitude {curve.value_of('NAME')} ({clock}) {samples}, replacing"
            self.remark(curve, f"{message} {len(rows)} data lines")
            if drive.step.number == 1 and rows and (began := rows[0].number(1, blank=0.0)):
                message = f"it began at {began:g}; the waveform begins where the mesh has the probe"
                self.remark(curve, message)
        self._remark_motion(length_mm)
        for step in drive.steps[drive.step.number :]:
            text = step.head.text if step.head.text.name else step.end.text
            self.remark(step.head, "left out to *END STEP, the run ends with the waveform")
            self._edit(text, step.head.start, step.end.body)

    def _remark_motion(self, length_mm: float) -> None:
        """Where the waveform leads, from where, in which unit, and from when."""
        drive, first = self.drive, self.drive.push[0]
        signs = {push.magnitude > 0 for push in drive.push}
        for push in drive.push if len(signs) > 1 else (first,):
            sign = "+" if push.magnitude > 0 else "-"
            self.remark(push, f"depth moves {push.target} along {sign}{_AXES[push.axis]}")
        if drive.start_depth:
            message = (
                f"the steps before leave {first.target} {drive.start_depth * length_mm:g} mm deep"
            )
            self.remark(first, f"{message}; the waveform begins there")
        if drive.factor != 1:
            message = f"magnitude {first.magnitude:g}: the waveform is divided by {drive.factor:g}"
            self.remark(first, message)
        if length_mm != 1:
            self.remarks.append(f"one length unit of the deck is {length_mm:g} mm")
        if drive.start_s is None:
            self.remark(drive.step.head, "at what total time the step begins is not known")
        elif drive.start_s > 0:
            message = (
                f"the step begins at {drive.start_s:g} s of total time, and the waveform with it"
            )
            self.remark(drive.step.head, message)

    def _insert_amplitude(self, lines: list[str]) -> None:
        """An amplitude before the first step, and on the lines that move the probe."""
        use = f"AMPLITUDE={OWN_AMPLITUDE}"
        head = self.drive.steps[0].head
        self._insert(head.text, head.start, [f"*AMPLITUDE, NAME={OWN_AMPLITUDE}", *lines])
        for start in dict.fromkeys(push.block.start for push in self.drive.push):
            pushes = [push for push in self.drive.push if push.block.start == start]
            block, rows = pushes[0].block, list(pushes[0].block.rows())
            row_starts = {push.row.start for push in pushes}
            moved = [row for row in rows if row.start in row_starts]
            texts = [
                f"{pushes[0].target}, {pushes[0].axis}, {pushes[0].axis}, {pushes[0].magnitude:g}."
                if pushes[0].by_request
                else block.text.data[row.start : row.stop].strip().decode("latin-1")
                for row in moved
            ]
            if len(moved) == len(rows):
                self._set_option(block, block.option("AMPLITUDE"), use)
                if pushes[0].by_request:
                    self._replace_rows(block, moved, texts)
                continue
            for row in moved:
                self._edit(row.text, row.start, row.stop)
            op_option = block.option("OP")
            op = f", OP={op_option.normalized}" if op_option is not None else ""
            self._insert(block.text, rows[-1].stop, [f"*BOUNDARY, {use}{op}", *texts])

    # ---- Increments: fixed ones, one a sample, or automatic ones of a sample at most. Solvers
    # end an increment at each time point, so results come at the samples either way.

    def write_increments(self) -> None:
        """The procedure's line and options in the waveform's step."""
        motion, count, procedure = self.motion, self.motion.increments, self._procedure()
        creeping = procedure.keyword == "VISCO" and self.abaqus
        self._raise_limits(procedure, count * (_INCREMENTS_PER_SAMPLE if self.automatic else 1))
        dt, period = fixed(motion.dt_s, _TIME_DIGITS), fixed(count * motion.dt_s, _TIME_DIGITS)
        direct = procedure.option("DIRECT")
        if self.automatic:
            if creeping:
                raise procedure.error(
                    "*VISCO has automatic increments with CETOL, which is not set"
                )
            if direct is not None:
                self._drop_option(procedure, direct)
            self._write_time_points(f"{dt}, {period}, {dt}")
            line = f"{dt}, {period}, {fixed(_MIN_INCREMENT_SHARE * motion.dt_s, 9)}, {dt}"
            effect = f" takes increments of {motion.dt_s:g} s or less, with results at {count} time"
            effect += " points"
        else:
            line, effect = f"{dt}, {period}", f", DIRECT takes {count} increments"
            if direct is None:
                if not creeping:  # whose increments are fixed without CETOL
                    self._set_option(procedure, None, "DIRECT")
            elif direct.normalized.startswith("NO") and not (
                self.abaqus and direct.normalized == "NOSTOP"
            ):
                self._set_option(procedure, direct, "DIRECT")  # to ccx, NO STOP is a no
        rows = list(procedure.rows())[:1]
        previous = procedure.text.data[rows[0].start : rows[0].stop].strip() if rows else b"nothing"
        self._replace_rows(procedure, rows, [line])
        message = f"{procedure.title}{effect}: {line} (was: {previous.decode('latin-1')})"
        self.remark(procedure, message)

    def _procedure(self) -> Block:
        """The procedure of the waveform's step, which leaves the increments to us."""
        step, curve = self.drive.step, self.drive.amplitude
        procedures = step.blocks_of(*MOVABLE)
        if len(procedures) != 1:
            kinds = ", ".join(f"*{name}" for name in MOVABLE)
            listed = "; ".join(f"{block.title}, {block.where}" for block in procedures)
            raise step.head.error(
                f"a waveform needs one of {kinds} in its step, found {listed or 'none'}"
            )
        (procedure,) = procedures
        conflicts = [(step.head, "PERTURBATION")]
        conflicts += [(procedure, name) for name in ("RIKS", "EXPLICIT", "SUBSPACE")]
        if procedure.keyword == "VISCO" and self.abaqus:
            conflicts.append((procedure, "CETOL"))
        for block, name in conflicts:
            if block.option(name) is not None:
                raise block.error(
                    f"{block.title}, {name} has no increments in time or chooses them itself; the "
                    "waveform needs its own"
                )
        smooth = curve.option("SMOOTH") if curve is not None else None
        sharp = smooth is not None and smooth.normalized.strip("0.") == ""
        if procedure.keyword == "DYNAMIC" and self.abaqus and not sharp:
            raise (curve or step.head).error(
                "in *DYNAMIC Abaqus rounds an amplitude's corners by SMOOTH, 0.25 "
                "without it, and the waveform with them; write SMOOTH=0"
            )
        return procedure

    def _raise_limits(self, procedure: Block, needed: int) -> None:
        """Let a solver take `needed` increments: INC, for ccx NLGEOM and a solver it has."""
        head, steps = self.drive.step.head, self.drive.steps[: self.drive.step.number]
        option = head.option("INC")
        limit = (
            _DEFAULT_INCREMENTS if option is None else parse_integer(option.value or "", head.where)
        )
        if limit < needed:
            self.remark(head, f"INC raised from {limit} to {needed}")
            self._set_option(head, option, f"INC={needed}")
        if self.abaqus:
            return
        linear = procedure.keyword != "DYNAMIC" and not self.deck.blocks_of(*_NONLINEAR)
        if linear and not any(step.head.option("NLGEOM") for step in steps):
            message = "NLGEOM put in: without it, contact or a nonlinear material ccx makes one"
            self.remark(head, f"{message} increment of a step")
            self._set_option(head, None, "NLGEOM")
        for block in (block for step in steps for block in step.blocks_of(*MOVABLE)):
            solver = block.option("SOLVER")
            if solver is not None and solver.normalized not in _SOLVERS and not block.text.name:
                message = (
                    f"SOLVER={solver.normalized} left out: not every ccx has it, and each takes the"
                )
                self.remark(block, f"{message} best of its own")
                self._drop_option(block, solver)

    def _write_time_points(self, line: str) -> None:
        """The samples as points in time, before the first step or where the deck has them."""
        for block in self.deck.blocks_of("TIMEPOINTS"):
            if block.value_of("NAME") == _TIME_POINTS:
                self._replace_rows(block, list(block.rows()), [line])
                return
        head = self.drive.steps[0].head
        self._insert(head.text, head.start, [f"*TIME POINTS, NAME={_TIME_POINTS}, GENERATE", line])

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

    def write_output(self, scopes: list[Scope], positions: Mapping[str, NodePosition]) -> None:
        """Request results at `positions`, or at all nodes."""
        on_set = bool(positions) and not self.request.all_nodes
        nodes_text = f"the nodes of {', '.join(positions)}" if on_set else "all nodes"
        if positions:
            self._write_sets(scopes, positions)
        for step in [self.drive.step] if self.abaqus else self._steps_to_write():
            if self.abaqus:
                removed_blocks, lines = _abaqus_requests(step), self._abaqus_request(on_set)
            else:
                removed_blocks = step.blocks_of(*_CALCULIX_REQUESTS)
                lines = self._calculix_request(step, on_set)
            interval = "every time point" if self.automatic else "every increment"
            times = interval if step is self.drive.step else "its last increment"
            for block in removed_blocks:  # keyword line and data; comments under it stay
                self._edit(block.text, block.start, block.body)
                for row in block.rows():
                    self._edit(row.text, row.start, row.stop)
            self._insert(step.end.text, step.end.start, lines)
            removed = ", ".join(f"{block.title} ({block.where})" for block in removed_blocks)
            replaced = f", replacing {removed}" if removed else ""
            self.remark(step.end, f"U and S at {nodes_text}, {times}{replaced}")

    # ---- CalculiX: the last request decides how often and whether binary, for all of them, so
    # ours come last in their step. ccx writes nothing when a step begins: what a trace has at
    # the waveform's start is the last increment of the step before.

    def _calculix_request(self, step: Step, on_set: bool) -> list[str]:
        """Request of U and S in `step`: every sample or, before the waveform's, its last."""
        kept_blocks = [block for block in step.blocks if block.keyword not in _CALCULIX_REQUESTS]
        timed = [block for block in kept_blocks if block.option("TIMEPOINTS") is not None]
        frequency = ", FREQUENCY=1"
        if step is not self.drive.step:  # points in time come before a number of increments
            frequency = "" if timed else f", FREQUENCY={_LAST_INCREMENT_ONLY}"
        elif self.automatic:
            frequency = f", TIME POINTS={_TIME_POINTS}"
        elif timed:
            raise timed[0].error(
                f"{timed[0].title}, TIME POINTS: ccx refuses it with fixed increments; take it "
                "out, or let increments be automatic"
            )
        nodes = f", NSET={_OUTPUT_SET}{frequency}{self._output_2d(step)}" if on_set else frequency
        if self.request.results == "text":
            return [f"*NODE FILE{nodes}", "U", f"*EL FILE{nodes}", "S"]
        return [f"*NODE OUTPUT{nodes}, DOUBLE", "U", f"*ELEMENT OUTPUT{nodes}, DOUBLE", "S"]

    def _steps_to_write(self) -> list[Step]:
        """The waveform's step and, where it has one before it in time, that one."""
        before = self.drive.steps[: self.drive.step.number - 1][-1:]
        return [*(step for step in before if step.blocks_of(*MOVABLE)), self.drive.step]

    def _output_2d(self, step: Step) -> str:
        """``OUTPUT=2D`` where something asks for 3D, which has no sets of nodes.

        Expanded nodes have numbers of their own, and results on a set of the deck's nodes
        are then empty. ccx 2.20 takes the word in the first step alone.
        """
        written = self._steps_to_write()
        for earlier in self.drive.steps[: self.drive.step.number]:
            for block in earlier.blocks:
                removed = earlier in written and block.keyword in _CALCULIX_REQUESTS
                if removed or block.value_of("OUTPUT") != "3D":
                    continue
                if earlier.number > 1 or earlier not in written:
                    raise block.error(
                        f"{block.title}, OUTPUT=3D: ccx then writes nothing for a set of "
                        "the deck's nodes; take it out"
                    )
                return ", OUTPUT=2D" if step is earlier else ""
        return ""

    # ---- Abaqus writes the state at the start of each step by itself. Positions ``NODES`` are
    # values of each element by itself, so that nothing is averaged over layers.

    def _abaqus_request(self, on_set: bool) -> list[str]:
        frequency = f"TIME POINTS={_TIME_POINTS}" if self.automatic else "FREQUENCY=1"
        nodes, elements = (f", {kind}={_OUTPUT_SET}" * on_set for kind in ("NSET", "ELSET"))
        return [
            f"*OUTPUT, FIELD, {frequency}",
            f"*NODE OUTPUT{nodes}",
            "U,",
            f"*ELEMENT OUTPUT{elements}, POSITION=NODES",
            "S,",
        ]

    # ---- Sets: one an afferent, one for all

    def _write_sets(self, scopes: list[Scope], positions: Mapping[str, NodePosition]) -> None:
        """Those sets that the deck has not yet, before its first step or the assembly's end."""
        required: dict[tuple[str, str], _Members] = {}
        nodes: dict[str, dict[int, NodePosition]] = {}
        for name, position in positions.items():
            key = "NSET", f"AFFERENT_{name.upper()}"
            if not _SET_NAME.fullmatch(name) or key in required:
                raise DeckError(
                    f"afferent {name!r}: its name becomes that of a set, and may have letters, "
                    "digits, - and _, and be there once"
                )
            required[key] = {position.instance: [position.node]}
            nodes.setdefault(position.instance, {})[position.node] = position
        required["NSET", _OUTPUT_SET] = {
            instance: list(numbers) for instance, numbers in nodes.items()
        }
        if self.abaqus:
            required["ELSET", _OUTPUT_SET] = _elements_around(scopes, nodes)
        lines, names = list[str](), dict[str, None]()
        for (keyword, name), numbers in required.items():
            makers = (keyword, "NODE", "ELEMENT")
            candidates = [block for block in scopes[0].blocks if block.keyword in makers]
            existing = [block for block in candidates if block.value_of(keyword) == name]
            if existing and not _set_has_members(existing, numbers):
                raise existing[0].error(
                    f"set {name} is there already and holds something else than the output "
                    "asked for; rename or remove it"
                )
            for instance, set_numbers in () if existing else numbers.items():
                instance_option = f", INSTANCE={instance}" if instance else ""
                lines += [
                    f"*{keyword}, {keyword}={name}{instance_option}",
                    *list_lines(set_numbers).splitlines(),
                ]
                names[name] = None  # a node set and an element set may share it
        if not lines:
            return
        ends = self.deck.blocks_of("ENDASSEMBLY") if any(nodes) else [self.drive.steps[0].head]
        if len(ends) != 1:
            raise DeckError(f"{len(ends)} *END ASSEMBLY, expected one to put sets before")
        text, start = ends[0].text, ends[0].start
        self._insert(text, start, lines)
        line = text.data.count(b"\n", 0, start) + 1
        self.remarks.append(f"line {line}: before it, sets {', '.join(names)}")

    # ---- Edits

    def _edit(self, text: Text, start: int, stop: int, new: bytes = b"") -> None:
        """Replace bytes of the deck by `new`; a change of an included file is refused."""
        if text.name:
            line = text.data.count(b"\n", 0, start) + 1
            raise DeckError(
                f"{text.location(line)}: would have to change, and an included file is not "
                "changed; put this line and its data into the deck itself"
            )
        self.edits.append(Edit(start, stop, new))

    def _insert(self, text: Text, start: int, lines: list[str]) -> None:
        """`lines` where a line begins, with line ends as the deck has them."""
        new = b"".join(line.encode("latin-1") + text.newline for line in lines)
        if start and text.data[start - 1 : start] != b"\n":  # after a last line without end
            new = text.newline + new.removesuffix(text.newline)
        self._edit(text, start, start, new)

    def _replace_rows(self, block: Block, rows: list[Row], lines: list[str]) -> None:
        """`lines` where the first of a block's `rows` is; the others go.

        Comments between them stay. Without rows the lines follow the keyword line.
        """
        if not rows:
            self._insert(block.text, block.body, lines)
            return
        first, *others = rows
        text = first.text
        old = text.data[first.start : first.stop]
        end = old[len(old.rstrip(b"\r\n")) :]
        joined = (end or text.newline).join(line.encode("ascii") for line in lines) + end
        if rows[-1].stop == len(text.data) and not text.data.endswith(b"\n"):
            joined = joined.removesuffix(end)  # the deck's last line had no end
        self._edit(text, first.start, first.stop, joined)
        for row in others:
            self._edit(row.text, row.start, row.stop)

    def _drop_option(self, block: Block, option: Option) -> None:
        """Take an option out of the keyword line, with the comma before it."""
        comma = block.text.data.rindex(b",", block.start, option.start)
        self._edit(block.text, comma, option.stop)

    def _set_option(self, block: Block, option: Option | None, new: str) -> None:
        """Replace an option of the keyword line by `new`, or append it."""
        if option is not None:
            self._edit(block.text, option.start, option.stop, new.encode())
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
    removed: list[Block] = []
    for head, *others in groups:
        parts = [block for block in others if block.keyword in ("NODEOUTPUT", "ELEMENTOUTPUT")]
        if head.option("FIELD") is not None:
            removed += [head, *others] if len(parts) == len(others) else parts
    return removed


def _set_has_members(blocks: list[Block], required: _Members) -> bool:
    """Whether a set has exactly the `required` members; False if it cannot be read."""
    expected = {
        (normalized_name(name), number) for name, numbers in required.items() for number in numbers
    }
    present: set[tuple[str, int]] = set()
    try:
        for block in blocks:
            for run in members(block, {}):
                if len(run) > len(expected):
                    return False
                present.update((block.value_of("INSTANCE"), number) for number in run)
    except DeckError:
        return False
    return present == expected


def _elements_around(
    scopes: list[Scope], nodes: Mapping[str, Mapping[int, NodePosition]]
) -> _Members:
    """Numbers of the elements at `nodes`, by instance and in deck order."""
    elements: dict[str, list[int]] = {}
    for scope in scopes:
        scope_nodes = nodes.get(scope.instance, {})
        reached: set[int] = set()
        for block in scope.blocks if scope_nodes else ():
            for number, corners in _elements(block) if block.keyword == "ELEMENT" else ():
                if shared := scope_nodes.keys() & corners:
                    elements.setdefault(scope.instance, []).append(number)
                    reached |= shared
        for node in scope_nodes.keys() - reached:
            raise DeckError(
                f"{scope_nodes[node].where}: no *ELEMENT of the deck has node {node}, so it "
                "has no stress"
            )
    return elements


def _elements(block: Block) -> Iterator[tuple[int, set[int]]]:
    """Number and nodes of each element; a line ending in a comma goes on."""
    fields: list[str] = []
    for row in (*block.rows(), None):
        if row is not None:
            fields += row.fields
            if not fields[-1]:
                fields.pop()
                continue
        # In an assembly a node may be named with its instance; such an element is no skin.
        if fields and all(field.isascii() and field.isdigit() for field in fields):
            yield int(fields[0]), set(map(int, fields[1:]))
        fields = []


# ---- Nodes


def _scopes_of(deck: Deck) -> list[Scope]:
    """The scopes of a deck: one, or the assembly's own and one an instance."""
    parts: dict[str, list[Block]] = {}
    scopes: list[Scope] = []
    outside: list[Block] = []
    inside: list[Block] = []
    opened: Block | None = None
    for block in deck.blocks:
        if opened is not None and block.keyword in (*_SCOPE_KEYWORDS, "ENDASSEMBLY", "STEP"):
            raise opened.error(f"this {opened.title} has no *END {opened.title[1:]}")
        if block.keyword in _SCOPE_KEYWORDS:
            opened, inside = block, []
        elif opened is not None and block.keyword == f"END{opened.keyword}":
            if opened.keyword == "PART":
                parts[opened.value_of("NAME")] = inside
            else:
                scopes.append(_instance(opened, parts, inside))
            opened = None
        else:
            (outside if opened is None else inside).append(block)
    return [Scope("", tuple(outside)), *scopes]


def _instance(block: Block, parts: dict[str, list[Block]], instance_blocks: list[Block]) -> Scope:
    part = block.value_of("PART")
    if part and part not in parts:
        raise block.error(f"*INSTANCE of part {part}, which is nowhere before it")
    option = block.option("NAME")
    if option is None:
        raise block.error(f"{block.title} without NAME=")
    # With its case and quotes, which Abaqus heeds together.
    name_text = block.text.data[option.start : option.stop].partition(b"=")[2]
    name = name_text.strip().decode("latin-1")
    rows = list(block.rows())
    shift = tuple(rows[0].number(index, blank=0.0) for index in range(3)) if rows else (0.0,) * 3
    rotated = rows[1].where if len(rows) > 1 else ""
    return Scope(name, (*parts.get(part, ()), *instance_blocks), shift, rotated)


def _find_nodes(deck: Deck, scopes: list[Scope], nodes: list[int]) -> list[NodePosition]:
    """Find each of `nodes`, in that order."""
    candidates: dict[int, list[NodePosition]] = {node: [] for node in nodes}
    solid = any(block.value_of("TYPE").startswith(_SOLID) for block in deck.blocks_of("ELEMENT"))
    for scope in scopes:
        for node, position in _nodes_in(scope, nodes, 3 if solid else 2).items():
            candidates[node].append(position)
    for node, positions in candidates.items():
        if not positions:
            made = deck.blocks_of(*_NODE_MAKERS)
            hint = f"; {made[0].title}, {made[0].where}, is not followed" if made else ""
            raise DeckError(f"no *NODE of the deck defines node {node}{hint}{deck.unread}")
        if len(positions) > 1:
            listed = ", ".join(
                f"{position.instance or 'the assembly'} ({position.where})"
                for position in positions
            )
            raise DeckError(
                f"node {node} is in several instances: {listed}; give one of them another number"
            )
    return [candidates[node][0] for node in nodes]


def _nodes_in(scope: Scope, nodes: list[int], axes: int) -> dict[int, NodePosition]:
    """Those of `nodes` that the scope defines."""
    positions: dict[int, NodePosition] = {}
    for block in scope.blocks:
        for row in _rows_of_nodes(block, nodes) if block.keyword == "NODE" else ():
            if block.value_of("SYSTEM") not in ("", "R"):
                raise block.error(
                    f"*NODE, SYSTEM={block.value_of('SYSTEM')}: node {row.fields[0]} is not in "
                    "rectangular coordinates"
                )
            node = row.integer(0)
            position = tuple(row.number(1 + k, blank=0.0) + scope.shift[k] for k in range(axes))
            positions[node] = NodePosition(
                node, position, scope.instance, row.where
            )  # the last one counts
    moved = [block.where for block in scope.blocks if block.keyword == "SYSTEM"]
    if positions and (moved or scope.rotated):
        raise DeckError(
            f"{(moved or [scope.rotated])[0]}: rotates or moves the nodes of "
            f"{scope.instance or 'the deck'}, and their position is not computed; "
            "write them in global coordinates"
        )
    return positions


def _rows_of_nodes(block: Block, nodes: list[int]) -> Iterator[Row]:
    """Data lines that begin with one of `nodes`: found by a search of the bytes."""
    numbers = "|".join(map(str, nodes)).encode()
    pattern = re.compile(rb"^[ \t]*0*(?:" + numbers + rb")[ \t]*[,\r\n]", re.MULTILINE)
    for piece in block.pieces:
        data = piece.text.data
        for match in pattern.finditer(data, piece.start, piece.stop):
            line = piece.line + data.count(b"\n", piece.start, match.start())
            end = data.find(b"\n", match.start(), piece.stop) + 1 or piece.stop
            yield from Piece(piece.text, match.start(), end, line).rows()


def _model_size(deck: Deck) -> float:
    """The longest side of the box around the nodes, in the deck's unit; of many, a sample."""
    lines = [
        line
        for block in deck.blocks_of("NODE")
        for piece in block.pieces
        for line in piece.text.data[piece.start : piece.stop].splitlines()
    ]
    box = [[math.inf, -math.inf] for _ in range(3)]
    for line in lines[:: len(lines) // _MAX_SAMPLED_NODES + 1]:
        for side, field in zip(box, line.split(b",")[1:4], strict=False):
            with suppress(ValueError):
                value = float(field)
                side[:] = min(side[0], value), max(side[1], value)
    return max(0.0, *(last - first for first, last in box))
