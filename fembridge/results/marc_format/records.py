"""Records of a post file, one after the other, whether binary or text.

Both kinds hold the same blocks of the same records: what a block means is said
once, on top of this interface. Outside of records stand words: ``=beg=NNNNN
(Name)``, ``=end=``, ``****`` (an increment begins), ``----`` (it ends), ``++++``
(the file ends).
"""

from typing import Protocol

from fembridge.results.byte_file import ByteFile
from fembridge.results.marc_format.numbers import Numbers

BEGIN, END = "=beg=", "=end="
INCREMENT, INCREMENT_END, FILE_END = "****", "----", "++++"
MARKS = (INCREMENT, INCREMENT_END, FILE_END)


class PostDamageError(Exception):
    """Bytes that are not what has to stand there; `at` is the first of them."""

    def __init__(self, problem: str, at: int) -> None:
        super().__init__(problem, at)
        self.problem, self.at = problem, at


def must_end(records: "PostRecords", what: str) -> None:
    """Refuse a block that goes on: its tables are not as long as was thought.

    Raises
    ------
    PostDamageError
        The block holds more than `what`.
    """
    if records.word() != END:
        raise PostDamageError(f"more than {what}", records.at)


class PostRecords(Protocol):
    """A place in a post file, moved on by what is read there.

    `free` collects the stretches, (first, last + 1), that hold values: what is
    between them is the same in every increment that is built alike. All methods
    raise `PostDamageError` where the file is cut or holds something else.
    """

    kind: str
    byte_order: str
    real_bytes: int
    file: ByteFile
    at: int
    free: list[tuple[int, int]]

    def word(self) -> str:
        """Give the word that stands here; "" if none does, or the file ends."""

    def pass_word(self) -> None:
        """Go behind the word that stands here."""

    def text(self, free: bool = False) -> str:
        """Read a record of text, without blanks at its ends."""

    def text_of(self, raw: bytes) -> str:
        """Give the text of a whole record that is in memory."""

    def label(self) -> tuple[list[int], str]:
        """Read a record of integers and a text: an element post code."""

    def integers(self, count: int | None = None, free: bool = False) -> list[int]:
        """Read a record of `count` integers; None takes what is there."""

    def verification(self, first: int, second: int) -> list[int]:
        """Read `first` and `second` integers of a model's verification data."""

    def table(self, rows: int, integers: int, reals: int) -> tuple[Numbers | None, Numbers | None]:
        """Pass `rows` records alike: `integers`, then `reals`; None for none."""

    def flow(self, rows: int, columns: int) -> Numbers:
        """Pass one record of `rows` times `columns` reals."""

    def empty(self) -> None:
        """Pass a record of nothing, if one stands here."""

    def pass_block(self) -> None:
        """Go to the ``=end=`` of the block that we are in."""
