"""A result file, its run folder, and the functions that read it.

With a ``run.toml`` of fembridge in its folder, time 0 of a trace is the start of the stimulus.
The solver's time starts earlier if the deck ramps to a pre-indentation. A result file has no
sample at the start of the analysis.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from copy import copy
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from decks.unit_system import LENGTH_UNITS, MM, UnitSystem
from fembridge.errors import FembridgeError, ResultError, UsageError, warn
from fembridge.io import RUN_FILE
from fembridge.results.fields import Field
from fembridge.results.history import NO_KEYS, STRESS, VON_MISES, History
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import READERS, STATUS, open_source
from fembridge.results.source import Source
from fembridge.trace import STEP_TOLERANCE, Traces
from fembridge.typing import FloatArray, Table

if TYPE_CHECKING:
    import pandas

    from fembridge.io.run_folder import AfferentNode, RunFolder

# The folder of a data set of touches, and the class that reads it, of a later room.
_DATASET_FILE, _DATASET = "dataset.toml", "fembridge.sweeps.dataset:Touches"


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """An open result file, its `source`, and the `run` that wrote it.

    `run` is None without a ``run.toml`` in the folder, or if it cannot be read: `run_error` is
    then the error, which histories raise.
    """

    source: Source
    run: RunFolder | None = None
    run_error: ResultError | None = None

    def with_options(self, **changed: Any) -> Result:  # noqa: ANN401 - fields of `ReadOptions`
        """The same open file with other options."""
        source = copy(self.source)
        source.options = replace(self.source.options, **changed)
        return replace(self, source=source)

    def named_nodes(self) -> Sequence[int]:
        """Nodes that a file of curves names; empty for other files."""
        if self.run_error is not None:
            raise self.run_error
        return self.with_options(quiet=True).source.named_nodes()

    def traces(self, nodes: Sequence[int] | None = None, **selection: Any) -> Traces:  # noqa: ANN401
        """Stress traces at the selected nodes; arguments as for `history`."""
        history = self.history(nodes, quantity=VON_MISES, from_start=True, **selection)
        traces = history.traces()
        if self.run is None:
            return Traces(traces)
        chosen = nodes is not None or selection.get("sets") or len(selection.get("near_mm", ()))
        if not chosen and not selection.get("all_nodes"):
            units = [site.unit for site in self.run.afferents]
            traces = [replace(trace, unit=unit) for trace, unit in zip(traces, units, strict=True)]
        return Traces(traces, self.run.origin())

    def history(
        self,
        nodes: Sequence[int] | None = None,
        *,
        quantity: str | None = None,
        all_nodes: bool = False,
        modes: bool = False,
        resample_ms: float | None = None,
        sets: Sequence[str] = (),
        near_mm: Sequence[Sequence[float]] = (),
        deck: Path | None = None,
        from_start: bool = False,
        on_grid: bool = True,
    ) -> History:
        """`quantity` at the selected nodes, at all nodes, or at the run's afferents.

        With a ``run.toml``, time 0 is the start of the stimulus; `from_start` takes the rows
        from there on, with `on_grid` on the even time grid of a trace.
        """
        if self.run_error is not None:
            raise self.run_error
        run, sites = self.run, None if all_nodes else self._select_nodes(nodes, sets, near_mm, deck)
        if run is not None:
            self._refuse_changed_deck(run)
        numbers = None if sites is None else [node for _, node in sites]
        history = self.source.history(numbers, quantity, modes)
        if run is None and history.quantity == STRESS and not self.source.options.quiet:
            self._warn_of_shells(history)
        if sites is not None:
            file_classes = history.afferents or (None,) * len(sites)
            classes = (
                (run_class, file_class)
                for (run_class, _), file_class in zip(sites, file_classes, strict=True)
            )
            history = replace(
                history,
                afferents=tuple(run_class or file_class for run_class, file_class in classes),
            )
        if run is not None and from_start:
            history = self._from_start(history, run, on_grid and resample_ms is None)
        elif run is not None and history.over_time:
            history = replace(history, at=history.at - run.start_ms)
        output_quantity = VON_MISES if history.quantity == STRESS else history.quantity
        output_quantity = output_quantity if quantity is None else quantity.lower()
        return history.selected(output_quantity, resample_ms, self.source.options.quiet)

    def _from_start(self, history: History, run: RunFolder, on_grid: bool) -> History:
        """Rows from the start of the stimulus (time 0) on, with `on_grid` at an even time step.

        After a ramp the sample at time 0 is an increment of the file. Without a ramp, and where
        the solver writes nothing at time 0, a sample is prepended: 0 of a model that is at rest
        then, else the initial stress of the deck.
        """
        path, options = self.source.path, self.source.options
        if not history.over_time:
            raise ResultError(f"a trace needs outputs over time; found {history.form}", path)
        last_ms, slack_ms = float(history.at.max()), STEP_TOLERANCE * run.dt_ms
        if abs(last_ms - run.end_ms) > 10 * slack_ms:
            message = f"results end at {last_ms:g} ms, expected the deck's end, {run.end_ms:g} ms"
            options.refuse(message, path)
        is_after_start = history.at >= run.start_ms - slack_ms
        at, values = history.at[is_after_start], history.values[is_after_start]  # noqa: PD008, PD011 - no frame
        if run.start_ms == 0.0 and at.size and at[0] > slack_ms:
            start = np.zeros_like(values[0]) if run.at_rest else self._start_stress(history, run)
            at = np.concatenate([[0.0], at])
            values = np.concatenate([start[None], values])
        trimmed = replace(history, at=at, values=values, keys=NO_KEYS)
        if not on_grid:
            return replace(trimmed, at=at - run.start_ms)
        if at.size < 2 or abs(at.min() - run.start_ms) > slack_ms:
            raise ResultError(
                f"no output at the start of the stimulus, {run.start_ms:g} ms of solver time; "
                f"found {history.form}",
                path,
            )
        trimmed = trimmed.with_even_times()
        mean_step_ms = (
            trimmed.dt_ms or trimmed.traces()[0].dt_ms
        )  # traces() raises if times are uneven
        # Times in a file are rounded, to six digits or to single precision.
        drift = abs(mean_step_ms / run.dt_ms - 1.0) * at.size
        step_ms = run.dt_ms if drift <= STEP_TOLERANCE else mean_step_ms
        at_ms: FloatArray = np.arange(at.size, dtype=np.float64) * step_ms
        return replace(trimmed, at=at_ms, step_ms=step_ms)

    def _warn_of_shells(self, history: History) -> None:
        """Warn that the stress of a shell is that of its middle."""
        node = self.source.shell_node(history.nodes)
        if node is not None:
            warn(
                f"node {node} is of a shell: its stress is that of the middle layer; with "
                "OUTPUT=3D on *NODE FILE and *EL FILE CalculiX writes bottom and top; fembridge "
                "build-deck --shell-face chooses one",
                self.source.path,
            )

    def _start_stress(self, history: History, run: RunFolder) -> FloatArray:
        """Stress at the nodes of `history` at time 0, ``(node, 6)``, as the deck states it."""
        stated = {
            node: site.start_stress_pa
            for site, (_, node) in zip(run.afferents, self._afferent_nodes(run), strict=True)
        }
        unknown = [node for node in history.nodes if not stated.get(node)]
        if unknown or history.quantity != STRESS:
            raise ResultError(
                f"the model holds initial stress at time 0, and it is not known at node "
                f"{(unknown or history.nodes)[0]}; build the deck with --afferent SA=N",
                self.source.path,
            )
        return np.array([stated[node] for node in history.nodes])

    def _afferent_nodes(self, run: RunFolder) -> list[tuple[str | None, int]]:
        """Class and node of each afferent of a run, in the numbers of the result file."""
        on_faces = [site for site in run.afferents if site.element]
        nodes = {} if not on_faces else self._shell_nodes(on_faces)
        return [(site.afferent, nodes.get(site.key, site.node)) for site in run.afferents]

    def _shell_nodes(self, sites: Sequence[AfferentNode]) -> dict[str, int]:
        """Nodes of afferents on the bottom or top of shells, by class and unit."""
        index = self.source.element_corners([site.element for site in sites])
        nodes = {}
        for site in sites:
            corners = index.get(site.element, ())
            if site.corner >= len(corners):
                problem = f"no expanded shell {site.element} for afferent {site.key}"
                raise ResultError(f"{problem}; the deck needs OUTPUT=3D", self.source.path)
            nodes[site.key] = int(corners[site.corner])
        return nodes

    def largest_node(self) -> tuple[int, Mapping[str, bool], History]:
        """Node where the default quantity is largest in the last output; options; its history.

        The options are the strictest that can read it: without `partial` before with it, inside
        one material before across materials.
        """
        problems = []
        for partial in dict.fromkeys((self.source.options.partial, True)):
            for across_materials in (False, True):
                options = {"partial": partial, "across_materials": across_materials}
                variant = self.with_options(**options, quiet=True)
                try:
                    last_rows = variant.source.history(None, last_only=True)
                    last_rows = last_rows.derived(
                        VON_MISES if last_rows.quantity == STRESS else last_rows.quantity
                    )
                    magnitudes = [abs(value) for _, value in last_rows.peaks()]
                    node = last_rows.nodes[magnitudes.index(max(magnitudes))]
                    return node, options, variant.history([node])
                except FembridgeError as error:
                    problems += [error] * across_materials
        raise problems[0]

    def _select_nodes(
        self,
        nodes: Sequence[int] | None,
        sets: Sequence[str],
        near_mm: Sequence[Sequence[float]],
        deck: Path | None,
    ) -> list[tuple[str | None, int]]:
        """Class and number of each selected node."""
        if nodes is not None or sets or len(near_mm):
            from fembridge.results.nodes import choose_nodes

            nodes = choose_nodes(self.source, nodes or (), sets, near_mm, deck)
        elif self.run is not None:
            if not self.run.afferents:
                folder = self.run.folder
                raise ResultError(
                    f"run.toml names no afferent: choose nodes, fembridge ingest {folder} --node N "
                    f"(nodes=[N]; fembridge ingest {folder} --list shows the sets), or build the "
                    "deck with --afferent SA=N",
                    self.source.path,
                )
            return self._afferent_nodes(self.run)
        elif not (nodes := self.named_nodes()):
            raise ResultError(
                "no run.toml in this folder: choose nodes with --node N (nodes=[N])",
                self.source.path,
            )
        if not nodes:
            raise ResultError("no nodes selected", self.source.path)
        return [(None, node) for node in nodes]

    def _refuse_changed_deck(self, run: RunFolder) -> None:
        """Refuse results of another deck than the one in the run folder.

        `fembridge run` writes the SHA-256 of the solved deck to ``solver.toml``; results
        without that file, of a solver run by hand, are accepted.
        """
        from fembridge.host.store import read_toml, sha256_of
        from fembridge.io.run_folder import SOLVER_FILE

        solved_sha256 = deck_sha256 = ""
        with suppress(FembridgeError, OSError, KeyError):  # also: no TOML
            solved_sha256 = read_toml(run.folder / SOLVER_FILE, FembridgeError)["deck_sha256"]
            deck_sha256 = sha256_of(run.deck)
        if (
            deck_sha256
            and solved_sha256 != deck_sha256
            and self.source.path.resolve() == run.results.resolve()
        ):
            raise ResultError(
                f"results of another deck than {run.deck.name} in this folder; solve it: "
                f"fembridge run {run.folder}",
                self.source.path,
            )


@contextmanager
def open_result(
    path: Path | str | RunFolder,
    *,
    partial: bool = False,
    across_materials: bool = False,
    stress_unit: str | None = None,
    length_unit: str | None = None,
    extrapolate: str | None = None,
    von_mises: str | None = None,
    columns: Mapping[str, str] | None = None,
    of_run: RunFolder | None = None,
) -> Iterator[Result]:
    """Open the result file `path`, or that of the run folder `path`; options as for `read`.

    `of_run` is the run of a result file in another folder.
    In a folder without ``run.toml`` the first format of `READERS` that exists is opened.
    """
    run: RunFolder | None = None
    run_error = None
    if not isinstance(path, str | os.PathLike):
        run, path = path, path.results
    elif of_run is not None:
        run, path = of_run, Path(path)
    elif ((path := Path(path)) / RUN_FILE).exists():
        run = _run_in(path)
        path = run.results
    else:
        if path.is_dir():
            from decks.dialects import JOB

            suffixes = [reader.suffix for reader in READERS if reader.suffix not in STATUS]
            candidates = [path / f"{JOB}{suffix}" for suffix in suffixes]
            folder, path = path, next(filter(Path.exists, candidates), candidates[0])
            if not path.exists():
                names = ", ".join(dict.fromkeys(candidate.name for candidate in candidates))
                raise ResultError(
                    f"no result file in this folder, expected {names}; fb.Simulation.read reads "
                    "the folder of a simulation",
                    folder,
                    expected=names,
                )
        try:
            if (path.parent / RUN_FILE).exists():
                run = _run_in(path.parent)
        except ResultError as error:
            run_error = error
    if columns and stress_unit is None:
        from fembridge.results.columns import check_units

        check_units(columns)
    units: UnitSystem | RunFolder = LENGTH_UNITS.get(length_unit or "", MM)
    run_options: dict[str, Any] = {}
    if run is not None:  # the units of its deck apply, not its heading
        for argument, requested, stored in (
            ("stress_unit", stress_unit, run.stress_unit),
            ("length_unit", length_unit, run.length_unit),
        ):
            if requested not in (None, stored):
                raise UsageError(
                    f"is {requested}, expected {stored}, the unit of this run folder",
                    path,
                    argument=argument,
                )
        units, run_options = run, {"branches": run.branches, "on_axis": run.on_axis}
        run_options["classes"] = {site.node: site.afferent for site in run.afferents}
    options = ReadOptions(
        partial=partial,
        across_materials=across_materials,
        stress_unit=stress_unit or units.stress_unit,
        length_unit=length_unit or units.length_unit,
        extrapolate=extrapolate,
        von_mises=von_mises,
        columns=dict(columns or {}),
        **run_options,
    )
    with open_source(path, options) as source:
        if run is None and length_unit is None and (stated := source.unit_system()) is not None:
            options.note(f"unit system {stated} from the heading")
            source.options = replace(
                options,
                length_unit=stated.length_unit,
                stress_unit=stress_unit or stated.stress_unit,
            )
        yield Result(source, run, run_error)


def _run_in(folder: Path) -> RunFolder:
    from fembridge.io.run_folder import read_run_folder

    return read_run_folder(folder)


def describe(path: Path | str) -> Table:
    """Content of a result file: header, mesh, quantities, defects, as of ``ingest --list``."""
    with open_result(path) as result:
        return result.source.describe()


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
    length_unit: str | None = None,
    resample_ms: float | None = None,
    extrapolate: str | None = None,
    von_mises: str | None = None,
    columns: Mapping[str, str] | None = None,
) -> Traces:
    """Stress traces, in Pa over ms, from a result file; or a data set of touches.

    With a ``run.toml`` of fembridge in the folder, time 0 is the start of the stimulus, and the
    first sample of a trace is the state at rest. A trace has an even time step; `read_history`
    returns outputs at any times, and other quantities.

    Parameters
    ----------
    path
        Result file, or run folder: its path, or a `RunFolder` of `fembridge.build_deck`. Of
        `fembridge.touch_many` the folder or address, without other arguments.
    nodes
        Node numbers. Default: None, the afferents' nodes in ``run.toml`` unless `node_set` or
        `near_mm` select nodes; all nodes of a CSV or NPZ.
    node_set
        Name of a node set in the file or its deck; case does not matter. Default: None.
    near_mm
        Positions (x, y) or (x, y, z) in mm of the undeformed mesh: the nearest node that has
        stress; node and distance are logged. Default: ().
    deck
        Deck that defines `node_set`. Default: None, the file itself if its format has sets,
        else the deck of the same name in its folder.
    partial
        Read the complete part of a run that did not end normally; omissions are logged.
        Default: False, such a file raises.
    across_materials
        Allow nodes on a layer boundary, where stress is a mean over both layers. Default: False.
    stress_unit
        Unit of stress in the file: "MPa", "kPa", "Pa" or "psi". Default: None, the unit in
        ``run.toml``, else of the unit system in the file's heading, else of `length_unit`,
        else MPa (N and mm).
    length_unit
        Unit of coordinates and displacements in the file: "mm", "m" or "in". Default: None, of
        the heading, else mm.
    resample_ms
        Time step in ms of the traces, made by PCHIP of the stress tensor from the first output
        on, for a file with uneven increments. Default: None, the outputs as they are.
    extrapolate
        Of a Marc file: extrapolation of stress from integration points to nodes, "linear",
        "translate" or "average". Default: None, "linear".
    von_mises
        Of a Marc file: "tensor" is the von Mises stress of the nodal tensor, "scalar" the
        extrapolated von Mises stress of the integration points. Default: None, "tensor".
    columns
        Of a CSV, NPZ, VTU, PVD or XDMF: column or array names by quantity, such as
        ``{"time": "t", "value": "S_Mises"}``, see `fembridge.results.columns`. Default: None,
        other formats.

    Returns
    -------
    Traces
        Von Mises stress at each node. `origin` is the stimulus and the parameters of the run;
        None without ``run.toml``. Of a data set a `Touches` with its tables.

    Raises
    ------
    ResultError
        The file is missing, cut, damaged or of an unknown format, or lacks the data.
    UsageError
        An argument is wrong, or the format does not have it.

    Examples
    --------
    >>> import fembridge as fb
    >>> [trace.afferent for trace in fb.read("runs/sine_20_250")]
    ['SA', 'RA', 'PC']
    """
    if _is_dataset(path):
        module, name = _DATASET.split(":")
        reader = getattr(import_module(module), name)
        return reader.read(path)  # type: ignore[no-any-return] # a Touches
    with open_result(
        path,
        partial=partial,
        across_materials=across_materials,
        stress_unit=stress_unit,
        length_unit=length_unit,
        extrapolate=extrapolate,
        von_mises=von_mises,
        columns=columns,
    ) as result:
        return result.traces(
            nodes,
            sets=() if node_set is None else (node_set,),
            near_mm=near_mm,
            deck=None if deck is None else Path(deck),
            resample_ms=resample_ms,
        )


def _is_dataset(path: Path | str | RunFolder) -> bool:
    """Whether `path` is the folder or address of a data set of touches."""
    if not isinstance(path, str | Path):
        return False
    return "://" in str(path) or (Path(path) / _DATASET_FILE).is_file()


def read_history(
    path: Path | str | RunFolder,
    nodes: Sequence[int] | str | None = None,
    *,
    quantity: str | None = None,
    node_set: str | None = None,
    near_mm: Sequence[Sequence[float]] = (),
    deck: Path | str | None = None,
    modes: bool = False,
    resample_ms: float | None = None,
    partial: bool = False,
    across_materials: bool = False,
    stress_unit: str | None = None,
    length_unit: str | None = None,
    extrapolate: str | None = None,
    von_mises: str | None = None,
    columns: Mapping[str, str] | None = None,
) -> pandas.DataFrame:
    """A quantity at nodes at all outputs of a file: a long table.

    A row for each output and node, whatever the outputs are: one increment, uneven increments,
    several steps, modes. Column names have units (``time_ms``, ``sxx_pa``, ``d1_mm``;
    ``frequency_hz`` of modes).

    Parameters
    ----------
    path
        Result file, or run folder: its path, or a `RunFolder` of `fembridge.build_deck`.
    nodes
        Node numbers, or "all". Default: None, the afferents' nodes in ``run.toml`` unless
        `node_set` or `near_mm` select nodes; all nodes of a CSV or NPZ.
    quantity
        "von-mises", "stress" (the tensor), "principal", "max-shear", "mean-stress",
        "displacement", "reaction-force", "strain", "temperature", or the name of another
        quantity in the file. Default: None, von Mises stress; of a file without stress
        displacement, else the first quantity.
    node_set
        Name of a node set in the file or its deck; case does not matter. Default: None.
    near_mm
        Positions (x, y) or (x, y, z) in mm of the undeformed mesh: the nearest node that has
        stress; node and distance are logged. Default: ().
    deck
        Deck that defines `node_set`. Default: None, the file itself if its format has sets,
        else the deck of the same name in its folder.
    modes
        Read the modes of frequency and buckling steps even if the file has outputs over time.
        Default: False.
    resample_ms
        Time step in ms of the table, made by PCHIP from the first output on. Default: None, the
        outputs as they are.
    partial
        Read the complete part of a run that did not end normally; omissions are logged.
        Default: False, such a file raises.
    across_materials
        Allow nodes on a layer boundary, where stress is a mean over both layers. Default: False.
    stress_unit
        Unit of stress in the file: "MPa", "kPa", "Pa" or "psi". Default: None, the unit in
        ``run.toml``, else of the unit system in the file's heading, else of `length_unit`,
        else MPa (N and mm).
    length_unit
        Unit of coordinates and displacements in the file: "mm", "m" or "in". Default: None, of
        the heading, else mm.
    extrapolate
        Of a Marc file: extrapolation of stress from integration points to nodes, "linear",
        "translate" or "average". Default: None, "linear".
    von_mises
        Of a Marc file: "tensor" is the von Mises stress of the nodal tensor, "scalar" the
        extrapolated von Mises stress of the integration points. Default: None, "tensor".
    columns
        Of a CSV, NPZ, VTU, PVD or XDMF: column or array names by quantity, such as
        ``{"time": "t", "value": "S_Mises"}``, see `fembridge.results.columns`. Default: None,
        other formats.

    Returns
    -------
    pandas.DataFrame
        Time in ms (or the frequency or factor of a mode), afferent, node, step, increment, and
        a column for each component.

    Raises
    ------
    ResultError
        The file is missing, cut, damaged or of an unknown format, or lacks the data.
    UsageError
        An argument is wrong, or the format does not have it.

    Examples
    --------
    >>> import fembridge as fb
    >>> list(fb.read_history("runs/sine_20_250", quantity="displacement"))[:4]
    ['time_ms', 'afferent', 'node', 'step']
    """
    if isinstance(nodes, str) and nodes != "all":
        raise UsageError(argument="nodes", found=nodes, expected="numbers or 'all'")
    with open_result(
        path,
        partial=partial,
        across_materials=across_materials,
        stress_unit=stress_unit,
        length_unit=length_unit,
        extrapolate=extrapolate,
        von_mises=von_mises,
        columns=columns,
    ) as result:
        history = result.history(
            None if isinstance(nodes, str) else nodes,
            quantity=quantity,
            all_nodes=isinstance(nodes, str),
            modes=modes,
            resample_ms=resample_ms,
            sets=() if node_set is None else (node_set,),
            near_mm=near_mm,
            deck=None if deck is None else Path(deck),
        )
        return history.to_frame()


def read_fields(
    path: Path | str | RunFolder,
    quantity: str = "STRESS",
    *,
    partial: bool = False,
    across_materials: bool = False,
    stress_unit: str | None = None,
    length_unit: str | None = None,
    extrapolate: str | None = None,
) -> Iterator[Field]:
    """One quantity at all nodes, one increment at a time, in file order.

    Stress is in Pa. At the boundary of two materials the nodal stress of CalculiX is a mean
    over both; ``fembridge ingest --one-sided`` reads each material's.

    Parameters
    ----------
    path
        A ``.frd``, ``.t16`` or ``.t19`` file, or run folder: its path, or a `RunFolder` of
        `fembridge.build_deck`.
    quantity
        Name in the file, or its unique beginning; case does not matter: "STRESS", "DISP",
        "TOSTRAIN", "FORC"; of a Marc file "Displacement", "Stress". Default: "STRESS".
    partial
        Read the complete part of a run that did not end normally; omissions are logged.
        Default: False, such a file raises.
    across_materials
        Of a Marc file: include nodes on a layer boundary, where stress is a mean over both
        layers. Default: False.
    stress_unit
        Unit of stress in the file: "MPa", "kPa", "Pa" or "psi". Default: None, the unit in
        ``run.toml``, else of the unit system in the file's heading, else of `length_unit`,
        else MPa (N and mm).
    length_unit
        Unit of coordinates and displacements in the file: "mm", "m" or "in". Default: None, of
        the heading, else mm.
    extrapolate
        Of a Marc file: extrapolation of stress from integration points to nodes, "linear",
        "translate" or "average". Default: None, "linear".

    Yields
    ------
    Field
        Values at all nodes with their units, in one increment or mode.

    Raises
    ------
    ResultError
        Immediately: the file is missing, cut or of an unknown format, or lacks the quantity.
        While reading: a damaged record, or a value that is not finite.

    Examples
    --------
    >>> import fembridge as fb
    >>> field = next(fb.read_fields("runs/sine_20_250", "DISP"))
    >>> field.time_ms, field.components, field.units
    (0.5, ('D1', 'D2', 'D3'), ('mm', 'mm', 'mm'))
    """
    with ExitStack() as stack:
        result = stack.enter_context(
            open_result(
                path,
                partial=partial,
                across_materials=across_materials,
                stress_unit=stress_unit,
                length_unit=length_unit,
                extrapolate=extrapolate,
            )
        )
        return _closing(result.source.fields(quantity), stack.pop_all())


def _closing(fields: Iterator[Field], stack: ExitStack) -> Iterator[Field]:
    with stack:
        yield from fields
