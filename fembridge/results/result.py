"""A result file: its reader, its run folder, and how to read it.

Beside a ``run.toml`` of fembridge time 0 of a trace is the start of the stimulus. The
solver's clock starts before (a ramp to a pre-indentation takes place there), and a
result file has no sample of the start itself.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from decks.dialects import JOB
from decks.unit_system import LENGTH_UNITS, MM, UnitSystem
from fembridge.errors import FembridgeError, ResultError, UsageError
from fembridge.results.fields import Field
from fembridge.results.history import NO_KEYS, STRESS, VON_MISES, History
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import READERS, STATUS, open_source
from fembridge.results.source import Source
from fembridge.run_folder import RUN_FILE, SOLVER_FILE, RunFolder, read_run_folder
from fembridge.store import read_toml, sha256_of
from fembridge.trace import STEP_TOLERANCE, Traces
from fembridge.typing import FloatArray, Table

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """A result file, the open `source`.

    `run` is the run that it is a result of: None without a ``run.toml`` beside it, or with one
    that cannot be read, which is the `trouble` that only histories mind.
    """

    source: Source
    run: RunFolder | None = None
    trouble: ResultError | None = None

    def reading(self, **changed: Any) -> "Result":  # noqa: ANN401 - fields of `ReadOptions`
        """The same open file, read with other options."""
        source = copy(self.source)
        source.options = replace(self.source.options, **changed)
        return replace(self, source=source)

    def named_nodes(self) -> Sequence[int]:
        """Nodes that a file of curves names itself; none of other files."""
        if self.trouble is not None:
            raise self.trouble
        return self.reading(log=None).source.named_nodes()

    def traces(self, nodes: Sequence[int] | None = None, **choice: Any) -> Traces:  # noqa: ANN401
        """Stress traces at the chosen nodes, with the words of `history`."""
        found = self.history(nodes, quantity=VON_MISES, from_start=True, **choice)
        return Traces(found.traces(), None if self.run is None else self.run.origin())

    def history(
        self,
        nodes: Sequence[int] | None = None,
        *,
        quantity: str | None = None,
        every: bool = False,
        modes: bool = False,
        resample_ms: float | None = None,
        sets: Sequence[str] = (),
        near_mm: Sequence[Sequence[float]] = (),
        deck: Path | None = None,
        from_start: bool = False,
    ) -> History:
        """`quantity` at the chosen nodes, at `every` one, or at the run's afferents, as it is.

        Beside a ``run.toml`` time 0 is the start of the stimulus; `from_start` takes the rows
        from there on, on the even grid that a trace needs.
        """
        if self.trouble is not None:
            raise self.trouble
        run, places = self.run, None if every else self._places(nodes, sets, near_mm, deck)
        if run is not None:
            self._refuse_another_deck(run)
        wanted = None if places is None else [node for _, node in places]
        held = self.source.history(wanted, quantity, modes)
        if places is not None:
            named = held.afferents or (None,) * len(places)
            classes = ((one, other) for (one, _), other in zip(places, named, strict=True))
            held = replace(held, afferents=tuple(one or other for one, other in classes))
        if run is not None and from_start:
            held = self._from_start(held, run, resample_ms is None)
        elif run is not None and held.over_time:
            held = replace(held, at=held.at - run.start_ms)
        word = VON_MISES if held.quantity == STRESS else held.quantity
        word = word if quantity is None else quantity.lower()
        return held.taken(word, resample_ms, self.source.options.log)

    def _from_start(self, held: History, run: RunFolder, even: bool) -> History:
        """The rows from the start of the stimulus on, which is time 0; on an `even` grid.

        With a ramp the sample there is an increment of the file. Without one the model is
        stress-free at time 0 by definition, and that sample, exactly 0, is put in front.
        """
        path, options = self.source.path, self.source.options
        if not held.over_time:
            raise ResultError(f"{held.form}: no history over time, no trace to take", path)
        last_ms, slack_ms = float(held.at.max()), STEP_TOLERANCE * run.dt_ms
        if abs(last_ms - run.end_ms) > 10 * slack_ms:
            words = f"results end at {last_ms:g} ms, the deck runs to {run.end_ms:g} ms"
            options.refuse(words, path)
        kept = held.at >= run.start_ms - slack_ms
        at, values = held.at[kept], held.values[kept]  # noqa: PD008, PD011 - no frame
        if run.start_ms == 0.0 and at.size and at[0] > slack_ms:
            at = np.concatenate([[0.0], at])
            values = np.concatenate([np.zeros_like(values[:1]), values])
        since = replace(held, at=at, values=values, keys=NO_KEYS)
        if not even:
            return replace(since, at=at - run.start_ms)
        if at.size < 2 or abs(at.min() - run.start_ms) > slack_ms:
            raise ResultError(
                f"the stimulus begins at {run.start_ms:g} ms of solver time, the file holds "
                f"{held.form}",
                path,
            )
        since = since.unrounded()
        found_ms = since.dt_ms or since.traces()[0].dt_ms  # which says what is uneven
        # A file's times may be rounded: to six digits, or to single precision.
        off = abs(found_ms / run.dt_ms - 1.0) * at.size
        step_ms = run.dt_ms if off <= STEP_TOLERANCE else found_ms
        at_ms: FloatArray = np.arange(at.size, dtype=np.float64) * step_ms
        return replace(since, at=at_ms, step_ms=step_ms)

    def largest_node(self) -> tuple[int, Mapping[str, bool], History]:
        """The node where what is taken by default is largest at the end; options; its history.

        The options are those that its reading takes: of a whole file before a partial one, inside
        one material where there is such a node.
        """
        problems = []
        for partial in dict.fromkeys((self.source.options.partial, True)):
            for across in (False, True):
                options = {"partial": partial, "across_materials": across}
                asked = self.reading(**options, log=None)
                try:
                    last = asked.source.history(None, last=True)
                    last = last.derived(VON_MISES if last.quantity == STRESS else last.quantity)
                    sizes = [abs(value) for _, value in last.peaks()]
                    node = last.nodes[sizes.index(max(sizes))]
                    return node, options, asked.history([node])
                except FembridgeError as error:
                    problems += [error] * across
        raise problems[0]

    def _places(
        self,
        nodes: Sequence[int] | None,
        sets: Sequence[str],
        near_mm: Sequence[Sequence[float]],
        deck: Path | None,
    ) -> list[tuple[str | None, int]]:
        """Class and node of each chosen node."""
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
            return [(place.afferent, place.node) for place in self.run.afferents]
        elif not (nodes := self.named_nodes()):
            raise ResultError("no run.toml beside it: name the nodes to read", self.source.path)
        if not nodes:
            raise ResultError("no nodes to read", self.source.path)
        return [(None, node) for node in nodes]

    def _refuse_another_deck(self, run: RunFolder) -> None:
        """Refuse results of another deck than the one beside them.

        `fembridge run` keeps the solved deck's SHA-256 in ``solver.toml``; results that
        someone's own ccx left have none, and are taken as they are.
        """
        solved = now = ""
        with suppress(FembridgeError, OSError, KeyError):  # also: no TOML
            solved = read_toml(run.folder / SOLVER_FILE, FembridgeError)["deck_sha256"]
            now = sha256_of(run.deck)
        if now and solved != now and self.source.path.resolve() == run.results.resolve():
            raise ResultError(
                f"results of another deck than the {run.deck.name} beside them; solve it: "
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
    log: Callable[[str], None] | None = None,
) -> Iterator[Result]:
    """The result file `path`, or that of the run folder `path`; options as for `read`.

    A folder without a ``run.toml`` has the result of the first format that is there.
    """
    run: RunFolder | None = None
    trouble = None
    if isinstance(path, RunFolder):
        run, path = path, path.results
    elif ((path := Path(path)) / RUN_FILE).exists():
        run = read_run_folder(path)
        path = run.results
    else:
        if path.is_dir():
            suffixes = [one.suffix for one in READERS if one.suffix not in STATUS]
            places = [path / f"{JOB}{suffix}" for suffix in suffixes]
            path = next((place for place in places if place.exists()), places[0])
        try:
            if (path.parent / RUN_FILE).exists():
                run = read_run_folder(path.parent)
        except ResultError as error:
            trouble = error
    if columns and stress_unit is None:
        from fembridge.results.columns import check_units

        check_units(columns)
    units: UnitSystem | RunFolder = LENGTH_UNITS.get(length_unit or "", MM)
    of_run: dict[str, Any] = {}
    if run is not None:  # its units were settled when its deck was built, heading and all
        for asked, held in ((stress_unit, run.stress_unit), (length_unit, run.length_unit)):
            if asked not in (None, held):
                raise UsageError(f"{path}: a run folder of fembridge is in {held}, always")
        units, of_run = run, {"branches": run.branches, "on_axis": run.on_axis}
        of_run["classes"] = {one.node: one.afferent for one in run.afferents}
    options = ReadOptions(
        partial=partial,
        across_materials=across_materials,
        stress_unit=stress_unit or units.stress_unit,
        length_unit=length_unit or units.length_unit,
        extrapolate=extrapolate,
        von_mises=von_mises,
        columns=dict(columns or {}),
        log=log,
        **of_run,
    )
    with open_source(path, options) as source:
        if run is None and length_unit is None and (stated := source.unit_system()) is not None:
            options.note(f"the heading names the unit system {stated}")
            source.options = replace(
                options,
                length_unit=stated.length_unit,
                stress_unit=stress_unit or stated.stress_unit,
            )
        yield Result(source, run, trouble)


def describe(path: Path | str) -> Table:
    """What a result file holds."""
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
    log: Callable[[str], None] | None = None,
) -> Traces:
    """Read stress traces, in Pa over ms, from a result file.

    With a ``run.toml`` of fembridge beside the file, time 0 is the start of the
    stimulus, and the traces begin with the rest sample. A trace has one time step;
    `read_history` gives any rows as they are, and other quantities.

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
        Unit of the file: "MPa" (N and mm), "kPa", "Pa" or "psi". None is the one in
        ``run.toml``, else that of the unit system that the file's heading names, else of
        `length_unit`, else MPa.
    length_unit
        That of its coordinates, "mm", "m" or "in". None is the heading's, else mm.
    resample_ms
        Make an even step of this many ms by PCHIP of the stress tensor, from the first
        sample on: of a file with uneven increments.
    extrapolate
        Of a Marc file: how stress is carried from integration points to nodes,
        "linear" (None too), "translate" or "average".
    von_mises
        Of a Marc file: "tensor" (None too) is the von Mises stress of the nodal
        tensor, "scalar" that of the points, carried to the node as a number.
    columns
        Of a CSV, NPZ, VTU, PVD or XDMF: what it holds under which name, such as
        ``{"time": "t", "value": "S_Mises"}``, see `fembridge.results.columns`. `nodes`
        None takes all of a CSV or NPZ.
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
    with open_result(
        path,
        partial=partial,
        across_materials=across_materials,
        stress_unit=stress_unit,
        length_unit=length_unit,
        extrapolate=extrapolate,
        von_mises=von_mises,
        columns=columns,
        log=log,
    ) as result:
        return result.traces(
            nodes,
            sets=() if node_set is None else (node_set,),
            near_mm=near_mm,
            deck=None if deck is None else Path(deck),
            resample_ms=resample_ms,
        )


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
    **options: Any,  # noqa: ANN401 - those of `read`
) -> "pandas.DataFrame":
    """A quantity at nodes as the file has it, whatever its rows are: a long table.

    One increment, uneven ones, several steps, modes: a row an output and node, units in the
    names of the columns (``time_ms``, ``sxx_pa``, ``d1_mm``; ``frequency_hz`` of modes).

    Parameters
    ----------
    path, node_set, near_mm, deck, resample_ms
        As for `read`.
    nodes
        Numbers of nodes, or "all".
    quantity
        "von-mises", "stress" (the tensor), "principal", "max-shear", "mean-stress",
        "displacement", "reaction-force", "strain", "temperature", or the file's name of any
        other. None takes von Mises stress, without stress in the file the displacement, else
        what comes first.
    modes
        The modes of frequency and buckling steps, of a file that has times, too.
    **options
        `partial`, `across_materials`, `stress_unit`, `length_unit`, `extrapolate`,
        `von_mises`, `columns` and `log` of `read`.

    Raises
    ------
    ResultError
        The file is absent, cut, foreign, or does not hold what was asked for.

    Examples
    --------
    >>> import fembridge as fb
    >>> list(fb.read_history("runs/sine_20_250", quantity="displacement"))[:4]
    ['time_ms', 'afferent', 'node', 'step']
    """
    if isinstance(nodes, str) and nodes != "all":
        raise UsageError(f"nodes {nodes!r}, expected numbers or 'all'")
    with open_result(path, **options) as result:
        found = result.history(
            None if isinstance(nodes, str) else nodes,
            quantity=quantity,
            every=isinstance(nodes, str),
            modes=modes,
            resample_ms=resample_ms,
            sets=() if node_set is None else (node_set,),
            near_mm=near_mm,
            deck=None if deck is None else Path(deck),
        )
        return found.to_frame()


def read_fields(
    path: Path | str,
    quantity: str = "STRESS",
    **options: Any,  # noqa: ANN401 - those of `read`
) -> Iterator[Field]:
    """One quantity, an increment at a time, in file order.

    Stress comes in Pa; CalculiX's nodal stress is, at the boundary of two materials, a
    mean over both: `fembridge ingest --one-sided` gives each side's.

    Parameters
    ----------
    path
        A ``.frd``, ``.t16`` or ``.t19`` file, or a run folder.
    quantity
        Its name in the file, case-blind, or a beginning that is one quantity's alone: "STRESS",
        "DISP", "TOSTRAIN", "FORC", ...; of a Marc file "Displacement", "Stress", ...
    **options
        `partial`, `stress_unit`, `length_unit` and `log` of `read`; of a Marc file also
        `across_materials` and `extrapolate`.

    Raises
    ------
    ResultError
        At once: the file is absent, foreign, cut, or has no such quantity. While
        it is read: a record or a number is none, or is not finite.

    Examples
    --------
    >>> import fembridge as fb
    >>> field = next(fb.read_fields("runs/sine_20_250", "DISP"))
    >>> field.time_ms, field.components, field.units
    (0.5, ('D1', 'D2', 'D3'), ('mm', 'mm', 'mm'))
    """
    with ExitStack() as stack:
        result = stack.enter_context(open_result(path, **options))
        return _closing(result.source.fields(quantity), stack.pop_all())


def _closing(fields: Iterator[Field], stack: ExitStack) -> Iterator[Field]:
    with stack:
        yield from fields
