"""One text for one content: what the address of a run is the digest of.

The order of keys, ``1`` against ``1.0`` and ``-0.0`` against ``0.0`` make no
difference; everything else does.
"""

import hashlib
import json
from collections.abc import Mapping

SHORT = 16
"""Hexadecimal digits of a digest that a folder is named by."""

# From here on a whole number is no float.
_NO_FLOAT = 2**1023


def digest(content: object) -> str:
    """Give the SHA-256 of the canonical text of `content`, hexadecimal.

    Raises
    ------
    ValueError
        A number that is not finite.
    TypeError
        What TOML has no word for.
    """
    return hashlib.sha256(canonical_text(content).encode()).hexdigest()


def canonical_text(content: object) -> str:
    """Write tables, lists, words and numbers as JSON, sorted, without blanks."""
    return json.dumps(_plain(content), sort_keys=True, separators=(",", ":"), allow_nan=False)


def _plain(content: object) -> object:
    if content is None or isinstance(content, bool | str):
        return content
    if isinstance(content, int):
        is_float = abs(content) < _NO_FLOAT and float(content) == content
        return float(content) if is_float else content
    if isinstance(content, float):
        return content + 0.0
    if isinstance(content, Mapping):
        return {str(key): _plain(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_plain(value) for value in content]
    raise TypeError(f"{content!r} has no canonical text")
