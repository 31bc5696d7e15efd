"""Rates of one family: curves, regression lines, and their table."""

from fembridge.tables import AFFERENTS
from fembridge.validation.agreement_cell import EVERY_SET, cell_of
from fembridge.validation.album import Album, file_name
from fembridge.validation.command_lines import CommandLines
from fembridge.validation.compared_rates import OBSERVED, TOUCHSIM
from fembridge.validation.family import Family
from fembridge.validation.judged_model import PUBLISHED_NAME
from fembridge.validation.number_text import share_text
from fembridge.validation.page import (
    Caption,
    Cell,
    Made,
    Section,
    TableText,
    figure_block,
    paragraph,
    table_block,
)
from fembridge.validation.rate_figure import rate_figure
from fembridge.validation.regression_figure import regression_figure
from fembridge.validation.report_tables import AGREEMENT, RATES
from fembridge.validation.shortfall import error_text, worst_set
from fembridge.validation.source_style import source_title
from fembridge.validation.study import Study
from fembridge.validation.summary_section import NUMBERS, number_cells, number_head


def family_section(study: Study, family: Family, lines: CommandLines, album: Album) -> Section:
    """Give everything about the rates under one family of stimuli."""
    reference = study.compared.reference(family.stimuli)
    blocks = []
    if reference != OBSERVED and study.observed is not None:
        blocks.append(
            paragraph(
                f"No observed rates of {family.title.lower()} were given. Regression "
                "lines are against TouchSim, a model and not data.",
                "note",
            )
        )
    blocks += [
        _curves(study, family, lines, album),
        _regression(study, family, reference, lines, album),
        _table(study, family, reference, lines),
    ]
    return Section(f"{family.name}-section", family.title, tuple(blocks))


def _curves(study: Study, family: Family, lines: CommandLines, album: Album) -> str:
    name = f"rates_{family.name}"
    sources = study.compared.known(family.stimuli)
    looks = {
        OBSERVED: "black dots: observed",
        PUBLISHED_NAME: "thin: the published model",
        TOUCHSIM: "grey dashes: TouchSim",
    }
    looks[study.judged.name] = "thick: this model"
    shown = [looks[source] for source in sources]
    caption = Caption(
        f"Rate against amplitude, {family.title.lower()} (as {family.figure}).",
        f"A row a class, a column a set of stimuli, one scale a row. "
        f"{_capital('; '.join(shown))}. {_conclusion(study, family)}",
    )
    drawing = album.keep(rate_figure(study.compared, family, study.judged.name), name)
    made = Made(lines.rates(family.name), (file_name(name), RATES))
    return figure_block(drawing, name, caption, made)


def _regression(
    study: Study, family: Family, reference: str, lines: CommandLines, album: Album
) -> str:
    name = f"regression_{family.name}"
    told = "observed" if reference == OBSERVED else "TouchSim’s"
    caption = Caption(
        f"Predicted against {told} rates, {family.title.lower()} (as {family.table}).",
        "Each mark is one stimulus, its shape the set. On the grey line both rates are "
        "equal; the dashed line is the regression through all marks. A high R² with a "
        "dashed line off the grey one means rates that go together and are not equal.",
    )
    figure = regression_figure(study.compared, study.cells, family, reference, study.judged.name)
    made = Made((lines.whole,), (file_name(name), RATES, AGREEMENT))
    return figure_block(album.keep(figure, name), name, caption, made)


def _table(study: Study, family: Family, reference: str, lines: CommandLines) -> str:
    heads = (
        (
            Cell("Stimuli", "words"),
            *(Cell(afferent, "starts", len(NUMBERS)) for afferent in AFFERENTS),
        ),
        (
            Cell(""),
            *(
                Cell(number_head(number), "starts" if number == NUMBERS[0] else "")
                for _ in AFFERENTS
                for number in NUMBERS
            ),
        ),
    )
    titles = {one.name: one.title for one in family.sets} | {EVERY_SET: "all"}
    rows: list[tuple[Cell, ...]] = []
    for source in study.compared.sources:
        if source in (OBSERVED, reference):
            continue
        rows.append((Cell(source_title(source, study.judged.name)),))
        for set_, title in titles.items():
            cells = [
                cell_of(study.cells, reference, source, family.name, afferent, set_)
                for afferent in AFFERENTS
            ]
            numbers = [number for cell in cells for number in number_cells(cell)]
            rows.append((Cell(title), *numbers))
    told = "observed rates" if reference == OBSERVED else "TouchSim (a model, not data)"
    caption = Caption(
        f"Regression lines against {told}, {family.title.lower()} (as {family.table}).",
        "A dash under R² and p: all predicted or all reference rates are equal, so "
        f"that there is no correlation. Slopes and intercepts are in {AGREEMENT}.",
    )
    name = f"agreement_{family.name}"
    made = Made((lines.whole,), (AGREEMENT,))
    return table_block(TableText(heads, tuple(rows)), name, caption, made)


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _conclusion(study: Study, family: Family) -> str:
    reference = study.compared.reference(family.stimuli)
    shares = []
    worst = []
    for afferent in AFFERENTS:
        cell = cell_of(study.cells, reference, study.judged.name, family.name, afferent)
        if cell.agreement is None:
            continue
        shares.append(f"{afferent} {share_text(cell.agreement.regression.r_squared)}")
        found = worst_set(study, family, afferent)
        if found is not None:
            worst.append(f"{afferent} at {found[0]}, {error_text(found[1])}")
    told = "the observed rates" if reference == OBSERVED else "TouchSim"
    return (
        f"Against {told}, R² of this model is {', '.join(shares)}. "
        f"It is furthest off for {'; '.join(worst)}."
    )
