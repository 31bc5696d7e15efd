"""Reading a solver's results: one table of formats, one function.

The table is in `fembridge.results.readers`; a file that is opened once, for several
questions, is a `fembridge.results.result.Result`. What a file lacks, or has damaged, is a
`ResultError` that names the file, and where it has lines the line; words that ask for what
such a file cannot have are a `UsageError`.
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
