"""A user's model about its state after some steps, as decks of small changes.

For CalculiX `stiffness_deck` writes the stiffness matrix (``SOLVER=MATRIXSTORAGE``), and
`unit_force_deck` the displacement under one unit force, to compare with. These are two decks: in
one, ccx 2.20 computes the matrix of a hyperelastic model from what the unit force left behind.
For Abaqus `abaqus_force_deck` has unit forces as load cases of one perturbation step, whose
stiffness Abaqus factorises once, and prints displacements and stress under each.

Steps up to the requested one stay as they are. Without one the model is undeformed: what its
first step holds or moves is held, and contact pairs are left out, since a linear step would glue
what touches.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from decks.inp import Block, Deck, Row, block_text, normalized_name
from decks.keyword_deck import list_lines
from decks.solid_model import HELD_WORDS
from fembridge.errors import DeckError
from fembridge.typing import IntArray

_CONTACT = ("CONTACTPAIR", "CONTACT", "CONTACTINCLUSIONS", "CONTACTPROPERTYASSIGNMENT", "CLEARANCE")
# Procedures after which a model may be linearised.
_STATIC = ("STATIC", "VISCO")
# Materials whose stress is not a function of strain alone, or whose elements are more than that.
_NOT_LINEARISED = (
    "CAPPLASTICITY", "CREEP", "CYCLICHARDENING", "DEFORMATIONPLASTICITY", "DRUCKERPRAGER",
    "MOHRCOULOMB", "PLASTIC", "USERMATERIAL",
)  # fmt: skip
# Of the mass, which is not used: a matrix is only written together with it.
_DENSITY = "1.E-9"
# Output that other solvers write, which is left out of the kept steps.
_CALCULIX_OUTPUT = ("NODEFILE", "ELFILE", "NODEOUTPUT", "ELEMENTOUTPUT", "OUTPUT", "CONTACTOUTPUT")
_ABAQUS_PRINTS = ("NODEPRINT", "ELPRINT", "CONTACTPRINT", "ENERGYPRINT", "SECTIONPRINT")
_LAST_INCREMENT_ONLY = 100000
# Sets of the decks of unit forces, whose names Abaqus prints above each table.
SKIN_SET, LAYER_SET, STATE_SET = "FEMBRIDGE_SKIN", "FEMBRIDGE_LAYER", "FEMBRIDGE_STATE"


@dataclass(frozen=True, slots=True, eq=False)
class LinearState:
    """A deck up to the state about which it is linearised.

    `model` are the blocks before the first step, `steps` those of the steps that are kept, and
    `boundaries` all ``*BOUNDARY`` blocks that hold in that state. `remarks` say left-out cards.
    """

    model: tuple[Block, ...]
    steps: tuple[tuple[Block, ...], ...]
    boundaries: tuple[Block, ...]
    remarks: tuple[str, ...]


def linear_state(deck: Deck, after_step: int) -> LinearState:
    """The state of a deck after step `after_step`, from 1; 0: the undeformed model.

    Raises
    ------
    DeckError
        No such step; a step or a material that cannot be linearised.
    """
    model, steps = _split(deck)
    if not 0 <= after_step <= len(steps):
        problem = f"is {after_step}, but the deck has {len(steps)} steps"
        raise DeckError(problem, argument="after_step", found=after_step)
    kept = steps[:after_step]
    remarks = []
    for step in kept:
        keywords = [block.keyword for block in step]
        if not any(name in keywords for name in _STATIC):
            names = ", ".join(block.title for block in step[1:-1]) or "nothing"
            raise step[0].error(
                f"a step of {names} cannot be linearised, expected *STATIC or *VISCO"
            )
        if step[0].option("PERTURBATION") is not None:
            raise step[0].error("*STEP, PERTURBATION leaves no state to linearise about")
    for block in model:
        if kept and block.keyword in _NOT_LINEARISED:
            raise block.error(
                f"{block.title} depends on the path of the deformation and cannot be linearised"
            )
        if block.keyword == "TRANSFORM":
            remarks.append(f"{block.where}: {block.title} is kept")
    if not kept:
        removed = [block for block in model if block.keyword in _CONTACT]
        remarks += [f"{block.where}: {block.title} left out" for block in removed]
        model = [block for block in model if block not in removed]
        boundaries = [b for b in (*model, *(steps[0] if steps else ())) if b.keyword == "BOUNDARY"]
        if steps:
            remarks.append(
                f"{steps[0][0].where}: the undeformed model is taken, held where step 1 holds or "
                "moves it; --after-step 1 linearises after that step"
            )
    else:
        boundaries = [b for b in (*model, *sum(kept, ())) if b.keyword == "BOUNDARY"]
        contact = [block for block in model if block.keyword in _CONTACT]
        remarks += [
            f"{block.where}: {block.title} stays as it is after step {after_step}, closed or open"
            for block in contact
        ]
    return LinearState(tuple(model), tuple(kept), tuple(boundaries), tuple(remarks))


def _split(deck: Deck) -> tuple[list[Block], list[tuple[Block, ...]]]:
    """Blocks before the first step, and the blocks of each step with ``*STEP`` and its end."""
    model, steps = list[Block](), list[list[Block]]()
    inside = False
    for block in deck.blocks:
        if block.keyword == "STEP":
            steps.append([])
            inside = True
        if inside:
            steps[-1].append(block)
        elif steps and block.keyword not in ("STEP", "ENDSTEP"):
            raise block.error(f"{block.title} between two steps")
        else:
            model.append(block)
        if block.keyword == "ENDSTEP":
            inside = False
    return model, [tuple(step) for step in steps]


def stiffness_deck(state: LinearState) -> bytes:
    """Deck for CalculiX that writes the stiffness matrix of `state`.

    Its results are the displacements after the last step that is kept.
    """
    option = b", PERTURBATION" if state.steps else b""
    step = b"*STEP" + option + b"\n*FREQUENCY, SOLVER=MATRIXSTORAGE\n*END STEP\n"
    return b"".join(_state_lines(state)) + step


def unit_force_deck(state: LinearState, node: int) -> bytes:
    """Deck for CalculiX with 1 N at `node` along each axis: displacements, as three modes."""
    lines = ["*STEP" + (", PERTURBATION" if state.steps else ""), "*GREEN"]
    for axis in (1, 2, 3):
        lines += ["*CLOAD", f"{node}, {axis}, 1."]
    lines += ["*NODE OUTPUT, DOUBLE", "U", "*END STEP", ""]
    return b"".join(_state_lines(state)) + "\n".join(lines).encode()


def abaqus_force_deck(
    state: LinearState,
    forces: IntArray,
    skin: IntArray,
    elements: IntArray,
    around: IntArray,
    *,
    coordinates: bool = False,
    step_per_force: bool = False,
) -> bytes:
    """Deck for Abaqus/Standard with unit forces about `state`, and printed tables of the results.

    Parameters
    ----------
    state
        The model and the steps that are kept.
    forces
        Node and axis (1 to 3) of each force, ``(K, 2)``.
    skin
        Nodes whose displacement is printed.
    elements
        Elements whose stress is printed at the integration points.
    around
        Nodes whose displacement is printed after the last step that is kept.
    coordinates
        Whether coordinates of the integration points are printed, which shows their order.
    step_per_force
        Whether each force has a perturbation step, instead of a load case of one step.
    """
    nodes = np.unique(skin)
    sets = [f"*NSET, NSET={SKIN_SET}\n{list_lines(nodes)}\n"]
    sets.append(f"*ELSET, ELSET={LAYER_SET}\n{list_lines(np.unique(elements))}\n")
    if state.steps:
        sets.append(f"*NSET, NSET={STATE_SET}\n{list_lines(np.unique(around))}\n")
    requests = (
        f"*NODE PRINT, NSET={SKIN_SET}, SUMMARY=NO, TOTALS=NO\nU\n"
        f"*EL PRINT, ELSET={LAYER_SET}, SUMMARY=NO, TOTALS=NO\nS\n"
    )
    lines = []
    quiet = "*STEP, NAME={}, PERTURBATION\n*STATIC\n*OUTPUT, FIELD, FREQUENCY=0\n"
    step = quiet + requests
    for number, (node, axis) in enumerate(forces.tolist(), start=1):
        load = f"*CLOAD\n{node}, {axis}, 1.\n"
        name = f"FORCE_{number}"
        if step_per_force:
            lines.append(f"{step.format(name)}{load}*END STEP\n")
        else:
            lines.append(f"*LOAD CASE, NAME={name}\n{load}*END LOAD CASE\n")
    if not step_per_force:
        lines = [step.format("FORCES"), *lines, "*END STEP\n"]
    if coordinates:
        node, axis = forces[0].tolist()
        lines.insert(
            0,
            f"{quiet.format('POSITIONS')}*CLOAD\n{node}, {axis}, 1.\n"
            f"*EL PRINT, ELSET={LAYER_SET}, SUMMARY=NO, TOTALS=NO\nCOORD\n*END STEP\n",
        )
    return b"".join([*_abaqus_state_lines(state, "".join(sets)), "".join(lines).encode()])


def _abaqus_state_lines(state: LinearState, sets: str) -> Iterator[bytes]:
    """The state with `sets` before the first step; displacements are printed after the last."""
    for block in state.model:
        if state.steps or block.keyword not in ("BOUNDARY", "AMPLITUDE"):
            yield block_text(block)
    if not state.steps:
        yield from _held_lines(state.boundaries, with_words=True)
    yield sets.encode()
    for number, step in enumerate(state.steps, start=1):
        for block in step[:-1]:
            if block.keyword not in _ABAQUS_PRINTS:
                yield block_text(block)
        if number == len(state.steps):
            yield (
                f"*NODE PRINT, NSET={STATE_SET}, FREQUENCY={_LAST_INCREMENT_ONLY}, "
                "SUMMARY=NO, TOTALS=NO\nU\n"
            ).encode()
        yield block_text(step[-1])


def _state_lines(state: LinearState) -> Iterator[bytes]:
    without_mass = _materials_without_density(state.model)
    for block in state.model:
        if block.keyword in ("BOUNDARY", "AMPLITUDE") and not state.steps:
            continue
        yield _without_words(block) if block.keyword == "BOUNDARY" else block_text(block)
        if block in without_mass:
            yield f"*DENSITY\n{_DENSITY},\n".encode()
    if not state.steps:
        yield from _held_lines(state.boundaries)
    for step_number, step in enumerate(state.steps, start=1):
        for block in step[:-1]:
            if block.keyword == "BOUNDARY":
                yield _without_words(block)
            elif block.keyword not in _CALCULIX_OUTPUT:
                yield block_text(block)
        if step_number == len(state.steps):
            yield b"*NODE OUTPUT, FREQUENCY=100000, DOUBLE\nU\n"
        yield block_text(step[-1])


def _materials_without_density(model: Sequence[Block]) -> list[Block]:
    """The ``*MATERIAL`` blocks that no ``*DENSITY`` follows."""
    without: list[Block] = []
    for block in model:
        if block.keyword == "MATERIAL":
            without.append(block)
        elif block.keyword == "DENSITY":
            without = without[:-1]
    return without


def _held_lines(boundaries: Sequence[Block], *, with_words: bool = False) -> Iterator[bytes]:
    """``*BOUNDARY`` without magnitudes; `with_words` as ``ENCASTRE``, which also hold rotations."""
    for block in boundaries:
        yield b"*BOUNDARY\n"
        for row in block.rows():
            for fields in (row.fields,) if with_words else _freedoms(row):
                yield (", ".join(fields[:3]) + "\n").encode("latin-1")


def _without_words(block: Block) -> bytes:
    """A ``*BOUNDARY`` block with numbers for words that Abaqus knows, as ``ENCASTRE``."""
    rows = list(block.rows())
    expanded = [fields for row in rows for fields in _freedoms(row)]
    if expanded == [row.fields for row in rows]:
        return block_text(block)
    head = block.text.data[block.start : block.body].rstrip(b"\r\n")
    return b"\n".join([head, *(", ".join(f).encode("latin-1") for f in expanded), b""])


def _freedoms(row: Row) -> Iterator[tuple[str, ...]]:
    """Fields of a row of ``*BOUNDARY``; of a word as ``XSYMM`` those of each displacement."""
    axes = HELD_WORDS.get(normalized_name(row.fields[1])) if len(row.fields) > 1 else None
    if axes is None:
        yield row.fields
    else:
        for axis in axes:
            yield (row.fields[0], axis, axis)
