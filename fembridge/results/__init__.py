"""Reading a solver's results: one table of formats, one function.

Suffix and first bytes both decide which reader takes a file; its module is
imported then. Another package adds a row, a `Reader`, under the entry point
group ``fembridge.readers``; it is asked when none of ours takes the file.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from decks.dialects import JOB
from fembridge.errors import ResultError, UsageError
from fembridge.results.node_choice import NodeChoice
from fembridge.results.read_options import ReadOptions
from fembridge.run_folder import RUN_FILE, RunFolder, read_run_folder
from fembridge.trace import StressTrace
from fembridge.typing import Table

ENTRY_POINTS = "fembridge.readers"
_FIRST_BYTES = 64
_PRINTS = (".dat", ".sta", ".cvg")
_KNOWN_STARTS = (
    (b"\x1f\x8b", "gzip: unpack it first"),
    (b"PK\x03\x04", "zip: unpack it first"),
    (b"\x89HDF", "HDF5"),
    (b"<?xml", "XML"),
    (b"<VTKFile", "VTK"),
    (b"# vtk", "VTK"),
    (b"\xef\xbb\xbf", "text with a byte order mark: something saved it anew"),
    (b"\xff\xfe", "UTF-16 text: something saved it anew"),
    (b"*", "a solver deck, no results"),
)


@dataclass(frozen=True, slots=True)
class Reader:
    """A format: its `suffix`, its `first_bytes`, and where its functions are.

    `target` is ``module:function``, called as ``(path, nodes, options)`` with
    `ReadOptions` and giving one `StressTrace` a node, in that order. A function
    ``describe(path)`` in that module tells what a file holds.
    """

    name: str
    suffix: str
    first_bytes: bytes
    target: str

    def load(self) -> Callable[[Path, Sequence[int], ReadOptions], list[StressTrace]]:
        """Import the reading function."""
        module, _, function = self.target.partition(":")
        found: Callable[[Path, Sequence[int], ReadOptions], list[StressTrace]]
        found = getattr(import_module(module), function)
        return found

    def describe(self, path: Path) -> Table:
        """Tell what `path` holds, as far as this format can."""
        module = import_module(self.target.partition(":")[0])
        tell: Any = getattr(module, "describe", None)
        found: Table = {"format": self.name} if tell is None else tell(path)
        return found


READERS = (Reader("ccx-frd", ".frd", b"    1C", "fembridge.results.frd:read"),)


def read(
    path: Path | str,
    nodes: Sequence[int] | None = None,
    *,
    node_set: str | None = None,
    near_mm: Sequence[Sequence[float]] = (),
    deck: Path | str | None = None,
    partial: bool = False,
    across_materials: bool = False,
    stress_unit: str = "MPa",
    tell: Callable[[str], None] | None = None,
) -> list[StressTrace]:
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
        Name of a set in the deck, case-blind: all its nodes.
    near_mm
        Places, x, y or x, y, z of the undeformed mesh: the nearest node that has
        a stress. `tell` hears which it is and how far away.
    deck
        Where `node_set` is. None takes the ``.inp`` with the stem of `path`.
    partial
        Take what is whole of a run that did not end well; `tell` hears what
        was left out.
    across_materials
        Let through nodes on a layer boundary.
    stress_unit
        Unit of the file: "MPa" (N and mm), "kPa" or "Pa".
    tell
        Called with each remark.

    Raises
    ------
    ResultError
        The file is absent, cut, foreign, or does not hold what was asked for.
    """
    path = result_file(path)
    options = ReadOptions(partial, across_materials, stress_unit, tell)
    reader = reader_of(path)
    run = run_folder_of(path)
    chosen = NodeChoice(
        nodes=() if nodes is None else nodes,
        sets=() if node_set is None else (node_set,),
        places_mm=near_mm,
        deck=None if deck is None else Path(deck),
    )
    if nodes is not None or chosen:
        places: list[tuple[str | None, int]] = [
            (None, node) for node in chosen.resolve(path, tell)
        ]
    elif run is not None:
        places = [(place.afferent, place.node) for place in run.afferents]
    else:
        raise ResultError("no run.toml beside it: name the nodes to read", path)
    if not places:
        raise ResultError("no nodes to read", path)
    if run is not None:
        if stress_unit != "MPa":
            raise UsageError(f"{path}: a run folder of fembridge is in MPa, always")
        from fembridge.results.run_traces import (
            check_deck,
            check_reach,
            in_stimulus_time,
        )

        check_deck(run, path)
    traces = reader.load()(path, [node for _, node in places], options)
    traces = [
        replace(trace, afferent=afferent)
        for trace, (afferent, _) in zip(traces, places, strict=True)
    ]
    if run is None:
        return traces
    check_reach(traces[0], run, path, options)
    return [in_stimulus_time(trace, run, path) for trace in traces]


def result_file(path: Path | str) -> Path:
    """Give the result file that `path` is, or that the run folder `path` holds."""
    path = Path(path)
    return path / f"{JOB}.frd" if path.is_dir() else path


def describe(path: Path) -> Table:
    """Tell what a result file holds."""
    return reader_of(path).describe(path)


def run_folder_of(path: Path) -> RunFolder | None:
    """Give the run that `path` is a result of; None without a ``run.toml``."""
    folder = path.parent
    return read_run_folder(folder) if (folder / RUN_FILE).exists() else None


def reader_of(path: Path) -> Reader:
    """Give the reader for `path`, by suffix and first bytes.

    Raises
    ------
    ResultError
        No such file, it is empty, or no reader takes it.
    """
    from fembridge.results.byte_file import ByteFile

    with ByteFile(path) as file:
        start = file.peek(0, _FIRST_BYTES)
    if not start:
        raise ResultError("empty: 0 bytes", path)
    for table in (lambda _: READERS, _plugged):
        for reader in table(path):
            same = path.suffix.lower() == reader.suffix
            if same and start.startswith(reader.first_bytes):
                return reader
    raise ResultError(_foreign(path, start), path)


def _foreign(path: Path, start: bytes) -> str:
    if path.suffix.lower() in _PRINTS:
        return (
            "prints of CalculiX, no nodal results: fembridge ingest makes a table of "
            "them, and --point traces of a .dat's integration points"
        )
    for reader in READERS:
        if start.startswith(reader.first_bytes):
            return (
                f"begins like {reader.name} and is named {path.suffix or 'nothing'}: "
                f"rename it to {reader.suffix}"
            )
    kinds = [f", {kind}" for mark, kind in _KNOWN_STARTS if start.startswith(mark)]
    kind = kinds[0] if kinds else ""
    wanted = "; ".join(
        f"{reader.suffix} begins with {reader.first_bytes!r}" for reader in READERS
    )
    return f"no result file we read: begins with {start[:12]!r}{kind}; {wanted}"


def _plugged(path: Path) -> tuple[Reader, ...]:
    from importlib.metadata import entry_points

    found = []
    for point in entry_points(group=ENTRY_POINTS):
        try:
            reader = point.load()
        except Exception as error:  # whatever another package does wrong
            raise ResultError(
                f"reader {point.name} ({point.value}) cannot be loaded: {error!r}", path
            ) from error
        if not isinstance(reader, Reader):
            raise ResultError(
                f"reader {point.name} ({point.value}) is a {type(reader).__name__}, "
                "expected a fembridge.results.Reader",
                path,
            )
        found.append(reader)
    return tuple(found)
