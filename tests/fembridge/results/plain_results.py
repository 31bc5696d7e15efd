"""Plain, slow readers of ``.frd`` and ``.dat``, written from the format alone, to compare with.

They share no line with fembridge. ``python tests/fembridge/results/plain_results.py FOLDER``
reads all ``.frd`` and ``.dat`` below a folder twice, by fembridge and by them, and counts the
numbers that are equal; each file that differs is a line.
"""

import itertools
import re
import struct
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

NODES_OF_TYPE = {1: 8, 2: 6, 3: 4, 4: 20, 5: 15, 6: 10, 7: 3, 8: 6, 9: 4, 10: 8, 11: 2, 12: 3}
FOREIGN = re.compile(r"E I G E N V A L U E|P A R T I C I P A T I O N|M O D A L|F R E Q U E N C Y")


@dataclass
class PlainBlock:
    """A result block: name, step, increment or mode, value of its axis as printed, records."""

    name: str
    step: int
    increment: int
    axis_value: float
    nodes: list = field(default_factory=list)
    values: list = field(default_factory=list)


@dataclass
class PlainFrd:
    """Coordinates by node, ``(type, nodes)`` by element, and the blocks in file order."""

    positions: dict = field(default_factory=dict)
    elements: dict = field(default_factory=dict)
    blocks: list = field(default_factory=list)


class _Lines:
    """Text lines and bytes of a file, one after the other."""

    def __init__(self, path):
        self.content, self.at = path.read_bytes(), 0

    def line(self):
        if self.at >= len(self.content):
            return None
        end = self.content.find(b"\n", self.at)
        end = len(self.content) if end < 0 else end
        text = self.content[self.at : end].decode("latin-1").rstrip("\r")
        self.at = end + 1
        return text

    def unpack(self, form):
        values = struct.unpack_from(form, self.content, self.at)
        self.at += struct.calcsize(form)
        return values


def number(text):
    """A number as C or Fortran prints it: ``1.0-101`` has lost its E."""
    text = text.strip()
    short = re.fullmatch(r"([+-]?\d*\.\d*)([+-]\d{3})", text)
    return float(f"{short[1]}E{short[2]}" if short else text)


def numbers(text, width=12):
    return [number(text[k : k + width]) for k in range(0, len(text.rstrip()), width)]


def plain_frd(path):
    """Read a ``.frd`` record by record."""
    file, result, step, increment, mode = _Lines(path), PlainFrd(), 0, 0, None
    while (line := file.line()) is not None:
        if line.startswith("    2C"):
            _nodes(file, line, result)
        elif line.startswith("    3C"):
            _elements(file, line, result)
        elif line.startswith("    1PSTEP"):
            increment, step, mode = int(line[36:48]), int(line[48:60]), None
        elif line.startswith("    1PMODE"):
            mode = int(line[10:].split()[0])
        elif line.startswith("  100C"):
            _block(file, line, result, step, mode or increment)
        elif line.startswith(" 9999"):
            break
    return result


def _nodes(file, line, result):
    flag = int(line[73:75])
    if flag < 2:
        start = 13 if flag else 8
        while not (line := file.line()).startswith(" -3"):
            result.positions[int(line[3:start])] = numbers(line[start:])
        return
    for _ in range(int(line[24:36])):
        node, *xyz = file.unpack("<i3d" if flag == 3 else "<i3f")
        result.positions[node] = xyz


def _elements(file, line, result):
    flag = int(line[73:75])
    if flag < 2:
        width = 10 if flag else 5
        while not (line := file.line()).startswith(" -3"):
            if line.startswith(" -1"):
                element = int(line[3 : 3 + width])
                result.elements[element] = (int(line[3 + width : 8 + width]), [])
            else:
                ids = line[3:].rstrip()
                result.elements[element][1].extend(
                    int(ids[k : k + width]) for k in range(0, len(ids), width)
                )
        return
    for _ in range(int(line[24:36])):
        element, kind, _group, _material = file.unpack("<4i")
        result.elements[element] = (kind, list(file.unpack(f"<{NODES_OF_TYPE[kind]}i")))


def _block(file, line, result, step, increment):
    flag, records = int(line[73:75]), int(line[24:36] or 0)
    axis_value, stored, block = number(line[12:24]), 0, None
    if line[56:58].strip() == "4":  # buckling: the state with factor 0 is before mode 1
        factors = [other.axis_value for other in result.blocks if other.step == step]
        increment = len({factor for factor in [*factors, axis_value] if factor})
    while file.content[file.at : file.at + 3] in (b" -4", b" -5"):
        text = file.line()
        if text.startswith(" -4"):
            block = PlainBlock(text[5:13].strip(), step, increment, axis_value)
        else:
            stored += int(text[33:38].strip() or 0) != 1
    result.blocks.append(block)
    if flag < 2:
        start = 13 if flag else 8
        while not (line := file.line()).startswith(" -3"):
            if line.startswith(" -1"):
                block.nodes.append(int(line[3:start]))
                block.values.append([])
            block.values[-1].extend(numbers(line[start:]))
        return
    for _ in range(records):
        node, *values = file.unpack(f"<i{stored}{'fd'[flag - 2]}")
        block.nodes.append(node)
        block.values.append(values)


@dataclass
class PlainTable:
    """A section of a ``.dat``: its header, time, labels and values by record."""

    header: str
    time_s: float
    labels: list = field(default_factory=list)
    values: list = field(default_factory=list)


def plain_dat(path):
    """Read the sections of a ``.dat`` line by line: those whose header has a time."""
    tables, table = [], None
    for line in path.read_text("latin-1").splitlines():
        words = line.split()
        if not words:
            continue
        if "time" in words and words[0][0].isalpha():
            table = PlainTable(line.strip(), number(words[-1]))
            tables.append(table)
        elif words[0][0].isalpha() or FOREIGN.search(line):
            is_part = table is not None and table.header.startswith("statistics")
            part = table and PlainTable(f"{table.header}: {line.strip()}", table.time_s)
            table = part if is_part else None
            if is_part:
                tables.append(part)
        elif table is not None:
            labels, values = _record(line)
            table.labels.append(labels)
            table.values.append(values)
    return [table for table in tables if table.values or "statistics" not in table.header]


def _record(line):
    """Values are the last fields, 14 characters wide; labels are what is left of them."""
    text = re.sub(r"\s+[A-Za-z_]\S*\s*$", "", line) if not line.rstrip().endswith("N") else line
    text, values = text.rstrip(), []
    while len(text) >= 14 and "." in text[-14:]:
        values.insert(0, number(text[-14:]))
        text = text[:-14]
    return [int(word) for word in text.split()], values


def compare_frd(path):
    """Count of numbers of fembridge that equal those of `plain_frd`; an AssertionError if not."""
    from fembridge.results import read_fields
    from fembridge.results.byte_file import ByteFile
    from fembridge.results.frd import FrdIndex, FrdSource
    from fembridge.results.read_options import ReadOptions

    plain, count = plain_frd(path), 0
    options = ReadOptions(stress_unit="Pa", length_unit="mm")
    with ByteFile(path) as file:
        index = FrdIndex(file)
        assert index.damage == [], index.damage
        names = [block.name for block in index.blocks]
        assert names == [block.name for block in plain.blocks], (names, plain.blocks)
        source = FrdSource(file, options)
        if plain.positions and plain.elements:
            scene = source.mesh()
            assert scene.nodes.tolist() == list(plain.positions), "nodes"
            assert (scene.points_mm == np.array(list(plain.positions.values()))).all(), "points"
            count += 4 * len(scene.nodes) + _compare_elements(scene, plain)
    for name in index.names:
        tables = [table for table in plain.blocks if table.name == name and table.nodes]
        fields = read_fields(path, name, stress_unit="Pa")
        for ours, table in itertools.zip_longest(fields, tables):
            assert (ours.step, ours.increment) == (table.step, table.increment), str(ours)
            axis_value = ours.time_ms / 1000 if np.isnan(ours.axis_value) else ours.axis_value
            assert abs(axis_value - table.axis_value) <= 1e-15 * abs(table.axis_value), str(ours)
            assert ours.nodes.tolist() == table.nodes, f"nodes of {name}"
            assert (ours.values == np.array(table.values)).all(), f"values of {name}"
            count += 3 + len(table.nodes) + ours.values.size
    return count


def _compare_elements(scene, plain):
    count, seen = 0, set()
    for cells in scene.cells:
        for element, rows in zip(cells.ids.tolist(), cells.rows, strict=True):
            kind, nodes = plain.elements[element]
            assert scene.nodes[rows].tolist() == nodes, f"element {element}"
            assert len(nodes) == NODES_OF_TYPE[kind]
            seen.add(element)
            count += 1 + len(nodes)
    assert seen == set(plain.elements), "elements"
    return count


def compare_dat(path):
    """Count of numbers of fembridge that equal those of `plain_dat`; an AssertionError if not."""
    from fembridge.results.printed import dat_sections
    from fembridge.results.read_options import ReadOptions

    count, tables = 0, plain_dat(path)
    sections = dat_sections(path, lambda *_: True, ReadOptions())
    for ours, table in itertools.zip_longest(sections, tables):
        assert ours is not None, f"fembridge lacks {table.header}"
        assert table is not None, f"plain reader lacks {ours}"
        assert abs(ours.time_ms - 1000 * table.time_s) <= 1e-12 * abs(ours.time_ms), str(ours)
        assert ours.labels.tolist() == table.labels, f"labels of {ours}"
        assert len(ours.values) == len(table.values), f"records of {ours}"
        if table.values:
            assert np.array_equal(ours.values, table.values), f"values of {ours}"
        count += 1 + ours.labels.size + ours.values.size
    return count


def main(folder):
    """Compare all files below `folder`; the exit code is 1 if one differs."""
    from fembridge.errors import ResultError

    failed = 0
    for suffix, compare in ((".frd", compare_frd), (".dat", compare_dat)):
        right, refused, count = 0, 0, 0
        paths = [path for path in sorted(folder.rglob(f"*{suffix}")) if path.stat().st_size > 100]
        for path in paths:
            try:
                count += compare(path)
                right += 1
            except ResultError as error:
                print(f"{path.name}: refused: {error.problem[:200]}")
                refused += 1
            except Exception as error:
                print(f"{path.name}: {type(error).__name__}: {str(error)[:300]}")
        print(f"{suffix}: {right} of {len(paths)} files, {refused} refused; {count} numbers")
        failed += len(paths) - right - refused
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
