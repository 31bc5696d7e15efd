"""The response of a user's deck: one load and unload, then every stimulus.

`map_deck` writes the deck of that run, `map_response` also solves it, or reads the results that a
user of Marc or Abaqus brings, and accepts or refuses them. A `DeckResponse` is the result; its
folder is what `fembridge.simulate`, `sweep`, `fit` and `threshold` read.

    map/response.toml   the response map
    map/run/            the run folder: deck, waveform, results

A command reads the signatures for its options: a function imports what it needs when it is called.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fembridge.errors import (
    DeckError,
    MissingError,
    ResponseError,
    ResultError,
    UsageError,
    check_type,
)
from fembridge.plots.shown import Shown
from fembridge.solver.settings import DEFAULTS, Solver

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from decks.own_model import Rebased, Request
    from fembridge.io.run_folder import RunFolder
    from fembridge.response.response_map import ResponseMap
    from fembridge.solver.afferents import Afferents
    from fembridge.solver.build import BaseDeck
    from fembridge.stimulus import Stimulus
    from fembridge.typing import FloatArray

RUN_FOLDER = "run"
PICTURE_FILE = "response.png"
TABLE_FILE = "response.csv"
REASONS_FILE = "no_map.txt"
# Of a table that `fembridge export-script` writes inside Mentat or Abaqus.
_TABLE_COLUMNS = {"time_ms": "time_ms", "value": "von_mises_pa"}
_DEFAULT_DEPTH_UM = 400.0
_DEFAULT_STEPS = 30


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class DeckResponse(Shown):
    """Stress at the afferents of a user's deck against depth, the result of `map_response`.

    Parameters
    ----------
    response
        The response map.

    Examples
    --------
    >>> import fembridge as fb
    >>> mine = fb.map_response("mine.inp", afferents={"SA": 461})  # doctest: +SKIP
    >>> mine.response.closure_percent < 0.5  # doctest: +SKIP
    True
    """

    response: ResponseMap

    def _lines(self) -> list[str]:
        response = self.response
        deck = response.origin.get("base_deck", {}).get("file", "a deck")
        quantity, low, high, unit = self._range()
        return [
            f"DeckResponse of {deck}: {response.classes_text()}",
            f"  {quantity} {low:g} to {high:g} {unit}, {response.depth_um.size} levels, unloading "
            f"within {response.closure_percent:.2g} %",
            "  .table, .traces(stimulus), .plot(), .write(folder); fb.simulate(..., response=...)",
        ]

    def _range(self) -> tuple[str, float, float, str]:
        """Driven quantity, its smallest and largest value, and its unit."""
        response, load = self.response, self.response.load
        low, high = float(response.depth_um[0]), response.deepest_um
        if load is None:
            return "depth", low, high, "um"
        return load.quantity, low * load.per_um, high * load.per_um, load.unit

    @property
    def provenance(self) -> dict[str, object]:
        """Deck with checksum and changes, run, solver, closure and afferents."""
        response = self.response
        return {
            **response.origin,
            "closure_percent": response.closure_percent,
            "lifts_off": response.lifts_off,
            "afferents": {site.key: site.node for site in response.places},
        }

    @property
    def peaks_pa(self) -> FloatArray:
        """Largest von Mises stress at each afferent in Pa, ``(afferent,)``."""
        from fembridge.results.von_mises import von_mises_pa

        peaks_pa: FloatArray = von_mises_pa(self.response.tensor_pa).max(axis=0)
        return peaks_pa

    @property
    def table(self) -> pandas.DataFrame:
        """Von Mises stress: ``afferent, unit, node, depth_um, von_mises_pa``, a row a depth.

        Of a force or pressure ``force_n`` or ``pressure_mpa`` follows ``depth_um``.
        """
        import numpy as np
        import pandas as pd

        from fembridge.results.von_mises import von_mises_pa

        response = self.response
        levels, count = response.depth_um.size, len(response.places)
        columns: dict[str, Any] = {
            name: np.repeat([getattr(site, name) for site in response.places], levels)
            for name in ("afferent", "unit", "node")
        }
        columns["depth_um"] = np.tile(response.depth_um, count)
        if (load := response.load) is not None:
            name = f"{load.quantity}_{load.unit.lower()}"
            columns[name] = load.per_um * columns["depth_um"]
        columns["von_mises_pa"] = von_mises_pa(response.tensor_pa).T.ravel()
        return pd.DataFrame(columns)

    def traces(self, stimulus: Stimulus) -> list[Any]:
        """Stress traces of a stimulus, one an afferent: see `fembridge.ResponseMap.traces`.

        Parameters
        ----------
        stimulus
            Depth of the probe in um against time in ms.

        Raises
        ------
        ResponseError
            The stimulus goes beyond the map.
        """
        return self.response.traces(stimulus)

    def plot(self, kind: str | None = None, ax: Any = None) -> Figure:  # noqa: ANN401 - axes
        """Picture of the stress at each afferent against depth, force or pressure.

        Parameters
        ----------
        kind
            ``response``, the only kind. Default: ``response``.
        ax
            Axes to draw into, one per panel. Default: a new figure.

        Raises
        ------
        UsageError
            Another kind, or another number of axes.
        """
        from fembridge.plots.response import response_figure

        if kind not in (None, "response"):
            raise UsageError(argument="kind", found=kind, expected="response")
        panels: list[Axes] | None = ax
        return response_figure(self.response, panels)

    def write(self, folder: str | os.PathLike[str], *, plot: bool = False) -> None:
        """Write ``response.toml`` and ``response.csv``, without the run.

        Parameters
        ----------
        folder
            Folder of the files, which is made.
        plot
            Whether to draw ``response.png``. Default: False.

        Raises
        ------
        OutputError
            The folder cannot be written.
        """
        from fembridge.host.store import filling
        from fembridge.io.text_table import write_table
        from fembridge.response.response_map import MAP_FILE, write_map

        with filling(Path(folder), last=MAP_FILE) as draft:
            table = self.table
            rows = zip(*(table[name].tolist() for name in table), strict=True)
            write_table(draft / TABLE_FILE, [*map(str, table)], rows)
            if plot:
                from fembridge.plots.style import save_figure

                save_figure(self.plot(), draft / PICTURE_FILE)
            write_map(draft / MAP_FILE, self.response)

    @classmethod
    def read(cls, folder: str | os.PathLike[str]) -> DeckResponse:
        """The response that `write` or ``fembridge map`` wrote.

        Parameters
        ----------
        folder
            Folder with ``response.toml``, or that file.

        Raises
        ------
        ResponseError
            No such file, or not a response map.
        """
        from fembridge.response.response_map import read_map

        return cls(read_map(Path(folder)))


@dataclass(frozen=True, slots=True)
class MapOptions:
    """Afferents, range and drive of a map: the options of `map_deck`, which describes them."""

    afferents: Afferents | None = None
    depth_um: float = _DEFAULT_DEPTH_UM
    retract_um: float | None = None
    steps: int = _DEFAULT_STEPS
    amplitude: str | None = None
    move: str | None = None
    step: str | None = None
    target: str | None = None
    length_unit: str | None = None
    increments: str = "fixed"
    shell_face: str | None = None
    newton_per_um: float | None = None
    mpa_per_um: float | None = None


def map_deck(
    base_deck: str | os.PathLike[str],
    output: str | os.PathLike[str] = "map",
    *,
    afferents: Afferents | None = None,
    depth_um: float = _DEFAULT_DEPTH_UM,
    retract_um: float | None = None,
    steps: int = _DEFAULT_STEPS,
    amplitude: str | None = None,
    move: str | None = None,
    step: str | None = None,
    target: str | None = None,
    length_unit: str | None = None,
    increments: str = "fixed",
    shell_face: str | None = None,
    newton_per_um: float | None = None,
    mpa_per_um: float | None = None,
) -> RunFolder:
    """Run folder of one load and unload of a deck of yours; `map_response` reads its results.

    The driven displacement goes from the position of the deck to `depth_um`, back, to
    `retract_um` on the other side, and back. Requests of results of your own stay in the deck.

    Parameters
    ----------
    base_deck
        Path of a .inp of CalculiX or Abaqus, or of a .dat of Marc.
    output
        Folder of the map; the run folder is ``run`` in it. Default: ``"map"``.
    afferents
        Nodes of each afferent class, as in `fembridge.rebase_deck`. Default: None, which is
        refused.
    depth_um
        Largest depth in um that a stimulus of the map may have. Default: 400.
    retract_um
        Distance in um that a stimulus may go up from the position of the deck; 0: not at all.
        Default: None, `depth_um`.
    steps
        Loading steps, 6 to 400. Default: 30, which are about 75 increments.
    amplitude, move, step, length_unit, increments, shell_face
        What the waveform moves, in which step, and how, as in `fembridge.rebase_deck`.
        Default: None, as the deck shows.
    target
        ``"calculix"`` or ``"abaqus"`` for a .inp without an unambiguous card. Default: None, as
        the deck shows.
    newton_per_um, mpa_per_um
        Force in N or pressure in MPa of each um, as in `fembridge.rebase_deck`, of a deck that a
        load drives: `depth_um` and `retract_um` times this scale are its range. Default: None, a
        displacement.

    Returns
    -------
    RunFolder
        ``folder``, ``solver``, increments and afferents of the run.

    Raises
    ------
    UsageError
        No afferents, or an argument out of range.
    ResponseError
        Stress in the deck depends on time: no map is possible.
    DeckError, OutputError
        The deck lacks a part or leaves it open, with its line; a folder cannot be written.

    Examples
    --------
    >>> import fembridge as fb
    >>> run = fb.map_deck("mine.dat", afferents={"SA": [461, 480]})  # doctest: +SKIP
    """
    options = MapOptions(
        afferents=afferents,
        depth_um=depth_um,
        retract_um=retract_um,
        steps=steps,
        amplitude=amplitude,
        move=move,
        step=step,
        target=target,
        length_unit=length_unit,
        increments=increments,
        shell_face=shell_face,
        newton_per_um=newton_per_um,
        mpa_per_um=mpa_per_um,
    )
    return write_map_run(base_deck, output, options)


def write_map_run(
    base_deck: str | os.PathLike[str], output: str | os.PathLike[str], options: MapOptions
) -> RunFolder:
    """Run folder of `map_deck`."""
    from fembridge.solver.build import build_own_folder
    from fembridge.solver.deck import report_rebased

    plan = plan_map(base_deck, options)
    folder = Path(output) / RUN_FOLDER
    run, rebased = build_own_folder(folder, plan.base, plan.stimulus, plan.request)
    report_rebased(plan.base, plan.request, run, rebased)
    return run


@dataclass(frozen=True, slots=True, eq=False)
class MapPlan:
    """A deck, the waveform of its load-unload run, the request, and the deck of that run."""

    base: BaseDeck
    stimulus: Stimulus
    request: Request
    rebased: Rebased

    @property
    def sha256(self) -> str:
        """Checksum of the deck of the run."""
        from hashlib import sha256

        return sha256(self.rebased.deck).hexdigest()

    @property
    def units(self) -> tuple[tuple[str, str], ...]:
        """Class and unit of each afferent."""
        from fembridge.trace import split_afferent_key

        return tuple(map(split_afferent_key, self.request.afferents))


def plan_map(base_deck: str | os.PathLike[str], options: MapOptions) -> MapPlan:
    """What `map_deck` writes; errors are those of `map_deck`."""
    from decks.own_model import Request
    from fembridge.response.deck_map import TRANSIENT, load_unload
    from fembridge.solver.afferents import afferent_nodes
    from fembridge.solver.build import read_base_deck, rebased_deck
    from fembridge.solver.loads import load_scale

    stimulus = load_unload(options.depth_um, options.retract_um, options.steps)
    base: BaseDeck = read_base_deck(Path(base_deck), options.target)
    nodes = afferent_nodes(options.afferents, base)
    if not nodes:
        expected = "nodes of one class or more: SA=461 (--afferent, --afferents)"
        raise UsageError(argument="afferents", found=options.afferents, expected=expected)
    request = Request(
        options.amplitude,
        options.step,
        nodes,
        options.length_unit,
        None,
        options.move,
        options.increments,
        shell_face=options.shell_face,
        keeps_output=True,
        load=load_scale(options.newton_per_um, options.mpa_per_um),
    )
    try:
        rebased = rebased_deck(base, stimulus, request)
    except DeckError as error:
        raise DeckError.from_error(error, base.path) from error
    if rebased.time_dependent:
        reasons = "; ".join(rebased.time_dependent)
        raise ResponseError(
            f"no map: stress depends on time as well as on depth ({reasons}); {TRANSIENT}",
            base.path,
            found=rebased.time_dependent[0],
        )
    return MapPlan(base, stimulus, request, rebased)


def map_response(
    base_deck: str | os.PathLike[str] | RunFolder,
    output: str | os.PathLike[str] = "map",
    *,
    results: str | os.PathLike[str] | None = None,
    afferents: Afferents | None = None,
    depth_um: float = _DEFAULT_DEPTH_UM,
    retract_um: float | None = None,
    steps: int = _DEFAULT_STEPS,
    amplitude: str | None = None,
    move: str | None = None,
    step: str | None = None,
    target: str | None = None,
    length_unit: str | None = None,
    increments: str = "fixed",
    shell_face: str | None = None,
    newton_per_um: float | None = None,
    mpa_per_um: float | None = None,
    solver: Solver = DEFAULTS,
) -> DeckResponse:
    """Stress of a deck of yours against depth: one load and unload, then every stimulus.

    With CalculiX the run of `map_deck` is solved. Of Marc and Abaqus bring its results:
    ``fb.map_response("map", results="job.t16")``. The map is accepted if unloading returns to the
    loading curve within 0.5 % at every afferent.

    Parameters
    ----------
    base_deck
        Path of a deck; or the folder or the `RunFolder` of `map_deck`, whose results are read.
    output
        Folder of the map, see `DeckResponse.write`; of a folder of `map_deck` that folder.
        Default: ``"map"``.
    results
        Result file of the run, of any format that `fembridge.read` reads; of a table the columns
        are ``time_ms, node, von_mises_pa``, as ``fembridge export-script`` writes them. Default:
        None, that in the run folder.
    afferents, depth_um, retract_um, steps
        Afferents, and range of the map in um, as in `map_deck`. Default: None, 400, None and 30.
    amplitude, move, step, target, length_unit, increments, shell_face
        What the waveform moves, as in `map_deck`. Default: None, as the deck shows.
    newton_per_um, mpa_per_um
        Force in N or pressure in MPa of each um, as in `map_deck`. Default: None, a displacement.
    solver
        Threads, limits, cache and progress. Default: ``Solver()``.

    Returns
    -------
    DeckResponse
        ``table``, ``traces(stimulus)``, ``plot()``, ``write(folder)``; `simulate`, `sweep`, `fit`
        and `threshold` take it, or its folder, as ``response``.

    Raises
    ------
    UsageError, DeckError
        As `map_deck`.
    ResponseError
        No map is possible: stress depends on time or on the path, or an afferent has none. The
        message names the reason; the way is then `rebase_deck` and `run`.
    SolverError
        The solver failed.
    MissingError
        The deck is written, and its solver is not here.
    ResultError
        The results are not those of the run.

    Examples
    --------
    >>> import fembridge as fb
    >>> mine = fb.map_response("mine.inp", afferents={"SA": [461, 480]})  # doctest: +SKIP
    >>> fb.simulate("noise_25_250", response=mine).rates  # doctest: +SKIP
    """
    from fembridge.io.run_folder import RUN_FILE, RunFolder, read_run_folder

    check_type("solver", solver, Solver)
    options = MapOptions(
        afferents=afferents,
        depth_um=depth_um,
        retract_um=retract_um,
        steps=steps,
        amplitude=amplitude,
        move=move,
        step=step,
        target=target,
        length_unit=length_unit,
        increments=increments,
        shell_face=shell_face,
        newton_per_um=newton_per_um,
        mpa_per_um=mpa_per_um,
    )
    is_run = isinstance(base_deck, RunFolder)
    if not is_run and not Path(base_deck).is_dir():  # type: ignore[arg-type] # a path
        if results is not None:
            raise UsageError("is for the folder of an earlier map_deck", argument="results")
        run = write_map_run(base_deck, output, options)  # type: ignore[arg-type] # a path
        return finish_map(run, Path(output), None, solver)
    for option in fields(MapOptions):
        value = getattr(options, option.name)
        is_plain = value is None or isinstance(value, str | int | float)
        if not is_plain or value != option.default:
            raise UsageError("is for a deck; the run in this folder has it", argument=option.name)
    if isinstance(base_deck, RunFolder):
        return finish_map(base_deck, base_deck.folder.parent, results, solver)
    folder = Path(base_deck)
    if (folder / RUN_FILE).is_file():
        return finish_map(read_run_folder(folder), folder.parent, results, solver)
    return finish_map(read_run_folder(folder / RUN_FOLDER), folder, results, solver)


def finish_map(
    run: RunFolder,
    output: Path,
    results: str | os.PathLike[str] | None = None,
    solver: Solver = DEFAULTS,
) -> DeckResponse:
    """Solve `run` if it is CalculiX's, read its results or `results`, and write the map."""
    from decks.own_model import LoadScale
    from fembridge.host.store import remove_file, write_text
    from fembridge.response.deck_map import deck_response, load_unload_of
    from fembridge.response.indentation import CONTACT_CAUSES
    from fembridge.response.response_map import MAP_FILE
    from fembridge.results.result import open_result
    from fembridge.solver.ccx import solve_once

    stimulus = load_unload_of(run)
    remove_file(output / MAP_FILE)  # possibly of another run
    if results is None and not (run.solver != "calculix" and run.results.is_file()):
        if (how := how_to_solve(run)) is not None:
            raise MissingError(
                f"no results in {run.folder}: {how}, then name its result file (--results)",
                found=run.solver,
            )
        outcome = solve_once(run, solver.shared_by(1))
        if outcome.failure is not None:
            error = outcome.to_error()
            if outcome.failure.cause in CONTACT_CAUSES:
                error.problem += "; a map with a smaller --depth-um or --retract-um may do"
                error.args = (error.problem, *error.args[1:])
            raise error
    elif results is not None and not Path(results).is_file():
        raise ResultError("no such file", Path(results))
    base: Any = run.inputs.get("base_deck", {})
    load = base.get("load")
    path = run if results is None else Path(results)
    columns = _TABLE_COLUMNS if isinstance(path, Path) and path.suffix.lower() == ".csv" else None
    try:
        with open_result(path, of_run=run, columns=columns) as result:
            response = deck_response(
                result,
                stimulus,
                load=None if load is None else LoadScale(**load),
                path_dependent=base.get("path_dependent", ()),
            )
    except ResponseError as error:
        write_text(output / REASONS_FILE, f"{error}\n")
        raise
    remove_file(output / REASONS_FILE)
    mapped = DeckResponse(response)
    mapped.write(output)
    return mapped


_OWN_COMMANDS = {"marc": "run_marc -jid job", "abaqus": "abaqus job=job"}


def how_to_solve(run: RunFolder) -> str | None:
    """How the user runs the deck of `run`, if fembridge does not; else None."""
    from fembridge.solver.ccx import load_solver

    try:
        load_solver(run.solver)
    except MissingError:
        command = _OWN_COMMANDS.get(run.solver, run.solver)
        return f"run {run.deck.name} with your solver in {run.folder} ({command})"
    return None
