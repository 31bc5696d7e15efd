"""A result file: its reader, its run folder, and how to read it.

Beside a ``run.toml`` of fembridge time 0 of a trace is the start of the stimulus. The
solver's clock starts before (a ramp to a pre-indentation takes place there), and a
result file has no sample of the start itself.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fembridge.errors import FembridgeError, ResultError, UsageError
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import Reader, reader_of, result_file
from fembridge.run_folder import RUN_FILE, SOLVER_FILE, RunFolder, read_run_folder
from fembridge.store import read_toml, sha256_of
from fembridge.trace import STEP_TOLERANCE, StressTrace, Traces
from fembridge.typing import Table

_BEFORE_STEPS = 0.25  # of a step that may be lost to rounding


@dataclass(frozen=True, slots=True)
class Result:
    """A result file at `path`, read with `options`.

    `run` is the run that it is a result of: None without a ``run.toml`` beside it, or
    with one that cannot be read, which is the `trouble` that only `traces` mind.
    """

    path: Path
    options: ReadOptions
    run: RunFolder | None = None
    trouble: ResultError | None = None

    @property
    def reader(self) -> Reader:
        """The reader that takes the file."""
        return reader_of(self.path)

    def describe(self) -> Table:
        """What the file holds."""
        reader = self.reader
        found: Table = reader.ask("describe", self.path, {"format": reader.name})
        return found

    def named_nodes(self) -> Sequence[int]:
        """Nodes that a file of curves names itself; none of other files."""
        if self.trouble is not None:
            raise self.trouble
        nodes: Sequence[int] = self.reader.ask("nodes_in", self.path, ())
        return nodes

    def traces(
        self,
        nodes: Sequence[int] | None = None,
        *,
        sets: Sequence[str] = (),
        near_mm: Sequence[Sequence[float]] = (),
        deck: Path | None = None,
    ) -> Traces:
        """Stress traces at the chosen nodes, without a choice at the run's afferents."""
        path, run, options = self.path, self.run, self.options
        reader = reader_of(path)
        load = reader.load(reader.target, path, options)
        if self.trouble is not None:
            raise self.trouble
        if nodes is not None or sets or len(near_mm):
            if sets or len(near_mm):
                from fembridge.results.nodes import choose_nodes

                nodes = choose_nodes(path, nodes or (), sets, near_mm, deck, options.log)
            chosen = dict.fromkeys(int(node) for node in nodes or ())
            places: list[tuple[str | None, int]] = [(None, node) for node in chosen]
        elif run is not None:
            places = [(place.afferent, place.node) for place in run.afferents]
        else:
            raise ResultError("no run.toml beside it: name the nodes to read", path)
        if not places:
            raise ResultError("no nodes to read", path)
        if run is not None:
            if options.stress_unit != run.stress_unit:
                raise UsageError(
                    f"{path}: a run folder of fembridge is in {run.stress_unit}, always"
                )
            _check_deck(run, path)
            options = replace(options, branches=run.branches, on_axis=run.on_axis)
            if run.before_ms:
                since_ms = run.before_ms - _BEFORE_STEPS * run.dt_ms
                options = replace(options, since_ms=since_ms)
        found = load(path, [node for _, node in places], options)
        traces = [
            replace(trace, afferent=afferent)
            for trace, (afferent, _) in zip(found, places, strict=True)
        ]
        if run is None:
            return Traces(traces)
        last_ms = float(traces[0].times_ms[-1])
        if abs(last_ms - run.end_ms) > STEP_TOLERANCE * run.dt_ms * 10:
            words = f"results end at {last_ms:g} ms, the deck runs to {run.end_ms:g} ms"
            if not options.partial:
                raise ResultError(f"{words}; --partial (partial=True) takes them so", path)
            options.note(words)
        return Traces((_in_stimulus_time(trace, run, path) for trace in traces), run.origin())


def open_result(
    path: Path | str | RunFolder,
    *,
    partial: bool = False,
    across_materials: bool = False,
    stress_unit: str | None = None,
    extrapolate: str | None = None,
    von_mises: str | None = None,
    log: Callable[[str], None] | None = None,
) -> Result:
    """The result file `path`, or that of the run folder `path`; options as for `read`."""
    run: RunFolder | None = None
    trouble = None
    if isinstance(path, RunFolder):
        run = path
        path = run.results
    elif ((folder := Path(path)) / RUN_FILE).exists():
        run = read_run_folder(folder)
        path = run.results
    else:
        path = result_file(path)
        try:
            if (path.parent / RUN_FILE).exists():
                run = read_run_folder(path.parent)
        except ResultError as error:
            trouble = error
    unit = stress_unit or (run.stress_unit if run is not None else "MPa")
    options = ReadOptions(partial, across_materials, unit, log, extrapolate, von_mises)
    return Result(path, options, run, trouble)


def describe(path: Path | str) -> Table:
    """What a result file holds."""
    return open_result(path).describe()


def read(
    path: Path | str | RunFolder,
    nodes: Sequence[int] | None = None,
    *,
    node_set: str | None = None,
    near_mm: Sequence[Sequence[float]] = (),
    deck: Path | str | None = None,
    partial: bool = False,
    across_materials: bool = False,
    stress_unit: str | None = None,
    extrapolate: str | None = None,
    von_mises: str | None = None,
    log: Callable[[str], None] | None = None,
) -> Traces:
    """Read stress traces, in Pa over ms, from a result file.

    With a ``run.toml`` of fembridge beside the file, time 0 is the start of the
    stimulus, and the traces begin with the rest sample.

    Parameters
    ----------
    path
        A result file, or a run folder: its path, or what `fembridge.build_deck` gave.
    nodes
        Numbers of nodes. None takes the afferents that ``run.toml`` names, unless
        `node_set` or `near_mm` choose.
    node_set
        Name of a set in the file or its deck, case-blind: all its nodes.
    near_mm
        Places, x, y or x, y, z of the undeformed mesh: the nearest node that has
        a stress. `log` gets which it is and how far away.
    deck
        Where `node_set` is. None takes the file itself where it has sets, else the
        deck with the stem of `path`.
    partial
        Take what is whole of a run that did not end well; `log` gets what was left
        out.
    across_materials
        Allow nodes on a layer boundary.
    stress_unit
        Unit of the file: "MPa" (N and mm), "kPa" or "Pa". None is the one in
        ``run.toml``, without one MPa.
    extrapolate
        Of a Marc file: how stress is carried from integration points to nodes,
        "linear" (None too), "translate" or "average".
    von_mises
        Of a Marc file: "tensor" (None too) is the von Mises stress of the nodal
        tensor, "scalar" that of the points, carried to the node as a number.
    log
        Called with each remark.

    Raises
    ------
    ResultError
        The file is absent, cut, foreign, or does not hold what was asked for.

    Examples
    --------
    >>> import fembridge as fb
    >>> [trace.afferent for trace in fb.read("runs/sine_20_250")]
    ['SA', 'RA', 'PC']
    """
    result = open_result(
        path,
        partial=partial,
        across_materials=across_materials,
        stress_unit=stress_unit,
        extrapolate=extrapolate,
        von_mises=von_mises,
        log=log,
    )
    return result.traces(
        nodes,
        sets=() if node_set is None else (node_set,),
        near_mm=near_mm,
        deck=None if deck is None else Path(deck),
    )


def _in_stimulus_time(trace: StressTrace, run: RunFolder, path: Path) -> StressTrace:
    """`trace` on the clock of the stimulus: first sample at time 0.

    With a ramp the sample at its end is an increment of the file and what comes
    before is dropped. Without one the model is stress-free at time 0 by
    definition, and that sample, exactly 0, is put in front.
    """
    before = (run.start_ms - trace.start_ms) / trace.dt_ms
    rows = round(before)
    on_grid = abs(before - rows) <= STEP_TOLERANCE
    stress_pa = None
    if on_grid and 0 <= rows < trace.stress_pa.size - 1:
        stress_pa = trace.stress_pa[rows:]
    elif on_grid and rows == -1 and run.start_ms == 0.0:
        stress_pa = np.concatenate([[0.0], trace.stress_pa])
    if stress_pa is None:
        raise ResultError(
            f"node {trace.node}: the stimulus begins at {run.start_ms:g} ms of solver "
            f"time, the file holds {trace.start_ms:g} to {trace.times_ms[-1]:g} ms in "
            f"steps of {trace.dt_ms:g} ms",
            path,
        )
    # A file's times may be rounded: to six digits, or to single precision.
    off = abs(trace.dt_ms / run.dt_ms - 1.0) * stress_pa.size
    dt_ms = run.dt_ms if off <= STEP_TOLERANCE else trace.dt_ms
    return replace(trace, stress_pa=stress_pa, start_ms=0.0, dt_ms=dt_ms)


def _check_deck(run: RunFolder, path: Path) -> None:
    """Refuse results of another deck than the one that is beside them now.

    `fembridge run` keeps the solved deck's SHA-256 in ``solver.toml``; results
    that someone's own ccx left have none, and are taken as they are.
    """
    try:
        record = read_toml(run.folder / SOLVER_FILE, FembridgeError)
        solved, now = record["deck_sha256"], sha256_of(run.deck)
    except (FembridgeError, OSError, KeyError):  # also: no TOML
        return
    if path.resolve() == run.results.resolve() and solved != now:
        raise ResultError(
            f"results of another deck than the {run.deck.name} beside them; solve it: "
            f"fembridge run {run.folder}",
            path,
        )
