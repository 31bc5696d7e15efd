"""Mutated files: an error of ours or numbers of the file, and that within a second.

10 000 mutations where ``CI`` is set, some hundreds elsewhere.
"""

import os
import re
import struct
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from opened import near_nodes

from fembridge.errors import FembridgeError, FembridgeWarning
from fembridge.results import describe, read, read_fields
from fembridge.results.nodes import read_node_sets
from fembridge.results.printed import print_rows, read_point_history, read_point_stress
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import read_values
from fembridge.results.status import read_cvg, read_sta

MUTATIONS = 10_000 if os.environ.get("CI") == "true" else 150
FEWEST = 18  # of a kind
LONGEST_S = 1.0
LENIENT = ReadOptions(partial=True, across_materials=True, stress_unit="Pa")
STRICT = ReadOptions(stress_unit="Pa")
PRINTED = re.compile(rb"(?=([ +-]?\d*\.\d+(?:[EeDd][+-]?\d{1,3}|[+-]\d{3})?))")
WHOLE = re.compile(rb"(?=(\d+))")
MARKERS = (b" -1", b" -2", b" -3\n", b" 9999\n", b"    1PSTEP", b"  100CL", b"\n", b"\0")

STA = b"""SUMMARY OF JOB INFORMATION
  STEP      INC     ATT  ITRS     TOT TIME     STEP TIME      INC TIME
     1          1     1     7  0.500000E-03  0.500000E-03  0.500000E-03
     1          2     1U    4  0.500000E-03  0.500000E-03  0.500000E-03
"""
REALS = b"  %s  0.1000E+03  0.0000E+00  0.0000E+00\n"
CVG = b"".join(
    [
        b"\n" * 4,
        b"     1     1     1     1     112" + REALS % b"0.4126E+03",
        b"     1     1     1  ****      76" + REALS % b"       NaN",
    ]
)
SHEARS = b" -1.290587E-03  0.000000E+00  1.500000-101\n"
HEAD = b" stresses (elem, integ.pnt.,sxx,syy,szz,sxy,sxz,syz) for set EP and time  "
DAT = b"".join(
    [
        b"\n" + HEAD + b"0.5000000E-03\n\n",
        b"         1   1  1.082338E-03  1.031436E-03  9.281549E-04" + SHEARS,
        b"         2   1  2.082338E-03  3.031436E-03  9.281549E-04" + SHEARS,
        b"\n total force (fx,fy,fz) for set TOP and time  0.5000000E-03\n\n",
        b"        1.000000-101 -2.500000E+00  0.000000E+00\n",
        b"\n" + HEAD + b"0.1000000E-02\n\n",
        b"         1   1  4.082338E-03  1.031436E-03  9.281549E-04" + SHEARS,
        b"         2   1  5.082338E-03  6.031436E-03  9.281549E-04" + SHEARS,
    ]
)
DECK = b"""*NODE, NSET=ALL
1, 0., 0., 0.
2, 1., 0., 0.
*NSET, NSET=A, GENERATE
1, 20, 3
*NSET, NSET=B
A, 5, 7
"""


def mutated(content, rng):
    """One to four changes: a byte, a bit, a cut, a hole, a copy, a marker, a digit."""
    changed = bytearray(content)
    for _ in range(rng.integers(1, 5)):
        size = max(1, len(changed))
        at, kind = int(rng.integers(size)), int(rng.integers(9))
        length = int(rng.integers(1, 60))
        if kind == 0:
            changed[at : at + 1] = bytes([rng.integers(256)])
        elif kind == 1 and changed:
            changed[at % len(changed)] ^= 1 << rng.integers(8)
        elif kind == 2 and rng.integers(4) == 0:
            del changed[at:]
        elif kind == 3:
            del changed[at : at + length]
        elif kind == 4:
            changed[at:at] = changed[at : at + length]
        elif kind == 5:
            to = int(rng.integers(size))
            changed[to : to + length] = changed[at : at + length]
        elif kind == 6:
            changed[at:at] = MARKERS[rng.integers(len(MARKERS))]
        elif kind == 7:
            digits = [m.start() for m in re.finditer(rb"\d", changed[at : at + 90])]
            if digits:
                changed[at + digits[0]] = ord("0") + rng.integers(10)
        else:
            changed[at : at + 4] = rng.integers(0, 2**31, 1, dtype="<i4").tobytes()
    return bytes(changed)


def numbers_of(content, scale=1.0):
    """Every decimal that can be read anywhere in `content`, and every integer."""
    found = set()
    for match in PRINTED.finditer(content):
        text = match[1].replace(b"D", b"E").replace(b"d", b"e")
        text = re.sub(rb"(?<=\d)(?=[+-]\d{3}$)", b"E", text)
        for end in range(len(text), 0, -1):  # a field may end before the match does
            try:
                found.add(float(text[:end]) * scale)
            except ValueError:
                continue
    return found


def check_frd(path, content, flag):
    seen = 0

    def real(value):
        nonlocal seen
        seen += 1
        if flag in (1, 4):
            assert value in numbers, value
        else:
            packed = struct.pack("<f" if flag == 2 else "<d", value)
            assert packed in content or value in numbers, value

    numbers = numbers_of(content)
    for options in (LENIENT, STRICT):
        try:
            times_ms, tensor_pa = read_values(path, [1, 3], options)
        except FembridgeError:
            continue
        in_ms = numbers_of(content, 1e3)
        for value in times_ms.tolist():
            assert value in in_ms
        for value in tensor_pa.ravel().tolist():
            real(value)
    for quantity in ("STRESS", "DISP"):
        try:
            for field in read_fields(path, quantity, partial=True, stress_unit="Pa"):
                for value in field.values.ravel().tolist():
                    real(value)
        except FembridgeError:
            continue
    read_quietly(describe, path)
    read_quietly(lambda p: near_nodes(p, [(1.0, 0.0)]), path)
    read_quietly(lambda p: read(p, [1], partial=True), path)
    return seen


def check_dat(path, content, _):
    numbers = numbers_of(content)
    for options in (LENIENT, STRICT):
        try:
            _, points, tensor_pa = read_point_stress(path, None, options)
        except FembridgeError:
            continue
        wholes = {int(m[1]) for m in WHOLE.finditer(content)}
        assert set(points.ravel().tolist()) <= wholes | every_part(wholes)
        assert set(tensor_pa.ravel().tolist()) <= numbers
    read_quietly(describe, path)
    read_quietly(lambda p: read_point_history(p, [(1, 1)], None, LENIENT), path)
    return check_rows(path, numbers)


def every_part(wholes):
    texts = [str(whole) for whole in wholes]
    spans = [(a, b) for a in range(20) for b in range(a + 1, 21)]
    return {int(text[a:b]) for text in texts for a, b in spans if text[a:b]}


def check_rows(path, numbers):
    in_ms, seen = {value * 1e3 for value in numbers}, 0
    try:
        for row in print_rows(path, LENIENT):
            for cell in row:
                if isinstance(cell, float) and np.isfinite(cell):
                    assert cell in numbers or cell in in_ms, cell
                    seen += 1
    except FembridgeError:
        return seen
    return seen


def check_status(path, content, _):
    read_quietly(read_sta if path.suffix == ".sta" else read_cvg, path)
    return check_rows(path, numbers_of(content))


def check_deck(path, content, _):
    wholes = {int(m[1]) for m in WHOLE.finditer(content)} | {0}
    sets = read_quietly(read_node_sets, path) or {}
    for piece in (piece for pieces in sets.values() for piece in pieces):
        assert piece.start in every_part(wholes)
    return len(sets)


def read_quietly(reader, path):
    """What `reader` makes of a damaged file: None where it is refused, whatever it warns of."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FembridgeWarning)
        try:
            return reader(path)
        except FembridgeError:
            return None


KINDS = {
    "ascii": ("job.frd", check_frd, 1, 0.25),
    "float32": ("job.frd", check_frd, 2, 0.15),
    "float64": ("job.frd", check_frd, 3, 0.15),
    "long exponents": ("job.frd", check_frd, 4, 0.1),
    "dat": ("job.dat", check_dat, 0, 0.15),
    "sta": ("job.sta", check_status, 0, 0.24),
    "cvg": ("job.cvg", check_status, 0, 0.24),
    "deck": ("job.inp", check_deck, 0, 0.08),
}
TEXTS = {"dat": DAT, "sta": STA, "cvg": CVG, "deck": DECK}


@pytest.mark.parametrize("kind", KINDS)
def test_no_mutation_crashes_hangs_or_makes_up_a_number(kind, small_run, write_frd, tmp_path):
    name, check, flag, share = KINDS[kind]
    if not (content := TEXTS.get(kind)):
        long = {"number": lambda x: f"{x:.5E}"[:-2] + "000"} if flag == 4 else {"flag": flag}
        mesh_flag = 2 if flag in (2, 3) else 1
        content = write_frd(small_run(3, **long), mesh_flag=mesh_flag).read_bytes()
    path: Path = tmp_path / name
    rng = np.random.default_rng(20261121)
    longest_s, seen = 0.0, 0
    rounds = max(FEWEST, int(MUTATIONS * share))
    for round_ in range(rounds):
        changed = mutated(content, rng)
        path.unlink(missing_ok=True)  # else the disk is waited for
        path.write_bytes(changed)
        begin = time.process_time()
        try:
            seen += check(path, changed, flag)
        except Exception as error:
            keep = tmp_path / f"round_{round_}_{name}"
            keep.write_bytes(changed)
            raise AssertionError(f"round {round_}, kept as {keep}") from error
        longest_s = max(longest_s, time.process_time() - begin)
    assert longest_s < LONGEST_S
    assert seen > rounds / 3  # not all were refused
