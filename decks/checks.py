"""Ranges of the numbers and words of a finger, a probe, a contact, checked when it is made."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from fembridge.errors import FembridgeError, FingerError

NOT_NEGATIVE = (0.0, math.inf)
POSITIVE = (math.ulp(0.0), math.inf)
FINITE = (-math.inf, math.inf)
_WORDS = {NOT_NEGATIVE: ">= 0", POSITIVE: "> 0"}


@dataclass(frozen=True, slots=True)
class Ranged:
    """A value whose fields lie in `RANGES`: finite numbers, ends included, or known words.

    Raises
    ------
    FingerError
        Or what `ERROR` says: names the field, its range and its value.
    """

    RANGES: ClassVar[Mapping[str, tuple[Any, ...]]] = {}
    ERROR: ClassVar[type[FembridgeError]] = FingerError

    def __post_init__(self) -> None:
        for name, allowed in self.RANGES.items():
            number = getattr(self, name)
            if isinstance(allowed[0], str):
                if number not in allowed:
                    expected = f"expected one of {', '.join(allowed)}"
                    raise self.ERROR(f"{name} {number!r}, {expected}")
                continue
            least, most = allowed
            if not math.isfinite(number):
                raise self.ERROR(f"{name} must be finite, got {number}")
            if not least <= number <= most:
                words = _WORDS.get((least, most), f"{least:g} to {most:g}")
                raise self.ERROR(f"{name} must be {words}, got {number:g}")
