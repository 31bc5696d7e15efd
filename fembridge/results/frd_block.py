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


@dataclass(frozen=True, slots=True)
class FrdBlock:
    """One quantity at one increment, and where in the file its records are.

    `time_ms` is the total time over all steps. `components` are those stored
    (``ALL``, the length of a vector, is announced and not stored). `free` marks
    ASCII records of unequal length (exponents of three digits): they have to be
    read line by line. `modal` marks an eigenmode, whose "time" is a frequency.
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
        return f"{self.name} of step {self.step}, increment {self.increment}"


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


def read_header(file: ByteFile, offset: int, key: tuple[int, int]) -> FrdBlock:
    """Read the ``100CL`` line at `offset` and the ``-4``, ``-5`` lines below it.

    Raises
    ------
    ResultError
        A line is cut, or is not what stands there in a result block.
    """
    step, increment = key
    line, at = _line(file, offset, "100CL", key)
    try:
        if not _TIME.fullmatch(line[12:24].strip()):
            raise ValueError(f"time {line[12:24]!r}")
        time_ms = float(line[12:24]) * MS_PER_S
        records = _count(line[24:36])
        flag = _count(line[73:75])
        if flag > 3:
            raise ValueError(f"format flag {flag}")
        modal = line[63:73].strip() == b"MODAL"
        line, at = _line(file, at, "-4", key)
        name = line[5:13].decode("ascii").strip()
        announced = _count(line[13:18])
        if not line.startswith(b" -4") or not name:
            raise ValueError(f"{line!r} where a name is expected")
        components, line_end = [], 1
        for _ in range(announced):
            before = at
            line, at = _line(file, at, name, key)
            if not line.startswith(b" -5"):
                raise ValueError(
                    f"{name} announces {announced} components, then {line[:40]!r}"
                )
            if line[33:38].strip() != b"1":
                components.append(line[5:13].decode("ascii").strip())
            line_end = at - before - len(line)
        if not components:
            raise ValueError(f"{name} without components")
    except ValueError as error:  # also UnicodeDecodeError
        raise ResultError(
            f"block header of step {step}, increment {increment} at byte {offset} "
            f"cannot be read: {error}",
            file.path,
        ) from error
    return FrdBlock(
        name=name,
        step=step,
        increment=increment,
        time_ms=time_ms,
        records=records,
        components=tuple(components),
        flag=flag,
        offset=at,
        line_end=line_end,
        modal=modal,
    )


def _line(
    file: ByteFile, offset: int, what: str, key: tuple[int, int]
) -> tuple[bytes, int]:
    found = file.line(offset)
    if found is None:
        raise ResultError(
            f"block header of step {key[0]}, increment {key[1]} is cut in its {what} "
            f"lines, at byte {offset} of {file.size}",
            file.path,
        )
    return found


def _count(field: bytes) -> int:
    text = field.strip()
    if not text.isdigit():
        raise ValueError(f"{field.decode('latin-1')!r} where a count is expected")
    return int(text)
