"""A small writer of ``.frd`` files, so that tests know every number in them."""

import struct
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # where opened is
FIXTURES = Path(__file__).parents[3] / "fixtures"
COMPONENTS = {"DISP": ("D1", "D2", "D3"), "STRESS": ("SXX", "SYY", "SZZ", "SXY", "SYZ", "SZX")}


@dataclass(frozen=True)
class Block:
    """A result block to write; `number` prints one value (12 characters)."""

    name: str
    increment: int
    time_s: float
    records: list
    flag: int = 1
    step: int = 1
    components: tuple = ()
    number: object = "{:12.5E}".format
    count: int | None = None


SQUARE = ((9, 1, (1, 2, 3, 4)),)


def frd_bytes(blocks, nodes=None, elements=SQUARE, mesh_flag=1, line_end="\n"):
    """Write a file; an element is (type, material, nodes).

    Without `nodes` the mesh has those of the square and of the blocks.
    """
    if nodes is None:
        nodes = sorted({1, 2, 3, 4, *(node for block in blocks for node, _ in block.records)})
    binary = mesh_flag >= 2
    out = [b"    1C\n    1UPGM               CalculiX\n    1UMAT    1EPI\n    1UMAT    2DER\n"]
    out.append(_mesh_line("    2C", len(nodes), 3 if binary else 1))
    for node in nodes:
        if binary:
            out.append(struct.pack("<i3d", node, node, 0.0, 0.0))
        else:
            out.append(f" -1{node:10d}{node:12.5E}{0:12.5E}{0:12.5E}\n".encode())
    out.append(b"" if binary else b" -3\n")
    out.append(_mesh_line("    3C", len(elements), 2 if binary else 1))
    for number, (kind, material, corners) in enumerate(elements, start=1):
        if binary:
            words = (number, kind, 0, material, *corners)
            out.append(struct.pack(f"<{len(words)}i", *words))
            continue
        out.append(f" -1{number:10d}{kind:5d}{0:5d}{material:5d}\n".encode())
        for first in range(0, len(corners), 10):
            ids = "".join(f"{node:10d}" for node in corners[first : first + 10])
            out.append(f" -2{ids}\n".encode())
    out.append(b"" if binary else b" -3\n")
    for running, block in enumerate(blocks, start=1):
        out.extend(_block(block, running))
    whole = b"".join([*out, b" 9999\n"])
    return whole.replace(b"\n", line_end.encode()) if line_end != "\n" else whole


def _mesh_line(key, count, flag):
    return f"{key}{'':18}{count:12d}{'':37}{flag}\n".encode()


def _block(block, running):
    names = block.components or COMPONENTS[block.name]
    time = f"{block.time_s:12.5E}" if block.time_s < 1 else f"{block.time_s:12.9f}"[:12]
    count = len(block.records) if block.count is None else block.count
    announced = len(names) + (block.name == "DISP")
    lines = [
        f"    1PSTEP{'':14}{running:12d}{block.increment:12d}{block.step:12d}",
        f"  100CL{100 + running:5d}{time}{count:12d}{'':20}{0:2d}{running:5d}"
        f"{'':10}{block.flag:2d}",
        f" -4  {block.name:8}{announced:5d}{1:5d}",
        *(f" -5  {name:8}{1:5d}{4:5d}{1:5d}{1:5d}" for name in names),
    ]
    if block.name == "DISP":
        lines.append(f" -5  ALL     {1:5d}{2:5d}{0:5d}{0:5d}{1:5d}ALL")
    out = [("\n".join(lines) + "\n").encode()]
    for node, values in block.records:
        if block.flag >= 2:
            kind = "f" if block.flag == 2 else "d"
            out.append(struct.pack(f"<i{len(values)}{kind}", node, *values))
            continue
        width = 5 if block.flag == 0 else 10
        for first in range(0, len(values), 6):
            start = f" -2{'':{width}}" if first else f" -1{node:{width}d}"
            numbers = "".join(block.number(x) for x in values[first : first + 6])
            out.append(f"{start}{numbers}\n".encode())
    out.append(b"" if block.flag >= 2 else b" -3\n")
    return out


@pytest.fixture(scope="session")
def write_frd(tmp_path_factory):
    """Give a function that writes blocks to a file of its own."""
    folder = tmp_path_factory.mktemp("written")

    def write(blocks, name="written.frd", **how):
        path = folder / name
        path.write_bytes(frd_bytes(blocks, **how))
        return path

    return write


@pytest.fixture(scope="session")
def block():
    """Give the class of blocks that `write_frd` writes."""
    return Block


@pytest.fixture(scope="session")
def small_run():
    """A function that gives DISP and STRESS of two nodes, every number another."""

    def blocks(increments, flag=1, **how):
        made, number = [], 1.0
        for k in range(1, increments + 1):
            for name, components in COMPONENTS.items():
                records = []
                for node, sign in ((3, -1), (1, 1)):
                    row = [sign * (number + 1.25 * j) for j in range(len(components))]
                    records.append((node, row))
                    number += 16.0
                made.append(Block(name, k, k * 5e-4, records, flag, **how))
        return made

    return blocks


@pytest.fixture(scope="session")
def samples():
    """Give the folder of recorded runs."""
    return FIXTURES / "frd_samples"
