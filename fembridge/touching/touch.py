"""A touch: a shape, how it moves, and what the afferents of a fingertip make of it.

Where a shape only goes in and out, the skin's stress is a function of its depth (or
force): contact is solved at some depths and each sample is read between them, as a
response map is. Where it slides, or pins move on their own, contact is solved step by
step. Stress is superposed from the contact's forces, and all units fire in one pass.

A scan is resolved to one node of the skin: forces are averaged over the time in which
the shape moves by that. Without it each node that comes into contact would be a tap.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from decks.stimuli import DT_MS
from fembridge.errors import UsageError
from fembridge.stimulus import Stimulus
from fembridge.store import write_text
from fembridge.tables import read_table, write_table
from fembridge.touching.contact import Contact, SkinNodes, gaps_mm, skin_height_mm, skin_nodes
from fembridge.touching.pad import Pad
from fembridge.touching.population import Population
from fembridge.touching.shape import Shape
from fembridge.touching.stress import influence_pa, von_mises_pa
from fembridge.typing import FloatArray, IntArray, SingleArray, Table
from neural.parameters import Parameters
from neural.units import UnitSpikes, encode_units

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
# Under a force, skin so far from the shape is first taken to be all that touches.
_FIRST_REACH_MM = 0.25
_MM_PER_UM = 1.0e-3
_MS_PER_S = 1.0e3
# The deepest that superposition of small strains is meant for.
MOST_UM = 2_000.0
_MOST_N = 20.0
_MOST_SAMPLES = 200_001


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """How a shape moves: samples every `dt_ms` from time 0.

    `depth_um` ``(T,)`` below first touch, or `force_n` ``(T,)``; the other is None.
    `x_mm`, `z_mm` ``(T,)`` are its way over the skin, None where it does not slide.
    `window_ms` is when spikes are counted.
    """

    name: str
    dt_ms: float
    window_ms: tuple[float, float]
    depth_um: FloatArray | None = None
    force_n: FloatArray | None = None
    x_mm: FloatArray | None = None
    z_mm: FloatArray | None = None

    def __post_init__(self) -> None:
        if (self.depth_um is None) == (self.force_n is None):
            raise UsageError("a shape is pressed to a depth or with a force, one of both")
        if self.pressed.size > _MOST_SAMPLES:
            raise UsageError(f"{self.pressed.size} samples, expected at most {_MOST_SAMPLES}")
        most, unit = (MOST_UM, "um") if self.force_n is None else (_MOST_N, "N")
        if not self.pressed.max() <= most:
            raise UsageError(f"pressed by {self.pressed.max():g} {unit}, expected at most {most:g}")

    @property
    def pressed(self) -> FloatArray:
        """Depth in um or force in N, ``(T,)``."""
        if self.depth_um is not None:
            return self.depth_um
        return np.zeros(0) if self.force_n is None else self.force_n

    @property
    def slides(self) -> bool:
        """Whether the shape moves over the skin."""
        return self.x_mm is not None

    @property
    def times_ms(self) -> FloatArray:
        """Time of each sample, ``(T,)``."""
        times: FloatArray = np.arange(self.pressed.size, dtype=np.float64) * self.dt_ms
        return times

    @classmethod
    def of_stimulus(cls, stimulus: Stimulus) -> "Way":
        """The way of a stimulus of the catalogue; its way aside is along x."""
        aside = stimulus.aside_um
        still = None if aside is None else np.zeros(aside.size)
        return cls(
            stimulus.id,
            stimulus.dt_ms,
            stimulus.window_ms,
            depth_um=np.asarray(stimulus.displacement_um),
            x_mm=None if aside is None else aside * _MM_PER_UM,
            z_mm=still,
        )

    @classmethod
    def hold(
        cls,
        press_um: float | None = None,
        press_n: float | None = None,
        ramp_ms: float = 50.0,
        hold_ms: float = 500.0,
    ) -> "Way":
        """Ramp, hold and ramp back; the ramps are raised cosines."""
        level, name = _level(press_um, press_n)
        if not (DT_MS <= ramp_ms <= 10_000 and DT_MS <= hold_ms <= 60_000):
            raise UsageError(f"ramp {ramp_ms:g} ms, hold {hold_ms:g} ms: expected 0.5 ms and more")
        ramp = 0.5 * (1 - np.cos(np.pi * np.arange(round(ramp_ms / DT_MS)) * DT_MS / ramp_ms))
        rest = np.zeros(20)  # 10 ms before, so that the onset is one
        held = np.ones(round(hold_ms / DT_MS) + 1)
        shape = np.concatenate([rest, ramp, held, ramp[::-1], rest])
        end_ms = (shape.size - 1) * DT_MS
        return cls(f"hold {name}", DT_MS, (0.0, end_ms), **_pressed(level * shape, press_um))

    @classmethod
    def slide(
        cls,
        speed_mm_per_s: float,
        press_um: float | None = None,
        press_n: float | None = None,
        duration_ms: float = 1000.0,
        direction_deg: float = -90.0,
        start_mm: tuple[float, float] = (0.0, 0.0),
    ) -> "Way":
        """Over the skin at one speed, pressed all the time; -90 degrees is towards -z."""
        level, name = _level(press_um, press_n)
        if not (np.isfinite(speed_mm_per_s) and 0 < speed_mm_per_s <= 1000):
            raise UsageError(f"slides at {speed_mm_per_s:g} mm/s, expected 0 to 1000")
        if not 10 <= duration_ms <= 60_000:
            raise UsageError(f"slides for {duration_ms:g} ms, expected 10 to 60000")
        times_ms = np.arange(round(duration_ms / DT_MS) + 1) * DT_MS
        way_mm = speed_mm_per_s * times_ms / _MS_PER_S
        turn = np.radians(direction_deg)
        return cls(
            f"slide {speed_mm_per_s:g} mm/s {name}",
            DT_MS,
            (0.0, float(times_ms[-1])),
            x_mm=start_mm[0] + np.cos(turn) * way_mm,
            z_mm=start_mm[1] + np.sin(turn) * way_mm,
            **_pressed(np.full(times_ms.size, level), press_um),
        )

    @classmethod
    def read(cls, path: Path | str) -> "Way":
        """A path: a table ``time_ms,x_mm,z_mm`` with ``depth_um`` or ``force_n``.

        Rows may be at any rising times; between them the path is straight.

        Raises
        ------
        TableError, UsageError
            Not such a table.
        """
        path = Path(path)
        table = read_table(path, ("time_ms", "x_mm", "z_mm"))
        pressed = [name for name in ("depth_um", "force_n") if name in table.header]
        if len(pressed) != 1 or table.size < 2:
            raise UsageError(f"{path}: expected two rows or more with either depth_um or force_n")
        at_ms = table.numbers("time_ms")
        table.refuse(np.diff(at_ms, prepend=at_ms[0] - 1) <= 0, lambda row: "time_ms does not rise")
        times_ms = np.arange(int((at_ms[-1] - at_ms[0]) / DT_MS + 1e-9) + 1) * DT_MS
        x_mm, z_mm, level = (
            np.interp(times_ms + at_ms[0], at_ms, table.numbers(name))
            for name in ("x_mm", "z_mm", pressed[0])
        )
        end_ms = float(times_ms[-1])
        depth = {pressed[0]: level}
        return cls(path.stem, DT_MS, (0.0, end_ms), x_mm=x_mm, z_mm=z_mm, **depth)


@dataclass(frozen=True, slots=True, eq=False)
class Pins:
    """Flat round pins, each with its own waveform: an array ``(pin,)`` of places.

    `depth_um` is ``(T, pin)``; each pin's is counted from its own first touch.
    """

    x_mm: FloatArray
    z_mm: FloatArray
    diameter_mm: FloatArray
    depth_um: FloatArray
    dt_ms: float
    window_ms: tuple[float, float]

    @classmethod
    def read(cls, path: Path | str, preindent_um: float = 0.0, seed: int | None = None) -> "Pins":
        """A table ``x_mm,z_mm,diameter_mm,stimulus``: an id of the catalogue a pin.

        Raises
        ------
        TableError, StimulusError
            Not such a table, or no such stimulus.
        """
        from fembridge.stimulus_file import stimuli_of

        table = read_table(Path(path), ("x_mm", "z_mm", "diameter_mm", "stimulus"))
        if not table.size:
            raise UsageError(f"{path}: a header and no rows, expected pins")
        waves = []
        for row, word in enumerate(table.words("stimulus")):
            found = stimuli_of(word, preindent_um, seed)
            if len(found) != 1:
                raise table.error(row, f"stimulus {word!r} names {len(found)}, expected one")
            waves += found
        most = max(wave.displacement_um.size for wave in waves)
        depth_um = np.stack(  # a pin whose waveform has ended stays where it is
            [np.pad(w.displacement_um, (0, most - w.displacement_um.size), "edge") for w in waves],
            -1,
        )
        return cls(
            table.numbers("x_mm"),
            table.numbers("z_mm"),
            table.numbers("diameter_mm", least=0.01),
            depth_um,
            waves[0].dt_ms,
            (min(w.window_ms[0] for w in waves), max(w.window_ms[1] for w in waves)),
        )


@dataclass(frozen=True, eq=False)
class Touch:
    """What came of a touch.

    `stress_pa` ``(T, unit)`` is von Mises stress at each unit, `force_n` and `depth_um`
    ``(T,)`` are the shape's. `contact_n` ``(S, node)`` are forces on `nodes` at depths or
    forces `contact_at`, or, where the shape slides, at those samples.
    """

    population: Population
    way: Way
    shape: Shape | None
    stress_pa: FloatArray
    force_n: FloatArray
    depth_um: FloatArray
    nodes: SkinNodes
    contact_n: FloatArray | SingleArray
    contact_at: FloatArray
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

    def write(self, folder: Path | str) -> list[str]:
        """Write the tables of ``fembridge touch``; their names.

        Raises
        ------
        OutputError
            `folder` cannot be written.
        """
        folder = Path(folder)
        self.population.write(folder / POPULATION_FILE)
        for name, frame in ((SPIKES_FILE, self.spikes), (RATES_FILE, self.rates)):
            write_text(folder / name, frame.to_csv(index=False, lineterminator="\n"))
        samples = np.stack([self.way.times_ms, self.depth_um, self.force_n], -1)
        write_table(folder / TOUCH_FILE, ("time_ms", "depth_um", "force_n"), samples.tolist())
        return [POPULATION_FILE, SPIKES_FILE, RATES_FILE, TOUCH_FILE]


def touch_skin(
    pad: Pad,
    shape: Shape,
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
    """Press or slide `shape` over the pad and fire all units.

    Raises
    ------
    UsageError
        A shape beside the pad, too deep, or with too many nodes in contact; a unit where
        the pad holds no stress.
    ParameterError
        Parameters of another time step or another quantity.
    """
    solved = _slid(pad, shape, way, friction) if way.slides else _pressed_to(pad, shape, way)
    return _fire(pad, shape, way, population, parameters, solved, trials, noise_mv, seed, origin)


def touch_pins(
    pad: Pad,
    pins: Pins,
    population: Population,
    parameters: Parameters,
    *,
    trials: int = 1,
    noise_mv: float = 0.0,
    seed: int = 0,
    origin: Mapping[str, Any] | None = None,
) -> Touch:
    """Press an array of pins, each with its own waveform; errors as of `touch_skin`."""
    nodes = skin_nodes(pad)
    overlap_um = np.full((len(pins.depth_um), nodes.column.size), -np.inf)
    for pin, (x, z, diameter) in enumerate(
        zip(pins.x_mm, pins.z_mm, pins.diameter_mm, strict=True)
    ):
        alone = Shape.punch(float(diameter)).moved(float(x), float(z))
        gap_mm = gaps_mm(nodes, alone) - first_touch_mm(pad, alone)
        under = np.isfinite(gap_mm) & (gap_mm < pins.depth_um[:, pin].max() * _MM_PER_UM)
        here = pins.depth_um[:, pin, None] - gap_mm[under] / _MM_PER_UM
        overlap_um[:, under] = np.maximum(overlap_um[:, under], here)
    reached = np.asarray((overlap_um > 0).any(axis=0))
    nodes = nodes.subset(reached)
    contact = Contact.of(nodes)
    forces = np.stack([contact.press(row) for row in overlap_um[:, reached] * _MM_PER_UM])
    way = Way(f"{len(pins.x_mm)} pins", pins.dt_ms, pins.window_ms, pins.depth_um.max(axis=1))
    solved = _Solved(nodes, forces, way.pressed, np.arange(len(forces)))
    places = list(
        zip(pins.x_mm.tolist(), pins.z_mm.tolist(), pins.diameter_mm.tolist(), strict=True)
    )
    shape = Shape.pins(places)
    return _fire(pad, shape, way, population, parameters, solved, trials, noise_mv, seed, origin)


def first_touch_mm(pad: Pad, shape: Shape) -> float:
    """How far `shape` is over the skin where it touches first, also between nodes.

    Raises
    ------
    UsageError
        The shape is nowhere over the part of the pad that may be touched.
    """
    nodes = skin_nodes(pad)
    gap = gaps_mm(nodes, shape)
    lowest = int(gap.argmin())
    if not np.isfinite(gap[lowest]):
        # Smaller than the grid, or beside it: look between the nodes.
        lowest = -1
    fine = np.arange(-8, 9) / 8 * pad.spacing_mm
    if lowest >= 0:
        x = pad.x_mm[nodes.column[lowest]] + fine
        z = nodes.row[lowest] * pad.spacing_mm + fine
    else:
        x = np.arange(pad.x_mm[0], pad.x_mm[-1], pad.spacing_mm / 8)
        z = np.arange(nodes.z_mm.min(), nodes.z_mm.max(), pad.spacing_mm / 8)
    x = x[np.abs(x) <= pad.reach_mm]
    height = shape.height_mm(*np.meshgrid(x, z, indexing="ij"))
    least = float((height - skin_height_mm(pad, *np.meshgrid(x, z, indexing="ij"))).min())
    if not np.isfinite(least):
        raise UsageError(
            f"{shape.name} is beside the pad, which reaches {pad.reach_mm:.3g} mm across and "
            f"{nodes.z_mm.max():.3g} mm along to both sides"
        )
    return least


# ---- Forces


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    """Forces ``(S, node)`` on `nodes`, solved at levels or at samples.

    With `level` ``(S,)`` each sample is read between levels, of which `depth_um` ``(S,)``
    are the depths; without, between the samples `row` ``(S,)``. `drag` ``(T, 2)`` is the
    force along x and z that comes with 1 N into the skin; None where nothing slips.
    """

    nodes: SkinNodes
    forces_n: FloatArray | SingleArray
    depth_um: FloatArray
    row: IntArray
    level: FloatArray | None = None
    drag: FloatArray | None = None


def _pressed_to(pad: Pad, shape: Shape, way: Way) -> _Solved:
    """Contact at `LEVELS` depths or forces, from none to the most."""
    most = max(float(way.pressed.max()), 0.0)
    level = max(most, 1e-9) * (np.arange(LEVELS) / (LEVELS - 1)) ** 1.5
    row = np.arange(LEVELS)
    first_mm = first_touch_mm(pad, shape)
    nodes = skin_nodes(pad)
    gap_mm = gaps_mm(nodes, shape) - first_mm
    if way.force_n is None:
        near = gap_mm < most * _MM_PER_UM
        nodes, gap_mm = nodes.subset(near), gap_mm[near]
        contact = Contact.of(nodes)
        forces = [contact.press(one * _MM_PER_UM - gap_mm) for one in level]
        return _Solved(nodes, np.stack(forces), level, row, level)
    near = gap_mm < _depth_mm(nodes, gap_mm, most)
    nodes, gap_mm = nodes.subset(near), gap_mm[near]
    contact = Contact.of(nodes)
    pairs = [contact.press_with(gap_mm, one) for one in level]
    depth_um = np.array([max(depth_mm, 0.0) for _, depth_mm in pairs]) / _MM_PER_UM
    return _Solved(nodes, np.stack([force for force, _ in pairs]), depth_um, row, level)


def _slid(pad: Pad, shape: Shape, way: Way, friction: float) -> _Solved:
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
    row = np.unique(np.append(np.arange(0, way.pressed.size, every), way.pressed.size - 1))
    everywhere = skin_nodes(pad)
    gaps = np.empty((row.size, everywhere.column.size), dtype=np.float32)
    for n, sample in enumerate(row.tolist()):
        gaps[n] = gaps_mm(everywhere, shape.moved(float(way.x_mm[sample]), float(way.z_mm[sample])))
    if way.force_n is None:
        level = way.pressed[row] * _MM_PER_UM
        reach_mm = float(level.max())
    else:
        level = way.pressed[row]
        some = range(0, row.size, max(1, row.size // 6))
        tried = [_depth_mm(everywhere, gaps[n].astype(float), float(level[n])) for n in some]
        reach_mm = max(tried)
    reached = np.asarray((gaps < reach_mm).any(axis=0))
    if not reached.any():
        raise UsageError(f"{shape.name} touches the pad nowhere on its way")
    nodes, gaps = everywhere.subset(reached), gaps[:, reached]
    contact = Contact.of(nodes, (float(drag[0, 0]), float(drag[0, 1])) if straight else (0.0, 0.0))
    forces = np.empty((row.size, nodes.column.size), dtype=np.float32)
    depth_um = np.empty(row.size)
    for n, gap in enumerate(gaps.astype(np.float64)):
        if way.force_n is None:
            forces[n], depth_mm = contact.press(level[n] - gap), level[n]
        else:
            forces[n], depth_mm = contact.press_with(gap, float(level[n]))
        depth_um[n] = depth_mm / _MM_PER_UM
    window = pad.spacing_mm / (fastest * every)
    averaged = _averaged(forces, window)
    drags = drag if friction else None
    return _Solved(nodes, averaged, _averaged(depth_um, window), row, drag=drags)


def _depth_mm(nodes: SkinNodes, gap_mm: FloatArray, force_n: float) -> float:
    """Depth at which `force_n` is reached, with a margin; gaps may be anything >= 0."""
    first_mm = float(gap_mm.min())
    reach_mm = _FIRST_REACH_MM
    while reach_mm < 2 * MOST_UM * _MM_PER_UM:
        near = gap_mm < first_mm + reach_mm
        contact = Contact.of(nodes.subset(near))
        _, depth_mm = contact.press_with(gap_mm[near] - first_mm, force_n)
        if depth_mm < 0.8 * reach_mm:
            return first_mm + 1.2 * depth_mm
        reach_mm = max(2 * reach_mm, 1.3 * depth_mm) if depth_mm < MOST_UM else np.inf
    raise UsageError(
        f"{force_n:g} N presses the shape deeper than {MOST_UM:g} um, expected less force"
    )


def _averaged(values: FloatArray | SingleArray, window: float) -> FloatArray:
    """Mean over `window` steps around each, any part of one; at the ends over what is there.

    Over just one node's way all that repeats from node to node is gone.
    """
    if window <= 1:
        return np.asarray(values, dtype=np.float64)
    count = len(values)
    total = np.zeros((count + 1, *values.shape[1:]))
    np.cumsum(values, axis=0, dtype=np.float64, out=total[1:])

    def until(at: FloatArray) -> FloatArray:
        row = np.minimum(at.astype(np.int64), count - 1)
        part = (at - row).reshape(-1, *[1] * (values.ndim - 1))
        return np.asarray(total[row] + part * values[row])

    middle = np.arange(count) + 0.5
    first, last = np.maximum(middle - window / 2, 0), np.minimum(middle + window / 2, count)
    width = (last - first).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray((until(last) - until(first)) / width)


# ---- Stress and spikes


def _fire(
    pad: Pad,
    shape: Shape | None,
    way: Way,
    population: Population,
    parameters: Parameters,
    solved: _Solved,
    trials: int,
    noise_mv: float,
    seed: int,
    origin: Mapping[str, Any] | None,
) -> Touch:
    """Stress at all units, and their spikes."""
    if not 1 <= trials <= 10_000:
        raise UsageError(f"{trials} repeats, expected 1 to 10000")
    pushed = np.asarray((solved.forces_n > 0).any(axis=0))
    nodes, forces = solved.nodes.subset(pushed), solved.forces_n[:, pushed]
    stress = _stress_pa(pad, nodes, forces, population, solved)
    total_n = forces.sum(axis=1)
    if solved.level is not None:
        at, knots = np.clip(way.pressed, 0.0, solved.level[-1]), solved.level
    else:
        at, knots = np.arange(way.pressed.size, dtype=np.float64), solved.row.astype(np.float64)
    stress, total_n, depth_um = (
        between(knots, each, at) for each in (stress, total_n, solved.depth_um)
    )
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
        shape=shape,
        stress_pa=stress,
        force_n=total_n,
        depth_um=depth_um,
        nodes=nodes,
        contact_n=forces,
        contact_at=knots,
        fired=fired,
        trials=trials,
        origin={**about, **(origin or {})},
    )


def _at_the_end(pad: Pad, nodes: SkinNodes, forces: FloatArray | SingleArray) -> bool:
    """Whether the outermost columns of skin carry more than a hundredth of the force."""
    outermost = (nodes.column == 0) | (nodes.column == pad.x_mm.size - 1)
    return bool(forces[:, outermost].sum() > 0.01 * forces.sum())


def _stress_pa(
    pad: Pad,
    nodes: SkinNodes,
    forces: FloatArray | SingleArray,
    population: Population,
    solved: _Solved,
) -> FloatArray:
    """Von Mises stress ``(S, unit)`` where contact was solved."""
    places = (list(population.layer), population.x_mm, population.z_mm, population.depth_mm)
    if solved.drag is None:
        return von_mises_pa(influence_pa(pad, nodes, *places), forces)
    drag = solved.drag[solved.row]
    if np.abs(drag - drag[0]).max() < 1e-6:
        one = (float(drag[0, 0]), float(drag[0, 1]))
        return von_mises_pa(influence_pa(pad, nodes, *places, drag=one), forces)
    # Along a curve the drag turns: tensors of the three directions are added.
    down = influence_pa(pad, nodes, *places)
    across, along = (
        influence_pa(pad, nodes, *places, drag=one) - down for one in ((1.0, 0.0), (0.0, 1.0))
    )
    influence = np.concatenate([down, across, along], axis=2)
    dragged = [forces, forces * drag[:, :1], forces * drag[:, 1:]]
    return von_mises_pa(influence, np.concatenate(dragged, axis=1, dtype=np.float32))


def touch_at(touch: Touch) -> FloatArray:
    """Where each sample ``(T,)`` is among the states that were solved, `contact_at`."""
    if touch.way.slides or touch.contact_at.size == touch.way.pressed.size:
        return np.arange(touch.way.pressed.size, dtype=np.float64)
    return np.clip(touch.way.pressed, 0.0, touch.contact_at[-1])


def between(knots: FloatArray, values: FloatArray | SingleArray, at: FloatArray) -> FloatArray:
    """Values ``(S, ...)`` at rising `knots`, read at `at` along a monotone cubic."""
    if np.array_equal(knots, at):
        return np.asarray(values, dtype=np.float64)
    from scipy.interpolate import PchipInterpolator

    found: FloatArray = PchipInterpolator(knots, values, axis=0)(at)
    return found


def _level(press_um: float | None, press_n: float | None) -> tuple[float, str]:
    """What a shape is pressed with, and its name."""
    if (press_um is None) == (press_n is None):
        raise UsageError("a shape is pressed to a depth or with a force, one of both")
    level = press_um if press_um is not None else press_n
    if level is None or not (np.isfinite(level) and level > 0):
        raise UsageError(f"pressed by {level}, expected more than 0")
    return level, f"{level:g} um" if press_um is not None else f"{level:g} N"


def _pressed(samples: FloatArray, press_um: float | None) -> dict[str, Any]:
    return {"depth_um" if press_um is not None else "force_n": samples}
