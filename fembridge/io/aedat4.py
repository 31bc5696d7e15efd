"""AEDAT4, the file format of event cameras: events with time, pixel and polarity.

A file is the line ``#!AER-DAT4.0``, a header, packets of events and a table of the packets. Header,
packets and table are FlatBuffers, each behind its size; a packet also has the number of its stream
and its size in front. The specification is that of iniVation's dv-processing; nothing here is
compressed. Only what this needs of FlatBuffers is written: each buffer has a fixed layout.
"""

import struct
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from fembridge.typing import IntArray

EVENT = np.dtype(
    {
        "names": ["t", "x", "y", "p"],
        "formats": ["<i8", "<i2", "<i2", "?"],
        "offsets": [0, 8, 10, 12],
        "itemsize": 16,
    }
)
"""An event as a packet has it: time in us, pixel, polarity."""

_MAGIC = b"#!AER-DAT4.0\r\n"
_STREAM = 0
_MOST_EVENTS = 1 << 14  # of a packet
_PACKET_US = 10_000  # readers play a file packet by packet
_PATH = "/mainloop/Recorder/outInfo/"


def write_aedat4(path: Path, events: NDArray[np.void], size: tuple[int, int]) -> None:
    """Write `events` ``(event,)`` of any fields ``t, x, y, p``, by time, on `size` pixels.

    `size` is width and height.
    """
    rows = np.zeros(events.size, dtype=EVENT)
    for name in ("t", "x", "y", "p"):
        rows[name] = events[name]
    with path.open("wb") as file:
        file.write(_MAGIC)
        # The header has a fixed length, so the position of the table can be filled in.
        file.write(_header(0, size))
        packets = []
        for first, end in _packets(rows["t"]):
            part = rows[first:end]
            content = _event_packet(part)
            file.write(struct.pack("<ii", _STREAM, len(content)))
            packets.append((file.tell(), len(content), part))  # behind its number and size
            file.write(content)
        position = file.tell()
        file.write(_packet_table(packets))
        file.seek(len(_MAGIC))
        file.write(_header(position, size))


def _packets(time_us: IntArray) -> list[tuple[int, int]]:
    """First and end event of each packet."""
    parts, first = [], 0
    while first < time_us.size:
        end = int(np.searchsorted(time_us, time_us[first] + _PACKET_US))
        end = min(end, first + _MOST_EVENTS)
        parts.append((first, end))
        first = end
    return parts


def _prefixed(buffer: bytes) -> bytes:
    """`buffer` behind its size, padded to 8 bytes with it."""
    padded = buffer + bytes(-(len(buffer) + 4) % 8)
    return struct.pack("<I", len(padded)) + padded


def _header(table_position: int, size: tuple[int, int]) -> bytes:
    """IOHeader: compression (none), position of the table of packets, and streams as XML."""
    text = _streams(size).encode()
    # Positions count from the size: 4 root, 8 name, 12 vtable of three fields, 24 table, 44 text.
    return _prefixed(
        struct.pack("<I4s", 24 - 4, b"IOHE")
        + struct.pack("<HHHHH2x", 10, 20, 16, 8, 4)
        + struct.pack("<iIqi", 24 - 12, 44 - 28, table_position, 0)
        + struct.pack("<I", len(text))
        + text
        + b"\0"
    )


def _event_packet(events: NDArray[np.void]) -> bytes:
    """EventPacket: a vector of events, which begins at position 32 of the buffer."""
    return _prefixed(
        struct.pack("<I4s", 20 - 4, b"EVTS")
        + struct.pack("<HHH2x", 6, 8, 4)
        + struct.pack("<iI", 20 - 12, 28 - 24)
        + struct.pack("<I", events.size)
        + events.tobytes()
    )


def _packet_table(packets: list[tuple[int, int, NDArray[np.void]]]) -> bytes:
    """FileDataTable: of each packet its position, size, number of events, first and last time."""
    # 4 root, 8 name, 12 vtable of the table, 20 table, 28 vector; then a vtable and the rows.
    rows_start = 32 + 4 * len(packets)
    vtable = rows_start + (-rows_start) % 4
    first_row = vtable + 14 + (-(vtable + 14 + 4)) % 8  # its numbers of 8 bytes begin 4 later
    row_bytes = 48
    content = struct.pack("<I4s", 20 - 4, b"FTAB")
    content += struct.pack("<HHH2x", 6, 8, 4)
    content += struct.pack("<iI", 20 - 12, 28 - 24)
    content += struct.pack("<I", len(packets))
    for row in range(len(packets)):
        content += struct.pack("<I", first_row + row * row_bytes - (32 + 4 * row))
    content += bytes(vtable - rows_start)
    content += struct.pack("<HHHHHHH", 14, 44, 4, 12, 20, 28, 36)
    content += bytes(first_row - (vtable + 14))
    for row, (position, size, events) in enumerate(packets):
        start = first_row + row * row_bytes
        times = int(events["t"][0]), int(events["t"][-1])
        content += struct.pack(
            "<iqiiqqq4x", start - vtable, position, _STREAM, size, events.size, *times
        )
    return _prefixed(content)


def _streams(size: tuple[int, int]) -> str:
    """The streams of the file as XML: one, of events."""

    def attribute(key: str, value: object, kind: str = "string") -> str:
        return f'<attr key="{key}" type="{kind}">{value}</attr>'

    def node(name: str, path: str, *content: str) -> str:
        return f"<node name={quoteattr(name)} path={quoteattr(path)}>{''.join(content)}</node>"

    info = node(
        "info",
        f"{_PATH}0/info/",
        attribute("sizeX", size[0], "int"),
        attribute("sizeY", size[1], "int"),
        attribute("source", "fembridge"),
    )
    stream = node(
        "0",
        f"{_PATH}0/",
        attribute("compression", "NONE"),
        attribute("originalModuleName", "fembridge"),
        attribute("originalOutputName", "events"),
        attribute("typeDescription", "Array of events (polarity ON/OFF)."),
        attribute("typeIdentifier", "EVTS"),
        info,
    )
    return f'<dv version="2.0">{node("outInfo", _PATH, stream)}</dv>'
