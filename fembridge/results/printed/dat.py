"""The ``.dat`` file: what ``*NODE PRINT`` and ``*EL PRINT`` asked for.

 total force (fx,fy,fz) for set NTOP and time  0.5000000E-03

        2.724901E-13 -1.466055E-02  3.393358E-14

A section does not say how long it is. One that was cut shows itself by a last
line without an end, or by fewer records than the section before it had.
Tensors are printed xx yy zz xy xz yz and leave here in the order of the
``.frd``, xx yy zz xy yz zx.
"""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.printed.dat_section import DatSection, dat_sections
from fembridge.results.read_options import ReadOptions, in_pa
from fembridge.results.stress import von_mises_pa
from fembridge.trace import StressTrace
from fembridge.typing import FloatArray, IntArray, Table

STRESSES = "stresses"
POINTS_AN_ELEMENT = 100  # no element has more; makes one number of element and point
_FRD_ORDER = [0, 1, 2, 3, 5, 4]  # xx yy zz xy yz zx of xx yy zz xy xz yz
_DEFAULTS = ReadOptions()


def read_sections(
    path: Path, quantity: str, set_name: str | None = None, options: ReadOptions = _DEFAULTS
) -> list[DatSection]:
    """Read all sections of `quantity` ("forces", "stresses", ...), in file order.

    Raises
    ------
    ResultError
        There is no such file or no such section; the file is cut, and
        `options.partial` is not set; a record is not one.
    """
    held: dict[str, int] = {}
    asked = None if set_name is None else set_name.casefold()
    sections = list(
        dat_sections(
            path,
            lambda name, of: name == quantity and (asked is None or of.casefold() == asked),
            options,
            held,
        )
    )
    if not sections:
        wanted = quantity if set_name is None else f"{quantity} for set {set_name}"
        words = "; ".join(held) or "nothing"
        raise ResultError(f"no {wanted} in it, it holds {words}", path)
    return sections


def read_total_force(
    path: Path, set_name: str, options: ReadOptions = _DEFAULTS
) -> tuple[FloatArray, FloatArray]:
    """Sum of the nodal forces on a set: ``(T,)`` in ms and ``(T, 3)`` in N."""
    times_ms, _, forces_n = _history(path, "total force", set_name, options)
    if forces_n.shape[1] != 1:
        raise ResultError(f"{forces_n.shape[1]} total forces at one time", path)
    return times_ms, forces_n[:, 0]


def read_node_print(
    path: Path, quantity: str, set_name: str, options: ReadOptions = _DEFAULTS
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Nodal values of a set: ``(T,)`` in ms, ``(node,)``, ``(T, node, column)``."""
    times_ms, labels, values = _history(path, quantity, set_name, options)
    if labels.shape[1] != 1:
        raise ResultError(f"{quantity} is not printed by node", path)
    return times_ms, labels[:, 0], values


def read_point_stress(
    path: Path, set_name: str | None = None, options: ReadOptions = _DEFAULTS
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Stress at integration points, which no averaging has touched.

    Returns
    -------
    times_ms, points, tensor_pa
        ``(T,)``; element and point ``(point, 2)``; ``(T, point, 6)`` in Pa,
        order xx yy zz xy yz zx.

    Raises
    ------
    ResultError
        No stresses of that set; without `set_name`, of more than one set; the
        file is cut, or a value is no finite number.
    """
    times_ms, points, values = _history(path, STRESSES, set_name, options)
    if values.shape[2] != 6 or points.shape[1] != 2:
        raise ResultError(f"{values.shape[2]} stress components, expected 6", path)
    tensor_pa = in_pa(values[:, :, _FRD_ORDER], options, path)
    return times_ms, points, tensor_pa


def read_point_traces(
    path: Path,
    points: Sequence[tuple[int, int]],
    set_name: str | None = None,
    options: ReadOptions = _DEFAULTS,
) -> list[StressTrace]:
    """Von Mises stress at integration points ``(element, point)``, in that order.

    A trace has one number for its place: `node` is element times 100 plus point.

    Raises
    ------
    ResultError
        As for `read_point_stress`; also a point that is not printed.
    """
    times_ms, held, tensor_pa = read_point_stress(path, set_name, options)
    rows = {(int(e), int(p)): row for row, (e, p) in reversed([*enumerate(held)])}
    with np.errstate(over="ignore"):  # a trace refuses what is not finite
        stress_pa = von_mises_pa(tensor_pa)
    traces = []
    for element, point in points:
        row = rows.get((element, point))
        if row is None:
            raise ResultError(_absent(element, point, held), path)
        samples = zip(times_ms.tolist(), stress_pa[:, row].tolist(), strict=True)
        node = element * POINTS_AN_ELEMENT + point
        traces.append(StressTrace.on_grid(node, list(samples), path))
    return traces


def describe(path: Path) -> Table:
    """Tell which sections the file holds, and whether its last line is whole."""
    heard: list[str] = []
    held: dict[str, int] = {}
    options = ReadOptions(partial=True, tell=heard.append)
    for _ in dat_sections(path, lambda *_: False, options, held):
        raise AssertionError("nothing was wanted")
    cut = [words for words in heard if words.startswith("cut")]
    return {
        "format": "ccx-dat",
        "bytes": path.stat().st_size,
        "sections": held,
        "remarks": [words for words in heard if words not in cut],
        "problem": cut[0] if cut else None,
    }


def _absent(element: int, point: int, held: IntArray) -> str:
    of_element = held[held[:, 0] == element, 1]
    if of_element.size:
        words = f"it has {of_element.min()} to {of_element.max()}"
    else:
        words = f"elements are {held[:, 0].min()} to {held[:, 0].max()}"
    return f"element {element}, point {point} is not printed: {words}"


def _history(
    path: Path, quantity: str, set_name: str | None, options: ReadOptions
) -> tuple[FloatArray, IntArray, FloatArray]:
    sections = read_sections(path, quantity, set_name, options)
    first = sections[0]
    sets = list(dict.fromkeys(section.set_name for section in sections))
    if len(sets) > 1:
        raise ResultError(
            f"{quantity} are there for {len(sets)} sets, {', '.join(sets)}: name one (--print-set)",
            path,
        )
    if not first.over_time:
        raise ResultError(f"{quantity} of modes or frequencies, no history over time", path)
    if not len(first.values):
        raise ResultError(f"{first}: no records", path)
    if options.partial and len(sections) > 1:
        last = sections[-1]
        if last.labels.shape[0] < first.labels.shape[0]:
            options.note(f"dropped {quantity} at {last.time_ms:g} ms: cut")
            sections.pop()
    for before, section in pairwise(sections):
        _check_pair(path, first, before, section)
    times_ms = np.array([section.time_ms for section in sections])
    values = np.stack([part.values for part in sections])
    _check_finite(path, first, times_ms, values)
    return times_ms, first.labels, values


def _check_pair(path: Path, first: DatSection, before: DatSection, section: DatSection) -> None:
    same = first.values.shape == section.values.shape
    if not same or not np.array_equal(section.labels, first.labels):
        raise ResultError(
            f"{section}: {len(section.labels)} records, expected the "
            f"{len(first.labels)} of {first.time_ms:g} ms in the same order",
            path,
        )
    if not section.time_ms > before.time_ms:
        raise ResultError(f"{section} comes after {before.time_ms:g} ms", path)


def _check_finite(path: Path, first: DatSection, times_ms: FloatArray, values: FloatArray) -> None:
    bad = np.argwhere(~np.isfinite(values))
    if bad.size:
        row, record, column = bad[0]
        labels = zip(first.label_names, first.labels[record].tolist(), strict=True)
        where = ", ".join(f"{name} {label}" for name, label in labels)
        raise ResultError(
            f"{where or first.quantity} at {times_ms[row]:g} ms: "
            f"{first.columns[column]} is {values[row, record, column]}",
            path,
        )
