"""Time of a fit of 10 000 evaluations, against what pymoo takes of an empty problem.

Run it from the root of the repository: ``python -m benchmarks.fit_search``, or with
``--quick`` for a tenth of the evaluations. One core. The observed rates are made up of
a known model: how long a search takes does not depend on whose rates they are.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import statistics
import sys
import time
from pathlib import Path

import numpy as np

from decks.stimuli import resolve
from fembridge.fitting.problem import fit_problem, stored_source
from fembridge.observed import ObservedRates
from neural.models import DEFAULT_MODELS, model_named
from neural.search import EVALUATIONS, POPULATION, search_front

REPEATS = 3
AFFERENTS = ("SA", "RA", "PC")


def main(evaluations: int) -> None:
    observed = _observed()
    response = stored_source("quick").response
    empty_s = _median(lambda: _search_of_nothing(evaluations))
    print(f"{evaluations} evaluations, populations of {POPULATION}, CPU seconds")
    print(f"{'pymoo, empty problem of four objectives':<44}{empty_s:6.2f}")
    for label, drives in (
        ("published", dict.fromkeys(AFFERENTS, "published")),
        ("default", DEFAULT_MODELS),
    ):
        total_s = 0.0
        for afferent in AFFERENTS:
            drive = model_named(drives[afferent], afferent)
            problem = fit_problem(observed, response, drive)
            spent_s = _median(
                lambda problem=problem: search_front(problem, evaluations=evaluations)
            )
            total_s += spent_s
            words = f"{label}: {afferent} {drive.name}, {problem.cells} cells"
            print(f"{words:<44}{spent_s:6.2f}  {spent_s / empty_s:.1f} x empty")
        print(f"{label + ': all three':<44}{total_s:6.2f}")


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


def _median(work) -> float:
    times_s = []
    for _ in range(REPEATS):
        start_s = time.process_time()
        work()
        times_s.append(time.process_time() - start_s)
    return statistics.median(times_s)


if __name__ == "__main__":
    main(EVALUATIONS // 10 if "--quick" in sys.argv[1:] else EVALUATIONS)
