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
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from decks.assembly import Scope, scopes_of
from decks.dialects import SHELL_FACES
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
from decks.own_model import (
    AfferentSite,
    Edit,
    LoadScale,
    Rebased,
    Request,
    apply_edits,
    size_warnings,
    units_per_mm,
)
from decks.own_model.inp_drive import (
    MOVABLE,
    OWN_AMPLITUDE,
    OWN_RAMP,
    Drive,
    Push,
    Step,
    period_s,
)
from decks.own_model.inp_load_drive import drive_of
from decks.own_model.inp_loads import (
    Ramp,
    acts_at_start,
    direction_text,
    initial_stress,
    loads_in,
    mean_stress,
    path_dependence,
    ramps,
    time_dependence,
)
from decks.own_model.inp_model import EXPANDED, Element, ModelScope, elements_in, family_of
from decks.own_model.inp_viscoelastic import Relaxation, relaxations, without_branches
from decks.unit_system import LENGTH_UNITS, MM, UnitSystem, unit_system_in
from fembridge.errors import DeckError
from fembridge.trace import split_afferent_key

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
_STATIC = re.compile(rb"\*[ \t]*STATIC", re.IGNORECASE)
_OUTPUT_SET = "FEMBRIDGE_OUTPUT"
_JOINT_SET = "FEMBRIDGE_OUTPUT_AND_YOURS"
# Of automatic increments: the samples, at which results are written.
_TIME_POINTS = "FEMBRIDGE_TIMES"
_SET_NAME = re.compile(r"[A-Za-z0-9_-]+")
_NODE_MAKERS = ("NCOPY", "NFILL", "NGEN", "NMAP")
# Elements of a solid model, where z counts.
_SOLID = ("C3D", "M3D", "SC", "S3", "S4", "S6", "S8")
_MAX_ALTERNATIVES = 20  # nodes that one pattern finds quickly
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
        expected = "binary or text; both is for Marc"
        raise DeckError(argument="results", found=request.results, expected=expected)
    abaqus = (dialect or solver_of(data)) == "abaqus"
    deck = read_inp(data, abaqus=abaqus, resolver=resolver)
    drive = drive_of(deck, request)
    units, stated = units_of(deck, request)
    per_mm = units_per_mm(units, request.load)
    scopes = scopes_of(deck)
    positions: dict[str, NodePosition] = {}
    if request.afferents:
        nodes = _find_nodes(deck, scopes, list(request.afferents.values()))
        positions = dict(zip(request.afferents, nodes, strict=True))
    sites = {
        name: AfferentSite(tuple(units.length_mm * value for value in position.position))
        for name, position in positions.items()
    }
    at_rest, families = True, frozenset[str]()
    relaxing: list[Relaxation] = []
    elastic_remarks: list[str] = []
    if not abaqus:  # Abaqus writes each element's own stress, and the state at time 0
        scope = ModelScope(scopes[0].blocks)
        families = scope.families
        relaxing, elastic_remarks = _relaxing_materials(deck, scope, drive, request, units, motion)
        terms = {item.name: item.terms for item in relaxing}
        sites = _sites_in_elements(scope, scopes[0], request, sites, terms)
        if not _steps_before(drive):
            sites, at_rest = _with_start_stress(deck, drive, scope, request, sites, units)
    editor = _DeckEditor(deck, drive, motion, request, abaqus)
    editor.expanded = bool(families.intersection(EXPANDED))
    editor.on_faces = any(site.element for site in sites.values())
    editor.relaxing = bool(relaxing)
    editor.doubts += elastic_remarks
    editor.remarks += [f"read as a deck for {'Abaqus' if abaqus else 'CalculiX'}", *stated]
    by_heading = bool(stated) and request.length_unit is None
    if request.load is None:
        size_mm = _model_size(deck) * units.length_mm
        editor.remarks += size_warnings(motion, size_mm, units, by_heading)
    editor.write_waveform(per_mm)
    ramped = editor.write_ramps()
    editor.write_branches(relaxing)
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
        sites=sites,
        needs=tuple(dict.fromkeys(inclusion.name for inclusion in deck.inclusions)),
        before_s=drive.start_s or 0.0,
        stands_mm=drive.start_depth / per_mm,
        units=units,
        doubts=tuple(editor.doubts),
        at_rest=at_rest,
        time_dependent=(
            *(f"{item.name} relaxes: stress depends on time" for item in relaxing),
            *ramped,
            *time_dependence(deck, drive),
        ),
        path_dependent=tuple(path_dependence(deck, abaqus=abaqus)),
        is_whole_field=editor.is_whole_field,
    )


def units_of(deck: Deck, request: Request) -> tuple[UnitSystem, list[str]]:
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
        self.doubts = list[str]()
        self.is_whole_field = False
        self.joint_sets = list[str]()  # sets of the user's requests of U and S
        self.expanded = False  # whether ccx makes solids of shells or beams
        self.relaxing = False  # whether a material gets branches that creep
        self.on_faces = False  # whether an afferent is on the bottom or top of a shell

    def remark(self, source: Block | Push, message: str) -> None:
        """Add a remark with the line of `source`."""
        self.remarks.append(f"{source.where}: {message}")

    # ---- The waveform: an amplitude that counts total time begins where the step does.

    def write_waveform(self, per_mm: float) -> None:
        """The motion as the amplitude's data; `per_mm` units of the deck are one mm of it."""
        drive, motion, curve = self.drive, self.motion, self.drive.amplitude
        depth = drive.start_depth + motion.depth_mm * per_mm
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
        if self.request.load is None:
            self._remark_motion(1.0 / per_mm)
        else:
            self._remark_load(self.request.load, per_mm)
        for step in drive.steps[drive.step.number :]:
            text = step.head.text if step.head.text.name else step.end.text
            self.remark(step.head, "left out to *END STEP, the run ends with the waveform")
            self._edit(text, step.head.start, step.end.body)

    def _remark_motion(self, length_mm: float) -> None:
        """Where the waveform leads, from where, in which unit, and from when."""
        drive, first = self.drive, self.drive.push[0]
        signs = {push.magnitude > 0 for push in drive.push}
        for push in drive.push if len(signs) > 1 else (first,):
            self.remark(push, f"depth moves {push.target} along {direction_text(self.deck, push)}")
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

    def _remark_load(self, load: LoadScale, per_mm: float) -> None:
        """What the load is at amplitude 1, how the waveform scales it, and where it begins."""
        drive, first = self.drive, self.drive.push[0]
        size = drive.factor / (per_mm / (1.0e3 * load.per_um))
        lines = f" and {len(drive.push) - 1} more lines" if len(drive.push) > 1 else ""
        message = f"{load.quantity} at {first.name}{lines}: {size:g} {load.unit} at amplitude 1"
        self.remark(first, f"{message}; one um of the waveform is {load.per_um:g} {load.unit}")
        if drive.start_depth:
            left = drive.start_depth / drive.factor * size
            message = f"the steps before leave {left:g} {load.unit}; the waveform begins there"
            self.remark(first, message)

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
            self._insert(block.text, rows[-1].stop, [f"{block.title}, {use}{op}", *texts])

    # ---- Other loads of the step, which a solver ramps over its length

    def write_ramps(self) -> list[str]:
        """An amplitude for each load that the step ramps, so that it keeps its course; which."""
        ramped = ramps(self.deck, self.drive, abaqus=self.abaqus)
        if not ramped:
            return []
        own_s = period_s(self._procedure())
        waveform_s = self.motion.increments * self.motion.dt_s
        used_names = {block.value_of("NAME") for block in self.deck.blocks_of("AMPLITUDE")}
        free = (f"{OWN_RAMP}{f'_{k}' * (k > 1)}" for k in count(1))
        names: dict[float, str] = {}
        head, lines = self.drive.steps[0].head, list[str]()
        for start in dict.fromkeys(ramp.start for ramp in ramped):
            names[start] = next(name for name in free if name not in used_names)
            lines += [f"*AMPLITUDE, NAME={names[start]}", f"0., {start:.9g}, {own_s:.9g}, 1."]
        self._insert(head.text, head.start, lines)
        for block in dict.fromkeys(ramp.block for ramp in ramped):
            self._set_ramps(block, [ramp for ramp in ramped if ramp.block is block], names)
        for ramp in ramped:
            for load in {load.row.start: load for load in ramp.loads}.values():
                self.remarks.append(
                    f"{load.where}: {load.name} has no amplitude and keeps its ramp over "
                    f"{own_s:g} s, by {names[ramp.start]}"
                )
                if waveform_s < own_s:
                    self.doubts.append(
                        f"{load.where}: {load.name}: the waveform ends after "
                        f"{100 * waveform_s / own_s:.2g} % of its ramp; a step of its own before "
                        "the waveform's would bring all of it"
                    )
        return [
            f"{load.where}: {load.name} is ramped beside the waveform; put it into a step before"
            for ramp in ramped
            for load in ramp.loads
        ]

    def _set_ramps(self, block: Block, ramped: list[Ramp], names: Mapping[float, str]) -> None:
        """Give the loads of a block their amplitudes; the block is split where others differ."""
        by_row = {load.row.start: names[ramp.start] for ramp in ramped for load in ramp.loads}
        if len(by_row) < sum(len({load.row.start for load in ramp.loads}) for ramp in ramped):
            raise block.error("degrees of freedom of one line start at different values; split it")
        others = {push.row.start for push in self.drive.push} | by_row.keys()
        constant = [load for load in loads_in(block) if load.row.start not in others]
        if len(set(by_row.values())) == 1 and not any(load.magnitude for load in constant):
            self._set_option(
                block, block.option("AMPLITUDE"), f"AMPLITUDE={names[ramped[0].start]}"
            )
            return
        title = block.text.data[block.start : block.head].decode("latin-1").rstrip(", ")
        rows = list(block.rows())
        for name in dict.fromkeys(by_row.values()):
            moved = [row for row in rows if by_row.get(row.start) == name]
            for row in moved:
                self._edit(row.text, row.start, row.stop)
            texts = [row.text.data[row.start : row.stop].strip().decode("latin-1") for row in moved]
            self._insert(block.text, rows[-1].stop, [f"{title}, AMPLITUDE={name}", *texts])

    # ---- Relaxing materials

    def write_branches(self, relaxing: list[Relaxation]) -> None:
        """Maxwell branches instead of ``*VISCOELASTIC``, which ccx leaves out."""
        head = self.drive.steps[0].head
        for item in relaxing:
            self._replace_rows(item.elastic, [item.row], [item.lasting_line])
            if (moduli := item.elastic.option("MODULI")) is not None:
                self._drop_option(item.elastic, moduli)
            block = item.viscoelastic
            self._edit(block.text, block.start, block.body)
            for row in block.rows():
                self._edit(row.text, row.start, row.stop)
            self._insert(head.text, head.start, list(item.branch_lines))
            message = f"{item.name} relaxes by {item.terms} Maxwell branches, for CalculiX leaves"
            self.remark(block, f"{message} *VISCOELASTIC out; its moduli are those that last")

    # ---- Increments: fixed ones, one a sample, or automatic ones of a sample at most. Solvers
    # end an increment at each time point, so results come at the samples either way.

    def write_increments(self) -> None:
        """The procedure's line and options in the waveform's step."""
        motion, samples, procedure = self.motion, self.motion.increments, self._procedure()
        creeping = procedure.keyword == "VISCO" and self.abaqus
        self._raise_limits(procedure, samples * (_INCREMENTS_PER_SAMPLE if self.automatic else 1))
        dt, period = fixed(motion.dt_s, _TIME_DIGITS), fixed(samples * motion.dt_s, _TIME_DIGITS)
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
            effect = (
                f" takes increments of {motion.dt_s:g} s or less, with results at {samples} time"
            )
            effect += " points"
        else:
            line, effect = f"{dt}, {period}", f", DIRECT takes {samples} increments"
            if direct is None:
                if not creeping:  # whose increments are fixed without CETOL
                    self._set_option(procedure, None, "DIRECT")
            elif direct.normalized.startswith("NO") and not (
                self.abaqus and direct.normalized == "NOSTOP"
            ):
                self._set_option(procedure, direct, "DIRECT")  # to ccx, NO STOP is a no
        if self.relaxing:
            self._set_creeping(procedure)
        rows = list(procedure.rows())[:1]
        previous = procedure.text.data[rows[0].start : rows[0].stop].strip() if rows else b"nothing"
        self._replace_rows(procedure, rows, [line])
        message = f"{procedure.title}{effect}: {line} (was: {previous.decode('latin-1')})"
        self.remark(procedure, message)

    def _set_creeping(self, procedure: Block) -> None:
        """``*VISCO``, in which ccx lets creep act; with fixed increments CETOL bounds nothing."""
        if procedure.keyword != "VISCO":
            start = procedure.text.data.index(b"*", procedure.start)
            keyword = _STATIC.match(procedure.text.data, start)
            assert keyword is not None  # nothing else has branches
            self._edit(procedure.text, start, keyword.end(), b"*VISCO")
        if procedure.option("CETOL") is None:
            self._set_option(procedure, None, "CETOL=1.0E6")

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
        if linear and not self.relaxing and not any(step.head.option("NLGEOM") for step in steps):
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
        on_set = bool(positions) and not self.request.all_nodes and not self.on_faces
        nodes_text = f"the nodes of {_listed(positions)}" if on_set else "all nodes"
        if positions:
            self._write_sets(scopes, positions)
        for step in [self.drive.step] if self.abaqus else self._steps_to_write():
            kept_blocks = list[Block]()
            if self.abaqus:
                removed_blocks, lines = _abaqus_requests(step), self._abaqus_request(on_set)
            else:
                removed_blocks = step.blocks_of(*_CALCULIX_REQUESTS)
                if self.request.keeps_output:  # those of an earlier deck of ours go
                    kept_blocks = [
                        block
                        for block in removed_blocks
                        if block.value_of("NSET") not in (_OUTPUT_SET, _JOINT_SET)
                    ]
                set_name = self._set_of_requests(kept_blocks) if on_set else ""
                nodes_text = nodes_text if set_name else "all nodes"
                lines = self._calculix_request(step, set_name, on_nodes=bool(positions))
            if self.request.keeps_output:
                removed_blocks = (
                    [] if self.abaqus else [b for b in removed_blocks if b not in kept_blocks]
                )
                self._keep_requests(kept_blocks)
            interval = "every time point" if self.automatic else "every increment"
            times = interval if step is self.drive.step else "its last increment"
            for block in removed_blocks:  # keyword line and data; comments under it stay
                self._edit(block.text, block.start, block.body)
                for row in block.rows():
                    self._edit(row.text, row.start, row.stop)
            self._insert(step.end.text, step.end.start, lines)
            self.is_whole_field = not self.abaqus and nodes_text == "all nodes"
            removed = ", ".join(f"{block.title} ({block.where})" for block in removed_blocks)
            replaced = f", replacing {removed}" if removed else ""
            self.remark(step.end, f"U and S at {nodes_text}, {times}{replaced}")

    # ---- CalculiX: the last request decides how often and whether binary, for all of them, so
    # ours come last in their step. ccx writes nothing when a step begins: what a trace has at
    # the waveform's start is the last increment of the step before.

    def _keep_requests(self, blocks: list[Block]) -> None:
        """Leave the user's requests, but for what our last one decides for all of them."""
        for block in blocks:
            dropped = [
                option
                for option in block.options
                if option.name in ("FREQUENCY", "TIMEPOINTS", "OUTPUT")
            ]
            for option in dropped:
                self._drop_option(block, option)
            names = ", ".join(option.name for option in dropped)
            change = f", without {names}: as ours" if names else ", as often as ours"
            self.remark(block, f"{block.title} stays{change}")

    def _set_of_requests(self, kept_blocks: list[Block]) -> str:
        """The node set of U and S: ours, with those of the user's requests; "" for all nodes.

        In ccx the last request of a quantity decides its nodes, so ours has all of them.
        """
        names = [block.value_of("NSET") for block in kept_blocks if _writes_our_quantities(block)]
        if not all(names):
            return ""
        if not names:
            return _OUTPUT_SET
        new = [name for name in dict.fromkeys(names) if name not in self.joint_sets]
        if new:
            joined = new if self.joint_sets else [_OUTPUT_SET, *new]
            head = self.drive.steps[0].head
            lines = [f"*NSET, NSET={_JOINT_SET}", *(f"{name}," for name in joined)]
            self._insert(head.text, head.start, lines)
            self.joint_sets += new
        return _JOINT_SET

    def _calculix_request(self, step: Step, set_name: str, *, on_nodes: bool) -> list[str]:
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
        on_deck_nodes = bool(set_name) or (on_nodes and self.request.keeps_output)
        mode = self._output_mode(step, on_deck_nodes)
        nodes = f"{f', NSET={set_name}' if set_name else ''}{frequency}{mode}"
        if self.request.results == "text":
            return [f"*NODE FILE{nodes}", "U", f"*EL FILE{nodes}", "S"]
        return [f"*NODE OUTPUT{nodes}, DOUBLE", "U", f"*ELEMENT OUTPUT{nodes}, DOUBLE", "S"]

    def _steps_to_write(self) -> list[Step]:
        """The waveform's step and, where it has one before it in time, that one."""
        return [*_steps_before(self.drive), self.drive.step]

    def _output_mode(self, step: Step, on_set: bool) -> str:
        """``OUTPUT=2D`` or ``OUTPUT=3D`` where the results need another than they would have.

        In 3D the nodes of plane elements, shells and beams have numbers of their own: results on
        a set of the deck's nodes are then empty, and the faces of a shell are there. In 2D there
        is the middle of a shell. Shells and beams are 3D by themselves, plane elements 2D. ccx
        2.20 takes the word in the first step alone.
        """
        first, written = self.drive.steps[0], self._steps_to_write()
        needed = "3D" if self.on_faces else "2D" if on_set else ""
        requests = [
            (earlier, block, earlier in written and block.keyword in _CALCULIX_REQUESTS)
            for earlier in self.drive.steps[: self.drive.step.number]
            for block in earlier.blocks
            if block.value_of("OUTPUT") in ("2D", "3D")
        ]
        if not needed:  # the user's own choice; of plane elements alone the deck's nodes
            kept = [block.value_of("OUTPUT") for _, block, removed in requests if removed]
            return f", OUTPUT={kept[0]}" if kept and self.expanded and step is first else ""
        kept_others = [
            (earlier, block)
            for earlier, block, removed in requests
            if not removed and block.value_of("OUTPUT") != needed
        ]
        for earlier, block in kept_others:
            if earlier is not first or first not in written:
                raise block.error(
                    f"{block.title}, OUTPUT={block.value_of('OUTPUT')}: ccx then has no results at "
                    f"the afferents, which need {needed}; take it out"
                )
        if first in written:
            explicit = step is first and (self.expanded or kept_others)
            return f", OUTPUT={needed}" if explicit else ""
        if self.expanded and needed == "2D" and not requests:
            raise first.head.error(
                "the first step decides how ccx writes shells and beams, and is not changed here: "
                "write OUTPUT=2D onto its *NODE FILE and *EL FILE"
            )
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
            *(self._abaqus_print() if on_set and self.request.keeps_output else ()),
        ]

    def _abaqus_print(self) -> list[str]:
        """Von Mises stress in the ``.dat`` too, for those who have no script for the ``.odb``."""
        where = f"ELSET={_OUTPUT_SET}, POSITION=AVERAGED AT NODES"
        return [f"*EL PRINT, {where}, FREQUENCY=1, SUMMARY=NO", "MISES"]

    # ---- Sets: one an afferent, one for all

    def _write_sets(self, scopes: list[Scope], positions: Mapping[str, NodePosition]) -> None:
        """Those sets that the deck has not yet, before its first step or the assembly's end."""
        required: dict[tuple[str, str], dict[str, list[int]]] = {}
        nodes: dict[str, dict[int, NodePosition]] = {}
        classes: dict[str, str] = {}
        for name, position in positions.items():
            afferent, _ = split_afferent_key(name)
            key = "NSET", f"AFFERENT_{afferent.upper()}"
            if not _SET_NAME.fullmatch(afferent) or classes.setdefault(key[1], afferent) != (
                afferent
            ):
                expected = "a unique name of letters, digits, - and _, which a set can have"
                problem = f"has the name {name!r}, expected {expected}"
                raise DeckError(problem, argument="afferents", found=name, expected=expected)
            in_set = required.setdefault(key, {}).setdefault(position.instance, [])
            in_set += [position.node] * (position.node not in in_set)
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


def _listed(keys: Iterable[str]) -> str:
    """Classes of the afferents `keys`, each with the number of its units if it has several."""
    counts = Counter(split_afferent_key(key)[0] for key in keys)
    return ", ".join(f"{name} ({units})" if units > 1 else name for name, units in counts.items())


def _writes_our_quantities(block: Block) -> bool:
    """Whether a request of CalculiX has U or S, whose nodes the last request decides."""
    return any({"U", "S"} & {field.upper() for field in row.fields} for row in block.rows())


def _steps_before(drive: Drive) -> list[Step]:
    """The step before the waveform's, if it takes time."""
    before = drive.steps[: drive.step.number - 1][-1:]
    return [step for step in before if step.blocks_of(*MOVABLE)]


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
) -> dict[str, list[int]]:
    """Numbers of the elements at `nodes`, by instance and in deck order."""
    elements: dict[str, list[int]] = {}
    for scope in scopes:
        scope_nodes = nodes.get(scope.instance, {})
        reached: set[int] = set()
        for block in scope.blocks if scope_nodes else ():
            for element in elements_in(block) if block.keyword == "ELEMENT" else ():
                if shared := scope_nodes.keys() & set(element.nodes):
                    elements.setdefault(scope.instance, []).append(element.number)
                    reached |= shared
        for node in scope_nodes.keys() - reached:
            raise DeckError(
                f"{scope_nodes[node].where}: no *ELEMENT of the deck has node {node}, so it "
                "has no stress"
            )
    return elements


# ---- Afferents in a deck for CalculiX


def _relaxing_materials(
    deck: Deck,
    scope: ModelScope,
    drive: Drive,
    request: Request,
    units: UnitSystem,
    motion: Motion,
) -> tuple[list[Relaxation], list[str]]:
    """Materials that get Maxwell branches, and remarks on those that stay elastic."""
    blocks = deck.blocks_of("VISCOELASTIC")
    if not blocks:
        return [], []
    reason = ""
    if request.increments != "fixed":
        reason = "its branches need increments that are fixed"
    elif not drive.step.blocks_of("STATIC", "VISCO"):
        reason = "creep does not act in *DYNAMIC"
    if reason:
        message = "relaxes, but CalculiX solves it elastic"
        return [], [f"{block.where}: {block.title}: {message}: {reason}" for block in blocks]
    return relaxations(deck, scope, units, motion.dt_s)


def _sites_in_elements(
    scope: ModelScope,
    numbers: Scope,
    request: Request,
    sites: Mapping[str, AfferentSite],
    terms: Mapping[str, int],
) -> dict[str, AfferentSite]:
    """`sites` with the layer of a shell; each must be inside one material.

    `terms` has the number of branches that each relaxing material gets.

    Raises
    ------
    DeckError
        A node without an element, between materials, in a beam, or in a shell whose layer is
        not chosen.
    """
    around = scope.elements_at(request.afferents[name] for name in sites)
    placed: dict[str, AfferentSite] = {}
    for name, site in sites.items():
        node = request.afferents[name]
        elements, present = without_branches(around[node], scope)
        if not elements:
            if not scope.kinds:  # in a file that was not read
                placed[name] = site
                continue
            raise DeckError(
                f"afferent {name}: no *ELEMENT with stress has node {node}, so it has no stress"
            )
        families = {family_of(element.kind) for element in elements}
        if families & {"beam", "truss"}:
            kind = next(item.kind for item in elements if family_of(item.kind) in ("beam", "truss"))
            raise DeckError(
                f"afferent {name}: node {node} is of elements {kind}, whose stress varies over a "
                "section that the node does not name; choose a node of solid elements"
            )
        materials = dict.fromkeys(scope.material_of(element.number) for element in elements)
        if len(materials) > 1:
            raise DeckError(
                f"afferent {name}: node {node} is between the materials "
                f"{' and '.join(material or 'none' for material in materials)}, and CalculiX "
                f"writes the mean of their stress; {_nodes_beside(scope, numbers, node, elements)}"
            )
        if not families & {"shell", "membrane"}:
            added = terms.get(next(iter(materials)), 0)
            placed[name] = replace(site, branches=1 + present + added)
            continue
        if len(families) > 1:
            raise DeckError(
                f"afferent {name}: node {node} joins elements {' and '.join(sorted(families))}; "
                "choose one inside either"
            )
        placed[name] = _site_on_shell(name, node, elements[0], site, request.shell_face)
    if request.shell_face is not None and not any(
        family_of(element.kind) in ("shell", "membrane")
        for node in around.values()
        for element in node
    ):
        raise DeckError(f"shell_face {request.shell_face}: no afferent is in a shell")
    return placed


def _site_on_shell(
    name: str, node: int, element: Element, site: AfferentSite, face: str | None
) -> AfferentSite:
    """`site` on the `face` of a shell: at a corner of the solid that ccx makes of `element`.

    The solid has the shell's nodes at its bottom, then at its top; so has it the nodes between
    them, at its edges, in the order of the result file.
    """
    if face is None:
        raise DeckError(
            f"afferent {name}: node {node} is of shells {element.kind}; choose the layer whose "
            f"stress is read: {', '.join(SHELL_FACES)} (--shell-face; the normal points to the top)"
        )
    if face == "middle":
        return site
    corners = 3 if len(element.nodes) in (3, 6) else 4
    index = element.nodes.index(node)
    top = face == "top"
    corner = index + corners * top if index < corners else index + corners + 2 * corners * top
    return replace(site, element=element.number, corner=corner)


def _nodes_beside(scope: ModelScope, numbers: Scope, node: int, elements: Sequence[Element]) -> str:
    """The nearest nodes inside each material, for an error."""
    around = dict.fromkeys(other for element in elements for other in element.nodes)
    positions = _nodes_in(numbers, list(around), 3)
    if node not in positions:
        return "choose a node inside one"
    start = positions[node].position
    nearest: dict[str, tuple[float, int]] = {}
    for other, materials in scope.materials_at(positions).items():
        if len(materials) == 1:
            distance = math.dist(start, positions[other].position)
            nearest[materials[0]] = min(nearest.get(materials[0], (math.inf, 0)), (distance, other))
    if not nearest:
        return "refine the mesh there: no node beside it is inside one material"
    listed = (f"{other} in {material or 'none'}" for material, (_, other) in nearest.items())
    return f"choose a node inside one, such as {' or '.join(listed)}"


def _with_start_stress(
    deck: Deck,
    drive: Drive,
    scope: ModelScope,
    request: Request,
    sites: dict[str, AfferentSite],
    units: UnitSystem,
) -> tuple[dict[str, AfferentSite], bool]:
    """`sites` with the stress of ``*INITIAL CONDITIONS``, and whether there is none.

    Raises
    ------
    DeckError
        The model holds stress at time 0 that neither the deck nor an output has.
    """
    if reasons := acts_at_start(deck, drive):
        raise DeckError(reasons[0])
    initial = initial_stress(deck)
    if initial is None:
        return sites, True
    stress, uneven = initial
    around = scope.elements_at(request.afferents[name] for name in sites)
    started: dict[str, AfferentSite] = {}
    for name, site in sites.items():
        elements = [element.number for element in around[request.afferents[name]]]
        if site.element or uneven.intersection(elements):
            raise DeckError(
                f"afferent {name}: its initial stress varies within an element, and CalculiX "
                "writes no output at time 0; put a *STATIC step before the waveform's, in which "
                "the model settles"
            )
        tensor = mean_stress(elements, stress)
        started[name] = replace(
            site, start_stress_pa=tuple(value * units.stress_pa for value in tensor)
        )
    return started, False


# ---- Nodes


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
            problem = f"no *NODE of the deck defines node {node}{hint}{deck.unread}"
            raise DeckError(problem, found=node)
        if len(positions) > 1:
            listed = ", ".join(
                f"{position.instance or 'the assembly'} ({position.where})"
                for position in positions
            )
            raise DeckError(
                f"node {node} is in several instances: {listed}; give one of them another number",
                found=node,
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
            position = scope.placement.moved(
                np.array([[row.number(1 + k, blank=0.0) for k in range(3)]])
            )[0]
            positions[node] = NodePosition(
                node, tuple(position[:axes].tolist()), scope.instance, row.where
            )  # the last one counts
    moved = [block.where for block in scope.blocks if block.keyword == "SYSTEM"]
    if positions and moved:
        raise DeckError(
            f"{moved[0]}: rotates or moves the nodes of {scope.instance or 'the deck'}, and their "
            "position is not computed; write them in global coordinates"
        )
    return positions


def _rows_of_nodes(block: Block, nodes: list[int]) -> Iterator[Row]:
    """Data lines that begin with one of `nodes`: found by a search of the bytes."""
    numbers, selected = rb"[0-9]+", {b"%d" % node for node in nodes}
    if len(nodes) <= _MAX_ALTERNATIVES:
        numbers = b"|".join(selected)
    pattern = re.compile(rb"^[ \t]*0*(" + numbers + rb")[ \t]*[,\r\n]", re.MULTILINE)
    for piece in block.pieces:
        data = piece.text.data
        for match in pattern.finditer(data, piece.start, piece.stop):
            if match[1] not in selected:
                continue
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
