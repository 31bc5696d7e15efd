"""Binary post files: unformatted sequential records of Fortran.

A record is its length, what it holds, and its length again. Text has one
character in the first byte of every word. Words are of four bytes in all files
seen; where the record of the verification data is twice as long they are of
eight. Reals are of four or eight bytes by the length of their record. A negative
length says that the record goes on in the next piece, as compilers write records
of more than 2^31 bytes: inferred from them, not seen.
"""

import struct

import numpy as np

from fembridge.results.byte_file import ByteFile
from fembridge.results.marc_format.irregular_numbers import Pieces, Split, take_pieces
from fembridge.results.marc_format.number_format import NumberFormat, packed
from fembridge.results.marc_format.numbers import Grid, Numbers, Run
from fembridge.results.marc_format.records import BEGIN, END, MARKS, PostDamageError

TITLE_WORDS = 70
_MARKER = 4  # bytes of a record's length
_LABEL_WORDS, _LONG_LABEL_WORDS = 24, 48
_LONGEST_TEXT = 1 << 16
_MARK_BYTES = 4  # **** and its like are packed, not one character a word


class BinaryRecords:
    """The records of a binary file, of words of `word_bytes`."""

    kind = "t16"

    def __init__(self, file: ByteFile, big_endian: bool, word_bytes: int) -> None:
        self.file = file
        self.at = 0
        self.free: list[tuple[int, int]] = []
        self.byte_order = "big" if big_endian else "little"
        self.real_bytes = 4
        self._big_endian = big_endian
        self._word_bytes = self._integer_bytes = word_bytes
        self._word_lengths = (_MARK_BYTES, len(END) * word_bytes, TITLE_WORDS * word_bytes)
        self._length = struct.Struct(">i" if big_endian else "<i")

    def word(self) -> str:
        """Give the word that stands here; "" if none does, or the file ends."""
        head = self.file.peek(self.at, _MARKER)
        if len(head) < _MARKER:
            return ""
        length = self._length.unpack(head)[0]
        if length not in self._word_lengths:
            return ""
        raw = self.file.peek(self.at + _MARKER, length)
        if length > _MARK_BYTES:
            raw = raw[:: self._word_bytes]
        text = raw.decode("latin-1").rstrip()
        known = text in MARKS or text == END or text.startswith(BEGIN)
        return text if known else ""

    def pass_word(self) -> None:
        """Go behind the word that stands here."""
        _, self.at = self._record()

    def text(self, free: bool = False) -> str:
        """Read a record of text, without blanks at its ends."""
        pieces, after = self._record()
        found = self._text(self._payload(pieces, self.at))
        self._pass(pieces, after, free)
        return found

    def text_of(self, raw: bytes) -> str:
        """Give the text of a whole record that is in memory."""
        return self._text(raw[_MARKER:-_MARKER])

    def label(self) -> tuple[list[int], str]:
        """Read a record of integers and a text: an element post code."""
        pieces, after = self._record()
        raw = self._payload(pieces, self.at)
        words = len(raw) // self._word_bytes
        letters = _LONG_LABEL_WORDS if words > _LONG_LABEL_WORDS else _LABEL_WORDS
        if not 0 < words - letters <= 2 or len(raw) % self._word_bytes:
            raise PostDamageError(f"a post code in a record of {len(raw)} bytes", self.at)
        cut = (words - letters) * self._word_bytes
        numbers = self._decode(raw[:cut], self._integer_bytes, self.at)
        self._pass(pieces, after, free=False)
        return numbers, self._text(raw[cut:])

    def integers(self, count: int | None = None, free: bool = False) -> list[int]:
        """Read a record of `count` integers; None takes what is there."""
        pieces, after = self._record()
        length = sum(size for _, size in pieces)
        width = self._integer_bytes
        if count is None:
            count = length // width
        if length != count * width:
            raise PostDamageError(
                f"a record of {length} bytes where {count} integers of {width} bytes are expected",
                self.at,
            )
        numbers = self._decode(self._payload(pieces, self.at), width, self.at)
        self._pass(pieces, after, free)
        return numbers

    def verification(self, first: int, second: int) -> list[int]:
        """Read the records of `first` and `second` integers; learn their width."""
        pieces, _ = self._record()
        for width in (4, 8):
            if sum(size for _, size in pieces) == first * width:
                self._integer_bytes = width
        return self.integers(first) + self.integers(second)

    def table(self, rows: int, integers: int, reals: int) -> tuple[Numbers | None, Numbers | None]:
        """Pass `rows` records alike: `integers`, then `reals`; None for none."""
        if rows == 0 or integers + reals == 0:
            return None, None
        start = self.at
        pieces, after = self._record()
        payload, stride = pieces[0][1], after - start
        before = integers * self._integer_bytes
        width = (payload - before) // reals if reals else 4
        if len(pieces) > 1 or payload != before + reals * width or width not in (4, 8):
            raise PostDamageError(
                f"a record of {payload} bytes where {integers} integers and {reals} "
                "reals are expected",
                start,
            )
        whole = (self.file.size - start) // stride
        if rows > whole:
            raise PostDamageError(f"cut after {whole} of {rows} records", self.file.size)
        marker = self._length.pack(payload)
        last = start + (rows - 1) * stride
        for at in (last, last + stride - _MARKER):
            if not self.file.holds(at, marker):
                raise PostDamageError(f"{rows} records of {payload} bytes: not so", at)
        self.at = start + rows * stride
        self.free.append((start + _MARKER, self.at - _MARKER))
        if reals:
            self.real_bytes = max(self.real_bytes, width)
        fixed = ((0, marker), (stride - _MARKER, marker))

        def part(offset: int, count: int, form: NumberFormat) -> Grid | None:
            run = Run(_MARKER + offset, count)
            return Grid(start, rows, stride, (run,), form, fixed) if count else None

        return (
            part(0, integers, packed(self._integer_bytes, True, self._big_endian)),
            part(before, reals, packed(width, False, self._big_endian)),
        )

    def flow(self, rows: int, columns: int) -> Numbers:
        """Pass one record of `rows` times `columns` reals."""
        pieces, after = self._record()
        length, count = sum(size for _, size in pieces), rows * columns
        width = length // count if count else 4
        if length != count * width or width not in (4, 8):
            raise PostDamageError(
                f"a record of {length} bytes where {rows} times {columns} reals are expected",
                self.at,
            )
        self._pass(pieces, after, free=True)
        form = packed(width, False, self._big_endian)
        if len(pieces) > 1:
            return Split(pieces, rows, columns, form)
        run = Run(0, columns)
        return Grid(pieces[0][0], rows, columns * width, (run,), form)

    def empty(self) -> None:
        """Pass a record of nothing, if one stands here."""
        if self.file.holds(self.at, bytes(2 * _MARKER)):
            self.at += 2 * _MARKER

    def pass_block(self) -> None:
        """Go to the ``=end=`` of the block that we are in."""
        while (word := self.word()) != END:
            if word.startswith(BEGIN) or word in MARKS:
                raise PostDamageError(f"{word!r} before the block's =end=", self.at)
            pieces, after = self._record()
            self._pass(pieces, after, free=True)

    def _record(self) -> tuple[Pieces, int]:
        """Give the pieces of the record here, and where the next begins."""
        at, pieces = self.at, []
        while True:
            length = self._marker(at)
            size = abs(length)
            end = at + _MARKER + size
            if end + _MARKER > self.file.size:
                raise PostDamageError(
                    f"cut: a record of {size} bytes begins here and the file ends at "
                    f"byte {self.file.size}",
                    at,
                )
            if abs(self._marker(end)) != size:
                raise PostDamageError(
                    f"a record of {size} bytes that ends in {self._marker(end)}", at
                )
            pieces.append((at + _MARKER, size))
            at = end + _MARKER
            if length >= 0:
                return tuple(pieces), at

    def _marker(self, at: int) -> int:
        raw = self.file.peek(at, _MARKER)
        if len(raw) < _MARKER:
            raise PostDamageError("cut", self.file.size)
        return int(self._length.unpack(raw)[0])

    def _pass(self, pieces: Pieces, after: int, free: bool) -> None:
        if free:
            self.free.extend((at, at + size) for at, size in pieces)
        self.at = after

    def _payload(self, pieces: Pieces, at: int) -> bytes:
        length = sum(size for _, size in pieces)
        if length > _LONGEST_TEXT:
            raise PostDamageError(f"a record of {length} bytes among short ones", at)
        return take_pieces(self.file, pieces, 0, length)

    def _text(self, raw: bytes) -> str:
        return raw[:: self._word_bytes].decode("latin-1").strip(" \0")

    def _decode(self, raw: bytes, width: int, at: int) -> list[int]:
        if len(raw) % width:
            raise PostDamageError(f"{len(raw)} bytes are no integers of {width}", at)
        order = ">" if self._big_endian else "<"
        found: list[int] = np.frombuffer(raw, dtype=f"{order}i{width}").tolist()
        return found
