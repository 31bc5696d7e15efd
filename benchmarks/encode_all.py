"""CPU time of encoding all 82 stimuli, a second of an afferent, against TouchSim's.

Run it from the root of the repository: ``python -m benchmarks.encode_all``. One core.
TouchSim's 1.7 ms an afferent-second were measured apart; where it is not installed
beside, the ratio is to that number. An afferent-second is a second of the trace of
one cell: the populations of the fitted set count as their cells.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"

import statistics
import time

import numpy as np

from decks.stimuli import resolve
from decks.synthesis import make_stimulus
from fembridge.fitting.response_source import stored_source
from neural import encode_afferents, parameter_set
from neural.parameter_sets import SET_NAMES

TOUCHSIM_MS = 1.7
REPEATS = 15


def main() -> None:
    response = stored_source("quick").response
    entries = resolve("all")
    for name in SET_NAMES:
        chosen = parameter_set(name)
        stimuli = [make_stimulus(entry, chosen.preindent_um) for entry in entries]
        traces = [response.traces(stimulus) for stimulus in stimuli]
        stress_pa = {
            trace.afferent: np.stack([row[k].stress_pa for row in traces], -1)
            for k, trace in enumerate(traces[0])
        }
        cells = sum(one.cells for one in chosen.parameters.values())
        times_s = []
        for _ in range(REPEATS):
            start_s = time.process_time()
            encode_afferents(stress_pa, 0.5, chosen.parameters)
            times_s.append(time.process_time() - start_s)
        each_ms = 1e3 * statistics.median(times_s) / (len(entries) * 0.25 * cells)
        print(
            f"{name:<10} {len(entries)} stimuli, {cells} cells: {each_ms:.4f} ms an "
            f"afferent-second, {TOUCHSIM_MS / each_ms:.0f} x less than TouchSim"
        )


if __name__ == "__main__":
    main()
