"""Published Prony sets by name; ``prony.toml`` beside this file has the numbers and sources.

A finger file names one where it would otherwise list terms::

    [materials.dermis]
    prony = "skin-wang-2015"
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from decks.finger import PronyTerm
from fembridge.errors import FingerError
from fembridge.host.store import near_hint, read_toml, structure

_SETS = Path(__file__).with_name("prony.toml")


@dataclass(frozen=True, slots=True)
class PronySet:
    """A published Prony set: its terms, the tissue, what was measured, and the source."""

    tissue: str
    measured: str
    source: str
    prony: tuple[PronyTerm, ...]


@cache
def prony_sets() -> Mapping[str, PronySet]:
    """All published sets by name."""
    table = read_toml(_SETS, FingerError)
    return {name: structure(entry, PronySet, FingerError, name) for name, entry in table.items()}


def prony_set(name: str) -> PronySet:
    """The published set `name`.

    Raises
    ------
    FingerError
        No set has this name; near ones are named.
    """
    sets = prony_sets()
    if name not in sets:
        expected = f"a list of terms, or one of {', '.join(sets)}"
        problem = f"is {name!r}, expected {expected}{near_hint(name, sets)}"
        raise FingerError(problem, argument="prony", found=name, expected=expected)
    return sets[name]


def name_of_prony(terms: Sequence[PronyTerm]) -> str | None:
    """Name of the published set that has these terms; None if none has."""
    matches = (name for name, entry in prony_sets().items() if entry.prony == tuple(terms))
    return next(matches, None)
