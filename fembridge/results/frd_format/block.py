"""One result block of a ``.frd``: what its header says and how its records lie.

    1PSTEP                         2           1           1
  100CL  101 5.00000E-04          47                     0    1           1
 -4  STRESS      6    1
 -5  SXX         1    4    1    1

Flags: 0 ASCII with ids of 5 characters, 1 ASCII with 10, 2 float32, 3 float64.
"""

import re
from dataclasses import dataclass

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.trace import MS_PER_S

VALUES_A_LINE = 6
_STEP_OF_ITERATIONS = re.compile(rb"STP *(\d+)INC *(\d+)")
_TIME = re.compile(rb"\d+\.\d*(?:[Ee][+-]\d{2,3})?")
_STATIC, _DYNAMIC, _FREQUENCY, _BUCKLING = 0, 1, 2, 4
_MOST_COMPONENTS = 10_000  # announced by a header; what is beyond is no header
_KEPT_NAMES = 32


@dataclass(frozen=True, slots=True)
class FrdOutput:
    """Which output of a job a block belongs to.

    `value` is the number that a ``100CL`` line holds: the total time, or the
    frequency of a mode, or its buckling factor.
    """

    value: float
    analysis: int = _STATIC
    modal: bool = False

    @property
    def over_time(self) -> bool:
        """Whether `value` is a time: in static and dynamic steps alone."""
        return not self.modal and self.analysis in (_STATIC, _DYNAMIC)

    @property
    def axis(self) -> str:
        """What `value` is."""
        if self.analysis == _BUCKLING:
            return "buckling factor"
        if self.modal:
            return "frequency in cycles per time"
        return "total time" if self.over_time else "number of the analysis"


@dataclass(frozen=True, slots=True)
class FrdBlock:
    """One quantity at one increment, and where in the file its records are.

    `time_ms` is the total time over all steps. `components` are those stored
    (``ALL``, the length of a vector, is announced and not stored). `free` marks
    ASCII records of unequal length (exponents of three digits): they have to be
    read line by line. `modal` marks a mode of a frequency or buckling analysis:
    its `increment` is the number of the mode, and it has no time: `output` tells
    its frequency or factor.
    """

    name: str
    step: int
    increment: int
    time_ms: float
    records: int
    components: tuple[str, ...]
    flag: int
    offset: int
    line_end: int = 1
    free: bool = False
    modal: bool = False
    output: FrdOutput = FrdOutput(0.0)

    @property
    def binary(self) -> bool:
        """Whether the records are packed numbers."""
        return self.flag >= 2

    @property
    def id_width(self) -> int:
        """Characters of a node's number in an ASCII record."""
        return 5 if self.flag == 0 else 10

    @property
    def record_bytes(self) -> int:
        """Length of one record: every record of a block has the same."""
        values = len(self.components)
        if self.binary:
            return 4 + (4 if self.flag == 2 else 8) * values
        lines = -(-values // VALUES_A_LINE)
        return lines * (3 + self.id_width + self.line_end) + 12 * values

    @property
    def end(self) -> int:
        """Where the records end, if their length is regular."""
        return self.offset + self.records * self.record_bytes

    @property
    def key(self) -> tuple[int, int]:
        """Step and increment: what joins the blocks of one output."""
        return self.step, self.increment

    def __str__(self) -> str:
        what = "mode" if self.modal else "increment"
        return f"{self.name} of step {self.step}, {what} {self.increment}"


@dataclass(frozen=True, slots=True)
class _Names:
    """The ``-4`` and ``-5`` lines of a quantity, which every increment repeats."""

    text: bytes
    name: str
    components: tuple[str, ...]
    line_end: int


class HeaderReader:
    """Reads the headers of blocks; the names of a quantity only once."""

    def __init__(self, file: ByteFile) -> None:
        self._file = file
        self._known: list[_Names] = []
        self._place = 0  # in _known, of the quantity before

    def read(self, offset: int, key: tuple[int, int], mode: int | None) -> FrdBlock:
        """Read the ``100CL`` line at `offset` and the ``-4``, ``-5`` lines below it.

        `records` of the block is -1 where an ASCII header leaves the count blank.

        Raises
        ------
        ResultError
            A line is cut, or is not what stands there in a result block.
        """
        where = f"block header of step {key[0]}, increment {key[1]}"
        line, at = self._line(offset, "100CL", where)
        try:
            output = _output(line)
            flag = _count(line[73:75])
            if flag > 3:
                raise ValueError(f"format flag {flag}")
            blank = flag < 2 and not line[24:36].strip()
            records = -1 if blank else _count(line[24:36])
            if output.modal:
                key = key[0], _count(line[58:63]) if mode is None else mode
            names = self._names(at, where)
        except ValueError as error:  # also UnicodeDecodeError
            raise ResultError(
                f"{where} at byte {offset} cannot be read: {error}", self._file.path
            ) from error
        step, increment = key
        return FrdBlock(
            name=names.name,
            step=step,
            increment=increment,
            time_ms=output.value * MS_PER_S,
            records=records,
            components=names.components,
            flag=flag,
            offset=at + len(names.text),
            line_end=names.line_end,
            modal=output.modal,
            output=output,
        )

    def _names(self, offset: int, where: str) -> _Names:
        count = len(self._known)
        for place in range(self._place + 1, self._place + 1 + count):
            names = self._known[place % count]  # quantities follow in turn
            if self._file.holds(offset, names.text):
                self._place = place % count
                return names
        line, at = self._line(offset, "-4", where)
        name = line[5:13].decode("ascii").strip()
        announced = _count(line[13:18])
        if not line.startswith(b" -4") or not name:
            raise ValueError(f"{line[:40]!r} where a name is expected")
        if announced > _MOST_COMPONENTS:
            raise ValueError(f"{name} announces {announced} components")
        components, line_end = [], 1
        for _ in range(announced):
            before = at
            line, at = self._line(at, name, where)
            if not line.startswith(b" -5"):
                raise ValueError(f"{name} announces {announced} components, then {line[:40]!r}")
            if line[33:38].strip() != b"1":
                components.append(line[5:13].decode("ascii").strip())
            line_end = at - before - len(line)
        if not components:
            raise ValueError(f"{name} without components")
        text = self._file.take(offset, at - offset)
        names = _Names(text, name, tuple(components), line_end)
        del self._known[: 1 - _KEPT_NAMES]
        self._known.append(names)
        self._place = len(self._known) - 1
        return names

    def _line(self, offset: int, what: str, where: str) -> tuple[bytes, int]:
        found = self._file.line(offset)
        if found is None:
            raise ResultError(
                f"{where} is cut in its {what} lines, at byte {offset} of "
                f"{self._file.size}: {self._file.why_no_line(offset)}",
                self._file.path,
            )
        return found


def read_step(line: bytes) -> tuple[int, int]:
    """Give step and increment of a ``1PSTEP`` line.

    Raises
    ------
    ValueError
        They are not where they should be.
    """
    iterations = _STEP_OF_ITERATIONS.match(line, 24)
    if iterations:
        return int(iterations[1]), int(iterations[2])
    return _count(line[48:60]), _count(line[36:48])


def read_mode(line: bytes) -> int:
    """Give the number of the mode of a ``1PMODE`` line.

    Raises
    ------
    ValueError
        It is not where it should be.
    """
    return _count(line[24:36])


def _output(line: bytes) -> FrdOutput:
    text = line[12:24].strip()
    if not _TIME.fullmatch(text):
        raise ValueError(f"time {line[12:24]!r}")
    word = line[56:58].strip()
    analysis = _count(word) if word else _STATIC
    modal = analysis in (_FREQUENCY, _BUCKLING) or line[63:73].strip() == b"MODAL"
    return FrdOutput(float(text), analysis, modal)


def _count(field: bytes) -> int:
    text = field.strip()
    if not text.isdigit():
        raise ValueError(f"{field.decode('latin-1')!r} where a count is expected")
    return int(text)
