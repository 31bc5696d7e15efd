"""Reading a solver's results: one table of formats, one function.

The table is in `fembridge.results.readers`.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path

from decks.dialects import JOB
from fembridge.errors import ResultError, UsageError
from fembridge.results.node_choice import NodeChoice
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import ENTRY_POINTS, READERS, Reader, reader_of
from fembridge.run_folder import RUN_FILE, RunFolder, read_run_folder
from fembridge.trace import Traces
from fembridge.typing import Table

__all__ = [
    "ENTRY_POINTS",
    "READERS",
    "Reader",
    "describe",
    "named_nodes",
    "read",
    "reader_of",
    "result_file",
    "run_folder_of",
]

_BEFORE_STEPS = 0.25  # of a step that may be lost to rounding


def read(
    path: Path | str,
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
    tell: Callable[[str], None] | None = None,
) -> Traces:
    """Read stress traces, in Pa over ms, from a result file.

    With a ``run.toml`` of fembridge beside the file, time 0 is the start of the
    stimulus, and the traces begin with the rest sample.

    Parameters
    ----------
    path
        A result file, or a run folder.
    nodes
        Numbers of nodes. None takes the afferents that ``run.toml`` names, unless
        `node_set` or `near_mm` choose.
    node_set
        Name of a set in the file or its deck, case-blind: all its nodes.
    near_mm
        Places, x, y or x, y, z of the undeformed mesh: the nearest node that has
        a stress. `tell` hears which it is and how far away.
    deck
        Where `node_set` is. None takes the file itself where it has sets, else the
        deck with the stem of `path`.
    partial
        Take what is whole of a run that did not end well; `tell` hears what
        was left out.
    across_materials
        Let through nodes on a layer boundary.
    stress_unit
        Unit of the file: "MPa" (N and mm), "kPa" or "Pa". None is the one in
        ``run.toml``, without one MPa.
    extrapolate
        Of a Marc file: how stress is carried from integration points to nodes,
        "linear" (None too), "translate" or "average".
    von_mises
        Of a Marc file: "tensor" (None too) is the von Mises stress of the nodal
        tensor, "scalar" that of the points, carried to the node as a number.
    tell
        Called with each remark.

    Raises
    ------
    ResultError
        The file is absent, cut, foreign, or does not hold what was asked for.
    """
    path = result_file(path)
    reader = reader_of(path)
    run = run_folder_of(path)
    options = ReadOptions(
        partial,
        across_materials,
        stress_unit or ("MPa" if run is None else run.stress_unit),
        tell,
        extrapolate,
        von_mises,
    )
    if not reader.points and (extrapolate or von_mises):
        raise UsageError(
            f"{path}: {reader.name} holds stress at nodes; how it is extrapolated "
            "there is asked of a Marc post file"
        )
    chosen = NodeChoice(
        nodes=() if nodes is None else nodes,
        sets=() if node_set is None else (node_set,),
        places_mm=near_mm,
        deck=None if deck is None else Path(deck),
    )
    if nodes is not None or chosen:
        places: list[tuple[str | None, int]] = [(None, node) for node in chosen.resolve(path, tell)]
    elif run is not None:
        places = [(place.afferent, place.node) for place in run.afferents]
    else:
        raise ResultError("no run.toml beside it: name the nodes to read", path)
    if not places:
        raise ResultError("no nodes to read", path)
    if run is not None:
        if options.stress_unit != run.stress_unit:
            raise UsageError(f"{path}: a run folder of fembridge is in {run.stress_unit}, always")
        from fembridge.results.run_traces import check_deck, check_reach, in_stimulus_time

        check_deck(run, path)
        if run.before_ms:
            since_ms = run.before_ms - _BEFORE_STEPS * run.dt_ms
            options = replace(options, since_ms=since_ms)
        options = replace(options, branches=run.branches, on_axis=run.on_axis)
    traces = reader.load()(path, [node for _, node in places], options)
    traces = [
        replace(trace, afferent=afferent)
        for trace, (afferent, _) in zip(traces, places, strict=True)
    ]
    if run is None:
        return Traces(traces)
    check_reach(traces[0], run, path, options)
    return Traces(in_stimulus_time(trace, run, path) for trace in traces)


def result_file(path: Path | str) -> Path:
    """Give the result file that `path` is, or that the run folder `path` holds.

    Of a folder: what the solver in its ``run.toml`` writes, the binary file first;
    without a ``run.toml``, what is there.
    """
    path = Path(path)
    if not path.is_dir():
        return path
    if (path / RUN_FILE).exists():
        return read_run_folder(path).results
    places = [path / f"{JOB}{reader.suffix}" for reader in READERS]
    return next((place for place in places if place.exists()), places[0])


def named_nodes(path: Path) -> Sequence[int]:
    """Give the nodes that a file of curves names itself; none of other files."""
    module = import_module(reader_of(path).target.partition(":")[0])
    names: Callable[[Path], Sequence[int]] = getattr(module, "nodes_in", lambda _: ())
    return names(path)


def describe(path: Path) -> Table:
    """Tell what a result file holds."""
    return reader_of(path).describe(path)


def run_folder_of(path: Path) -> RunFolder | None:
    """Give the run that `path` is a result of; None without a ``run.toml``."""
    folder = path.parent
    return read_run_folder(folder) if (folder / RUN_FILE).exists() else None
