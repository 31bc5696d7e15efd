"""A user's model about its state after some steps, as decks of small changes for CalculiX.

`stiffness_deck` writes the stiffness matrix (``SOLVER=MATRIXSTORAGE``), and
`unit_force_deck` the displacement under one unit force, to compare with. These are two decks: in
one, ccx 2.20 computes the matrix of a hyperelastic model from what the unit force left behind.

Steps up to the requested one stay as they are. Without one the model is undeformed: what its
first step holds or moves is held, and contact pairs are left out, since a linear step would glue
what touches.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from decks.inp import Block, Deck, Option
from fembridge.errors import DeckError

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


def _state_lines(state: LinearState) -> Iterator[bytes]:
    without_mass = _materials_without_density(state.model)
    for block in state.model:
        if block.keyword in ("BOUNDARY", "AMPLITUDE") and not state.steps:
            continue
        yield _text(block)
        if block in without_mass:
            yield f"*DENSITY\n{_DENSITY},\n".encode()
    if not state.steps:
        yield from _held_lines(state.boundaries)
    for step_number, step in enumerate(state.steps, start=1):
        for block in step[:-1]:
            if block.keyword not in ("NODEFILE", "ELFILE", "NODEOUTPUT", "ELEMENTOUTPUT"):
                yield _text(block)
        if step_number == len(state.steps):
            yield b"*NODE OUTPUT, FREQUENCY=100000, DOUBLE\nU\n"
        yield _text(step[-1])


def _materials_without_density(model: Sequence[Block]) -> list[Block]:
    """The ``*MATERIAL`` blocks that no ``*DENSITY`` follows."""
    without: list[Block] = []
    for block in model:
        if block.keyword == "MATERIAL":
            without.append(block)
        elif block.keyword == "DENSITY":
            without = without[:-1]
    return without


def _held_lines(boundaries: Sequence[Block]) -> Iterator[bytes]:
    """``*BOUNDARY`` without magnitudes."""
    for block in boundaries:
        yield b"*BOUNDARY\n"
        for row in block.rows():
            yield (", ".join(row.fields[:3]) + "\n").encode("latin-1")


def _text(block: Block) -> bytes:
    """The bytes of a block with its data, wherever they are; without ``INPUT=``."""
    head = block.text.data[block.start : block.body]
    if (option := block.option("INPUT")) is not None:
        head = _without(block, option)
    data = b"".join(piece.text.data[piece.start : piece.stop] for piece in block.pieces)
    return (
        head.rstrip(b"\r\n") + b"\n" + data + (b"" if not data or data.endswith(b"\n") else b"\n")
    )


def _without(block: Block, option: Option) -> bytes:
    data = block.text.data
    comma = data.rindex(b",", block.start, option.start)
    return data[block.start : comma] + data[option.stop : block.body]
