"""A run folder: one deck, the waveform it prescribes, and what was built from what.

``job.inp``       the deck; ccx is called with ``-i job``
``stimulus.csv``  ``time_ms,displacement_um``: the waveform, sample by sample
``run.toml``      this value: which node is which afferent, times, inputs

After a run the solver's own files (``job.frd``, ``job.dat``, ``job.sta``,
``job.cvg``) and ``solver.log`` stand beside them.
"""

import csv
import hashlib
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from fembridge.errors import ResultError
from fembridge.outputs import write_text
from fembridge.typing import FloatArray, Table

FORMAT = 1
RUN_FILE = "run.toml"
STIMULUS_FILE = "stimulus.csv"
SOLVER_FILE = "solver.toml"
JOB = "job"


@dataclass(frozen=True, slots=True)
class AfferentNode:
    """Where one afferent sits: a solver's node inside one layer of the finger."""

    afferent: str
    node: int
    layer: str
    x_mm: float
    y_mm: float
    depth_mm: float


@dataclass(frozen=True, slots=True)
class RunFolder:
    """One run: `folder`, its `solver`, its time axis and its afferents.

    The solver's clock starts `start_ms` before the stimulus does (a ramp to a
    pre-indentation takes place there) and ends at `end_ms` of solver time after
    `increments` fixed increments of `dt_ms`. `apex_node` is the skin's node under
    the probe: its displacement shows that the probe pushed (0 where unknown). `inputs` tells what the deck was
    made from; nothing reads it back, people do.
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

    @property
    def end_ms(self) -> float:
        """Solver time at the end of the run, in ms."""
        return self.increments * self.dt_ms

    @property
    def deck(self) -> Path:
        """The deck's path."""
        return self.folder / f"{JOB}.inp"

    @property
    def results(self) -> Path:
        """The path of the result file that the solver writes."""
        return self.folder / f"{JOB}.frd"

    def node_of(self) -> dict[str, int]:
        """Give the node of each afferent by its name."""
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
            },
            "apex_node": self.apex_node,
            "afferents": {
                place.afferent: {
                    "node": place.node,
                    "layer": place.layer,
                    "x_mm": place.x_mm,
                    "y_mm": place.y_mm,
                    "depth_mm": place.depth_mm,
                }
                for place in self.afferents
            },
            "inputs": dict(self.inputs),
        }
        write_text(self.folder / RUN_FILE, tomli_w.dumps(table))


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
    except FileNotFoundError as error:
        raise ResultError("no run.toml: not a run folder of fembridge", folder) from (
            error
        )
    except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
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
            increments=int(table["time"]["increments"]),
            dt_ms=float(table["time"]["dt_ms"]),
            start_ms=float(table["time"]["start_ms"]),
            afferents=tuple(
                AfferentNode(
                    afferent=name,
                    node=int(place["node"]),
                    layer=str(place["layer"]),
                    x_mm=float(place["x_mm"]),
                    y_mm=float(place["y_mm"]),
                    depth_mm=float(place["depth_mm"]),
                )
                for name, place in table["afferents"].items()
            ),
            apex_node=int(table.get("apex_node", 0)),
            deck_sha256=str(table["deck_sha256"]),
            inputs=table.get("inputs", {}),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ResultError(f"not a run.toml of fembridge: {error!r}", path) from error


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
            if next(reader, None) != ["time_ms", "displacement_um"]:
                raise ResultError("expected time_ms,displacement_um", path, 1)
            for row in reader:
                time_ms, depth_um = (float(field) for field in row)
                if not (math.isfinite(time_ms) and math.isfinite(depth_um)):
                    raise ValueError("not finite")
                rows.append((time_ms, depth_um))
    except (ValueError, UnicodeDecodeError) as error:
        raise ResultError(f"not a sample: {error}", path, len(rows) + 2) from error
    except OSError as error:
        raise ResultError(f"cannot be read: {error.strerror}", path) from error
    if len(rows) < 2:
        raise ResultError(f"{len(rows)} samples, expected two or more", path)
    times_ms, depth_um = np.array(rows, dtype=np.float64).T
    return times_ms, depth_um


def sha256_of(path: Path) -> str:
    """Digest of a file's bytes, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
