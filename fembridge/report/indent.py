"""A probe pressed into a finger to one depth, in equal steps: what most studies do."""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from decks.analysis import Model
from decks.dialects import JOB
from fembridge.build import inputs_of
from fembridge.report.runs import Attempt, Cost, Runs
from fembridge.results.printed import read_total_force
from fembridge.results.source import read_values
from fembridge.results.stress import von_mises_pa
from fembridge.run_folder import read_run_folder
from fembridge.solver.ccx import LOG_FILE
from fembridge.stimulus import Stimulus
from fembridge.typing import FloatArray

AFFERENTS = ("SA", "RA", "PC")
DEPTH_UM = 200.0
STEPS, STEPS_QUICK = 10, 4

_PROBE_SET = "PROBE"
_SPRINGS = re.compile(r"Number of contact spring elements=(\d+)")
_DT_MS = 0.5
_UM_PER_MM = 1000.0


@dataclass(frozen=True, slots=True, eq=False)
class Indented:
    """Von Mises stress `stress_pa` ``(T, afferent)`` at `depth_um` ``(T,)``.

    Afferents are those of the finger, in its order; `apex_um` ``(T,)`` is how far the
    skin under the probe moved in. The state at rest comes first. `touching` nodes of
    the skin touch the probe at the end.
    """

    elements: int
    depth_um: FloatArray
    stress_pa: FloatArray
    force_n_per_mm: FloatArray
    apex_um: FloatArray
    touching: int
    cost: Cost

    @property
    def last_pa(self) -> FloatArray:
        """Stress ``(afferent,)`` at the end."""
        last: FloatArray = self.stress_pa[-1]
        return last


def through(depths_um: FloatArray, name: str) -> Stimulus:
    """Stimulus that moves the probe through `depths_um` ``(T,)``, the first of them 0."""
    return Stimulus(name, depths_um, _DT_MS, (0.0, (depths_um.size - 1) * _DT_MS))


def down(depth_um: float = DEPTH_UM, steps: int = STEPS) -> Stimulus:
    """Stimulus that moves the probe down to `depth_um` in equal steps."""
    return through(np.linspace(0.0, depth_um, steps + 1), f"down_{depth_um:g}")


def indent(
    runs: Runs, name: str, model: Model, stimulus: Stimulus | None = None, *, law: str = "linear"
) -> Indented:
    """Solve and read one indentation.

    Raises
    ------
    SolverError
        The run is not accepted.
    """
    stimulus = stimulus or down(steps=STEPS_QUICK if runs.quick else STEPS)
    attempt = attempt_indent(runs, name, model, stimulus, law=law).accepted()
    return read_indented(attempt, model, stimulus)


def attempt_indent(
    runs: Runs, name: str, model: Model, stimulus: Stimulus, *, law: str = "linear"
) -> Attempt:
    """Solve one indentation; a failure is in the attempt."""
    analysis = replace(model, support="prescribed", law=law).analysis(stimulus)
    inputs = {"law": law, **inputs_of(model, stimulus)}
    return runs.attempt(name, analysis, stimulus, inputs)


def read_indented(attempt: Attempt, model: Model, stimulus: Stimulus) -> Indented:
    """Result of an accepted run, with the state at rest in front."""
    run = read_run_folder(attempt.folder)
    nodes = [place.node for place in run.afferents]
    _, tensor_pa = read_values(run.results, nodes)
    _, moved_mm = read_values(run.results, [run.apex_node], quantity="displacement")
    _, force_n = read_total_force(attempt.folder / f"{JOB}.dat", _PROBE_SET)
    return Indented(
        elements=len(model.mesh.quad),
        depth_um=stimulus.displacement_um,
        stress_pa=_from_rest(von_mises_pa(tensor_pa)),
        force_n_per_mm=_from_rest(-force_n[:, 1]),
        apex_um=_from_rest(-_UM_PER_MM * moved_mm[:, 0, 1]),
        touching=read_touching(attempt.folder / LOG_FILE),
        cost=attempt.cost,
    )


def read_touching(log: Path) -> int:
    """Last number of contact springs in CalculiX's log."""
    numbers = _SPRINGS.findall(log.read_text(encoding="utf-8", errors="replace"))
    return int(numbers[-1]) if numbers else 0


def _from_rest(values: FloatArray) -> FloatArray:
    return np.concatenate([np.zeros_like(values[:1]), values])
