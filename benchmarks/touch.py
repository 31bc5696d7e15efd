"""What a touch of a whole fingertip costs: beside TouchSim's jobs, and how it grows.

``python -m benchmarks.touch [REPEATS]``. Seconds are of the processor, the median of some
repeats after one that imports; of TouchSim (Saal et al. 2017) too where it can be imported
(it has no licence, and is for comparing only). Ratios hold with one thread (OMP_NUM_THREADS=1).
"""

import sys
import time
from statistics import median

import numpy as np

from decks.stimuli import resolve
from decks.synthesis import make_stimulus
from fembridge.touching.contact import ContactSolver
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.population import Population
from fembridge.touching.ridged_pad import with_ridges
from fembridge.touching.shape import Shape
from fembridge.touching.touch import touch_skin
from fembridge.touching.trajectory import PinArray, Trajectory
from neural import parameter_set

REPEATS = int(sys.argv[1]) if len(sys.argv) > 1 else 3
PAD = resolve_pad("reference")
PARAMETERS = parameter_set("fitted_pad")
UNITS_958 = Population.fingertip(density=958 / 888)


def seconds(job):
    job()
    taken = []
    for _ in range(REPEATS):
        begin = time.process_time()
        job()
        taken.append(time.process_time() - begin)
    return median(taken)


def wave(word):
    [entry] = resolve([word])
    return make_stimulus(entry, preindent_um=75.0)


def pin_array(count):
    """A bar of `count` pins of 0.5 mm, 40 a row, all with one waveform of their own."""
    stimulus = wave("sine_20_129.49")
    across = min(count, 16)
    x = (np.arange(count) % across - 0.5 * (across - 1)) * 0.5
    z = (np.arange(count) // across - 0.5 * (np.ceil(count / across) - 1)) * 0.5
    depth = np.repeat(stimulus.displacement_um[:, None], count, axis=1)
    positions = tuple(zip(x.tolist(), z.tolist(), [0.5] * count, strict=True))
    pins = PinArray(positions, depth)
    trajectory = Trajectory(
        depth.max(axis=1), window_ms=stimulus.window_ms, name=f"{count} pins", pins=pins
    )
    return None, trajectory


def touched(shape, trajectory, units=UNITS_958, pad=PAD):
    return lambda: touch_skin(pad, shape, trajectory, units, PARAMETERS)


def contact_table():
    print("\ncontact nodes   ms a step (warm)   ms the first time")
    nodes = PAD.skin_nodes()
    gap = nodes.gaps_mm(Shape.grating(0.5, 1.5))
    for force in (0.1, 0.3, 0.6, 1.0, 1.6):
        near = gap < gap.min() + 0.35 + 0.7 * force
        some = nodes.subset(near)
        contact = ContactSolver.on_nodes(some)
        shapes = [Shape.grating(0.5, 1.5).moved(0.0, 0.02 * k) for k in range(40)]
        begin = time.process_time()
        pressed = contact.press_with(some.gaps_mm(shapes[0]), force)[0]
        first = time.process_time() - begin
        taken = []
        for shape in shapes[1:]:
            here = some.gaps_mm(shape)
            begin = time.process_time()
            pressed = contact.press_with(here, force)[0]
            taken.append(time.process_time() - begin)
        count = int((pressed > 0).sum())
        print(f"{count:8d} of {near.sum():5d}   {1e3 * median(taken):8.1f}   {1e3 * first:12.0f}")


def touchsim_table():
    try:
        import touchsim
    except ImportError:
        return
    units = touchsim.affpop_hand(region="D2d", seed=1)
    sine = touchsim.stim_sine(freq=20.0, amp=0.12949, len=0.25, pin_radius=0.5)
    bar = touchsim.shape_bar(width=8.0, height=1.0, pins_per_mm=4)
    bar = touchsim.generators.stim_indent_shape(
        bar[np.linspace(0, len(bar) - 1, 80).astype(int)], sine, pin_radius=0.1
    )
    x, y = (each.ravel() for each in np.mgrid[-4:4:17j, -6:6:25j])
    moved = y[:, None] + 40.0 * np.arange(0.0, 1.0, 0.001)
    up = (np.mod(moved, 2.0) < 0.5) & (np.mod(x, 2.0) < 0.5)[:, None]
    dots = touchsim.Stimulus(
        trace=0.3 * up, location=np.stack([x, y], -1), fs=1000.0, pin_radius=0.2
    )
    print(f"\nTouchSim, {len(units)} afferents")
    for name, stimulus in (
        ("one pin, 250 ms", sine),
        ("a bar of 80 pins, 250 ms", bar),
        (f"dots 2 mm apart, scanned for 1 s, {x.size} pins", dots),
    ):
        print(f"{name:45}{seconds(lambda s=stimulus: units.response(s)):8.2f} s")


def main():
    print(f"{len(UNITS_958)} afferents, seconds of processor")
    sine = Trajectory.from_waveform(wave("sine_20_129.49"))
    scan = Trajectory.slide(40.0, press_um=300, duration_ms=1000)
    for name, job in (
        ("one pin, 250 ms", touched(Shape.punch(1.0), sine)),
        ("a bar of 1 x 8 mm, 250 ms", touched(Shape.bar(1.0, 8.0), sine)),
        (
            "80 pins, each with its waveform, 250 ms",
            touched(*pin_array(80)),
        ),
        ("dots 2 mm apart, scanned for 1 s", touched(Shape.dots(2.0), scan)),
    ):
        print(f"{name:45}{seconds(job):8.2f} s")
    ridged = with_ridges(PAD, "loop")
    grating = Trajectory.slide(40.0, press_n=0.5, duration_ms=1000)
    for name, shape, trajectory in (
        ("one pin", Shape.punch(1.0), sine),
        ("dots 2 mm apart", Shape.dots(2.0), scan),
        ("a grating of 1 mm, 0.5 N", Shape.grating(0.5, 0.5), grating),
    ):
        taken = [seconds(touched(shape, trajectory, pad=pad)) for pad in (ridged, PAD)]
        print(f"{name:45}{taken[0]:8.2f} s on ridged skin, {taken[1]:.2f} s on smooth skin")
    touchsim_table()
    print("\nunits     s (one pin, 250 ms)")
    for density in (0.25, 1.0, 4.0, 16.0):
        units = Population.fingertip(density=density)
        print(f"{len(units):6d}{seconds(touched(Shape.punch(1.0), sine, units)):10.2f}")
    print("\nsteps     s (dots, scanned)")
    for duration in (250, 500, 1000, 2000):
        trajectory = Trajectory.slide(40.0, press_um=300, duration_ms=duration)
        print(f"{trajectory.level.size:6d}{seconds(touched(Shape.dots(2.0), trajectory)):10.2f}")
    contact_table()


if __name__ == "__main__":
    main()
