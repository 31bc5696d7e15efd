"""A run folder: one deck, the waveform it prescribes, and what was built from what.

``job.inp``       the deck; ccx is called with ``-i job`` (``job.dat`` for Marc)
``stimulus.csv``  ``time_ms,displacement_um``: the waveform, sample by sample; where
                  the probe slides, ``aside_um`` as well
``run.toml``      this value: which node is which afferent, times, inputs

After a run the solver's own files (``job.frd``, ``job.dat``, ``job.sta``,
``job.cvg``) and ``solver.log`` are beside them.
"""

import csv
import math
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TypeGuard

from decks.dialects import dialect_of
from fembridge.errors import ResultError
from fembridge.store import write_text
from fembridge.typing import FloatArray, Table

FORMAT = 1
RUN_FILE = "run.toml"
STIMULUS_FILE = "stimulus.csv"
SOLVER_FILE = "solver.toml"
COLUMNS = ["time_ms", "displacement_um", "aside_um"]


@dataclass(frozen=True, slots=True)
class AfferentNode:
    """Where one afferent sits: a solver's node inside one layer of the finger.

    In someone's own model layer and depth are unknown: "" and None.
    """

    afferent: str
    node: int
    layer: str
    x_mm: float
    y_mm: float
    depth_mm: float | None = None

    @classmethod
    def from_table(cls, afferent: str, table: Mapping[str, Any]) -> "AfferentNode":
        """From a section of TOML; what is wrong in it is a `ValueError`."""
        node = table["node"]
        if not _is_whole(node, least=1):
            raise ValueError(f"{afferent}: node is {node!r}, expected 1 or more")
        layer = str(table["layer"])
        keys = ("x_mm", "y_mm", "depth_mm") if layer else ("x_mm", "y_mm")
        place = [float(table[key]) for key in keys]
        if not all(map(math.isfinite, place)):
            raise ValueError(f"{afferent}: its place is not finite")
        return cls(afferent, node, layer, *place)

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
    time, the way to the pre-indentation. Stress may be in another unit there.
    `solver_increments` is how many the solver makes in all, where that is another
    number: there are more than one to a sample, or steps before. 0: the same.
    Where skin relaxes, `branches` is by node how many branches its stress is the
    sum of, whose mean the solver writes. Of a half of the section `on_axis` are the
    nodes on its axis, where shear is 0, whatever the solver writes of one half.
    `apex_node` is the skin's node under the probe: its displacement shows that the
    probe pushed (0 where unknown).
    `inputs` is what the deck was made from: for people, and for the origin of a
    response map.

    Raises
    ------
    ResultError
        Increments, times or a node's number that no run has.
    """

    folder: Path
    solver: str
    increments: int
    dt_ms: float
    start_ms: float
    afferents: tuple[AfferentNode, ...]
    deck_sha256: str
    apex_node: int = 0
    inputs: Mapping[str, object] = field(default_factory=dict)
    before_ms: float = 0.0
    stress_unit: str = "MPa"
    branches: Mapping[int, int] = field(default_factory=dict)
    solver_increments: int = 0
    on_axis: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for name, least in (("increments", 1), ("apex_node", 0), ("solver_increments", 0)):
            if not _is_whole(number := getattr(self, name), least):
                raise self._error(f"{name} is {number!r}, expected {least} or more")
        for node, count in self.branches.items():
            if not (_is_whole(node, 1) and _is_whole(count, 1)):
                raise self._error(f"branches of node {node!r} are {count!r}")
        for node in self.on_axis:
            if not _is_whole(node, 1):
                raise self._error(f"a node on the axis is {node!r}, expected 1 or more")
        if not (math.isfinite(self.dt_ms) and self.dt_ms > 0):
            raise self._error(f"dt_ms is {self.dt_ms}, expected more than 0")
        if not (math.isfinite(self.before_ms) and self.before_ms >= 0):
            raise self._error(f"before_ms is {self.before_ms}, expected 0 or more")
        if not self.before_ms <= self.start_ms <= self.end_ms:
            raise self._error(
                f"start_ms is {self.start_ms:g}, expected from {self.before_ms:g} to "
                f"the end of the run, {self.end_ms:g}"
            )

    def _error(self, problem: str) -> ResultError:
        return ResultError(problem, self.folder / RUN_FILE)

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

    def node_of(self) -> dict[str, int]:
        """Node of each afferent by its name."""
        return {place.afferent: place.node for place in self.afferents}

    def write(self) -> None:
        """Write ``run.toml``."""
        import tomli_w

        table: Table = {
            "format": FORMAT,
            "solver": self.solver,
            "deck_sha256": self.deck_sha256,
            "time": {
                "increments": self.increments,
                "dt_ms": self.dt_ms,
                "start_ms": self.start_ms,
                **({"before_ms": self.before_ms} if self.before_ms else {}),
                **({"solver_increments": self.solver_increments} if self.solver_increments else {}),
            },
            "apex_node": self.apex_node,
            **({"on_axis": list(self.on_axis)} if self.on_axis else {}),
            **({} if self.stress_unit == "MPa" else {"stress_unit": self.stress_unit}),
            "afferents": {place.afferent: place.to_table() for place in self.afferents},
            **self._branches_table(),
            "inputs": dict(self.inputs),
        }
        write_text(self.folder / RUN_FILE, tomli_w.dumps(table))

    def _branches_table(self) -> Table:
        if not self.branches:
            return {}
        return {"branches": {str(node): n for node, n in self.branches.items()}}


def read_run_folder(folder: Path) -> RunFolder:
    """Read the ``run.toml`` of `folder`.

    Raises
    ------
    ResultError
        There is none, or it is not one that fembridge wrote.
    """
    path = folder / RUN_FILE
    try:
        with path.open("rb") as file:
            table = tomllib.load(file)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise ResultError("no run.toml: not a run folder of fembridge", folder) from (error)
    except OSError as error:
        raise ResultError(f"cannot be read: {error.strerror}", path) from error
    except (ValueError, RecursionError) as error:  # no TOML, no UTF-8, nested deep
        raise ResultError(f"not readable as TOML: {error}", path) from error
    if table.get("format") != FORMAT:
        raise ResultError(
            f"format {table.get('format')!r}, expected {FORMAT}; "
            "build the deck again with this version",
            path,
        )
    try:
        return RunFolder(
            folder=folder,
            solver=str(table["solver"]),
            increments=table["time"]["increments"],
            dt_ms=float(table["time"]["dt_ms"]),
            start_ms=float(table["time"]["start_ms"]),
            before_ms=float(table["time"].get("before_ms", 0.0)),
            solver_increments=table["time"].get("solver_increments", 0),
            afferents=tuple(
                AfferentNode.from_table(name, place) for name, place in table["afferents"].items()
            ),
            apex_node=table.get("apex_node", 0),
            stress_unit=str(table.get("stress_unit", "MPa")),
            branches={int(k): n for k, n in table.get("branches", {}).items()},
            on_axis=tuple(table.get("on_axis", ())),
            deck_sha256=str(table["deck_sha256"]),
            inputs=dict(table["inputs"]),  # the last section: a cut file has none
        )
    except KeyError as error:
        raise ResultError(f"not a run.toml of fembridge: no {error}", path) from error
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise ResultError(f"not a run.toml of fembridge: {error}", path) from error


def read_waveform(folder: Path) -> tuple[FloatArray, FloatArray]:
    """Read ``stimulus.csv``: times ``(T,)`` in ms and displacement ``(T,)`` in um.

    Raises
    ------
    ResultError
        There is none, or a row is not two finite numbers.
    """
    import numpy as np

    path = folder / STIMULUS_FILE
    rows = []
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.reader(file)
            header = next(reader, [])
            if header not in (COLUMNS[:2], COLUMNS):
                raise ResultError("expected time_ms,displacement_um", path, 1)
            for row in reader:
                sample = [float(field) for field in row]
                if len(sample) != len(header):
                    raise ValueError(f"{len(sample)} numbers, not {len(header)}")
                if not all(map(math.isfinite, sample)):
                    raise ValueError("not finite")
                rows.append((sample[0], sample[1]))
    except (ValueError, csv.Error) as error:  # also: not UTF-8
        raise ResultError(f"not a sample: {error}", path, len(rows) + 2) from error
    except OSError as error:
        raise ResultError(f"cannot be read: {error.strerror}", path) from error
    if len(rows) < 2:
        raise ResultError(f"{len(rows)} samples, expected two or more", path)
    times_ms, depth_um = np.array(rows, dtype=np.float64).T
    return times_ms, depth_um


def _is_whole(number: object, least: int) -> TypeGuard[int]:
    """Whether it is a whole number, and no truth value, that is large enough."""
    return isinstance(number, int) and not isinstance(number, bool) and number >= least
