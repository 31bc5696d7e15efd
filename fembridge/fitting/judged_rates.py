"""Predicted rates beside observed ones of a class, and how well they agree."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from decks.stimuli import Entry
from fembridge.errors import ParameterError
from fembridge.fitting.problem import group_of
from fembridge.typing import FloatArray
from neural.agreement import Agreement, agreement

EVERY = "all"


@dataclass(frozen=True, slots=True)
class AgreementRow:
    """Agreement over one group of a family, over a family, or over all (``all``)."""

    family: str
    group: str
    agreement: Agreement


@dataclass(frozen=True, slots=True, eq=False)
class JudgedRates:
    """`predicted_ips` of a model beside `observed_ips`, ``(S,)``, stimuli `entries`.

    `seen` are stimuli that the model was fitted to.

    Raises
    ------
    ParameterError
        No stimulus, or not one rate of each kind a stimulus.
    """

    entries: tuple[Entry, ...]
    observed_ips: FloatArray
    predicted_ips: FloatArray
    seen: bool

    def __post_init__(self) -> None:
        for name in ("observed_ips", "predicted_ips"):
            rate_ips = np.array(getattr(self, name), dtype=np.float64)
            if not self.entries or rate_ips.shape != (len(self.entries),):
                raise ParameterError(
                    f"{name} of shape {rate_ips.shape}, expected one for each of "
                    f"{len(self.entries)} stimuli, one or more"
                )
            rate_ips.flags.writeable = False
            object.__setattr__(self, name, rate_ips)

    @property
    def groups(self) -> tuple[str, ...]:
        """Group of each stimulus."""
        return tuple(map(group_of, self.entries))

    @property
    def total(self) -> Agreement:
        """Agreement over all stimuli."""
        return agreement(self.observed_ips, self.predicted_ips)

    def rows(self) -> list[AgreementRow]:
        """Give the agreement of each group, each family, and of all families."""
        families = [entry.family for entry in self.entries]
        found = []
        for family in dict.fromkeys(families):
            mine = [k for k, name in enumerate(families) if name == family]
            for group in dict.fromkeys(self.groups[k] for k in mine):
                inside = [k for k in mine if self.groups[k] == group]
                found.append(AgreementRow(family, group, self._over(inside)))
            found.append(AgreementRow(family, EVERY, self._over(mine)))
        if len(set(families)) > 1:
            found.append(AgreementRow(EVERY, EVERY, self.total))
        return found

    def of_group(self, group: str) -> "JudgedRates":
        """Give the stimuli of one group, in their order."""
        inside = [k for k, name in enumerate(self.groups) if name == group]
        return JudgedRates(
            tuple(self.entries[k] for k in inside),
            self.observed_ips[inside],
            self.predicted_ips[inside],
            self.seen,
        )

    def _over(self, rows: Sequence[int]) -> Agreement:
        inside = list(rows)
        return agreement(self.observed_ips[inside], self.predicted_ips[inside])
