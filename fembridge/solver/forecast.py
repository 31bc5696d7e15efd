"""How long the solver will take, before it starts.

An increment of a converged run costs two iterations, each a factorisation: of a plane
mesh about the 1.15th power of its elements, as `fembridge verify` measured from 1 600 to
39 700 of them. How fast this machine is, the runs in the cache say.
"""

import statistics

from fembridge.cache import entries

_ELEMENTS, _INCREMENT_S, _POWER = 3100, 0.45, 1.15
_DECK_BYTES = 69.4
"""Of a deck of the reference fingers, an element."""


def increment_s(elements: float) -> float:
    """Seconds of an increment of a mesh of so many `elements`."""
    ratios: list[float] = [
        record["wall_s"] / record["increments"] / _reference_s(record["deck_bytes"] / _DECK_BYTES)
        for record in (entry.record for entry in entries())
        if record.get("wall_s") and record.get("increments")
    ]
    return _reference_s(elements) * (statistics.median(ratios) if ratios else 1.0)


def in_words(seconds: float) -> str:
    """A time of which the first figure may be right: ``20 s``, ``4 min``, ``6 h``."""
    size, unit = next(
        (each for each in ((3600.0, "h"), (60.0, "min")) if seconds >= 1.5 * each[0]), (1.0, "s")
    )
    count = max(seconds, 1.0) / size
    figures = 1 if unit == "s" and count < 10 else 2
    return f"{float(f'{count:.{figures}g}'):g} {unit}"


def _reference_s(elements: float) -> float:
    seconds: float = _INCREMENT_S * (elements / _ELEMENTS) ** _POWER
    return seconds
