"""Thresholds of each class, and where it fires once a cycle."""

from collections.abc import Callable, Iterable

from fembridge.tables import AFFERENTS
from fembridge.validation.album import Album, file_name
from fembridge.validation.command_lines import CommandLines
from fembridge.validation.compared_rates import OBSERVED
from fembridge.validation.family import SINES
from fembridge.validation.number_text import ABSENT, amplitude_text, share_text
from fembridge.validation.page import (
    Caption,
    Cell,
    Made,
    Section,
    TableText,
    figure_block,
    table_block,
)
from fembridge.validation.report_tables import ENTRAINMENT, LOCKING, THRESHOLDS
from fembridge.validation.shortfall import THRESHOLD_FACTOR
from fembridge.validation.source_style import source_title
from fembridge.validation.study import Study
from fembridge.validation.threshold_figure import threshold_figure
from fembridge.validation.threshold_row import ThresholdRow, times_apart
from neural.threshold import CRITERION_IPS, PLATEAU

_NAME = "thresholds"


def threshold_section(study: Study, lines: CommandLines, album: Album) -> Section:
    """Give the figure of both, and a table of each."""
    drawing = album.keep(threshold_figure(study.thresholds, study.judged.name), _NAME)
    least, most = PLATEAU
    caption = Caption(
        "Thresholds and entrainment under sinusoids.",
        "Thin lines: amplitudes for which there is a rate. Marks: lowest amplitude at "
        f"which the rate reaches {CRITERION_IPS:.1f} impulses/s, one impulse in "
        "245 ms; a triangle where none does. A mark at the left end of its line: "
        f"there, or lower. Bars: amplitudes with {least:g} to {most:g} impulses a "
        f"cycle. {_conclusion(study)}",
    )
    files = (file_name(_NAME), THRESHOLDS, ENTRAINMENT)
    made = Made(lines.rates(SINES.name), files)
    return Section(
        "threshold-section",
        "Thresholds and entrainment",
        (
            figure_block(drawing, _NAME, caption, made),
            _thresholds(study, lines),
            _entrainment(study, lines),
            _locking(study, lines),
        ),
    )


def _thresholds(study: Study, lines: CommandLines) -> str:
    caption = Caption(
        "Threshold amplitudes (µm).",
        "Interpolated over the logarithm of the amplitude. ≤: the weakest stimulus is "
        "answered already; >: not even the strongest is. Rates from 100 ms have steps "
        "of 10 impulses/s for a single cell.",
    )
    table = _by_frequency(study, lambda row: row.told(row.threshold_um))
    made = Made((lines.whole,), (THRESHOLDS,))
    return table_block(table, "threshold_table", caption, made)


def _entrainment(study: Study, lines: CommandLines) -> str:
    caption = Caption(
        "Entrainment (µm): lowest amplitude with one impulse a cycle; range with about one.",
        "In brackets the range of amplitudes with 0.9 to 1.1 impulses a cycle, as far "
        "as was tried; no brackets: the curve never stays there. 245 ms hold 4.9 "
        "cycles of 20 Hz, so that a locked cell has 4 or 5 spikes, 0.82 or 1.02 a "
        "cycle.",
    )
    table = _by_frequency(study, _entrained)
    made = Made((lines.whole,), (ENTRAINMENT,))
    return table_block(table, "entrainment_table", caption, made)


def _locking(study: Study, lines: CommandLines) -> str:
    strongest = {
        one.entries[-1].id: one.entries[-1].numbers()["frequency_hz"] for one in SINES.sets
    }
    found = {
        (row.source, row.afferent, row.frequency_hz): row.vector_strength
        for row in study.locking
        if row.stimulus in strongest
    }
    heads = _heads(strongest.values())
    rows: list[tuple[Cell, ...]] = []
    for model in study.models:
        rows.append((Cell(source_title(model.name, study.judged.name)),))
        rows += [
            (
                Cell(afferent),
                *(
                    Cell(share_text(found[model.name, afferent, frequency_hz]))
                    for frequency_hz in strongest.values()
                ),
            )
            for afferent in AFFERENTS
        ]
    caption = Caption(
        "Vector strength at the strongest sinusoid of each frequency.",
        "1: all spikes at one phase; 0: spread over the cycle. Few spikes look locked. "
        "Observed and TouchSim’s rates come without spike times. All amplitudes, and "
        f"impulses a cycle of every source, are in {LOCKING}.",
    )
    table = TableText(heads, tuple(rows))
    return table_block(table, "locking_table", caption, Made((lines.whole,), (LOCKING,)))


def _by_frequency(study: Study, told: Callable[[ThresholdRow], str]) -> TableText:
    rows = {(row.source, row.afferent, row.frequency_hz): row for row in study.thresholds}
    frequencies_hz = [one.entries[0].numbers()["frequency_hz"] for one in SINES.sets]
    lines: list[tuple[Cell, ...]] = []
    for source in dict.fromkeys(row.source for row in study.thresholds):
        lines.append((Cell(source_title(source, study.judged.name)),))
        for afferent in AFFERENTS:
            mine = [rows.get((source, afferent, f_hz)) for f_hz in frequencies_hz]
            cells = [Cell(told(row) if row else ABSENT) for row in mine]
            lines.append((Cell(afferent), *cells))
    return TableText(_heads(frequencies_hz), tuple(lines))


def _heads(frequencies_hz: Iterable[float]) -> tuple[tuple[Cell, ...], ...]:
    return ((Cell("Class"), *(Cell(f"{f_hz:g} Hz") for f_hz in frequencies_hz)),)


def _entrained(row: ThresholdRow) -> str:
    told = row.told(row.entrainment_um)
    if row.plateau is None:
        return told
    ends = (row.plateau.low_um, row.plateau.high_um)
    return f"{told} ({'–'.join(dict.fromkeys(map(amplitude_text, ends)))})"


def _conclusion(study: Study) -> str:
    """Say how many thresholds of the judged model are near the reference's."""
    rows = {(row.source, row.afferent, row.frequency_hz): row for row in study.thresholds}
    reference = study.compared.reference(SINES.stimuli)
    apart = [
        times_apart(rows[study.judged.name, afferent, frequency_hz], row)
        for (source, afferent, frequency_hz), row in rows.items()
        if source == reference
    ]
    near = sum(ratio <= THRESHOLD_FACTOR for ratio in apart)
    whose = "the observed one" if reference == OBSERVED else "TouchSim’s"
    return (
        f"This model’s threshold is within a factor of {THRESHOLD_FACTOR:g} of {whose} "
        f"in {near} of {len(apart)} places."
    )
