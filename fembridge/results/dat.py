"""The ``.dat`` file: what ``*NODE PRINT`` and ``*EL PRINT`` asked for.

 total force (fx,fy,fz) for set NTOP and time  0.5000000E-03

        2.724901E-13 -1.466055E-02  3.393358E-14

A section does not say how long it is. One that was cut shows itself by a last
line without an end, or by fewer records than the section before it had.
Tensors are printed xx yy zz xy xz yz and leave here in the order of the
``.frd``, xx yy zz xy yz zx.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.read_options import ReadOptions
from fembridge.trace import MS_PER_S
from fembridge.typing import FloatArray, IntArray

_HEADER = re.compile(
    r" (?P<quantity>[A-Za-z][^(]*?) \((?P<columns>[^)]*)\)"
    r" for ?(?:set +(?P<set>.+?)|all contact elements) and time +(?P<time>\S+)"
)
_LABELS = ("elem", "integ.pnt.", "slave element+face")
_VALUE_WIDTH = 14
_VALUE = re.compile(r" +[+-]?\d*\.\d+(E[+-]\d{2}|[+-]\d{3})")
_ODD_VALUE = re.compile(r" +[+-]?(nan|inf|infinity)", re.IGNORECASE)
_FRD_ORDER = [0, 1, 2, 3, 5, 4]  # xx yy zz xy yz zx of xx yy zz xy xz yz


@dataclass(frozen=True, slots=True, eq=False)
class DatSection:
    """One quantity of one set at one time.

    `labels` ``(record, 0 to 2)``: nothing, a node, or element and point (or
    face). `values` ``(record, column)`` as printed, units of the deck.
    """

    quantity: str
    set_name: str
    columns: tuple[str, ...]
    time_ms: float
    labels: IntArray
    values: FloatArray


def read_sections(
    path: Path,
    quantity: str,
    set_name: str | None = None,
    options: ReadOptions = ReadOptions(),  # noqa: B008 - frozen
) -> list[DatSection]:
    """Read all sections of `quantity` ("forces", "stresses", ...), in file order.

    Raises
    ------
    ResultError
        There is no such file or no such section; the file is cut, and
        `options.partial` is not set; a record is not one.
    """
    held: dict[str, None] = {}
    sections = list(_sections(path, quantity, set_name, held, options))
    if not sections:
        wanted = quantity if set_name is None else f"{quantity} for set {set_name}"
        words = "; ".join(held) or "nothing"
        raise ResultError(f"no {wanted} in it, it holds {words}", path)
    return sections


def read_total_force(
    path: Path,
    set_name: str,
    options: ReadOptions = ReadOptions(),  # noqa: B008
) -> tuple[FloatArray, FloatArray]:
    """Sum of the nodal forces on a set: ``(T,)`` in ms and ``(T, 3)`` in N."""
    times_ms, _, forces_n = _history(path, "total force", set_name, options)
    if forces_n.shape[1] != 1:
        raise ResultError(f"{forces_n.shape[1]} total forces at one time", path)
    return times_ms, forces_n[:, 0]


def read_node_print(
    path: Path,
    quantity: str,
    set_name: str,
    options: ReadOptions = ReadOptions(),  # noqa: B008
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Nodal values of a set: ``(T,)`` in ms, ``(node,)``, ``(T, node, column)``."""
    times_ms, labels, values = _history(path, quantity, set_name, options)
    if labels.shape[1] != 1:
        raise ResultError(f"{quantity} is not printed by node", path)
    return times_ms, labels[:, 0], values


def read_point_stress(
    path: Path,
    set_name: str,
    options: ReadOptions = ReadOptions(),  # noqa: B008
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Stress at integration points, which no averaging has touched.

    Returns
    -------
    times_ms, points, tensor_pa
        ``(T,)``; element and point ``(point, 2)``; ``(T, point, 6)`` in Pa,
        order xx yy zz xy yz zx.
    """
    times_ms, points, values = _history(path, "stresses", set_name, options)
    if values.shape[2] != 6:
        raise ResultError(f"{values.shape[2]} stress components, expected 6", path)
    tensor_pa: FloatArray = values[:, :, _FRD_ORDER] * options.pa_per_unit
    return times_ms, points, tensor_pa


def _history(
    path: Path, quantity: str, set_name: str, options: ReadOptions
) -> tuple[FloatArray, IntArray, FloatArray]:
    sections = read_sections(path, quantity, set_name, options)
    first = sections[0]
    if options.partial and len(sections) > 1:
        last = sections[-1]
        if last.labels.shape[0] < first.labels.shape[0]:
            options.note(f"dropped {quantity} at {last.time_ms:g} ms: cut")
            sections.pop()
    for before, section in pairwise(sections):
        if not np.array_equal(section.labels, first.labels):
            raise ResultError(
                f"{quantity} for set {set_name} at {section.time_ms:g} ms: "
                f"{len(section.labels)} records, expected the {len(first.labels)} of "
                f"{first.time_ms:g} ms in the same order",
                path,
            )
        if not section.time_ms > before.time_ms:
            raise ResultError(
                f"{quantity} for set {set_name}: {section.time_ms:g} ms comes after "
                f"{before.time_ms:g} ms",
                path,
            )
    times_ms = np.array([section.time_ms for section in sections])
    return times_ms, first.labels, np.stack([part.values for part in sections])


def _sections(
    path: Path,
    quantity: str,
    set_name: str | None,
    held: dict[str, None],
    options: ReadOptions,
) -> Iterator[DatSection]:
    """Yield what is wanted; note in `held` all that there is."""
    header: re.Match[str] | None = None
    records: list[tuple[list[int], list[float]]] = []
    for number, line in _lines(path, options):
        if not line.strip():
            continue
        if line.lstrip()[0].isalpha() and not _ODD_VALUE.match(line):
            if header is not None:
                yield _section(header, records, path, number)
            header, records = _HEADER.fullmatch(line.rstrip()), []
            if header is not None:
                name = header["set"] or "all contact elements"
                held[f"{header['quantity']} for {name}"] = None
                same = set_name is None or name.casefold() == set_name.casefold()
                if header["quantity"] != quantity or not same:
                    header = None
        elif header is not None:
            records.append(_record(line, header, path, number))
    if header is not None:
        yield _section(header, records, path, None)


def _section(
    header: re.Match[str],
    records: list[tuple[list[int], list[float]]],
    path: Path,
    line: int | None,
) -> DatSection:
    try:
        time_ms = _number(f" {header['time']}") * MS_PER_S
    except ValueError as error:
        raise ResultError(f"time of a section: {error}", path, line) from error
    columns = tuple(name.strip() for name in header["columns"].split(","))
    shape = (len(records), -1) if records else (0, 0)
    return DatSection(
        quantity=header["quantity"],
        set_name=header["set"] or "all contact elements",
        columns=tuple(name for name in columns if name not in _LABELS),
        time_ms=time_ms,
        labels=np.array([r[0] for r in records], dtype=np.int64).reshape(shape),
        values=np.array([r[1] for r in records], dtype=np.float64).reshape(shape),
    )


def _record(
    line: str, header: re.Match[str], path: Path, number: int
) -> tuple[list[int], list[float]]:
    names = [name.strip() for name in header["columns"].split(",")]
    count = sum(name not in _LABELS for name in names)
    expected = 0 if header["quantity"].startswith("total") else 1
    if len(names) > count:
        expected = 2
    split = len(line) - count * _VALUE_WIDTH
    try:
        labels = [int(word) for word in line[: max(split, 0)].split()]
        values = [
            _number(line[at : at + _VALUE_WIDTH])
            for at in range(split, len(line), _VALUE_WIDTH)
        ]
    except ValueError as error:
        raise ResultError(f"no record: {error}", path, number) from error
    if split < 0 or len(labels) != expected:
        raise ResultError(f"no record of {header['quantity']}: {line!r}", path, number)
    return labels, values


def _number(field: str) -> float:
    if _VALUE.fullmatch(field):
        return float(re.sub(r"(?<=\d)(?=[+-])", "E", field))  # 1.000000-101
    if _ODD_VALUE.fullmatch(field):
        return float(field)
    raise ValueError(f"{field!r} is no number")


def _lines(path: Path, options: ReadOptions) -> Iterator[tuple[int, str]]:
    try:
        file = path.open("rb")
    except OSError as error:
        raise ResultError(f"cannot be opened: {error.strerror}", path) from error
    with file:
        for number, line in enumerate(file, start=1):
            if not line.endswith(b"\n"):
                words = f"cut inside a line: {line[:40]!r}"
                if not options.partial:
                    raise ResultError(words, path, number)
                options.note(words)
                return
            yield number, line.decode("latin-1").rstrip("\r\n")
