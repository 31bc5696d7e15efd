"""How well one source follows another in one cell: a family or set, and a class."""

from dataclasses import dataclass

import numpy as np

from fembridge.errors import UsageError
from fembridge.tables import AFFERENTS
from fembridge.validation.compared_rates import OBSERVED, TOUCHSIM, ComparedRates
from fembridge.validation.family import FAMILIES
from neural import Agreement, agreement

# Section 4.2: "R² was almost greater than 0.8 for the regression line of all plots of
# each tactile afferent"; "P values of the regression were less than 0.05".
PAPER_R_SQUARED = 0.8
PAPER_P_VALUE = 0.05

# This project's own goal, with an RMSE below TouchSim's.
GOAL_R_SQUARED = 0.9

EVERY_SET = "all"


@dataclass(frozen=True, slots=True)
class AgreementCell:
    """One row of a table: `source` against `reference`, and how many points there are.

    `set` is one of the family's sets, or ``all`` of them. `agreement` is None where
    the two have no stimulus in common.
    """

    reference: str
    source: str
    family: str
    set: str
    afferent: str
    agreement: Agreement | None

    @property
    def count(self) -> int:
        """Stimuli that both have a rate of."""
        return 0 if self.agreement is None else self.agreement.regression.count

    @property
    def meets_paper(self) -> bool | None:
        """Whether R² and p are what the paper reports; None without observed rates."""
        if self.agreement is None or self.reference != OBSERVED:
            return None
        line = self.agreement.regression
        return line.r_squared > PAPER_R_SQUARED and line.p_value < PAPER_P_VALUE

    def beats(self, other: "AgreementCell") -> bool | None:
        """Whether R² is `GOAL_R_SQUARED` or more and RMSE below that of `other`.

        None without observed rates.
        """
        mine, its = self.agreement, other.agreement
        if mine is None or its is None or self.reference != OBSERVED:
            return None
        enough = mine.regression.r_squared >= GOAL_R_SQUARED  # False of NaN
        return enough and mine.rmse_ips < its.rmse_ips


def agreement_cells(compared: ComparedRates, reference: str) -> tuple[AgreementCell, ...]:
    """Hold every other computed source against `reference`, cell by cell.

    Observed rates are no source here: they are predicted by nobody.
    """
    cells = []
    for source in compared.sources:
        if source in (reference, OBSERVED):
            continue
        for family in FAMILIES:
            sets = {one.name: one.stimuli for one in family.sets}
            for name, stimuli in {**sets, EVERY_SET: family.stimuli}.items():
                for afferent in AFFERENTS:
                    target = compared.of(reference, afferent, stimuli)
                    predicted = compared.of(source, afferent, stimuli)
                    both = np.isfinite(target) & np.isfinite(predicted)
                    found = agreement(target[both], predicted[both]) if both.any() else None
                    cells.append(
                        AgreementCell(reference, source, family.name, name, afferent, found)
                    )
    return tuple(cells)


def cell_of(
    cells: tuple[AgreementCell, ...],
    reference: str,
    source: str,
    family: str,
    afferent: str,
    set_: str = EVERY_SET,
) -> AgreementCell:
    """Find the one cell of these names.

    Raises
    ------
    UsageError
        There is none.
    """
    wanted = (reference, source, family, set_, afferent)
    for cell in cells:
        if (cell.reference, cell.source, cell.family, cell.set, cell.afferent) == wanted:
            return cell
    raise UsageError(f"no agreement of {', '.join(wanted)}")


def references_of(compared: ComparedRates) -> tuple[str, ...]:
    """Give what agreement is told with: observed rates, if any, and TouchSim's."""
    observed = (OBSERVED,) if OBSERVED in compared.sources else ()
    return (*observed, TOUCHSIM)
