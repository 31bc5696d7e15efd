"""A touch: a shape, how it moves, and what the afferents of a fingertip make of it.

Where a shape only goes in and out, the skin's stress is a function of its depth (or
force): contact is solved at some depths and each sample is read between them, as a
response map is. Where it slides, or pins move on their own, contact is solved step by
step. Stress is superposed from the contact's forces, and all units fire in one pass.

A scan is resolved to one node of the skin: forces, in proportion to what presses, are
averaged over the time in which the shape moves by that. Without it each node that comes
into contact would be a tap.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.errors import UsageError
from fembridge.stimulus import Stimulus
from fembridge.store import filling, write_text
from fembridge.touching.contact import (
    MM_PER_UM,
    SkinNodes,
    first_touch_mm,
    gaps_mm,
    press_all,
    press_to,
    skin_nodes,
)
from fembridge.touching.pad import Pad, pad_named
from fembridge.touching.population import (
    ENDINGS_MM,
    Population,
    check_inside,
    population_named,
)
from fembridge.touching.shape import Shape, shape_named
from fembridge.touching.stress import driving_stress_pa
from fembridge.touching.way import Pins, Way, read_pins, way_of
from fembridge.typing import FloatArray, SingleArray, Table
from neural.encoder import UnitSpikes, encode_units
from neural.parameter_sets import ParameterSet, parameter_set
from neural.parameters import Parameters

if TYPE_CHECKING:
    import pandas

POPULATION_FILE, TOUCH_FILE = "population.csv", "touch.csv"
SPIKES_FILE, RATES_FILE = "spikes.csv", "rates.csv"

# Friction of skin on what it touches (Ishizuka et al., 3.1).
FRICTION = 0.4
# Depths at which contact is solved for a shape that goes in and out.
LEVELS = 25
# A shape that slides is solved at least so often while it moves by one node.
_STEPS_A_NODE = 8
_MOST_EVERY = 20
_MS_PER_S = 1.0e3
# What is touched.
PAD = "reference"


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """Forces ``(S, node)`` on `nodes` and depths ``(S,)`` at the states that were solved.

    Sample n of the touch lies at `at` ``(T,)`` among their rising `knots` ``(S,)``. `drag`
    ``(S, 2)`` is the force along x and z that comes with 1 N into the skin; None where
    nothing slips.
    """

    nodes: SkinNodes
    forces_n: FloatArray | SingleArray
    depth_um: FloatArray
    knots: FloatArray
    at: FloatArray
    drag: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Touch:
    """What came of a touch.

    `stress_pa` ``(T, unit)`` drives each unit, `force_n` and `depth_um` ``(T,)`` are the
    shape's; `solved` is the contact.
    """

    population: Population
    way: Way
    stress_pa: FloatArray
    force_n: FloatArray
    depth_um: FloatArray
    solved: Solved
    fired: UnitSpikes
    trials: int = 1
    origin: Table = field(default_factory=dict)

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
    shape: str | Shape = "punch",
    *,
    stimulus: str | Stimulus | None = None,
    press_um: float | None = None,
    press_n: float | None = None,
    ramp_ms: float = 50.0,
    hold_ms: float = 500.0,
    slide_mm_per_s: float | None = None,
    direction_deg: float = -90.0,
    duration_ms: float = 1000.0,
    path: Path | str | None = None,
    pins: Path | str | None = None,
    at_mm: tuple[float, float] = (0.0, 0.0),
    angle_deg: float = 0.0,
    pixel_mm: float | None = None,
    relief_mm: float | None = None,
    friction: float = FRICTION,
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
    slide_mm_per_s, direction_deg, duration_ms
        The shape slides that way, 0 degrees is to the right, 90 towards the tip.
    path
        A table ``time_ms,x_mm,z_mm`` with ``depth_um`` or ``force_n``.
    pins
        In place of a shape, a table ``x_mm,z_mm,diameter_mm,stimulus``.
    at_mm, angle_deg
        Where the shape's middle is at first, and how far it is rotated.
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
        Depth before time 0 of a stimulus. None: as in the fit of the parameters.
    repeats, noise_mv, seed
        Trials, the noise of the membrane in mV after 1 ms, and its seed.

    Returns
    -------
    Touch
        ``population``, ``spikes`` and ``rates`` (DataFrames), ``stress_pa``, ``force_n``,
        ``depth_um``; ``fb.plot(it)`` is the pad from above, ``write(folder)`` the tables
        of the command.

    Raises
    ------
    UsageError, StimulusError, TableError
        Words, numbers or files that mean nothing, or a shape beside the pad.
    ResponseError
        A pad that was altered.

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
    depth_um = chosen.preindent_um if preindent_um is None else preindent_um
    if pins is not None:
        others = (stimulus, press_um, press_n, slide_mm_per_s, path)
        if any(each is not None for each in others):
            raise UsageError("pins have waveforms of their own: no other way beside them")
        way, rigid = read_pins(pins, preindent_um=depth_um), None
    else:
        named = shape if isinstance(shape, Shape) else shape_named(shape, pixel_mm, relief_mm, log)
        rigid = named.rotated(angle_deg).moved(*at_mm)
        way = way_of(
            stimulus, press_um, press_n, ramp_ms, hold_ms, slide_mm_per_s, direction_deg,
            duration_ms, path, depth_um, log,
        )  # fmt: skip
    if stimulus is not None and depth_um and preindent_um is None:
        log(
            f"parameters {chosen.name}: the shape is {depth_um:g} um deep before time 0, as "
            "in their fit"
        )
    origin = {"parameter_set": chosen.name, "seed": seed}
    return touch_skin(
        skin, rigid, way, units, chosen.parameters,
        friction=friction, trials=repeats, noise_mv=noise_mv, seed=seed, origin=origin,
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
    """
    if not 1 <= trials <= 10_000:
        raise UsageError(f"{trials} repeats, expected 1 to 10000")
    if seed < 0:
        raise UsageError(f"seed is {seed}, expected 0 or more")
    check_inside(pad, population)
    if way.pins is not None:
        solved = _pinned(pad, way, way.pins)
    elif shape is None:
        raise UsageError("nothing touches: neither a shape nor pins")
    elif way.slides:
        solved = _slid(pad, shape, way, friction)
    else:
        most = max(float(way.pressed.max()), 1e-9)
        level = most * (np.arange(LEVELS) / (LEVELS - 1)) ** 1.5
        pressed = press_to(pad, shape, level, newton=way.newton)
        solved = Solved(*pressed, level, np.clip(way.pressed, 0.0, most))
    pushed = np.asarray((solved.forces_n > 0).any(axis=0))
    nodes, forces = solved.nodes.subset(pushed), solved.forces_n[:, pushed]
    solved = replace(solved, nodes=nodes, forces_n=forces)
    states = (
        driving_stress_pa(pad, nodes, forces, population, solved.drag),
        forces.sum(axis=1),
        solved.depth_um,
    )
    stress, total_n, depth_um = (between(solved.knots, each, solved.at) for each in states)
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
    about: Table = {"pad": dict(pad.origin), "nodes_in_contact": int(pushed.sum())}
    if _at_the_end(pad, nodes, forces):
        about["note"] = (
            f"contact reaches the end of the skin that may be touched, {pad.reach_mm:.3g} mm to "
            "both sides of the apex: there is more of it than shown"
        )
    return Touch(
        population=population,
        way=way,
        stress_pa=stress,
        force_n=total_n,
        depth_um=depth_um,
        solved=solved,
        fired=fired,
        trials=trials,
        origin={**about, **(origin or {})},
    )


# ---- Forces


def _pinned(pad: Pad, way: Way, pins: Pins) -> Solved:
    """Contact sample by sample of pins that move on their own."""
    samples = np.arange(way.pressed.size, dtype=np.float64)
    nodes = skin_nodes(pad)
    overlap_um = np.full((samples.size, nodes.column.size), -np.inf)
    for (x_mm, z_mm, diameter_mm), depth_um in zip(pins.places, pins.depth_um.T, strict=True):
        alone = Shape.punch(diameter_mm).moved(x_mm, z_mm)
        gap_um = (gaps_mm(nodes, alone) - first_touch_mm(pad, alone)) / MM_PER_UM
        under = gap_um < depth_um.max()
        here = depth_um[:, None] - gap_um[under]
        overlap_um[:, under] = np.maximum(overlap_um[:, under], here)
    pressed = press_all(nodes, -overlap_um * MM_PER_UM, np.zeros(samples.size))
    return Solved(*pressed[:2], way.pressed, samples, samples)


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
    everywhere = skin_nodes(pad)
    gaps = np.empty((row.size, everywhere.column.size), dtype=np.float32)
    for n, sample in enumerate(row.tolist()):
        gaps[n] = gaps_mm(everywhere, shape.moved(float(way.x_mm[sample]), float(way.z_mm[sample])))
    one_drag = (float(drag[0, 0]), float(drag[0, 1])) if straight else (0.0, 0.0)
    level = way.pressed[row]
    nodes, forces, depth_um = press_all(everywhere, gaps, level, newton=way.newton, drag=one_drag)
    if not forces.size:
        raise UsageError(f"{shape.name} touches the pad nowhere on its way")
    window = pad.spacing_mm / (fastest * every) if speed.any() else 1.0
    pressed = np.maximum(level, 0.0)
    part = pressed / np.maximum(_averaged(pressed, window), 1e-12)
    averaged = part[:, None] * _averaged(forces, window)
    drags = drag[row] if friction else None
    knots, at = (each.astype(np.float64) for each in (row, samples))
    depth_um = _averaged(depth_um, window) if way.newton else level
    return Solved(nodes, averaged, depth_um, knots, at, drags)


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


def _at_the_end(pad: Pad, nodes: SkinNodes, forces: FloatArray | SingleArray) -> bool:
    """Whether the outermost columns of skin carry more than a hundredth of the force."""
    outermost = (nodes.column == 0) | (nodes.column == pad.x_mm.size - 1)
    return bool(forces[:, outermost].sum() > 0.01 * forces.sum())


def between(knots: FloatArray, values: FloatArray | SingleArray, at: FloatArray) -> FloatArray:
    """Values ``(S, ...)`` at rising `knots`, read at `at` along a monotone cubic."""
    if np.array_equal(knots, at):
        return np.asarray(values, dtype=np.float64)
    from scipy.interpolate import PchipInterpolator

    found: FloatArray = PchipInterpolator(knots, values, axis=0)(at)
    return found


def parameters_on(pad: Pad, parameters: str | ParameterSet | None) -> ParameterSet:
    """The set of a name, a file, or as it is; None: the one that was fitted on such a pad."""
    if parameters is None:
        parameters = "fitted" if pad.plane else "fitted_pad"
    return parameter_set(parameters)
