"""Post files of Marc, of a gigabyte: how long three nodes' traces take to read.

``python -m benchmarks.marc_post`` writes two binary post files in a folder for
passing things and reads them with our reader: one of some hundred large increments
(17 702 elements of four points, seven values a point, 38 000 nodes) and one of very
many small ones. It prints, in Markdown, how long opening takes, how long it takes to
read twelve elements and three nodes in every increment, and the peak of memory. The
files lie in the page cache when they are read. No Marc is involved: the layout is
that of post revision 14, every number is made up.
"""

import argparse
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fembridge.results.byte_file import ByteFile
from fembridge.results.marc_post import PostFile

MEGABYTES, QUICK_MEGABYTES = 1000.0, 10.0
ELEMENTS_READ, NODES_READ = 12, 3
POINTS, CORNERS, EXTRAS = 4, 5, 5
CODES = (17, 311, 312, 313, 314, 315, 316)
QUANTITIES = (("Displacement", 1), ("External Force", 3), ("Reaction Force", 5))
DT_S = 5e-4
STEPS, ROUNDING = (0.5, 0.25), 2e-2  # of single precision, added up
CHECKED = 500  # increments whose numbers are held against what was written
_KB_PER_MB = 1e6 / 1024


@dataclass(frozen=True)
class Size:
    """How large the model of a file is."""

    name: str
    elements: int
    nodes: int


SIZES = (Size("large increments", 17_702, 38_000), Size("small increments", 8, 18))


def record(payload: bytes) -> bytes:
    """Give an unformatted record."""
    marker = len(payload).to_bytes(4, "little")
    return marker + payload + marker


def text(words: str, width: int) -> bytes:
    """Give a record of text, one character in each word of four bytes."""
    return record("".join(f"{c}   " for c in words.ljust(width)).encode())


def integers(*values: int) -> bytes:
    """Give a record of integers."""
    return record(np.array(values, dtype="<i4").tobytes())


def reals(*values: float) -> bytes:
    """Give a record of reals."""
    return record(np.array(values, dtype="<f4").tobytes())


def block(number: int, name: str, *records: bytes) -> bytes:
    """Give a block of `records`."""
    return b"".join([text(f"=beg={number} ({name})", 70), *records, text("=end=", 5)])


def table(words: np.ndarray) -> bytes:
    """Give one record for each row of four-byte `words` ``(rows, columns)``."""
    rows, columns = words.shape
    whole = np.empty((rows, columns + 2), dtype="<i4")
    whole[:, 0] = whole[:, -1] = 4 * columns
    whole[:, 1:-1] = words.view("<i4")
    return whole.tobytes()


def header(size: Size) -> bytes:
    """Give the model: a strip of quadrilaterals with pressure nodes."""
    first = [len(CODES), size.nodes, size.elements, 2, POINTS, -1, 1, 0, 2, CORNERS]
    ids = np.arange(1, size.elements + 1, dtype="<i4")
    corners = [ids, ids % size.nodes + 1, (ids + 1) % size.nodes + 1, ids, ids]
    kind = [np.full_like(ids, 80), np.full_like(ids, CORNERS)]
    extras = [np.ones_like(ids)] * EXTRAS
    nodes = np.zeros((size.nodes, 3), dtype="<i4")
    nodes[:, 0] = np.arange(1, size.nodes + 1)
    nodes[:, 1] = np.linspace(0, 20, size.nodes, dtype="<f4").view("<i4")
    return b"".join(
        [
            block(50100, "Analysis Title", text("          job1", 70)),
            block(
                50200,
                "Analysis Verification Data",
                integers(*first, 2, 0, 0, 14, 0, 0, 0, 0),
                integers(*[0] * 12),
            ),
            block(
                50602,
                "Element Variable Postcodes",
                *(record(np.array([c, 0], "<i4").tobytes() + b" " * 192) for c in CODES),
            ),
            block(
                50702,
                "Element Connectivities",
                integers(0, CORNERS, EXTRAS),
                table(np.stack([ids, *kind, *corners, *extras], axis=1)),
            ),
            block(50800, "Nodal Coordinates", table(nodes)),
        ]
    )


def increments(size: Size, seed: int) -> Iterator[bytes]:
    """Give one increment after the other, each with other numbers."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(size.elements * POINTS, len(CODES))).astype("<f4")
    moved = rng.normal(size=2 * size.nodes).astype("<f4")
    number = 0
    while True:
        points += np.float32(STEPS[0])
        moved += np.float32(STEPS[1])
        nodal = [integers(len(QUANTITIES), 2 * len(QUANTITIES))]
        for name, code in QUANTITIES:
            nodal += [text(name, 48), integers(code, 0, 0, 2, 0, 0, -1, *[0] * 5)]
            nodal.append(record(moved.tobytes()))
        words = [0, number, 0, 102, 6, 0, 0, 3, 0, 0, 0, 0]
        energies = [np.float32(number * DT_S), *[0.0] * 23]
        yield b"".join(
            [
                record(b"****"),
                block(51600, "Loadcase Title", text("          lcase1", 70)),
                block(51701, "Integer Increment Verification Data", integers(*words)),
                block(51801, "Real Increment Verification Data", integers(24), reals(*energies)),
                block(52300, "Element Integration Point Values", table(points)),
                block(52401, "Nodal Results", *nodal),
                record(b"----"),
            ]
        )
        number += 1


def write(path: Path, size: Size, megabytes: float) -> int:
    """Write a file of so many megabytes; give how many increments it has."""
    written = 0
    with path.open("wb") as file:
        file.write(header(size))
        for whole in increments(size, seed=5):
            file.write(whole)
            written += 1
            if file.tell() > megabytes * 1e6:
                break
        file.write(record(b"++++"))
    return written


def timed(path: Path, size: Size, written: int) -> tuple[float, float]:
    """Give seconds to open, and seconds with which all is read."""
    began = time.perf_counter()
    with ByteFile(path) as file:
        post = PostFile(file)
        opened = time.perf_counter() - began
        if len(post.increments) != written or post.problem:
            raise SystemExit(f"{path}: {len(post.increments)} of {written} increments")
        rng = np.random.default_rng(1)
        elements = np.sort(rng.integers(0, size.elements, ELEMENTS_READ))
        nodes = np.sort(rng.integers(0, size.nodes, NODES_READ))
        kept = []
        for row in range(len(post.increments)):
            stress = post.element_values(row, elements)
            moved = post.nodal_values(row, "Displacement")[nodes]
            if row < CHECKED:
                kept.append((stress, moved))
    whole = time.perf_counter() - began
    for values, step in zip(zip(*kept, strict=True), STEPS, strict=True):
        if not np.allclose(np.diff(np.array(values), axis=0), step, atol=ROUNDING):
            raise SystemExit(f"{path}: other numbers than were written")
    return opened, whole


def main(words: list[str] | None = None) -> None:
    """Write the files, read them, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--megabytes", type=float, default=MEGABYTES)
    parser.add_argument("--quick", action="store_true", help="files of 10 MB")
    parser.add_argument("--folder", type=Path, help="where the files are made")
    options = parser.parse_args(words)
    megabytes = QUICK_MEGABYTES if options.quick else options.megabytes
    print("| file | MB | increments | opened in | all read in | peak memory |")
    print("| --- | ---: | ---: | ---: | ---: | ---: |")
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        for size in SIZES:
            path = Path(folder) / "job.t16"
            written = write(path, size, megabytes)
            opened, whole = timed(path, size, written)
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / _KB_PER_MB
            print(
                f"| {size.name} | {path.stat().st_size / 1e6:.0f} | {written} "
                f"| {opened:.2f} s | {whole:.2f} s | {peak:.0f} MB |"
            )


if __name__ == "__main__":
    main(sys.argv[1:])
