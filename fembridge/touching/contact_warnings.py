"""Warnings of a contact: too deep, at the end of the pad, or of too fine a shape.

Rules, with h the distance between two nodes of the skin:

- deeper than `TRUSTED_UM`: where large strain is computed, what is known of its error; else that
  superposition is that of small strains;
- at any time more than a hundredth of the force on the last nodes across or along the finger:
  beyond them the shape meets no skin;
- parts of a shape, or grooves in it, narrower than 1.75 h, see `narrow_part_mm`.
"""

import numpy as np

from fembridge.touching.pad import Pad, SkinNodes
from fembridge.touching.shape import Shape
from fembridge.touching.trajectory import Trajectory
from fembridge.typing import BoolArray, FloatArray, SingleArray

# Up to here a depth needs no warning (docs/how_to/touch.md: what was compared with large strain).
TRUSTED_UM = 1_000.0
# Share of the force on the last nodes of the skin above which contact goes on beyond them.
_END_SHARE = 0.01
# States with less than this share of the largest force do not count.
_LEAST_SHARE = 0.01
# Parts narrower than so many distances of nodes lie on one or two nodes as they happen to stand:
# the force on a pin of 0.4 mm changes by 17 % with that, of 0.5 mm by 8 %, of 1 mm by 1 %.
NARROW = 1.75
# Heights are sampled at so many places between two nodes, and compared up to so much below the
# highest one, both as a share of the distance of nodes.
_SAMPLES, _LEVEL, _LOW_LEVEL = 8, 1 / 16, 1.0
# Heights are sampled so many distances of nodes beyond the contact, half of that is its middle.
_MARGIN = 4.0
# A flat part keeps more than this share of its area at a quarter of the level; of a ball it is a
# quarter, of a cylinder half: they get wider as they are pressed.
_FLAT_SHARE = 0.7
# Parts that hold less of all the area do not count: specks of a picture.
_SPECK_SHARE = 0.1


def depth_warning(depth_um: float, *, large: bool = False) -> str | None:
    """Warning of a depth; None up to `TRUSTED_UM`. `large`: large strain was computed."""
    if depth_um <= TRUSTED_UM:
        return None
    if not large:
        return (
            f"{depth_um:.0f} um deep, computed with small strain: beyond {TRUSTED_UM:.0f} um "
            "forces are 10 % and more off, stress in the epidermis under a wide shape a factor of 2"
        )
    return (
        f"{depth_um:.0f} um deep, computed with large strain: compared with whole contact runs "
        "of the human finger, forces are within 8 % and stress under a plate mostly within 20 %, "
        "under a ball of 5 mm up to 40 % low"
    )


def end_warning(pad: Pad, nodes: SkinNodes, forces_n: FloatArray | SingleArray) -> str | None:
    """Warning of contact at the end of the skin that may be touched; None if there is none.

    `forces_n` is ``(S, node)``.
    """
    total = np.asarray(forces_n.sum(axis=1))
    counts = total > _LEAST_SHARE * total.max(initial=0.0)
    if not counts.any():
        return None
    shares = {
        name: float((forces_n[:, at].sum(axis=1)[counts] / total[counts]).max())
        for name, at in pad.end_nodes(nodes).items()
        if at.any()
    }
    parts = [f"{share:.0%} ({name})" for name, share in shares.items() if share > _END_SHARE]
    if not parts:
        return None
    return (
        f"contact reaches the end of the skin that may be touched, {pad.limits}: the "
        f"last nodes carry up to {', '.join(parts)} of the force, and skin beyond them is missing"
    )


def texture_end_ms(
    shape: Shape, trajectory: Trajectory, middle_mm: tuple[float, float]
) -> float | None:
    """When the end of a height map that slides passes the middle of the contact; None: never.

    Before it has come there, the map has not ended.
    """
    half_mm = shape.half_size_mm
    if half_mm is None or trajectory.x_mm is None or trajectory.z_mm is None:
        return None
    x_mm, z_mm = shape.own_position_mm(
        middle_mm[0] - trajectory.x_mm, middle_mm[1] - trajectory.z_mm
    )
    is_over = (np.abs(x_mm) <= half_mm[0]) & (np.abs(z_mm) <= half_mm[1])
    if not is_over.any() or is_over[-1]:
        return None
    return float((np.flatnonzero(is_over)[-1] + 1) * trajectory.dt_ms)


def texture_warning(name: str, end_ms: float | None) -> str | None:
    """Warning of a height map that slides away; None if it does not."""
    if end_ms is None:
        return None
    return (
        f"{name} ends after {end_ms:g} ms: a shorter slide is needed, or a map that repeats (tile)"
    )


def narrow_warning(pad: Pad, name: str, width_mm: float | None) -> str | None:
    """Warning of parts of a shape that are `width_mm` wide; None if the nodes resolve them."""
    limit_mm = NARROW * pad.spacing_mm
    if width_mm is None or width_mm >= limit_mm - 1e-9:
        return None
    return (
        f"{name} has parts about {width_mm:.2g} mm wide; nodes of the skin {pad.spacing_mm:.3g} mm "
        f"apart resolve {limit_mm:.2g} mm: {pad.remedy_for_narrow} is needed"
    )


def narrow_part_mm(
    pad: Pad, shape: Shape, nodes: SkinNodes, force_n: FloatArray | SingleArray
) -> float | None:
    """Width of the parts of `shape` that are too narrow for the nodes around the contact.

    None: no part is. `force_n` ``(node,)`` is the contact. Heights are sampled between the
    nodes. A part is what lies within h/16 below the highest place, h the distance of nodes;
    its width is the diameter of the largest circle in it. Too narrow are flat parts and
    the grooves between parts where that is less than `NARROW` h, and pointed parts that are still
    narrower h below their top. Parts with less than a tenth of the area of all do not count.
    """
    from scipy.ndimage import distance_transform_edt, label

    pressed = np.asarray(force_n > 0)
    if not pressed.any():
        return None
    fine_mm = pad.spacing_mm / _SAMPLES
    margin_mm = _MARGIN * pad.spacing_mm
    x, z = (
        np.arange(at_mm.min() - margin_mm, at_mm.max() + margin_mm + fine_mm, fine_mm)
        for at_mm in (seen_mm[pressed] for seen_mm in nodes.seen_mm)
    )
    z = np.zeros(1) if pad.plane else z
    height_mm = shape.height_mm(*np.meshgrid(x, z, indexing="ij"))
    # Beyond the border nothing is sampled: circles end there. Parts that count are those that
    # reach into the middle, whose own circles do not end at the border.
    rim = round(0.5 * _MARGIN * _SAMPLES)
    middle = (slice(rim, -rim), slice(None) if pad.plane else slice(rim, -rim))
    to_border = np.minimum.outer(*(_places_to_end(at.size) for at in (x, z)))
    below_mm = height_mm - height_mm[middle].min()
    level_mm = _LEVEL * pad.spacing_mm
    limit_mm = NARROW * pad.spacing_mm

    def narrow_mm(inside: BoolArray, core: BoolArray | None, wider_mm: float) -> list[float]:
        """Widths of parts too narrow; edges at 45 degrees make them `wider_mm` than the shape's."""
        if inside.all() or not inside.any():
            return []
        part, count = label(inside, np.ones((3, 3)))
        radius = np.minimum(distance_transform_edt(inside), to_border)
        circle = np.zeros(count + 1)
        np.maximum.at(circle, part.ravel(), radius.ravel())
        width_mm = (2 * circle[1:] - 1) * fine_mm - wider_mm
        area, in_middle, of_core = (
            np.bincount(some.ravel(), minlength=count + 1)[1:]
            for some in (part, part[middle], part if core is None else part[core])
        )
        narrow = (width_mm < limit_mm - 1e-9) & (in_middle > 0) & (of_core > _FLAT_SHARE * area)
        if area[narrow].sum() <= _SPECK_SHARE * area.sum():
            return []
        return [float(width) for width in width_mm[narrow]]

    raised = below_mm <= level_mm
    widths_mm = [
        *narrow_mm(raised, below_mm <= level_mm / 4, 2 * level_mm),
        *narrow_mm(~raised, None, -2 * level_mm),
        *narrow_mm(below_mm <= _LOW_LEVEL * pad.spacing_mm, None, 0.0),
    ]
    return max(min(widths_mm), fine_mm) if widths_mm else None


def _places_to_end(count: int) -> FloatArray:
    """How many of `count` places it is to the nearer end; of a single one it is far away."""
    places = np.arange(1.0, count + 1.0)
    return np.minimum(places, places[::-1]) if count > 1 else np.full(1, np.inf)
