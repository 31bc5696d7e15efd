"""What a fit is asked to do, checked before it starts."""

import math
from dataclasses import dataclass

from fembridge.errors import UsageError
from fembridge.observed import FAMILIES
from neural.choice import RULES
from neural.search import EVALUATIONS, POPULATION

_LEAST_POPULATION = 4
_MOST_POPULATION = 10_000
_MOST_CELLS = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class FitSettings:
    """How long is searched, in which stimuli, and which candidate is taken.

    `families` of stimuli are fitted; the others are judged only. `cells` is None
    for as many as each drive has.

    Raises
    ------
    UsageError
        A number or a word that no fit can be made with.
    """

    families: tuple[str, ...] = FAMILIES[:1]
    preindent_um: float = 0.0
    cells: int | None = None
    evaluations: int = EVALUATIONS
    population: int = POPULATION
    seed: int = 1
    rule: str = "smallest_error"

    def __post_init__(self) -> None:
        if not self.families or set(self.families) - set(FAMILIES):
            raise UsageError(
                f"families {', '.join(self.families) or 'none'}, expected some of "
                f"{', '.join(FAMILIES)}"
            )
        if not (math.isfinite(self.preindent_um) and self.preindent_um >= 0):
            raise UsageError(f"preindent_um is {self.preindent_um}, expected >= 0")
        if self.cells is not None and not 1 <= self.cells <= _MOST_CELLS:
            raise UsageError(f"cells is {self.cells}, expected 1 to {_MOST_CELLS}")
        if self.population < _LEAST_POPULATION:
            raise UsageError(
                f"population is {self.population}, expected {_LEAST_POPULATION} or more"
            )
        if self.population > _MOST_POPULATION:
            raise UsageError(
                f"population is {self.population}, expected at most {_MOST_POPULATION}"
            )
        if self.evaluations < self.population:
            raise UsageError(
                f"{self.evaluations} evaluations, expected at least one population of "
                f"{self.population}"
            )
        if self.seed < 0:
            raise UsageError(f"seed is {self.seed}, expected 0 or more")
        if self.rule not in RULES:
            raise UsageError(f"rule {self.rule!r}, expected one of {', '.join(RULES)}")
