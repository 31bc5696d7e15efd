"""Every number of a report as long tables, one file each."""

import math
from collections.abc import Sequence

from fembridge.tables import AFFERENTS, SPIKE_COLUMNS
from fembridge.validation.family import FAMILIES
from fembridge.validation.long_table import LongTable
from fembridge.validation.repeat_raster import repeated_trains
from fembridge.validation.study import Study
from neural.threshold import CRITERION_IPS

RATES = "rates.csv"
AGREEMENT = "agreement.csv"
RASTERS = "rasters.csv"
THRESHOLDS = "thresholds.csv"
ENTRAINMENT = "entrainment.csv"
LOCKING = "locking.csv"
DEFLECTION = "deflection.csv"
CONVERGENCE = "deflection_convergence.csv"

_AGREEMENT_NUMBERS = (
    "count",
    "slope",
    "intercept_ips",
    "r_squared",
    "p_value",
    "rmse_ips",
    "bias_ips",
)


def report_tables(study: Study) -> tuple[LongTable, ...]:
    """Give all tables of `study`."""
    return (
        _rates(study),
        _agreement(study),
        _rasters(study),
        _thresholds(study),
        _entrainment(study),
        _locking(study),
        _deflection(study),
        _convergence(study),
    )


def _rates(study: Study) -> LongTable:
    rows: list[Sequence[object]] = []
    for source in study.compared.sources:
        for family in FAMILIES:
            for one in family.sets:
                for entry in one.entries:
                    for afferent in AFFERENTS:
                        [rate] = study.compared.of(source, afferent, [entry.id])
                        if not math.isnan(rate):
                            rows.append(
                                (
                                    source,
                                    entry.id,
                                    afferent,
                                    float(rate),
                                    family.name,
                                    one.name,
                                    entry.level_um,
                                )
                            )
    columns = (*("source", "stimulus", "afferent", "rate_ips"), *("family", "set", "level_um"))
    return LongTable(RATES, columns, tuple(rows))


def _agreement(study: Study) -> LongTable:
    rows = []
    for cell in study.cells:
        numbers = {"count": 0.0} if cell.agreement is None else cell.agreement.to_row()
        names = (cell.reference, cell.source, cell.family, cell.set, cell.afferent)
        found = [numbers.get(name, math.nan) for name in _AGREEMENT_NUMBERS]
        rows.append((*names, int(found[0]), *found[1:]))
    columns = ("reference", "source", "family", "set", "afferent", *_AGREEMENT_NUMBERS)
    return LongTable(AGREEMENT, columns, tuple(rows))


def _rasters(study: Study) -> LongTable:
    rows = tuple(
        (name, train.stimulus, train.afferent, train.repeat, time_ms)
        for name, simulation in study.simulations.items()
        for train in repeated_trains(simulation)
        for time_ms in train.times_ms.tolist()
    )
    return LongTable(RASTERS, ("source", *SPIKE_COLUMNS), rows)


def _thresholds(study: Study) -> LongTable:
    columns = (
        *("source", "afferent", "frequency_hz", "criterion_ips"),
        *("lowest_tried_um", "highest_tried_um", "threshold_um"),
    )
    rows = tuple(
        (
            *(row.source, row.afferent, row.frequency_hz, CRITERION_IPS),
            *(row.lowest_um, row.highest_um, row.threshold_um),
        )
        for row in study.thresholds
    )
    return LongTable(THRESHOLDS, columns, rows)


def _entrainment(study: Study) -> LongTable:
    columns = (
        *("source", "afferent", "frequency_hz", "entrainment_threshold_um"),
        *("plateau_low_um", "plateau_high_um", "plateau_decades"),
    )
    rows = []
    for row in study.thresholds:
        held = row.plateau
        nothing = (math.nan, math.nan, math.nan)
        numbers = (held.low_um, held.high_um, held.decades) if held else nothing
        names = (row.source, row.afferent, row.frequency_hz, row.entrainment_um)
        rows.append((*names, *numbers))
    return LongTable(ENTRAINMENT, columns, tuple(rows))


def _locking(study: Study) -> LongTable:
    columns = (
        *("source", "afferent", "stimulus", "frequency_hz", "amplitude_um"),
        *("impulses_per_cycle", "vector_strength"),
    )
    rows = tuple(tuple(getattr(row, column) for column in columns) for row in study.locking)
    return LongTable(LOCKING, columns, rows)


def _deflection(study: Study) -> LongTable:
    rows = tuple(
        (mesh.name, mesh.elements, distance_mm, deflection_mm)
        for mesh in study.deflections
        for distance_mm, deflection_mm in zip(
            mesh.distance_mm.tolist(), mesh.deflection_mm.tolist(), strict=True
        )
    )
    columns = ("mesh", "elements", "distance_mm", "deflection_mm")
    return LongTable(DEFLECTION, columns, rows)


def _convergence(study: Study) -> LongTable:
    rows = tuple(
        (
            *(row.quantity, mesh.name, mesh.elements, value),
            *(row.change_percent, row.limit, row.order),
        )
        for row in study.convergence
        for mesh, value in zip(study.deflections, row.values, strict=True)
    )
    columns = (
        *("quantity", "mesh", "elements", "value"),
        *("last_change_percent", "limit", "order"),
    )
    return LongTable(CONVERGENCE, columns, rows)
