"""From the solver's clock to the stimulus's: traces of a run folder of ours.

The solver's clock starts before the stimulus does (a ramp to a pre-indentation
takes place there), and a result file has no sample of the start itself.
"""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.read_options import ReadOptions
from fembridge.run_folder import SOLVER_FILE, RunFolder
from fembridge.store import sha256_of
from fembridge.trace import STEP_TOLERANCE, StressTrace


def in_stimulus_time(trace: StressTrace, run: RunFolder, path: Path) -> StressTrace:
    """Give `trace` on the clock of the stimulus: first sample at time 0.

    With a ramp the sample at its end is an increment of the file and what comes
    before is dropped. Without one the model is stress-free at time 0 by
    definition, and that sample, exactly 0, is put in front.

    Raises
    ------
    ResultError
        No increment stands where stimulus time 0 is.
    """
    before = (run.start_ms - trace.start_ms) / trace.dt_ms
    rows = round(before)
    on_grid = abs(before - rows) <= STEP_TOLERANCE
    stress_pa = None
    if on_grid and 0 <= rows < trace.stress_pa.size - 1:
        stress_pa = trace.stress_pa[rows:]
    elif on_grid and rows == -1 and run.start_ms == 0.0:
        stress_pa = np.concatenate([[0.0], trace.stress_pa])
    if stress_pa is not None:
        # A file's times may be rounded: to six digits, or to single precision.
        off = abs(trace.dt_ms / run.dt_ms - 1.0) * stress_pa.size
        dt_ms = run.dt_ms if off <= STEP_TOLERANCE else trace.dt_ms
        return replace(trace, stress_pa=stress_pa, start_ms=0.0, dt_ms=dt_ms)
    raise ResultError(
        f"node {trace.node}: the stimulus begins at {run.start_ms:g} ms of solver "
        f"time, the file holds {trace.start_ms:g} to {trace.times_ms[-1]:g} ms in "
        f"steps of {trace.dt_ms:g} ms",
        path,
    )


def check_deck(run: RunFolder, path: Path) -> None:
    """Hold the deck that was solved against the deck that stands there now.

    `fembridge run` keeps the solved deck's SHA-256 in ``solver.toml``; results
    that someone's own ccx left have none, and are taken as they are.

    Raises
    ------
    ResultError
        The deck was built anew or edited after these results.
    """
    try:
        record = tomllib.loads((run.folder / SOLVER_FILE).read_text("utf-8"))
        solved, now = record["deck_sha256"], sha256_of(run.deck)
    except (OSError, KeyError, TypeError, ValueError):  # also: no TOML, no UTF-8
        return
    if path.resolve() == run.results.resolve() and solved != now:
        raise ResultError(
            f"results of another deck than the {run.deck.name} beside them; solve it: "
            f"fembridge run {run.folder}",
            path,
        )


def check_reach(trace: StressTrace, run: RunFolder, path: Path, options: ReadOptions) -> None:
    """Hold the last sample, in solver time, against the end of the run.

    Raises
    ------
    ResultError
        It stops short, and `options.partial` is not set.
    """
    last_ms = float(trace.times_ms[-1])
    if abs(last_ms - run.end_ms) <= STEP_TOLERANCE * run.dt_ms * 10:
        return
    words = f"results end at {last_ms:g} ms, the deck runs to {run.end_ms:g} ms"
    if not options.partial:
        raise ResultError(f"{words}; --partial (partial=True) takes them so", path)
    options.note(words)
