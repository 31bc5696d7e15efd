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
from fembridge.store import read_toml, structure, write_toml
from fembridge.trace import AFFERENT_NAME, Origin, finger_id, mean_step
from fembridge.typing import FloatArray, Table

FORMAT = 1
RUN_FILE = "run.toml"
STIMULUS_FILE = "stimulus.csv"
SOLVER_FILE = "solver.toml"
COLUMNS = ["time_ms", "displacement_um", "aside_um"]

# Sections of the inputs.
_TABLES = ("base_deck", "contact", "finger", "parameters", "probe", "stimulus")
_MOST_WHOLE = 2**63 - 1  # as TOML has it


@dataclass(frozen=True, slots=True)
class AfferentNode:
    """Where one afferent sits: a solver's node inside one layer of the finger.

    In someone's own model layer and depth are unknown: "" and None; a solid one has z.
    """

    afferent: str
    node: int
    layer: str
    x_mm: float
    y_mm: float
    depth_mm: float | None = None
    z_mm: float | None = None

    def to_table(self) -> Table:
        """Section of TOML, without the afferent's name."""
        table = asdict(self)
        del table["afferent"]
        return {key: value for key, value in table.items() if value is not None}


@dataclass(frozen=True, slots=True)
class RunFolder:
    """One run: `folder`, its `solver`, its time axis and its afferents.

    The solver's clock starts `start_ms` before the stimulus does (a ramp to a
    pre-indentation takes place there) and ends at `end_ms` of solver time after
    `increments` fixed increments of `dt_ms`. Steps of other increments, `before_ms` of
    them, may precede all that: of someone's own model, or, where stress depends on
    time, the way to the pre-indentation. Stress and length may be in another unit there.
    `solver_increments` is how many the solver makes in all, where that is another
    number: there are more than one to a sample, or steps before. 0: the same.
    Where skin relaxes, `branches` is by node how many branches its stress is the
    sum of, whose mean the solver writes. Of a half of the section `on_axis` are the
    nodes on its axis, where shear is 0, whatever the solver writes of one half.
    `apex_node` is the skin's node under the probe: its displacement shows that the
    probe pushed (0 where unknown).
    `inputs` is what the deck was made from: for people, and for the origin of a
    response map.
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

    @property
    def increments_in_all(self) -> int:
        """How many increments the solver makes, as far as is known."""
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
        chosen = {key: stimulus[key] for key in ("window_ms", "preindent_um") if key in stimulus}
        if isinstance(base := self.inputs.get("base_deck"), Mapping):
            stands_um = base.get("stands_um", 0.0)  # where the deck's own steps leave the probe
            depth_um = chosen.get("preindent_um", 0.0)
            for key, value in (("base_deck.stands_um", stands_um), ("preindent_um", depth_um)):
                if isinstance(value, bool) or not isinstance(value, int | float):
                    raise ResultError(f"inputs: {key} is {value!r}, expected a number", path)
            if stands_um:
                chosen["preindent_um"] = round(depth_um + stands_um, 6)
            known = {"name": base.get("file", ""), "sha256": base.get("sha256", "")}
        else:
            known = finger_id(finger) if isinstance(finger, Mapping) else {}
        table = {
            "stimulus": stimulus["id"],
            **chosen,
            "parameters": self.inputs.get("parameters", {}),
            "finger": known,
        }
        return structure(table, Origin, lambda words: ResultError(f"inputs: {words}", path))

    def write(self) -> None:
        """Write ``run.toml``; what is as usual is left out."""
        odd = {
            one.name: value
            for one in fields(self)
            if (value := getattr(self, one.name)) != one.default
        }
        table: Table = {
            "format": FORMAT,
            "solver": self.solver,
            "deck_sha256": self.deck_sha256,
            "time": {one.name: odd[one.name] for one in fields(_Time) if one.name in odd},
            "apex_node": self.apex_node,
            **{
                name: odd[name] for name in ("on_axis", "stress_unit", "length_unit") if name in odd
            },
            "afferents": {place.afferent: place.to_table() for place in self.afferents},
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


def read_run_folder(folder: Path) -> RunFolder:
    """Read the ``run.toml`` of `folder`.

    Raises
    ------
    ResultError
        There is none, or it is not one that fembridge wrote.
    """
    path = folder / RUN_FILE
    failed = ResultError.at(path)
    if not path.exists():
        raise ResultError("no run.toml: not a run folder of fembridge", folder)
    table = read_toml(path, failed)
    if (found := table.pop("format", None)) != FORMAT:
        raise failed(f"format {found!r}, expected {FORMAT}; build the deck again with this version")
    places = table.get("afferents")
    if isinstance(places, dict):  # a section is named after its afferent
        for name, place in places.items():
            places[name] = {"afferent": name, **place} if isinstance(place, dict) else place
    file = structure(table, _RunFile, failed)
    time = file.time
    for place in file.afferents:
        if not AFFERENT_NAME.fullmatch(place):
            raise failed(f"afferents.{place[:60]}: expected the name of a class such as SA")
    for node in file.branches:
        if not node.isdecimal():
            raise failed(f"branches.{node}: expected the number of a node")
    known = {one.name: getattr(file, one.name) for one in fields(file) if one.name != "time"} | {
        "afferents": tuple(file.afferents.values()),
        "branches": {int(node): count for node, count in file.branches.items()},
    }
    run = RunFolder(folder, **known, **asdict(time))
    for name, value, least in (
        ("time.increments", time.increments, 1),
        ("time.solver_increments", time.solver_increments, 0),
        ("time.before_ms", time.before_ms, 0),
        ("time.start_ms", time.start_ms, time.before_ms),
        ("apex_node", run.apex_node, 0),
        *((f"afferents.{place.afferent}.node", place.node, 1) for place in run.afferents),
    ):
        if not value >= least:
            raise failed(f"{name} is {value}, expected {least:g} or more")
    if not (math.isfinite(time.dt_ms) and time.dt_ms > 0):
        raise failed(f"time.dt_ms is {time.dt_ms}, expected more than 0")
    if time.start_ms > run.end_ms:
        raise failed(f"time.start_ms is {time.start_ms:g}, after the end at {run.end_ms:g} ms")
    for key, content in _values_in(table):
        if isinstance(content, float) and not math.isfinite(content):
            raise failed(f"{key} is {content}, expected a finite number")
        if isinstance(content, int) and abs(content) > _MOST_WHOLE:
            raise failed(f"{key} is larger than a whole number of 64 bits")
        if not isinstance(content, bool | int | float | str):
            raise failed(f"{key} is {content}, expected a number or a word")
    for name in _TABLES:
        if not isinstance(run.inputs.get(name, {}), Mapping):
            raise failed(f"inputs.{name}: expected a table")
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
    from fembridge.tables import read_table

    path = folder / STIMULUS_FILE
    try:
        table = read_table(path, COLUMNS[:2], COLUMNS[2:])
        times_ms, depth_um = (table.numbers(name) for name in COLUMNS[:2])
    except TableError as error:
        raise ResultError(error.problem, path, error.line) from error
    if table.size < 2:
        raise ResultError(f"{table.size} samples, expected two or more", path)
    with np.errstate(over="ignore", invalid="ignore"):  # of 1e308
        _, odd = mean_step(times_ms)
    if odd is not None:
        before_ms, after_ms = times_ms[odd : odd + 2]
        problem = f"time goes from {before_ms:g} to {after_ms:g} ms, expected an even step"
        raise ResultError(problem, path, int(table.lines[odd + 1]))
    return times_ms, depth_um
