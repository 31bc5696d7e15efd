"""Cost of the encoder on hardware: the C header, and `neural.Stream`.

``python -m benchmarks.encoder_in_c`` compiles the header of ``fembridge export-c`` with gcc -O2,
encodes a press with a vibration, and prints processor time for a step of a cell, and sizes. Times
are medians of seven runs; ``--write`` fills the table of ``docs/how_to/hardware.md``.
"""

import argparse
import ctypes
import subprocess
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np

from benchmarks.touch_evidence import replaced
from neural import Stream, parameter_set
from neural.c_header import export_c

PAGE = Path(__file__).parents[1] / "docs" / "how_to" / "hardware.md"
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno")
PROGRAM = """
#include <time.h>
#include "afferents.h"
static afferents state;
unsigned long state_bytes(void) { return sizeof state; }
void start(void) { afferents_init(&state); }
int step(const afferents_real *stress, unsigned char *fired)
{
    return afferents_step(&state, stress, fired);
}
double seconds(const double *stress, long count, long *spikes)
{
    unsigned char fired[AFFERENTS_ROOM];
    clock_t begin;
    long n;
    afferents_init(&state);
    *spikes = 0;
    begin = clock();
    for (n = 0; n < count; n++) {
        afferents_real now[AFFERENTS_CLASSES];
        int k;
        for (k = 0; k < AFFERENTS_CLASSES; k++) now[k] = (afferents_real)stress[n];
        *spikes += afferents_step(&state, now, fired);
    }
    return (double)(clock() - begin) / CLOCKS_PER_SEC;
}
"""
RUNS = 7
CASES = (
    ("fitted", "double", 0.1),
    ("fitted", "float", 0.1),
    ("fitted", "double", 1.0),
    ("fitted", "float", 1.0),
    ("published", "double", 0.5),
    ("published", "float", 0.5),
)


def signal(duration_ms, dt_ms):
    """A press of 20 kPa with 2 kPa at 100 Hz, and noise."""
    times_ms = np.arange(round(duration_ms / dt_ms)) * dt_ms
    held = 2e4 * np.clip(np.sin(2e-3 * np.pi * times_ms), 0, 0.5) * 2
    noise = np.random.default_rng(0).normal(0, 10, times_ms.size)
    return held + 2e3 * np.sin(0.2 * np.pi * times_ms) + noise


def cost_in_c(name, precision, sensor_ms, folder):
    """Nanoseconds a cell-step, steps, spikes, and bytes of code with constants and of the state."""
    (folder / "afferents.h").write_text(export_c(name, precision=precision, sensor_ms=sensor_ms))
    (folder / "cost.c").write_text(PROGRAM)
    library = folder / f"{name}_{precision}_{sensor_ms:g}.so"
    source = str(folder / "cost.c")
    subprocess.run(["gcc", *FLAGS, "-shared", "-fPIC", "-o", str(library), source], check=True)
    cost = ctypes.CDLL(str(library))
    cost.seconds.restype, cost.state_bytes.restype = ctypes.c_double, ctypes.c_ulong
    stress_pa = signal(20_000, sensor_ms)
    spikes = ctypes.c_long()
    pointer = stress_pa.ctypes.data_as(ctypes.c_void_p)
    count = ctypes.c_long(stress_pa.size)
    seconds = [cost.seconds(pointer, count, ctypes.byref(spikes)) for _ in range(RUNS)]
    parameters = parameter_set(name).parameters
    cell_steps = sum(
        values.cells * stress_pa.size * sensor_ms / values.dt_ms for values in parameters.values()
    )
    bare = folder / "cost.o"
    small = ["-Os", *(flag for flag in FLAGS if flag != "-O2")]
    lines = PROGRAM[: PROGRAM.index("double seconds")].replace("#include <time.h>", "")
    (folder / "bare.c").write_text(lines)
    subprocess.run(["gcc", *small, "-c", "-o", str(bare), str(folder / "bare.c")], check=True)
    sizes = subprocess.run(["size", str(bare)], check=True, capture_output=True, text=True)
    text, data, *_ = map(int, sizes.stdout.splitlines()[1].split()[:3])
    nanoseconds = 1e9 * median(seconds) / cell_steps
    return nanoseconds, 1e6 * median(seconds) / stress_pa.size, text + data, cost.state_bytes()


def cost_of_stream(name, sensor_ms, part):
    """Microseconds a sample of `Stream`, in parts of `part` samples."""
    stress_pa = signal(1000, sensor_ms)
    spent = []
    for _ in range(RUNS):
        stream = Stream(name, sensor_ms)
        begin = time.process_time()
        for first in range(0, stress_pa.size, part):
            stream.push(stress_pa[first : first + part])
        spent.append(time.process_time() - begin)
    return 1e6 * median(spent) / stress_pa.size


def table():
    rows = [
        "| parameters | a sample every | numbers | a cell and step | a sample, all cells | code "
        "| state |",
        "|---|---|---|---|---|---|---|",
    ]
    with tempfile.TemporaryDirectory() as folder:
        for name, precision, sensor_ms in CASES:
            nanoseconds, sample_us, code, state = cost_in_c(
                name, precision, sensor_ms, Path(folder)
            )
            rows.append(
                f"| `{name}` | {sensor_ms:g} ms | {precision} | {nanoseconds:.1f} ns "
                f"| {sample_us:.2f} µs | {code / 1024:.1f} kB | {state} B |"
            )
    rows += [
        "",
        "| `Stream`, parameters | a sample every | a sample, one by one | in parts of 10 "
        "| in parts of 100 |",
        "|---|---|---|---|---|",
    ]
    for name, sensor_ms in (("fitted", 0.1), ("fitted", 1.0), ("published", 0.5)):
        costs = [f"{cost_of_stream(name, sensor_ms, part):.0f} µs" for part in (1, 10, 100)]
        rows.append(f"| `{name}` | {sensor_ms:g} ms | {' | '.join(costs)} |")
    return "\n".join(rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="fill the table of the page")
    args = parser.parse_args()
    text = table()
    print(text)
    if args.write:
        PAGE.write_text(replaced(PAGE.read_text("utf-8"), "cost", text), "utf-8")


if __name__ == "__main__":
    main()
