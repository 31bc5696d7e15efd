"""What a touch of a whole fingertip costs: beside TouchSim's jobs, and how it grows.

``python -m benchmarks.touch [REPEATS]``. Seconds are of the processor, the first and the least of
some repeats, which other work on the machine disturbs least; of TouchSim (Saal et al. 2017), in
turn, where it can be imported (it has no licence, and is for comparing only). All is the default:
ridged skin, `fitted_pad` at 0.1 ms. Ratios hold with one thread (OMP_NUM_THREADS=1);
``python -m benchmarks.touch threads`` compares one thread with all, ``loop`` has touches of one
shape in a loop alone.
"""

import os
import subprocess
import sys
import time
import warnings
from statistics import median

import numpy as np

from decks.stimuli import resolve
from decks.synthesis import make_stimulus
from fembridge.touching.contact import ContactSolver, blas_threads
from fembridge.touching.kept_states import drop_states
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.population import Population
from fembridge.touching.ridged_pad import with_ridges
from fembridge.touching.shape import Shape
from fembridge.touching.touch import touch, touch_skin
from fembridge.touching.trajectory import PinArray, Trajectory
from neural import parameter_set
from neural.compiled import compile_for

REPEATS = int(sys.argv[1]) if sys.argv[1:] and sys.argv[1].isdigit() else 3
PAD = resolve_pad("reference")
RIDGED = with_ridges(PAD, None)
PARAMETERS = parameter_set("fitted_pad")
UNITS_958 = Population.fingertip(density=958 / 888)


def seconds(*jobs):
    """The first time and the least of the repeats of each job, ``(job, 2)``; jobs take turns."""
    taken = []
    for _ in range(REPEATS + 1):
        for job in jobs:
            begin = time.process_time()
            job()
            taken.append(time.process_time() - begin)
    by_job = np.reshape(taken, (REPEATS + 1, len(jobs)))
    return np.stack([by_job[0], by_job[1:].min(axis=0)], -1)


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


def touched(shape, trajectory, units=UNITS_958, pad=RIDGED):
    return lambda: touch_skin(pad, shape, trajectory, units, PARAMETERS)


def contact_table():
    """Steps of 1/2 node under gratings: of the direct contact alone, on the fine grid."""
    print("\nforce (N)  nodes in contact (of possible)   ms a step")
    shape, nodes = Shape.grating(0.5, 1.5), RIDGED.skin_nodes()
    gap = nodes.gaps_mm(shape)
    for force in (0.1, 0.3, 0.6, 1.0):
        near = gap < gap.min() + 0.5 + 0.9 * force
        some = nodes.subset(near)
        contact = ContactSolver.on_nodes(some)
        taken = []
        with blas_threads(contact.nodes_at_once):
            for step in range(60):
                here = some.gaps_mm(shape.moved(0.0, 0.0625 * step))
                begin = time.process_time()
                pressed = contact.press_with(here, force)[0]
                taken.append(time.process_time() - begin)
        count = int((pressed > 0).sum())
        print(f"{force:8g}{count:8d} of {near.sum():5d}   {1e3 * median(taken[20:]):8.1f}")


def touchsim_jobs():
    """TouchSim's side of the five jobs; no such job without it."""
    try:
        import touchsim
    except ImportError:
        return [None] * 5
    units = touchsim.affpop_hand(region="D2d", seed=1)
    print(f"TouchSim: {len(units)} afferents")
    sine = touchsim.stim_sine(freq=20.0, amp=0.12949, len=0.25, pin_radius=0.5)
    edge = touchsim.shape_bar(width=8.0, height=1.0, pins_per_mm=4)
    bar = touchsim.generators.stim_indent_shape(
        edge[np.linspace(0, len(edge) - 1, 80).astype(int)], sine, pin_radius=0.1
    )
    across = np.stack([np.arange(80) % 16 - 7.5, np.arange(80) // 16 - 2.0], -1) * 0.5
    waves = np.tile(sine.trace[:1], (80, 1)) * np.linspace(0.5, 1.0, 80)[:, None]
    pins = touchsim.Stimulus(trace=waves, location=across, fs=sine.fs, pin_radius=0.25)
    x, y = (each.ravel() for each in np.mgrid[-4:4:17j, -6:6:25j])
    moved = y[:, None] + 40.0 * np.arange(0.0, 1.0, 0.001)
    up = (np.mod(moved, 2.0) < 0.5) & (np.mod(x, 2.0) < 0.5)[:, None]
    place = {"location": np.stack([x, y], -1), "fs": 1000.0, "pin_radius": 0.2}
    dots = touchsim.Stimulus(trace=0.3 * up, **place)
    grating = touchsim.Stimulus(trace=0.3 * (np.mod(moved, 1.0) < 0.5), **place)
    return [lambda s=s: units.response(s) for s in (sine, bar, pins, dots, grating)]


def five_jobs():
    compile_for(10_000_000)  # as after some touches
    print(f"{len(UNITS_958)} afferents, seconds of processor")
    sine = Trajectory.from_waveform(wave("sine_20_129.49"))
    scan = Trajectory.slide(40.0, press_um=300, duration_ms=1000)
    pressed = Trajectory.slide(40.0, press_n=0.5, duration_ms=1000)
    jobs = (
        ("one pin, 250 ms", Shape.punch(1.0), sine),
        ("a bar of 1 x 8 mm, 250 ms", Shape.bar(1.0, 8.0), sine),
        ("80 pins, each with its waveform, 250 ms", *pin_array(80)),
        ("dots 2 mm apart, scanned for 1 s", Shape.dots(2.0), scan),
        ("a grating of 1 mm, 0.5 N, scanned for 1 s", Shape.grating(0.5, 0.5), pressed),
    )
    for (name, shape, trajectory), other in zip(jobs, touchsim_jobs(), strict=True):
        jobs_in_turn = [touched(shape, trajectory), *([other] if other else [])]
        (first, least), *touchsim = seconds(*jobs_in_turn)
        beside = "".join(f", TouchSim {s:.2f} s, {s / least:.1f} times" for _, s in touchsim)
        print(f"{name:45}{least:6.2f} s (first {first:.2f}){beside}", flush=True)


def loop_table(count=200):
    """One shape in a loop of `count` touches: to other depths or forces, or at other places."""
    along = np.linspace(0, 1, count)
    loops = {
        "50 to 300 um": [{"press_um": 50 + 250 * share} for share in along],
        "100 to 500 um": [{"press_um": 100 + 400 * share} for share in along],
        "20 to 200 mN": [{"press_n": 0.02 + 0.18 * share} for share in along],
        "200 um at as many places": [
            {"press_um": 200.0, "at_mm": (-3 + 6 * share, 2 - 4 * share)} for share in along
        ],
    }
    print(f"\nseconds of processor of {count} touches in a loop, and the median of one")
    for name, presses in loops.items():
        for shape in ("punch", "braille:text=b"):
            drop_states()
            taken = []
            for press in presses:
                begin = time.process_time()
                touch(shape, **press)
                taken.append(time.process_time() - begin)
            print(f"{shape:16}{name:26}{sum(taken):6.1f}{median(taken):8.4f}", flush=True)


def threads_table():
    """A grating with one thread and with all: seconds of processor and of the clock."""
    for threads in ("1", str(os.cpu_count())):
        code = "from benchmarks.touch import scan_seconds; scan_seconds()"
        environment = {**os.environ, "OMP_NUM_THREADS": threads, "NUMBA_NUM_THREADS": threads}
        found = subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, check=True
        )
        print(f"{threads} threads: {found.stdout.decode().strip()}", flush=True)


def scan_seconds():
    slide = Trajectory.slide(40.0, press_n=0.5, duration_ms=400)
    job, taken = touched(Shape.grating(0.5, 0.5), slide), []
    for _ in range(REPEATS + 1):
        begin = time.process_time(), time.perf_counter()
        job()
        taken.append((time.process_time() - begin[0], time.perf_counter() - begin[1]))
    processor, clock = np.min(taken[1:], axis=0)
    print(f"{processor:.2f} s of processor, {clock:.2f} s by the clock")


def main():
    warnings.simplefilter("ignore")
    if sys.argv[1:] == ["threads"]:
        threads_table()
        return
    if sys.argv[1:] == ["loop"]:
        for press_um in (200, 200, 200, 400):  # as after some touches
            touch(press_um=press_um)
        loop_table()
        return
    five_jobs()
    loop_table()
    sine = Trajectory.from_waveform(wave("sine_20_129.49"))
    print("\nunits     s (one pin, 250 ms)")
    for density in (0.25, 1.0, 4.0, 16.0):
        units = Population.fingertip(density=density)
        [(_, least)] = seconds(touched(Shape.punch(1.0), sine, units))
        print(f"{len(units):6d}{least:10.2f}")
    print("\nsteps     s (dots, scanned)")
    for duration in (250, 500, 1000, 2000):
        trajectory = Trajectory.slide(40.0, press_um=300, duration_ms=duration)
        [(_, least)] = seconds(touched(Shape.dots(2.0), trajectory))
        print(f"{trajectory.level.size:6d}{least:10.2f}")
    contact_table()


if __name__ == "__main__":
    main()
