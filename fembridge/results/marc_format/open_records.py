"""Which kind of post file begins here: binary of either byte order, or text."""

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.results.marc_format.binary_records import TITLE_WORDS, BinaryRecords
from fembridge.results.marc_format.formatted_records import FormattedRecords
from fembridge.results.marc_format.records import BEGIN, PostRecords

_SHOWN_BYTES = 24


def open_records(file: ByteFile) -> PostRecords:
    """Tell the kind of `file` by its first bytes.

    Raises
    ------
    ResultError
        It is empty, older than revision 9, or no post file.
    """
    head = file.peek(0, 4 + 8 * TITLE_WORDS)
    if not head:
        raise ResultError("empty, expected a post file of Marc", file.path)
    if head.lstrip().startswith(BEGIN.encode()):
        return FormattedRecords(file)
    for big_endian in (False, True):
        length = int.from_bytes(head[:4], "big" if big_endian else "little")
        word, rest = divmod(length, TITLE_WORDS)
        if rest or word not in (4, 8):
            continue
        text = head[4 : 4 + length : word]
        if text.startswith(BEGIN.encode()):
            return BinaryRecords(file, big_endian, word)
        if text.isascii() and text.decode("latin-1").isprintable():
            raise ResultError(
                "a post file without =beg= marks, of Marc K7 or before (revision 7 or "
                "older), which is not read; Marc writes newer ones",
                file.path,
            )
    raise ResultError(
        f"begins with {head[:_SHOWN_BYTES]!r}, which no post file of Marc does: "
        "expected =beg=50100, as text or in a record of 280 bytes",
        file.path,
    )
