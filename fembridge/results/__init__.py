"""Readers of solver results: one table of formats, one function.

The table is in `fembridge.results.readers`. A `fembridge.results.result.Result` is an open
file that answers several questions. Missing or damaged content raises a `ResultError` with
the file and, in a text file, the line. A request that the format cannot answer raises a
`UsageError`.
"""

from fembridge.results.readers import ENTRY_POINTS, READERS, Reader
from fembridge.results.result import (
    Result,
    describe,
    open_result,
    read,
    read_fields,
    read_history,
)
from fembridge.results.source import Source

__all__ = [
    "ENTRY_POINTS",
    "READERS",
    "Reader",
    "Result",
    "Source",
    "describe",
    "open_result",
    "read",
    "read_fields",
    "read_history",
]
