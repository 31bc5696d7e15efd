"""A run folder: one deck, the waveform it prescribes, and what was built from what.

``job.inp``       the deck; ccx is called with ``-i job`` (``job.dat`` for Marc)
``stimulus.csv``  ``time_ms,displacement_um``: the waveform, sample by sample; where
                  the probe slides, ``aside_um`` as well
``run.toml``      this value: which node is which afferent, times, inputs

After a run the solver's own files (``job.frd``, ``job.dat``, ``job.sta``,
``job.cvg``) and ``solver.log`` are beside them.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from decks.dialects import dialect_of
from fembridge.errors import ResultError, TableError
from fembridge.host.store import read_toml, structure, write_toml
from fembridge.io import RUN_FILE as RUN_FILE
from fembridge.trace import (
    AFFERENT_NAME,
    Origin,
    afferent_key,
    finger_id,
    mean_step,
    split_afferent_key,
)
from fembridge.typing import FloatArray, Table

FORMAT = 1
STIMULUS_FILE = "stimulus.csv"
SOLVER_FILE = "solver.toml"
COLUMNS = ["time_ms", "displacement_um", "aside_um"]

# Sections of the inputs.
_TABLES = ("base_deck", "contact", "finger", "parameters", "probe", "stimulus")
_MOST_WHOLE = 2**63 - 1  # as TOML has it
_MAX_SHOWN = 6  # afferents in a line
_MAX_BYTES, _MAX_KEYS = 20_000_000, 200_000  # of a run.toml with thousands of afferents


@dataclass(frozen=True, slots=True)
class AfferentNode:
    """Where one afferent sits: a solver's node inside one layer of the finger.

    In someone's own model layer and depth are unknown: "" and None; a solid one has z.
    `start_stress_pa` is its stress at time 0, xx yy zz xy yz zx, where the deck states one. On
    the bottom or top of a shell its stress is at another node of the results: the one of
    `corner` (from 0) of `element` there. `unit` names the afferent where its class has several.
    """

    afferent: str
    node: int
    layer: str
    x_mm: float
    y_mm: float
    depth_mm: float | None = None
    z_mm: float | None = None
    start_stress_pa: tuple[float, ...] = ()
    element: int = 0
    corner: int = 0
    unit: str = ""

    @property
    def key(self) -> str:
        """Class, and unit where the class has several: the name of its section of TOML."""
        return afferent_key(self.afferent, self.unit)

    def to_table(self) -> Table:
        """Section of TOML, without class and unit, which are its name."""
        table = asdict(self)
        del table["afferent"], table["unit"]
        if not self.element:
            del table["element"], table["corner"]
        return {key: value for key, value in table.items() if value not in (None, ())}


@dataclass(frozen=True, slots=True)
class RunFolder:
    """One run: its folder, solver, time axis and afferents, as ``run.toml`` has them.

    The stimulus begins at `start_ms` of the solver's clock, after a ramp to the pre-indentation
    or after a user's own steps; the run ends at `end_ms`.

    Parameters
    ----------
    folder
        Path of the folder.
    solver
        Name of the solver: ``"calculix"``, ``"marc"`` or ``"abaqus"``.
    increments
        Number of fixed increments of `dt_ms`, those of the ramp included.
    dt_ms
        Time step of the results in ms.
    start_ms
        Time in ms on the solver's clock at which the stimulus begins.
    afferents
        Node and position of each afferent.
    deck_sha256
        Checksum of the deck.
    apex_node
        Node of the skin under the probe, whose displacement shows that the probe pushed.
        Default: 0, unknown.
    inputs
        Stimulus, finger, probe, contact and parameters from which the deck was made.
        Default: empty.
    before_ms
        Duration in ms of the steps before the fixed increments: those of an own deck,
        or the way to the pre-indentation where stress depends on time. Default: 0.
    stress_unit
        Unit of stress in the results. Default: ``"MPa"``.
    branches
        Number of stress terms by node where skin relaxes; the solver writes their mean.
        Default: none.
    solver_increments
        Number of all increments, where it differs from `increments`. Default: 0, the same.
    on_axis
        Nodes on the axis of a half section, where shear is 0. Default: none.
    length_unit
        Unit of length in the results. Default: ``"mm"``.
    at_rest
        Whether the model is free of stress at time 0, or an output has its state there.
        Default: True.
    """

    folder: Path
    solver: str
    increments: int
    dt_ms: float
    start_ms: float
    afferents: tuple[AfferentNode, ...]
    deck_sha256: str
    apex_node: int = 0
    inputs: Mapping[str, Any] = field(default_factory=dict)
    before_ms: float = 0.0
    stress_unit: str = "MPa"
    branches: Mapping[int, int] = field(default_factory=dict)
    solver_increments: int = 0
    on_axis: tuple[int, ...] = ()
    length_unit: str = "mm"
    at_rest: bool = True

    def __repr__(self) -> str:
        classes = "".join(f", {site.key} {site.node}" for site in self.afferents[:_MAX_SHOWN])
        if len(self.afferents) > _MAX_SHOWN:
            classes += f" and {len(self.afferents) - _MAX_SHOWN} more"
        return (
            f"RunFolder({str(self.folder)!r}, {self.solver}, {self.increments} increments every "
            f"{self.dt_ms:g} ms{classes})"
        )

    @property
    def increments_in_all(self) -> int:
        """Number of increments of the solver, as far as it is known."""
        return self.solver_increments or self.increments

    @property
    def end_ms(self) -> float:
        """Solver time at the end of the run, in ms."""
        return self.before_ms + self.increments * self.dt_ms

    @property
    def deck(self) -> Path:
        """The deck's path."""
        return self.folder / dialect_of(self.solver).deck

    @property
    def results(self) -> Path:
        """The path of the result file that the solver writes.

        Of several kinds the first that is there; the first of all if none is.
        """
        names = dialect_of(self.solver).results
        paths = [self.folder / name for name in names]
        return next((path for path in paths if path.exists()), paths[0])

    def origin(self) -> Origin | None:
        """What its traces are to be encoded by; None where it names no stimulus.

        Raises
        ------
        ResultError
            Its inputs are not as fembridge writes them.
        """
        path = self.folder / RUN_FILE
        stimulus, finger = self.inputs.get("stimulus"), self.inputs.get("finger")
        if not isinstance(stimulus, Mapping) or "id" not in stimulus:
            return None
        settings = {key: stimulus[key] for key in ("window_ms", "preindent_um") if key in stimulus}
        if isinstance(base := self.inputs.get("base_deck"), Mapping):
            stands_um = base.get("stands_um", 0.0)  # where the deck's own steps leave the probe
            depth_um = settings.get("preindent_um", 0.0)
            for key, value in (("base_deck.stands_um", stands_um), ("preindent_um", depth_um)):
                if isinstance(value, bool) or not isinstance(value, int | float):
                    key = f"inputs.{key}"
                    raise ResultError(path=path, key=key, found=value, expected="a number")
            if stands_um:
                settings["preindent_um"] = round(depth_um + stands_um, 6)
            finger_identity = {"name": base.get("file", ""), "sha256": base.get("sha256", "")}
        else:
            finger_identity = finger_id(finger) if isinstance(finger, Mapping) else {}
        table = {
            "stimulus": stimulus["id"],
            **settings,
            "parameters": self.inputs.get("parameters", {}),
            "finger": finger_identity,
        }
        return structure(table, Origin, ResultError.at(path), "inputs")

    def write(self) -> None:
        """Write ``run.toml``; defaults are left out."""
        non_default = {
            item.name: value
            for item in fields(self)
            if (value := getattr(self, item.name)) != item.default
        }
        table: Table = {
            "format": FORMAT,
            "solver": self.solver,
            "deck_sha256": self.deck_sha256,
            "time": {
                item.name: non_default[item.name]
                for item in fields(_Time)
                if item.name in non_default
            },
            "apex_node": self.apex_node,
            **{
                name: non_default[name]
                for name in ("on_axis", "stress_unit", "length_unit", "at_rest")
                if name in non_default
            },
            "afferents": {site.key: site.to_table() for site in self.afferents},
            "branches": {str(node): count for node, count in self.branches.items()},
            "inputs": dict(self.inputs),
        }
        if not self.branches:
            del table["branches"]
        write_toml(self.folder / RUN_FILE, table)


@dataclass(frozen=True, slots=True)
class _Time:
    increments: int
    dt_ms: float
    start_ms: float
    before_ms: float = 0.0
    solver_increments: int = 0


@dataclass(frozen=True, slots=True)
class _RunFile:
    """``run.toml`` as it stands; `inputs` is the last section, a cut file has none."""

    solver: str
    deck_sha256: str
    time: _Time
    afferents: dict[str, AfferentNode]
    inputs: dict[str, Any]
    apex_node: int = 0
    stress_unit: str = "MPa"
    branches: dict[str, int] = field(default_factory=dict)
    on_axis: tuple[int, ...] = ()
    length_unit: str = "mm"
    at_rest: bool = True


def check_run_folder(folder: Path) -> None:
    """Refuse a folder without ``run.toml``; a ResultError."""
    if not (folder / RUN_FILE).exists():
        raise ResultError("no run.toml: not a run folder of fembridge", folder)


def read_run_folder(folder: Path) -> RunFolder:
    """Read the ``run.toml`` of `folder`.

    Raises
    ------
    ResultError
        There is none, or it is not one that fembridge wrote.
    """
    path = folder / RUN_FILE
    failed = ResultError.at(path)
    check_run_folder(folder)
    table = read_toml(path, failed, _MAX_BYTES, _MAX_KEYS)
    if (file_format := table.pop("format", None)) != FORMAT:
        problem = f"is {file_format!r}, expected {FORMAT}; build the deck again with this version"
        raise failed(problem, key="format", found=file_format, expected=str(FORMAT))
    sections = table.get("afferents")
    if isinstance(sections, dict):  # a section is named after its afferent
        for key, section in sections.items():
            if isinstance(section, dict):
                afferent, unit = split_afferent_key(key)
                sections[key] = {"afferent": afferent, "unit": unit, **section}
    file = structure(table, _RunFile, failed)
    time = file.time
    for name in file.afferents:
        if not AFFERENT_NAME.fullmatch(split_afferent_key(name)[0]):
            key = f"afferents.{name[:60]}"
            raise failed("is not the name of a class such as SA", key=key)
    for node in file.branches:
        if not node.isdecimal():
            raise failed("is not the number of a node", key=f"branches.{node}")
    values = {item.name: getattr(file, item.name) for item in fields(file) if item.name != "time"}
    values |= {
        "afferents": tuple(file.afferents.values()),
        "branches": {int(node): count for node, count in file.branches.items()},
    }
    run = RunFolder(folder, **values, **asdict(time))
    for name, value, least in (
        ("time.increments", time.increments, 1),
        ("time.solver_increments", time.solver_increments, 0),
        ("time.before_ms", time.before_ms, 0),
        ("time.start_ms", time.start_ms, time.before_ms),
        ("apex_node", run.apex_node, 0),
        *((f"afferents.{site.key}.node", site.node, 1) for site in run.afferents),
        *((f"afferents.{site.key}.corner", site.corner, 0) for site in run.afferents),
    ):
        if not value >= least:
            raise failed(key=name, found=value, expected=f"{least:g} or more")
    if not (math.isfinite(time.dt_ms) and time.dt_ms > 0):
        raise failed(key="time.dt_ms", found=time.dt_ms, expected="more than 0")
    if time.start_ms > run.end_ms:
        expected = f"before the end at {run.end_ms:g} ms"
        raise failed(key="time.start_ms", found=time.start_ms, expected=expected)
    for key, content in _values_in(table):
        if isinstance(content, float) and not math.isfinite(content):
            raise failed(key=key, found=content, expected="a finite number")
        if isinstance(content, int) and abs(content) > _MOST_WHOLE:
            raise failed("is larger than a whole number of 64 bits", key=key, found=content)
        if not isinstance(content, bool | int | float | str):
            raise failed(key=key, found=str(content), expected="a number or a word")
    for name in _TABLES:
        if not isinstance(run.inputs.get(name, {}), Mapping):
            content = run.inputs[name]
            raise failed(key=f"inputs.{name}", found=content, expected="a table")
    return run


def _values_in(value: object, key: str = "") -> Iterator[tuple[str, object]]:
    """Values of nested tables and lists, each with its key, as ``inputs.probe.x_mm``."""
    if isinstance(value, Mapping):
        for name, item in value.items():
            yield from _values_in(item, f"{key}.{name}" if key else str(name))
    elif isinstance(value, list):
        for item in value:
            yield from _values_in(item, key)
    else:
        yield key, value


def read_waveform(folder: Path) -> tuple[FloatArray, FloatArray]:
    """Read ``stimulus.csv``: times ``(T,)`` in ms and displacement ``(T,)`` in um.

    Raises
    ------
    ResultError
        There is none, a row is not two finite numbers, or times are not even.
    """
    from fembridge.io.text_table import read_table

    path = folder / STIMULUS_FILE
    try:
        table = read_table(path, COLUMNS[:2], COLUMNS[2:])
        times_ms, depth_um = (table.numbers(name) for name in COLUMNS[:2])
    except TableError as error:
        raise ResultError.from_error(error) from error
    if table.size < 2:
        raise ResultError(f"{table.size} samples, expected two or more", path)
    with np.errstate(over="ignore", invalid="ignore"):  # of 1e308
        _, odd = mean_step(times_ms)
    if odd is not None:
        before_ms, after_ms = times_ms[odd : odd + 2]
        problem = f"time goes from {before_ms:g} to {after_ms:g} ms, expected an even step"
        raise ResultError(problem, path, int(table.lines[odd + 1]))
    return times_ms, depth_um
