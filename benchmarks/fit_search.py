"""Time of a fit of 10 000 evaluations, against what pymoo takes of an empty problem.

Run it from the root of the repository: ``python -m benchmarks.fit_search``, or with
``--quick`` for a tenth of the evaluations. NumPy has one thread; the compiled kernel has
all cores, or ``NUMBA_NUM_THREADS``. Each ratio is to the empty problem run just before.
The observed rates are made up of a known model: how long a search takes does not depend
on whose rates they are.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from decks.stimuli import resolve
from fembridge.fitting.problem import fit_problem
from fembridge.fitting.response_source import stored_source
from fembridge.io.observed_rates import ObservedRates
from neural.models import DEFAULT_MODELS, model_named
from neural.search import EVALUATIONS, POPULATION, search_front

REPEATS = 5
AFFERENTS = ("SA", "RA", "PC")


def main(evaluations: int) -> None:
    observed = _observed()
    response = stored_source("quick").response
    print(f"{evaluations} evaluations, populations of {POPULATION}, medians of {REPEATS} in turn")
    print(f"{'':<32}{'clock s':>9}{'CPU s':>9}{'x empty, clock':>16}{'x empty, CPU':>14}")
    searches = {"pymoo, empty, four objectives": lambda: _search_of_nothing(evaluations)}
    for label, drives in (
        ("published", dict.fromkeys(AFFERENTS, "published")),
        ("default", DEFAULT_MODELS),
    ):
        for afferent in AFFERENTS:
            drive = model_named(drives[afferent], afferent)
            problem = fit_problem(observed, response, drive)
            words = f"{label}: {afferent} {drive.name}, {problem.cells} cells"
            searches[words] = partial(search_front, problem, evaluations=evaluations)
    spent_s = np.array([[_spent_s(search) for search in searches.values()] for _ in range(REPEATS)])
    times = np.median(np.concatenate([spent_s, spent_s / spent_s[:, :1]], axis=2), axis=0)
    for words, (clock_s, cpu_s, by_clock, by_cpu) in zip(searches, times, strict=True):
        print(f"{words:<32}{clock_s:9.2f}{cpu_s:9.2f}{by_clock:16.1f}{by_cpu:14.1f}")
    for label, own in (("published", times[1:4]), ("default", times[4:])):
        clock_s, cpu_s = own[:, :2].sum(axis=0)
        print(f"{label + ': all three':<32}{clock_s:9.2f}{cpu_s:9.2f}")


def _observed() -> ObservedRates:
    stimuli = tuple(entry.id for entry in resolve("sine"))
    rates = np.random.default_rng(1).uniform(0, 150, (len(stimuli), len(AFFERENTS)))
    return ObservedRates(stimuli, AFFERENTS, rates, Path("made-up"), "0" * 64)


def _search_of_nothing(evaluations: int) -> None:
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.core.problem import Problem
    from pymoo.optimize import minimize

    class Nothing(Problem):
        def __init__(self):
            super().__init__(n_var=4, n_obj=4, xl=0.0, xu=1.0)

        def _evaluate(self, unit, out, *_, **__):
            out["F"] = np.stack([((unit - c) ** 2).sum(1) for c in (0, 0.3, 0.6, 1)], 1)

    minimize(Nothing(), NSGA2(pop_size=POPULATION), ("n_eval", evaluations), seed=1)


def _spent_s(work: Callable[[], object]) -> tuple[float, float]:
    """What `work` takes, by the clock and of processors."""
    clock_s, cpu_s = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - clock_s, time.process_time() - cpu_s


if __name__ == "__main__":
    main(EVALUATIONS // 10 if "--quick" in sys.argv[1:] else EVALUATIONS)
