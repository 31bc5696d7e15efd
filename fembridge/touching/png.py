"""PNG pictures, read only when every checksum holds.

A PNG is a list of chunks, each with a CRC-32, and its pixels are a zlib stream with an
Adler-32 (W3C, PNG Specification, 5.3 and 10.1). Pillow skips both checksums of the pixels:
a changed byte becomes another picture. Here both are compared, and the amount of pixel
data with the size that the header states. The header also bounds the memory before a pixel
is decoded.
"""

import io
import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import UsageError
from fembridge.host.memory import check_memory

SIGNATURE = b"\x89PNG\r\n\x1a\n"
MAX_PIXELS = 20_000_000

# Channels by type of colour, and the depths in bits that each allows.
_COLOURS = {
    0: (1, (1, 2, 4, 8, 16)),  # grey
    2: (3, (8, 16)),  # red, green, blue
    3: (1, (1, 2, 4, 8)),  # palette
    4: (2, (8, 16)),  # grey, opacity
    6: (4, (8, 16)),  # red, green, blue, opacity
}
# Chunks that the pixels depend on. Others (text, profiles, dates) are checked and left out.
_PIXEL_CHUNKS = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")
# First column and row of each pass of an interlaced picture, and the steps between them.
_PASSES = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2),
           (0, 1, 1, 2))  # fmt: skip
# Of a pixel, at most: 8 bytes in Pillow, 8 in its copy, 16 as four numbers, 40 as heights.
_PIXEL_BYTES = 72
_BLOCK_BYTES = 1 << 20


def read_png(path: Path, content: bytes) -> NDArray[np.float32]:
    """Pixels of a PNG, ``(row, column)`` or ``(row, column, 3 or 4)``, from 0 to 1.

    Raises
    ------
    UsageError
        Not a PNG, cut, a checksum that fails, or more than `MAX_PIXELS`.
    """
    sound = _checked(path, content)
    from matplotlib.image import imread

    try:
        return np.asarray(imread(io.BytesIO(sound), format="png"), dtype=np.float32)
    except Exception as error:  # Pillow raises many kinds
        raise UsageError(f"{path}: not a PNG picture that can be decoded: {error}") from error


def _checked(path: Path, content: bytes) -> bytes:
    """The PNG with the chunks alone that its pixels depend on, all checksums compared."""
    if not content.startswith(SIGNATURE):
        raise UsageError(
            f"{path}: not a PNG picture, expected .png or .csv: other pictures have no checksums, "
            "save it as PNG"
        )
    kept = [SIGNATURE]
    pixel_data: list[bytes] = []
    pixel_bytes, previous, start = -1, b"", len(SIGNATURE)
    while previous != b"IEND":
        if start + 12 > len(content):
            raise UsageError(f"{path}: a PNG that is cut: {len(content)} bytes and no IEND")
        (length,) = struct.unpack_from(">I", content, start)
        name, end = content[start + 4 : start + 8], start + 12 + length
        if end > len(content):
            raise UsageError(f"{path}: a PNG that is cut, or damaged at byte {start}")
        (stated,) = struct.unpack_from(">I", content, end - 4)
        if zlib.crc32(memoryview(content)[start + 4 : end - 4]) != stated:
            raise UsageError(
                f"{path}: the checksum of {_name_text(name)} at byte {start} is wrong: damaged"
            )
        body = content[start + 8 : end - 4]
        if not previous:
            if name != b"IHDR":
                raise UsageError(f"{path}: {_name_text(name)} where a PNG has IHDR: damaged")
            pixel_bytes = _pixel_bytes(path, body)
        elif name == b"IHDR" or (name == b"IDAT" and pixel_data and previous != b"IDAT"):
            raise UsageError(f"{path}: {_name_text(name)} twice in a PNG, at byte {start}: damaged")
        if name == b"IDAT":
            pixel_data.append(body)
        if name in _PIXEL_CHUNKS:
            kept.append(content[start:end])
        elif not name[0] & 0x20:  # a capital: a decoder must know it
            raise UsageError(f"{path}: chunk {_name_text(name)} is of no PNG: damaged")
        previous, start = name, end
    _check_pixel_data(path, pixel_data, pixel_bytes)
    return b"".join(kept)


def _pixel_bytes(path: Path, header: bytes) -> int:
    """Bytes of the pixels, filters included, that an IHDR states."""
    if len(header) != 13:
        raise UsageError(f"{path}: a PNG whose IHDR has {len(header)} bytes, expected 13")
    columns, rows, depth, colour, compression, filters, interlace = struct.unpack(
        ">IIBBBBB", header
    )
    channels, depths = _COLOURS.get(colour, (0, ()))
    if not columns or not rows or depth not in depths or compression or filters or interlace > 1:
        raise UsageError(
            f"{path}: a PNG of {columns} x {rows} pixels, type {colour} with {depth} bits, "
            f"interlace {interlace}: no such picture"
        )
    if columns * rows > MAX_PIXELS:
        raise UsageError(f"{path}: {columns} x {rows} pixels, expected at most {MAX_PIXELS} in all")
    check_memory(_PIXEL_BYTES * columns * rows, f"{path}: a picture of this size", UsageError)
    size = 0
    for first_column, first_row, column_step, row_step in _PASSES if interlace else ((0, 0, 1, 1),):
        width = -(-max(columns - first_column, 0) // column_step)
        height = -(-max(rows - first_row, 0) // row_step)
        if width:
            size += height * (1 + -(-width * channels * depth // 8))
    return size


def _check_pixel_data(path: Path, pixel_data: list[bytes], pixel_bytes: int) -> None:
    """Unpack the pixels block by block, to compare their size and their Adler-32."""
    unpack, size = zlib.decompressobj(), 0
    try:
        for body in pixel_data:
            packed = body
            while packed and not unpack.eof and size <= pixel_bytes:
                size += len(unpack.decompress(packed, _BLOCK_BYTES))
                packed = unpack.unconsumed_tail
        if size <= pixel_bytes:
            size += len(unpack.flush())
    except zlib.error as error:
        raise UsageError(f"{path}: damaged pixel data: {error}") from error
    if size != pixel_bytes or not unpack.eof:
        amount = "more" if size > pixel_bytes else "less"
        raise UsageError(f"{path}: {amount} pixel data than its header states: cut or damaged")


def _name_text(name: bytes) -> str:
    return ascii(name.decode("latin-1"))
