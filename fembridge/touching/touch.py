"""A touch: a shape, how it moves, and what the afferents of a fingertip make of it.

Where a shape only goes in and out, the skin's stress is a function of its depth (or
force): contact is solved at some depths and each sample is read between them, as a
response map is. Where it slides, or pins move on their own, contact is solved step by
step. Stress is superposed from the contact's forces, and all units fire in one pass.

A scan is resolved to one node of the skin: forces, in proportion to what presses, are
averaged over the time in which the shape moves by that. Without it each node that comes
into contact would be a tap.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.errors import UsageError
from fembridge.memory import check_memory
from fembridge.stimulus import Stimulus
from fembridge.store import filling, write_text
from fembridge.touching.contact import (
    MM_PER_UM,
    MOST_UM,
    SkinNodes,
    first_touch_mm,
    gaps_mm,
    press_steps,
    press_to,
    skin_nodes,
)
from fembridge.touching.doubts import (
    depth_doubt,
    end_doubt,
    narrow_doubt,
    narrow_part_mm,
    warn,
)
from fembridge.touching.pad import Pad
from fembridge.touching.pad_file import pad_named
from fembridge.touching.population import (
    ENDINGS_MM,
    Population,
    check_inside,
    population_named,
)
from fembridge.touching.shape import SHAPES, Shape, shape_named
from fembridge.touching.stress import Solved, UnitStress, between
from fembridge.touching.way import Pins, Way, read_pins, way_of
from fembridge.typing import FloatArray, IntArray, SingleArray, Table
from neural.encoder import UnitSpikes, encode_units
from neural.parameter_sets import ParameterSet, parameter_set
from neural.parameters import Parameters

if TYPE_CHECKING:
    import pandas

POPULATION_FILE, TOUCH_FILE = "population.csv", "touch.csv"
SPIKES_FILE, RATES_FILE = "spikes.csv", "rates.csv"

# Friction of skin on what it touches (Ishizuka et al., 3.1), and the most that is solved.
FRICTION, _MAX_FRICTION = 0.4, 10.0
_MAX_TRIALS, _MAX_NOISE_MV = 10_000, 1_000.0
# Depths at which contact is solved for a shape that goes in and out.
LEVELS = 25
# A shape that slides is solved at least so often while it moves by one node.
_STEPS_A_NODE = 8
_MOST_EVERY = 20
# Numbers in double precision of which a mean over steps is made at a time.
_NUMBERS = 4_000_000
_MS_PER_S = 1.0e3
# What is touched, and by default what touches.
PAD, SHAPE = "reference", "punch"
# What the arguments of `touch` are that only some ways use, where they are None.
DEFAULTS: Mapping[str, Any] = {
    "at_mm": (0.0, 0.0),
    "angle_deg": 0.0,
    "friction": FRICTION,
    "ramp_ms": 50.0,
    "hold_ms": 500.0,
    "direction_deg": -90.0,
    "duration_ms": 1000.0,
}


@dataclass(frozen=True, eq=False)
class Touch:
    """What came of a touch.

    `force_n` and `depth_um` ``(T,)`` are the shape's; `solved` is the contact, and `stress_pa`
    is superposed from it when it is read.
    """

    population: Population
    way: Way
    force_n: FloatArray
    depth_um: FloatArray
    solved: Solved
    fired: UnitSpikes
    trials: int = 1
    origin: Table = field(default_factory=dict)

    @cached_property
    def stress_pa(self) -> FloatArray:
        """Stress that drives each unit, ``(T, unit)`` in Pa.

        Raises
        ------
        UsageError
            It takes more memory than `fembridge.memory` allows; `stress_of` has some units.
        """
        return self.stress_of(range(len(self.population)))

    def stress_of(self, units: Sequence[int]) -> FloatArray:
        """Stress that drives some `units`, counted from 0, ``(T, len(units))`` in Pa.

        Raises
        ------
        UsageError
            It takes more memory than `fembridge.memory` allows.
        """
        rows, samples = np.asarray(units, dtype=np.int64), self.way.pressed.size
        what = f"stress of {rows.size} units at {samples} samples"
        check_memory(2 * 8 * samples * rows.size, what, UsageError)
        return UnitStress(self.solved.nodes.pad, self.population, self.solved).whole(rows)

    @cached_property
    def spikes(self) -> "pandas.DataFrame":
        """``stimulus, afferent, unit, repeat, spike_time_ms``, a row a spike."""
        import pandas

        unit = np.array(self.population.unit, dtype=object)
        afferent = np.array(self.population.afferent, dtype=object)
        return pandas.DataFrame(
            {
                "stimulus": self.way.name,
                "afferent": afferent[self.fired.unit],
                "unit": unit[self.fired.unit],
                "repeat": self.fired.trial if self.trials > 1 else np.zeros_like(self.fired.trial),
                "spike_time_ms": self.fired.time_ms,
            }
        )

    @cached_property
    def rate_ips(self) -> FloatArray:
        """Mean rate of each unit over all trials, ``(unit,)``."""
        start, end = self.way.window_ms
        inside = (self.fired.time_ms > start) & (self.fired.time_ms <= end)
        counts = np.bincount(self.fired.unit[inside], minlength=len(self.population))
        return np.asarray(counts * _MS_PER_S / ((end - start) * self.trials), dtype=np.float64)

    @cached_property
    def rates(self) -> "pandas.DataFrame":
        """``stimulus, afferent, unit, rate_ips``, a row a unit."""
        import pandas

        return pandas.DataFrame(
            {
                "stimulus": self.way.name,
                "afferent": list(self.population.afferent),
                "unit": list(self.population.unit),
                "rate_ips": self.rate_ips,
            }
        )

    def summary(self) -> dict[str, dict[str, float]]:
        """Units, how many fire, mean and largest rate, by class."""
        afferent = np.array(self.population.afferent)
        found = {}
        for name in dict.fromkeys(self.population.afferent):
            rate = self.rate_ips[afferent == name]
            found[name] = {
                "units": int(rate.size),
                "firing": int((rate > 0).sum()),
                "mean_ips": float(rate.mean()),
                "most_ips": float(rate.max()),
            }
        return found

    def tables(self) -> "dict[str, pandas.DataFrame]":
        """Tables of ``fembridge touch`` by their files' names."""
        import pandas

        samples = {
            "time_ms": self.way.times_ms,
            "depth_um": self.depth_um,
            "force_n": self.force_n,
        }
        return {
            POPULATION_FILE: self.population.to_frame(),
            SPIKES_FILE: self.spikes,
            RATES_FILE: self.rates,
            TOUCH_FILE: pandas.DataFrame(samples),
        }

    def write(self, folder: Path | str) -> list[str]:
        """Write `tables`, all or none; their names.

        Raises
        ------
        OutputError
            `folder` cannot be written.
        """
        tables = self.tables()
        with filling(Path(folder), last=TOUCH_FILE) as draft:
            for name, table in tables.items():
                write_text(draft / name, table.to_csv(index=False, lineterminator="\n"))
        return list(tables)


def touch(
    shape: str | Shape = SHAPE,
    *,
    stimulus: str | Stimulus | None = None,
    press_um: float | None = None,
    press_n: float | None = None,
    ramp_ms: float | None = None,
    hold_ms: float | None = None,
    slide_mm_per_s: float | None = None,
    direction_deg: float | None = None,
    duration_ms: float | None = None,
    path: Path | str | None = None,
    pins: Path | str | None = None,
    at_mm: tuple[float, float] | None = None,
    angle_deg: float | None = None,
    pixel_mm: float | None = None,
    relief_mm: float | None = None,
    friction: float | None = None,
    population: str | Population = "fingertip",
    endings_mm: float = ENDINGS_MM,
    sa_von_mises: bool = False,
    pad: str | Pad = PAD,
    parameters: str | ParameterSet | None = None,
    preindent_um: float | None = None,
    repeats: int = 1,
    noise_mv: float = 0.0,
    seed: int = 0,
    log: Callable[[str], None] = lambda line: None,
) -> Touch:
    """Press, vibrate or slide a shape on a whole fingertip: every afferent's spikes.

    Parameters
    ----------
    shape
        A `Shape`, a word such as ``bar:width_mm=1``, or a file of heights (.png, .csv)
        with `pixel_mm` and, of a picture, `relief_mm`.
    stimulus
        An id, a `Stimulus` or a waveform's path: the shape's depth. Else `press_um` or
        `press_n`: ramp-and-hold, or while it slides.
    ramp_ms, hold_ms
        Of ramp-and-hold; 50 and 500.
    slide_mm_per_s, direction_deg, duration_ms
        The shape slides that way, 0 degrees is to the right, 90 towards the tip; -90 degrees
        for 1000 ms.
    path
        A table ``time_ms,x_mm,z_mm`` with ``depth_um`` or ``force_n``.
    pins
        Instead of a shape, a table ``x_mm,z_mm,diameter_mm,stimulus``.
    at_mm, angle_deg
        Where the shape's middle is at first, and how far it is rotated; (0, 0) and 0.
    friction
        Of what slides, 0 to 10; 0.4.
    population
        A `Population`, ``fingertip``, ``grid``, ``line``, ``one_each``, or a table.
    endings_mm
        An SA or RA unit has eight endings so far around the one at its place, half as
        sensitive, and feels by the one that is driven most; 0: it is a point.
    sa_von_mises
        SA units read von Mises stress, as in the paper, in place of a share of
        compression and of stretch.
    pad
        ``reference``, ``plane`` (the ridged section, endless along z), a file that
        ``fembridge pad`` made, or a `Pad`.
    parameters
        A set's name, a file or a set; None: ``fitted_pad``, on a plane pad ``fitted``.
    preindent_um
        Depth before time 0 of a stimulus, or of those of pins. None: as in the fit of the
        parameters.
    repeats, noise_mv, seed
        Trials, 1 to 10000, the noise of the membrane in mV after 1 ms, 0 to 1000, and its seed.

    Returns
    -------
    Touch
        ``population``, ``spikes`` and ``rates`` (DataFrames), ``stress_pa``, ``force_n``,
        ``depth_um``; ``fb.plot(it)`` is the pad from above, ``write(folder)`` the tables
        of the command.

    Raises
    ------
    UsageError, StimulusError, TableError
        Words, numbers or files that mean nothing, an argument that the chosen way does not
        use, or a shape beside the pad.
    ResponseError
        A pad that was altered.

    Warns
    -----
    FembridgeWarning
        Contact that reaches the end of the skin that may be touched, a shape with parts finer
        than the nodes resolve, or a depth of more than 1 mm; see `touch_skin`.

    Examples
    --------
    >>> import fembridge as fb
    >>> result = fb.touch("punch:diameter_mm=1", press_um=200, population="one_each")
    >>> result.rates["afferent"].tolist()
    ['SA', 'RA', 'PC']
    """
    skin = pad_named(pad)
    chosen = parameters_on(skin, parameters)
    units = population_named(population, skin.finger)
    units = replace(units, endings_mm=endings_mm, sa_von_mises=sa_von_mises)
    if preindent_um is not None and stimulus is None and pins is None:
        raise _unused("preindent_um", "a stimulus or pins")
    depth_um = chosen.preindent_um if preindent_um is None else preindent_um
    check_number("preindent_um", depth_um, 0.0, MOST_UM)
    optional: dict[str, Any] = {
        "at_mm": at_mm, "angle_deg": angle_deg, "friction": friction, "ramp_ms": ramp_ms,
        "hold_ms": hold_ms, "direction_deg": direction_deg, "duration_ms": duration_ms,
    }  # fmt: skip
    rigid: Shape | None = None
    if pins is not None:
        others = (stimulus, press_um, press_n, slide_mm_per_s, path)
        if any(other is not None for other in others):
            raise UsageError("pins have waveforms of their own: no other way beside them")
        if shape != SHAPE:
            raise UsageError("pins are the shape: no other shape beside them")
        optional |= {"pixel_mm": pixel_mm, "relief_mm": relief_mm}
        _refuse_unused(optional, (), "a shape, not with pins")
        way = read_pins(pins, preindent_um=depth_um)
    else:
        _check_height_map(shape, pixel_mm, relief_mm)
        named = shape if isinstance(shape, Shape) else shape_named(shape, pixel_mm, relief_mm, log)
        values = {name: DEFAULTS[name] if v is None else v for name, v in optional.items()}
        rigid = named.rotated(values["angle_deg"]).moved(*values["at_mm"])
        way = way_of(
            stimulus, press_um, press_n, values["ramp_ms"], values["hold_ms"], slide_mm_per_s,
            values["direction_deg"], values["duration_ms"], path, depth_um, log,
        )  # fmt: skip
        if stimulus is not None or path is not None or slide_mm_per_s is not None:
            _refuse_unused(optional, ("ramp_ms", "hold_ms"), "press_um or press_n without a slide")
        if slide_mm_per_s is None:
            _refuse_unused(optional, ("direction_deg", "duration_ms"), "slide_mm_per_s")
        if not way.slides:
            needs = "a shape that slides: slide_mm_per_s, path or a stimulus with a way aside"
            _refuse_unused(optional, ("friction",), needs)
    if stimulus is not None and depth_um and preindent_um is None:
        log(
            f"parameters {chosen.name}: the shape is {depth_um:g} um deep before time 0, as "
            "in their fit"
        )
    origin = {"parameter_set": chosen.name, "seed": seed}
    return touch_skin(
        skin, rigid, way, units, chosen.parameters,
        friction=FRICTION if friction is None else friction,
        trials=repeats, noise_mv=noise_mv, seed=seed, origin=origin,
    )  # fmt: skip


def touch_skin(
    pad: Pad,
    shape: Shape | None,
    way: Way,
    population: Population,
    parameters: Parameters,
    *,
    friction: float = FRICTION,
    trials: int = 1,
    noise_mv: float = 0.0,
    seed: int = 0,
    origin: Mapping[str, Any] | None = None,
) -> Touch:
    """Press or slide `shape`, or the pins of `way`, over the pad and fire all units.

    Raises
    ------
    UsageError
        A shape beside the pad, too deep, or with too many nodes in contact; a unit where
        the pad holds no stress.
    ParameterError
        Parameters of another time step or another quantity.

    Warns
    -----
    FembridgeWarning
        Contact at the end of the skin that may be touched, parts of the shape narrower than
        1.75 times the distance of nodes, a depth of more than 1 mm; all are also
        ``origin["note"]``.
    """
    check_number("friction", friction, 0.0, _MAX_FRICTION)
    check_number("repeats", trials, 1, _MAX_TRIALS, whole=True)
    check_number("noise_mv", noise_mv, 0.0, _MAX_NOISE_MV)
    check_number("seed", seed, 0, math.inf, whole=True)
    check_inside(pad, population)
    solved = _solved(pad, shape, way, friction)
    stress = UnitStress(pad, population, solved)
    fired = encode_units(
        stress,
        list(population.afferent),
        way.dt_ms,
        parameters,
        population.deviate,
        trials=trials,
        noise_mv=noise_mv,
        rng=np.random.default_rng(seed),
    )
    about: Table = {"pad": dict(pad.origin), "nodes_in_contact": solved.nodes.column.size}
    doubts = _doubts(pad, shape, way, solved)
    if doubts:
        about["note"] = "; ".join(doubts)
    for doubt in doubts:
        warn(doubt)
    return Touch(
        population=population,
        way=way,
        force_n=between(solved.knots, solved.total_n, solved.at),
        depth_um=between(solved.knots, solved.depth_um, solved.at),
        solved=solved,
        fired=fired,
        trials=trials,
        origin={**about, **(origin or {})},
    )


# ---- Arguments


def _unused(name: str, needs: str) -> UsageError:
    return UsageError(f"{name} is not used here: it goes with {needs}")


def _refuse_unused(optional: Mapping[str, Any], names: Sequence[str], needs: str) -> None:
    """Refuse those of `names`, or any if there are none, that are not None."""
    for name in names or optional:
        if optional[name] is not None:
            raise _unused(name, needs)


def _check_height_map(shape: str | Shape, pixel_mm: float | None, relief_mm: float | None) -> None:
    """Refuse sizes of a height map for another shape, and a relief of heights in mm."""
    if isinstance(shape, Shape) or shape.partition(":")[0] in SHAPES:
        _refuse_unused({"pixel_mm": pixel_mm}, ("pixel_mm",), "a file of heights")
        _refuse_unused({"relief_mm": relief_mm}, ("relief_mm",), "a picture of heights")
    elif shape.lower().endswith((".csv", ".txt")):
        _refuse_unused({"relief_mm": relief_mm}, ("relief_mm",), "a picture; a table is in mm")


def check_number(
    name: str, value: float, least: float, most: float, *, whole: bool = False
) -> None:
    """Refuse what is no number from `least` to `most`, or no whole one.

    Raises
    ------
    UsageError
        Names the argument and the range.
    """
    number = Integral if whole else Real
    if isinstance(value, number) and not isinstance(value, bool) and least <= value <= most:
        return
    kind = "a whole number" if whole else "a number"
    limits = f"from {least:g} to {most:g}" if most < math.inf else f"of {least:g} or more"
    raise UsageError(f"{name} is {value!r}, expected {kind} {limits}")


# ---- Forces


def _solved(pad: Pad, shape: Shape | None, way: Way, friction: float) -> Solved:
    """The contact, of the nodes that are pressed at any time."""
    if way.pins is not None:
        return _pinned(pad, way, way.pins)
    if shape is None:
        raise UsageError("nothing touches: neither a shape nor pins")
    if way.slides:
        return _slid(pad, shape, way, friction)
    most = max(float(way.pressed.max()), 1e-9)
    level = most * (np.arange(LEVELS) / (LEVELS - 1)) ** 1.5
    nodes, forces, depth_um = press_to(pad, shape, level, newton=way.newton)
    pushed = np.asarray((forces > 0).any(axis=0))
    nodes, forces = nodes.subset(pushed), forces[:, pushed]
    at = np.clip(way.pressed, 0.0, most)
    return Solved(nodes, forces, forces.sum(axis=1), depth_um, level, at)


def _pinned(pad: Pad, way: Way, pins: Pins) -> Solved:
    """Contact sample by sample of pins that move on their own."""
    nodes = skin_nodes(pad)
    under_pins = []
    nearest_um = np.full(nodes.column.size, np.inf)
    for (x_mm, z_mm, diameter_mm), depth_um in zip(pins.places, pins.depth_um.T, strict=True):
        alone = Shape.punch(diameter_mm).moved(x_mm, z_mm)
        gap_um = (gaps_mm(nodes, alone) - first_touch_mm(pad, alone)) / MM_PER_UM
        under = np.flatnonzero(gap_um < depth_um.max())
        under_pins.append((under, gap_um[under]))
        nearest_um[under] = np.minimum(nearest_um[under], gap_um[under] - depth_um.max())

    def gaps_at(chosen: IntArray, samples: IntArray) -> FloatArray:
        overlap_um = np.full((samples.size, nodes.column.size), -np.inf)
        for (under, gap_um), depth_um in zip(under_pins, pins.depth_um.T, strict=True):
            here = depth_um[samples, None] - gap_um
            overlap_um[:, under] = np.maximum(overlap_um[:, under], here)
        return -overlap_um[:, chosen] * MM_PER_UM

    level = np.zeros(way.pressed.size)
    pressed = press_steps(nodes, gaps_at, nearest_um * MM_PER_UM, level)
    samples = np.arange(level.size, dtype=np.float64)
    return Solved(pressed.nodes, pressed.forces_n, pressed.total_n, way.pressed, samples, samples)


def _slid(pad: Pad, shape: Shape, way: Way, friction: float) -> Solved:
    """Contact step by step while the shape slides; friction drags the skin along.

    Depth is counted from where the shape's highest plane touches the pad's apex.
    """
    if way.x_mm is None or way.z_mm is None:
        raise UsageError("a way that does not slide")
    step_mm = np.stack([np.gradient(way.x_mm), np.gradient(way.z_mm)], -1)
    speed = np.hypot(*step_mm.T)
    fastest = max(float(speed.max()), 1e-9)
    drag = friction * step_mm / np.maximum(speed, 1e-12)[:, None]
    straight = np.abs(drag - drag[0]).max() < 1e-6
    fine_mm = pad.spacing_mm / _STEPS_A_NODE
    every = 1 if np.ptp(way.pressed) else max(1, min(int(fine_mm / fastest), _MOST_EVERY))
    samples = np.arange(way.pressed.size, dtype=np.int64)
    row = np.unique(np.append(samples[::every], samples[-1]))
    x_mm, z_mm = way.x_mm[row], way.z_mm[row]

    def gap_at(nodes: SkinNodes, step: int) -> SingleArray:
        here = shape.moved(float(x_mm[step]), float(z_mm[step]))
        return gaps_mm(nodes, here).astype(np.float32)

    def gaps_at(chosen: IntArray, steps: IntArray) -> SingleArray:
        nodes = everywhere.subset(chosen)
        return np.stack([gap_at(nodes, step) for step in steps.tolist()])

    everywhere = skin_nodes(pad)
    nearest_mm = np.full(everywhere.column.size, np.inf, dtype=np.float32)
    for step in range(row.size):
        np.minimum(nearest_mm, gap_at(everywhere, step), out=nearest_mm)
    one_drag = (float(drag[0, 0]), float(drag[0, 1])) if straight else (0.0, 0.0)
    level = way.pressed[row]
    solved = press_steps(everywhere, gaps_at, nearest_mm, level, newton=way.newton, drag=one_drag)
    forces = solved.forces_n
    if not forces.size:
        raise UsageError(f"{shape.name} touches the pad nowhere on its way")
    window = pad.spacing_mm / (fastest * every) if speed.any() else 1.0
    pressed = np.maximum(level, 0.0)
    part = pressed / np.maximum(_averaged(pressed, window), 1e-12)
    total_n = np.zeros(row.size)
    # Some nodes at a time: sums over all steps are in double precision.
    width = max(1, _NUMBERS // row.size)
    for first in range(0, forces.shape[1], width):
        some = forces[:, first : first + width]
        averaged = part[:, None] * _averaged(some, window)
        total_n += averaged.sum(axis=1)
        some[:] = averaged
    drags = drag[row] if friction else None
    knots, at = (each.astype(np.float64) for each in (row, samples))
    depth_um = _averaged(solved.depth_um, window) if way.newton else level
    return Solved(solved.nodes, forces, total_n, depth_um, knots, at, drags)


def _averaged(values: FloatArray | SingleArray, window: float) -> FloatArray:
    """Mean over `window` steps around each, any part of one; at the ends over what is there.

    Over just one node's way all that repeats from node to node is gone.
    """
    if window <= 1:
        return np.asarray(values, dtype=np.float64)
    from scipy.interpolate import make_interp_spline

    count = len(values)
    total = np.zeros((count + 1, *values.shape[1:]))
    np.cumsum(values, axis=0, dtype=np.float64, out=total[1:])
    until = make_interp_spline(np.arange(count + 1), total, k=1)
    middle = np.arange(count) + 0.5
    first, last = np.maximum(middle - window / 2, 0), np.minimum(middle + window / 2, count)
    return np.asarray(((until(last) - until(first)).T / (last - first)).T)


def _doubts(pad: Pad, shape: Shape | None, way: Way, solved: Solved) -> list[str]:
    """What is doubtful about a contact, see `fembridge.touching.doubts`."""
    if not solved.forces_n.size:
        return []
    narrow = None
    if way.pins is not None:
        narrowest_mm = min(diameter_mm for *_, diameter_mm in way.pins.places)
        narrow = narrow_doubt(pad, "a pin", narrowest_mm)
    elif shape is not None:
        hardest = int(solved.total_n.argmax())
        if way.x_mm is not None and way.z_mm is not None:
            sample = int(solved.knots[hardest])
            shape = shape.moved(float(way.x_mm[sample]), float(way.z_mm[sample]))
        width_mm = narrow_part_mm(pad, shape, solved.nodes, solved.forces_n[hardest])
        narrow = narrow_doubt(pad, shape.name, width_mm)
    end = end_doubt(pad, solved.nodes, solved.forces_n)
    doubts = (end, narrow, depth_doubt(float(solved.depth_um.max())))
    return [doubt for doubt in doubts if doubt]


def parameters_on(pad: Pad, parameters: str | ParameterSet | None) -> ParameterSet:
    """The set of a name, a file, or as it is; None: the one that was fitted on such a pad."""
    if parameters is None:
        parameters = "fitted" if pad.plane else "fitted_pad"
    return parameter_set(parameters)
