"""Where the judged model fails, in sentences: nobody has to look for it in a table."""

from collections.abc import Iterator

import numpy as np

from fembridge.tables import AFFERENTS
from fembridge.validation.agreement_cell import PAPER_R_SQUARED, AgreementCell, cell_of
from fembridge.validation.compared_rates import OBSERVED
from fembridge.validation.family import FAMILIES, SINES, Family
from fembridge.validation.number_text import rate_text, share_text
from fembridge.validation.study import Study
from fembridge.validation.threshold_row import times_apart

# An RMSE above this share of the mean rate is told even where R² is high.
RMSE_SHARE = 0.5

# A threshold this many times too high or too low is told.
THRESHOLD_FACTOR = 2.0


def shortfalls(study: Study) -> tuple[str, ...]:
    """Give a sentence for each cell and class where the model is not good enough."""
    found = []
    for family in FAMILIES:
        for afferent in AFFERENTS:
            told = _cell(study, family, afferent)
            if told:
                found.append(told)
    return (*found, *_thresholds(study))


def worst_set(study: Study, family: Family, afferent: str) -> tuple[str, AgreementCell] | None:
    """Give title and cell of the set with the largest mean error, if any is known."""
    reference = study.compared.reference(family.stimuli)
    known = []
    for one in family.sets:
        cell = cell_of(study.cells, reference, study.judged.name, family.name, afferent, one.name)
        if cell.agreement is not None:
            known.append((one.title, cell))
    return max(known, key=lambda pair: abs(_bias_ips(pair[1])), default=None)


def error_text(cell: AgreementCell) -> str:
    """Say how far, and to which side, a cell's rates are off on average."""
    bias_ips = _bias_ips(cell)
    side = "high" if bias_ips > 0 else "low"
    return f"{rate_text(abs(bias_ips))} impulses/s too {side} on average"


def _cell(study: Study, family: Family, afferent: str) -> str | None:
    reference = study.compared.reference(family.stimuli)
    cell = cell_of(study.cells, reference, study.judged.name, family.name, afferent)
    if cell.agreement is None:
        return None
    line = cell.agreement.regression
    against = "" if reference == OBSERVED else ", against TouchSim"
    name = f"{afferent}, {family.title.lower()}{against}"
    predicted = study.compared.of(study.judged.name, afferent, family.stimuli)
    target = study.compared.of(reference, afferent, family.stimuli)
    if not np.nanmax(predicted) > 0 and np.nanmax(target) > 0:
        top = rate_text(float(np.nanmax(target)))
        return f"{name}: silent throughout, where {reference} reaches {top} impulses/s."
    mean_ips = float(np.nanmean(target))
    near = cell.agreement.rmse_ips <= RMSE_SHARE * mean_ips
    if near and (line.r_squared > PAPER_R_SQUARED or mean_ips == 0):
        return None
    worst = worst_set(study, family, afferent)
    where = "" if worst is None else f"; at {worst[0]} {error_text(worst[1])}"
    return (
        f"{name}: R² {share_text(line.r_squared)}, "
        f"RMSE {rate_text(cell.agreement.rmse_ips)} impulses/s where the mean "
        f"rate is {rate_text(mean_ips)}{where}."
    )


def _thresholds(study: Study) -> Iterator[str]:
    rows = {(row.source, row.afferent, row.frequency_hz): row for row in study.thresholds}
    reference, name = study.compared.reference(SINES.stimuli), study.judged.name
    for afferent in AFFERENTS:
        told = []
        for source, its, frequency_hz in rows:
            if (source, its) != (reference, afferent):
                continue
            mine = rows[name, afferent, frequency_hz]
            theirs = rows[reference, afferent, frequency_hz]
            if times_apart(mine, theirs) > THRESHOLD_FACTOR:
                told.append(
                    f"{mine.told(mine.threshold_um)} µm instead of "
                    f"{theirs.told(theirs.threshold_um)} µm at {frequency_hz:g} Hz"
                )
        if told:
            yield (
                f"{afferent}, thresholds off by more than {THRESHOLD_FACTOR:g} times "
                f"from {'the observed' if reference == OBSERVED else 'TouchSim’s'}: "
                f"{', '.join(told)}."
            )


def _bias_ips(cell: AgreementCell) -> float:
    return 0.0 if cell.agreement is None else cell.agreement.bias_ips
