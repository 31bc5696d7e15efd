"""Contact along a trajectory: the forces on the nodes of the skin over time.

Where a shape only goes in and out, the forces are a function of its depth or force: contact is
solved at some levels and read between them, as in a response map. Where it slides, pins move on
their own, or the skin relaxes (`fembridge.touching.relaxation`), contact is solved step by step.
A shape that begins to slide, turns or stops sticks at first (`fembridge.touching.friction`).

On the nodes of a pad a slide is resolved to one node of the skin: forces, in proportion to the
level, are averaged over the time in which the shape moves by one node. Otherwise each node that
comes into contact would be a tap. On the fine grid of ridged skin nothing is averaged.
"""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from sys import getsizeof
from typing import TypedDict

import numpy as np

from fembridge.errors import UsageError
from fembridge.host.memory import check_memory
from fembridge.host.progress import advance
from fembridge.touching.contact import (
    MM_PER_UM,
    MOST_UM,
    ContactSolver,
    PressBy,
    press_steps,
    press_to,
)
from fembridge.touching.contact_warnings import (
    depth_warning,
    end_warning,
    narrow_part_mm,
    narrow_warning,
    texture_end_ms,
    texture_warning,
)
from fembridge.touching.friction import friction_shares, slid_before
from fembridge.touching.grid_contact import GridContactSolver
from fembridge.touching.kept_states import kept, shape_key
from fembridge.touching.large_strain import (
    LargeStrain,
    has_large_strain,
    is_deep,
    press_deep,
)
from fembridge.touching.pad import Pad, SkinNodes
from fembridge.touching.press_levels import LEAST_N, LEAST_UM, levels_up_to, rung_of
from fembridge.touching.relaxation import Relaxation, RelaxingContact, relaxation_of
from fembridge.touching.shape import Shape
from fembridge.touching.trajectory import PinArray, Trajectory
from fembridge.typing import BoolArray, FloatArray, IntArray, SingleArray

_MAX_STRIDE = 20
# Numbers in double precision of which a mean over steps is taken at a time.
_NUMBERS_PER_BLOCK = 4_000_000


@dataclass(frozen=True, slots=True, eq=False)
class ContactHistory:
    """Forces on the skin in the states that were solved.

    Parameters
    ----------
    nodes
        Nodes of the skin that carry a force in any state.
    forces_n
        Force into the skin on each node in N, ``(S, node)``.
    total_n, depth_um
        Force of the shape in N and its depth in um, ``(S,)``.
    knots
        Rising coordinate of the states, ``(S,)``: level or number of the sample. Levels go on to
        the top of a rung, beyond the largest of the touch.
    position
        Coordinate of each sample of the trajectory, ``(T,)``.
    drag
        Force along x and z that comes with 1 N into the skin, ``(S, 2)``; None where nothing
        slips.
    large_strain
        Loads that stand for contact and large strain in the states of a deep touch. Default: None,
        small strain.
    key
        All that the states depend on, where they are kept for touches to come. Default: None.
    layer_forces_n
        By layer, forces ``(S, node)`` whose elastic stress is that in the layer. Default: none,
        `forces_n`; relaxing skin has others.
    """

    nodes: SkinNodes
    forces_n: FloatArray | SingleArray
    total_n: FloatArray
    depth_um: FloatArray
    knots: FloatArray
    position: FloatArray
    drag: FloatArray | None = None
    layer_forces_n: Mapping[str, SingleArray] = field(default_factory=dict)
    large_strain: LargeStrain | None = None
    key: Hashable | None = None

    @property
    def reached(self) -> int:
        """Number of states up to the first that no sample goes beyond; further ones are of a rung.

        Samples lie between states, and states go on to the top of a rung that touches share.
        """
        if not self.position.size:
            return self.knots.size
        highest = float(self.position.max())
        return min(int(np.searchsorted(self.knots, highest)) + 1, self.knots.size)

    @property
    def hardest(self) -> int:
        """The state nearest to the sample with the largest force."""
        hardest = int(np.interp(self.position, self.knots, self.total_n).argmax())
        return int(np.abs(self.knots - self.position[hardest]).argmin())

    @property
    def nbytes(self) -> int:
        """Memory of the states, without the responses of the pad."""
        loads = 0 if self.large_strain is None else self.large_strain.loads_n.nbytes
        return self.forces_n.nbytes + loads + 64 * self.nodes.size

    def forces_in(self, layer: str) -> FloatArray | SingleArray:
        """Forces ``(S, node)`` in N whose elastic stress is that in a layer.

        Parameters
        ----------
        layer
            Layer of the finger.
        """
        return self.layer_forces_n.get(layer, self.forces_n)


def solve_contact(
    pad: Pad, shape: Shape | None, trajectory: Trajectory, friction: float
) -> ContactHistory:
    """Contact of `shape`, or of the pins of `trajectory`.

    Parameters
    ----------
    pad
        Pad that is touched.
    shape
        Shape at its place; None for pins.
    trajectory
        Depth or force, and position.
    friction
        Coefficient of friction of a shape that slides.

    Raises
    ------
    UsageError
        A shape beside the pad, too deep, or with too many nodes in contact.
    """
    relaxation = relaxation_of(pad)
    if relaxation is None:
        return _solve(pad, shape, trajectory, friction, {})
    contact = _solve(pad, shape, trajectory, friction, _memory(relaxation, trajectory))
    return with_layer_forces(contact, relaxation, trajectory)


def with_layer_forces(
    contact: ContactHistory, relaxation: Relaxation, trajectory: Trajectory
) -> ContactHistory:
    """A contact of every sample, with the forces of each layer of relaxing skin."""
    copies = 1 + len(relaxation.layers)
    check_memory(4 * contact.forces_n.size * copies, "the forces of a touch", UsageError)
    layer_forces_n = relaxation.layer_forces_n(
        contact.forces_n, trajectory.dt_ms, rested=_rested(trajectory)
    )
    return replace(contact, layer_forces_n=layer_forces_n)


def _rested(trajectory: Trajectory) -> bool:
    """Whether the shape has stood at its first depth before time 0; a press comes from above."""
    return trajectory.preindent_um is not None


class _Memory(TypedDict, total=False):
    """Arguments of `press_steps` for skin that relaxes; none for elastic skin."""

    over_time: Callable[[ContactSolver | GridContactSolver], PressBy]
    lasting_share: float


def _memory(relaxation: Relaxation, trajectory: Trajectory) -> _Memory:
    def over_time(contact: ContactSolver | GridContactSolver) -> PressBy:
        rested = _rested(trajectory)
        return RelaxingContact(contact, relaxation, trajectory.dt_ms, rested=rested).press_by

    return {"over_time": over_time, "lasting_share": relaxation.lasting_share}


def _solve(
    pad: Pad, shape: Shape | None, trajectory: Trajectory, friction: float, memory: _Memory
) -> ContactHistory:
    """Contact of elastic skin, or of skin with a memory."""
    deepest_um = 0.0 if trajectory.by_force else float(trajectory.level.max())
    goes_in_and_out = not (trajectory.pins is not None or trajectory.slides or memory)
    if deepest_um > MOST_UM and not (goes_in_and_out and has_large_strain(pad)):
        raise UsageError(
            "is for shapes that go in and out of the pad of a finger without ridges of its own",
            argument="depth_um",
            found=deepest_um,
            expected=f"at most {MOST_UM:g} um",
        )
    if trajectory.pins is not None:
        return _press_pins(pad, trajectory, trajectory.pins, memory)
    if shape is None:
        raise UsageError("neither a shape nor pins", argument="shape")
    if trajectory.slides:
        return _slide(pad, shape, trajectory, friction, memory)
    if memory:
        return _press_over_time(pad, shape, trajectory, memory)
    highest = float(trajectory.level.max())
    states = _shared_states(pad, shape, highest, by_force=trajectory.by_force)
    return replace(states, position=np.clip(trajectory.level, 0.0, states.knots[-1]))


def _shared_states(pad: Pad, shape: Shape, highest: float, *, by_force: bool) -> ContactHistory:
    """States of a press up to `highest` um, or N by force: those of its rung, or its own.

    Without a rung is what presses nothing, or where its top is beyond what can be solved.
    """
    touched = pad, shape_key(shape)
    if highest >= (LEAST_N if by_force else LEAST_UM):
        try:
            top, is_large = rung_of(pad, shape, highest, by_force=by_force)
            # A pad that is seen from a side is made anew for each touch.
            key = None if pad.pose else (*touched, top, is_large, by_force)
            make = partial(_states_up_to, pad, shape, top, is_large, by_force=by_force, key=key)
            states = kept(key, make, lambda made: made.nbytes)
            advance("contact", 1.0)  # also if they were kept
            if states.large_strain is not None:  # fields on the pad, 50 MB, are those of a touch
                states = replace(states, large_strain=replace(states.large_strain))
            return states
        except UsageError:  # deeper than can be solved, or all of it is wrong: raised again
            pass
    highest = max(highest, 1e-9)
    # A force that never presses is a depth of nothing.
    by_force = by_force and highest > 1e-9
    level = levels_up_to(highest)
    is_large = has_large_strain(pad) and is_deep(pad, shape, level, by_force=by_force)
    return _states_up_to(pad, shape, highest, is_large, by_force=by_force)


def _states_up_to(
    pad: Pad,
    shape: Shape,
    top: float,
    is_large: bool,
    *,
    by_force: bool,
    key: Hashable | None = None,
) -> ContactHistory:
    """States at `LEVELS` levels up to `top`, with large strain or without."""
    level = levels_up_to(top)
    nodes: SkinNodes
    large_strain = None
    if is_large and has_large_strain(pad):
        nodes, forces, depth_um, large_strain = press_deep(pad, shape, level, by_force=by_force)
    else:
        nodes, forces, depth_um = press_to(pad, shape, level, by_force=by_force)
    is_loaded = np.asarray((forces > 0).any(axis=0))
    nodes, forces = nodes.subset(is_loaded), forces[:, is_loaded]
    return ContactHistory(
        nodes,
        forces,
        forces.sum(axis=1),
        depth_um,
        level,
        np.zeros(0),
        large_strain=large_strain,
        key=key,
    )


def _press_over_time(
    pad: Pad, shape: Shape, trajectory: Trajectory, memory: _Memory
) -> ContactHistory:
    """Contact, sample by sample, of a shape that goes in and out of skin that relaxes."""
    nodes = pad.skin_nodes()
    gap_mm = nodes.gaps_mm(shape) - pad.first_touch_mm(shape)

    def gaps_at(rows: IntArray, samples: IntArray) -> FloatArray:
        return np.broadcast_to(gap_mm[rows], (samples.size, rows.size))

    level, by_force = np.maximum(trajectory.level, 0.0), trajectory.by_force
    steps = press_steps(
        nodes, gaps_at, lambda reach_mm: gap_mm < reach_mm, level, by_force=by_force, **memory
    )
    samples = np.arange(level.size, dtype=np.float64)
    return ContactHistory(
        steps.nodes, steps.forces_n, steps.total_n, steps.depth_um, samples, samples
    )


def _press_pins(
    pad: Pad, trajectory: Trajectory, pins: PinArray, memory: _Memory
) -> ContactHistory:
    """Contact, sample by sample, of pins that move on their own."""
    nodes = pad.skin_nodes()
    pin_gaps = []
    nearest_um = np.full(nodes.size, np.inf)
    for (x_mm, z_mm, diameter_mm), depth_um in zip(pins.positions, pins.depth_um.T, strict=True):
        pin = Shape.punch(diameter_mm).moved(x_mm, z_mm)
        gap_um = (nodes.gaps_mm(pin) - pad.first_touch_mm(pin)) / MM_PER_UM
        under = np.flatnonzero(gap_um < depth_um.max())
        pin_gaps.append((under, gap_um[under]))
        nearest_um[under] = np.minimum(nearest_um[under], gap_um[under] - depth_um.max())

    def gaps_at(rows: IntArray, samples: IntArray) -> FloatArray:
        overlap_um = np.full((samples.size, nodes.size), -np.inf)
        for (under, gap_um), depth_um in zip(pin_gaps, pins.depth_um.T, strict=True):
            pin_overlap_um = depth_um[samples, None] - gap_um
            overlap_um[:, under] = np.maximum(overlap_um[:, under], pin_overlap_um)
        return -overlap_um[:, rows] * MM_PER_UM

    level = np.zeros(trajectory.level.size)
    steps = press_steps(
        nodes, gaps_at, lambda reach_mm: nearest_um * MM_PER_UM < reach_mm, level, **memory
    )
    samples = np.arange(level.size, dtype=np.float64)
    return ContactHistory(
        steps.nodes, steps.forces_n, steps.total_n, trajectory.level, samples, samples
    )


def _slide(
    pad: Pad, shape: Shape, trajectory: Trajectory, friction: float, memory: _Memory
) -> ContactHistory:
    """Contact, step by step, of a shape that slides; friction drags the skin along.

    Depth is counted from where the shape's highest plane touches the pad's apex.
    """
    if trajectory.x_mm is None or trajectory.z_mm is None:
        raise UsageError("expected a trajectory that slides", argument="trajectory")
    step_mm = np.stack([np.gradient(trajectory.x_mm), np.gradient(trajectory.z_mm)], -1)
    speed = np.hypot(*step_mm.T)
    fastest = max(float(speed.max()), 1e-9)
    direction = step_mm / np.maximum(speed, 1e-12)[:, None]
    is_steady = (
        np.abs(direction - direction[0]).max() < 1e-6
        and slid_before(trajectory.x_mm, trajectory.z_mm)
        and float(trajectory.level.min()) > 0
    )
    steady_drag = (friction * float(direction[0, 0]), friction * float(direction[0, 1]))
    fine_mm = pad.spacing_mm / pad.steps_per_node
    stride = (
        1
        if memory or np.ptp(trajectory.level)
        else max(1, min(int(fine_mm / fastest), _MAX_STRIDE))
    )
    samples = np.arange(trajectory.level.size, dtype=np.int64)
    states = np.unique(np.append(samples[::stride], samples[-1]))
    x_mm, z_mm = trajectory.x_mm[states], trajectory.z_mm[states]

    all_nodes = pad.skin_nodes()
    seen_x_mm, seen_z_mm = all_nodes.seen_mm
    skin_mm = all_nodes.height_mm

    def gaps_at(rows: IntArray, steps: IntArray) -> SingleArray:
        at_x_mm, at_z_mm, height_mm = seen_x_mm[rows], seen_z_mm[rows], skin_mm[rows]
        gaps = np.empty((steps.size, rows.size), dtype=np.float32)
        for gap, step in zip(gaps, steps.tolist(), strict=True):
            gap[:] = shape.height_mm(at_x_mm - x_mm[step], at_z_mm - z_mm[step]) - height_mm
        return gaps

    def reached(reach_mm: float) -> BoolArray:
        # Heights are at least 0: only this skin can be touched, and a texture soon touches most.
        is_reached = np.zeros(all_nodes.size, dtype=bool)
        rows = np.flatnonzero(-skin_mm < reach_mm)
        order = np.argsort(np.arange(states.size) * 0.6180339887 % 1.0)
        for step in order.tolist():
            if not rows.size:
                break
            touched = gaps_at(rows, np.array([step]))[0] < reach_mm
            is_reached[rows[touched]] = True
            rows = rows[~touched]
        return is_reached

    level = trajectory.level[states]
    try:
        steps = press_steps(
            all_nodes,
            gaps_at,
            reached,
            level,
            by_force=trajectory.by_force,
            drag=steady_drag if is_steady else (0.0, 0.0),
            **memory,
        )
    except UsageError as error:  # a map that slides away sinks in with what is left of it
        if text := texture_warning(shape.name, texture_end_ms(shape, trajectory, (0.0, 0.0))):
            raise UsageError(f"{error}; {text}", argument="trajectory") from error
        raise
    forces = steps.forces_n
    window = pad.averaged_mm / (fastest * stride) if speed.any() else 1.0
    loaded = np.maximum(level, 0.0)
    share = loaded / np.maximum(_moving_mean(loaded, window), 1e-12)
    total_n = np.zeros(states.size)
    # Some nodes at a time: sums over all steps are in double precision.
    width = max(1, _NUMBERS_PER_BLOCK // states.size)
    for first in range(0, forces.shape[1], width):
        block = forces[:, first : first + width]
        mean_n = share[:, None] * _moving_mean(block, window)
        total_n += mean_n.sum(axis=1)
        block[:] = mean_n
    depth_um = _moving_mean(steps.depth_um, window) if trajectory.by_force else level
    drag = None
    if friction and is_steady:
        drag = np.broadcast_to(steady_drag, (states.size, 2))
    elif friction:
        slip_mm = friction * MM_PER_UM * np.interp(samples, states, depth_um)
        touches = np.interp(samples, states, total_n) > 0
        shares = friction_shares(trajectory.x_mm, trajectory.z_mm, slip_mm, touches)
        drag = friction * shares[states]
    return ContactHistory(
        steps.nodes,
        forces,
        total_n,
        depth_um,
        knots=states.astype(np.float64),
        position=samples.astype(np.float64),
        drag=drag,
    )


def _moving_mean(values: FloatArray | SingleArray, window: float) -> FloatArray:
    """Mean over `window` steps around each, also a part of a step; shorter at the ends.

    Over the time of just one node all that repeats from node to node is gone.
    """
    if window <= 1:
        return np.asarray(values, dtype=np.float64)
    from scipy.interpolate import make_interp_spline

    count = len(values)
    total = np.zeros((count + 1, *values.shape[1:]))
    np.cumsum(values, axis=0, dtype=np.float64, out=total[1:])
    integral = make_interp_spline(np.arange(count + 1), total, k=1)
    middle = np.arange(count) + 0.5
    first, last = np.maximum(middle - window / 2, 0), np.minimum(middle + window / 2, count)
    return np.asarray(((integral(last) - integral(first)).T / (last - first)).T)


def _middle_mm(contact: ContactHistory) -> tuple[float, float]:
    """Middle of the contact once it has half of its largest force, in the plane of the shape."""
    half_n = 0.5 * contact.total_n[contact.hardest]
    force_n = contact.forces_n[int((contact.total_n >= half_n).argmax())]
    x_mm, z_mm = contact.nodes.seen_mm
    total_n = max(float(force_n.sum()), 1e-30)
    return float(force_n @ x_mm) / total_n, float(force_n @ z_mm) / total_n


def contact_warnings(
    pad: Pad,
    shape: Shape | None,
    trajectory: Trajectory,
    contact: ContactHistory,
    depth_um: float,
) -> list[str]:
    """Warnings of a contact `depth_um` deep, see `fembridge.touching.contact_warnings`."""
    if not contact.forces_n.size:
        return []
    narrow, ended, end_ms = None, shape, None
    if shape is not None:
        end_ms = texture_end_ms(shape, trajectory, _middle_mm(contact))
    if trajectory.pins is not None:
        narrowest_mm = min(diameter_mm for *_, diameter_mm in trajectory.pins.positions)
        narrow = narrow_warning(pad, "a pin", narrowest_mm)
    elif shape is not None:
        hardest = contact.hardest
        if trajectory.x_mm is not None and trajectory.z_mm is not None:
            sample = int(contact.knots[hardest])
            shape = shape.moved(float(trajectory.x_mm[sample]), float(trajectory.z_mm[sample]))
        width_mm = kept(
            contact.key and (contact.key, hardest, "narrow part"),
            partial(narrow_part_mm, pad, shape, contact.nodes, contact.forces_n[hardest]),
            getsizeof,
        )
        narrow = narrow_warning(pad, shape.name, width_mm)
    end = end_warning(pad, contact.nodes, contact.forces_n[: contact.reached])
    deep = depth_warning(depth_um, large=contact.large_strain is not None)
    texts = (end, narrow, deep, None if ended is None else texture_warning(ended.name, end_ms))
    return [text for text in texts if text]
