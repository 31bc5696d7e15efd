"""What a transient costs, and what each way to make it cheaper changes in it.

``python -m benchmarks.transient_cost`` presses the usual probe into a finger and takes
it off again, `paper` unless ``--finger`` names another, once for each way to write the
deck: every node of the probe prescribed; the probe on a spring; half of the section;
and that on two threads, without friction, and without the force of 1e-12 N that keeps
skin in the air off the smallest numbers (with ``--increments 80`` it shows). It prints,
in Markdown, processor time, iterations, and the largest difference of a trace from the
first row's, in percent of the peak. Without ``--folder`` nothing is kept.
"""

import argparse
import hashlib
import resource
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from decks.contact_analysis import Model
from decks.presets import PRESETS, model_of
from fembridge.host.store import write_text
from fembridge.io.run_folder import RunFolder
from fembridge.results import read
from fembridge.solver.build import build_run_folder
from fembridge.solver.ccx import run_ccx
from fembridge.solver.settings import Solver
from fembridge.stimulus import Stimulus
from fembridge.typing import FloatArray

INCREMENTS = 40
DEPTH_UM = 90.0
DT_MS = 0.5
# Off the skin the probe rises slowly, one of these a sample.
_RISE_UM = 1.0


@dataclass(frozen=True, slots=True)
class Way:
    """One way to solve the same transient; what differs from the default."""

    shown: str
    drive: str = "spring"
    section: str = "half"
    friction: float | None = None
    threads: int = 1
    force: bool = True


WAYS = (
    Way("each node of the probe prescribed", drive="prescribed", section="whole"),
    Way("the probe on a spring", section="whole"),
    Way("on a spring, half of the section"),
    Way("the same on two threads", threads=2),
    Way("the same without 1e-12 N", force=False),
    Way("the same without friction", friction=0.0),
)


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """What a way cost; `stress_pa` ``(afferent, T)``, None where it was given up."""

    cpu_s: float
    wall_s: float
    increments: int
    iterations: int
    stress_pa: FloatArray | None


def waveform(increments: int) -> Stimulus:
    """Half a period of a sine into the skin, and three times as long off it.

    Skin in the air comes to rest increment by increment; it takes some twenty of them
    until its displacement is among the numbers that processors are slow with.
    """
    down = increments // 4
    depth_um = DEPTH_UM * np.sin(np.pi * np.arange(down + 1) / down)
    up_um = -_RISE_UM * (10 + np.arange(increments - down))
    samples = np.concatenate([np.round(depth_um, 6), up_um])
    return Stimulus("in_and_off", samples, DT_MS, (0.0, DT_MS * increments))


def build(folder: Path, model: Model, way: Way, increments: int) -> RunFolder:
    """Write the run folder of a way."""
    contact = model.contact
    if way.friction is not None:
        contact = replace(contact, friction=way.friction)
    asked = replace(model, contact=contact, drive=way.drive, section=way.section)
    run = build_run_folder(folder, asked, waveform(increments))
    if way.force:
        return run
    before, card, after = run.deck.read_text("ascii").partition("*CLOAD\n")
    deck = before + after.partition("\n")[2]
    if not card:
        raise ValueError(f"{run.deck}: no *CLOAD to leave out")
    write_text(run.deck, deck)
    run = replace(run, deck_sha256=hashlib.sha256(deck.encode()).hexdigest())
    run.write()
    return run


def solve(run: RunFolder, threads: int) -> Solved:
    """Run the solver: it ends before the next begins, so its time is the children's."""
    before_s = _children_s()
    outcome = run_ccx(run, Solver(threads=threads))
    cpu_s = _children_s() - before_s
    stress_pa = None
    if outcome.accepted:
        stress_pa = np.array([trace.stress_pa for trace in read(run.folder)])
    else:
        print(outcome.failure, file=sys.stderr)
    return Solved(cpu_s, outcome.wall_s, outcome.increments, outcome.iterations, stress_pa)


def off_percent(one: FloatArray, first: FloatArray) -> float:
    """Largest difference of two sets of traces, in percent of each one's peak."""
    peak_pa = np.abs(first).max(axis=1, keepdims=True)
    return float(100 * np.abs((one - first) / peak_pa).max())


def table(model: Model, folder: Path, increments: int) -> list[str]:
    """Solve each way, and give the lines of the table."""
    lines = [
        f"`{model.finger.name}`, {increments} increments",
        "",
        "| | CPU, s | wall, s | iterations | CPU of one, s | trace off by, % of peak |",
        "|---|---|---|---|---|---|",
    ]
    first: FloatArray | None = None
    for number, way in enumerate(WAYS):
        print(way.shown, file=sys.stderr)
        run = build(folder / f"way_{number}", model, way, increments)
        solved = solve(run, way.threads)
        each_s = solved.cpu_s / max(solved.iterations, 1)
        off = f"ended after {solved.increments} increments"
        if solved.stress_pa is not None:
            first = solved.stress_pa if first is None else first
            off = f"{off_percent(solved.stress_pa, first):.4f}"
        lines.append(
            f"| {way.shown} | {solved.cpu_s:.1f} | {solved.wall_s:.1f} "
            f"| {solved.iterations} | {each_s:.3f} | {off} |"
        )
    return lines


def main(words: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--finger", choices=tuple(PRESETS), default="paper")
    parser.add_argument("--increments", type=int, default=INCREMENTS)
    parser.add_argument("--folder", type=Path, help="keep the runs here")
    args = parser.parse_args(words)
    if args.increments < 8:
        parser.error(f"--increments is {args.increments}, expected 8 or more")
    model = model_of(PRESETS[args.finger])
    with tempfile.TemporaryDirectory() as temporary:
        lines = table(model, args.folder or Path(temporary), args.increments)
    print("\n".join(lines))


def _children_s() -> float:
    """Processor time of all child processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
