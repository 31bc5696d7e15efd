"""Time of a fit's inner loop: 10 000 candidates, 37 conditions, 500 steps.

Run it from the root of the repository: ``python -m benchmarks.encode_batch``, or with
``--quick`` for a tenth of the candidates. One core, float64; the drives are those of
sinusoids with the frequencies and number of the paper's Appendix A.
"""

import sys
import time

import numpy as np

from neural import PUBLISHED
from neural.counts import candidate_counts
from neural.encoder import afferent_drives
from neural.models import Coefficients
from neural.rates import window_rows

DT_MS = 0.5
SAMPLES = 501
CONDITIONS_AT_HZ = {20.0: 12, 50.0: 10, 100.0: 9, 300.0: 6}
HALVES = {"SA": ("a1_pa", "a2_pa_per_ms"), "RA": ("a3_pa_per_ms",), "PC": ("a4_pa_per_ms2",)}


def main(candidates: int) -> None:
    rng = np.random.default_rng(7)
    times_ms = np.arange(SAMPLES) * DT_MS
    frequencies_hz = np.repeat(list(CONDITIONS_AT_HZ), list(CONDITIONS_AT_HZ.values()))
    peaks_pa = rng.uniform(1e3, 3e4, frequencies_hz.size)
    stress_pa = peaks_pa * np.maximum(
        np.sin(2e-3 * np.pi * frequencies_hz * times_ms[:, None]), 0.0
    )
    steps = SAMPLES - 1
    whole = (0, steps)
    windows_ms = [(5.0, 250.0) if hz == 20.0 else (100.0, 200.0) for hz in frequencies_hz]
    rows = [window_rows(window_ms, DT_MS) for window_ms in windows_ms]
    own = ([each.start for each in rows], [each.stop for each in rows])
    print(f"{candidates} candidates x {frequencies_hz.size} conditions x {steps} steps")
    for name, published in PUBLISHED.items():
        drives = [d[:-1] for d in afferent_drives(name, stress_pa, DT_MS)]
        varied = [*HALVES[name], "alpha_mv_per_ms", "tau_ms"]
        sets = np.array([getattr(published, field) for field in varied])
        sets = sets * rng.uniform(0.3, 3.0, (candidates, len(varied)))
        for label, window, size in (
            ("every step, one call", whole, candidates),
            ("each condition's own window, one call", own, candidates),
            ("each condition's own window, 100 candidates a call", own, 100),
        ):
            start, spikes = time.perf_counter(), 0
            for first in range(0, candidates, size):
                *halves, alpha, tau = sets[first : first + size].T
                counts = candidate_counts(
                    drives,
                    Coefficients(alpha, halves=tuple(halves)),
                    tau,
                    dt_ms=DT_MS,
                    gap_mv=published.gap_mv,
                    refractory_ms=published.refractory_ms,
                    window=window,
                )
                spikes += int(counts.sum())
            taken = time.perf_counter() - start
            print(f"{name}  {taken:5.2f} s  {spikes:>9} spikes  {label}")


if __name__ == "__main__":
    main(1_000 if "--quick" in sys.argv[1:] else 10_000)
