"""The first table: each class and family, each model, and which goals are met."""

from collections.abc import Sequence
from typing import TypeVar

from fembridge.tables import AFFERENTS
from fembridge.validation.agreement_cell import (
    PAPER_P_VALUE,
    PAPER_R_SQUARED,
    AgreementCell,
    cell_of,
)
from fembridge.validation.command_lines import CommandLines
from fembridge.validation.compared_rates import OBSERVED, TOUCHSIM
from fembridge.validation.family import FAMILIES
from fembridge.validation.number_text import ABSENT, p_text, rate_text, share_text, signed_text
from fembridge.validation.page import (
    Caption,
    Cell,
    Made,
    Section,
    TableText,
    bullets,
    paragraph,
    table_block,
)
from fembridge.validation.report_tables import AGREEMENT
from fembridge.validation.shortfall import shortfalls
from fembridge.validation.source_style import source_title
from fembridge.validation.study import Study

NUMBERS = ("R²", "p", "RMSE", "bias")
PAPER_GOAL = f"R² > {PAPER_R_SQUARED:g}, p < {PAPER_P_VALUE:g}"
GOALS = (PAPER_GOAL.replace(", ", "\n"), "R² ≥ 0.9, RMSE\nbelow TouchSim")

_Word = TypeVar("_Word")

_NOT_DATA = (
    "No observed rates were given (--observed RATES.csv). What stands here is "
    "agreement with TouchSim, which is another model and not data: it says how alike "
    "two models are, not how good either is. So no goal is marked as met or not met."
)


def summary_section(study: Study, lines: CommandLines) -> Section:
    """Give the summary, and under it where the model falls short."""
    blocks = []
    if study.reference != OBSERVED:
        blocks.append(paragraph(_NOT_DATA, "note"))
    blocks.append(agreement_block(study, lines, study.reference, "summary", _verdict(study)))
    found = shortfalls(study)
    if found:
        judges = study.reference == OBSERVED
        where = "falls short" if judges else "is unlike TouchSim"
        blocks.append(paragraph(f"Where this model {where}:"))
        blocks.append(bullets(found))
    return Section("summary-section", "Summary", tuple(blocks))


def agreement_block(
    study: Study, lines: CommandLines, reference: str, name: str, verdict: str
) -> str:
    """Give the table of all families against `reference`."""
    sources = [s for s in study.compared.sources if s not in (OBSERVED, reference)]
    judges = reference == OBSERVED
    goals = GOALS if judges else ()
    heads = (
        (
            Cell("Class"),
            *(
                Cell(source_title(source, study.judged.name), "starts", len(NUMBERS))
                for source in sources
            ),
            *([Cell("Goals of this model", "starts", len(goals))] if goals else []),
        ),
        (
            Cell(""),
            *(
                Cell(number_head(number), "starts" if first else "")
                for _ in sources
                for first, number in _marked(NUMBERS)
            ),
            *(Cell(goal, "starts" if first else "") for first, goal in _marked(goals)),
        ),
    )
    rows: list[tuple[Cell, ...]] = []
    for family in FAMILIES:
        rows.append((Cell(f"{family.title} ({len(family.stimuli)} stimuli)"),))
        for afferent in AFFERENTS:
            cells = [
                cell_of(study.cells, reference, source, family.name, afferent) for source in sources
            ]
            rows.append((Cell(afferent), *_numbers(cells), *_goals(cells, judges)))
    told = "the observed rates" if judges else "TouchSim (a model, not data)"
    caption = Caption(
        f"Agreement with {told}.",
        "One regression line through all stimuli of a family and a class; RMSE and "
        f"bias, predicted minus {reference}, in impulses/s. {verdict}",
    )
    return table_block(
        TableText(heads, tuple(rows)), name, caption, Made((lines.whole,), (AGREEMENT,))
    )


def number_cells(cell: AgreementCell) -> tuple[Cell, ...]:
    """Give R², p, RMSE and bias of a cell, or why there are none."""
    found = cell.agreement
    if found is None:
        words = "no observed rates" if cell.reference == OBSERVED else "no rates"
        return (Cell(words, "starts none", len(NUMBERS)),)
    return (
        Cell(share_text(found.regression.r_squared), "starts"),
        Cell(p_text(found.regression.p_value)),
        Cell(rate_text(found.rmse_ips)),
        Cell(signed_text(found.bias_ips)),
    )


def _numbers(cells: list[AgreementCell]) -> list[Cell]:
    return [number for cell in cells for number in number_cells(cell)]


def _goals(cells: list[AgreementCell], judges: bool) -> list[Cell]:
    if not judges:
        return []
    marks = _marks(cells)
    return [_mark(met, first) for first, met in _marked(marks)]


def _marks(cells: list[AgreementCell]) -> tuple[bool | None, bool | None]:
    """Say of the judged model, which comes first, whether it meets either goal."""
    touchsim = next(cell for cell in cells if cell.source == TOUCHSIM)
    return cells[0].meets_paper, cells[0].beats(touchsim)


def _mark(met: bool | None, first: bool) -> Cell:
    edge = "starts " if first else ""
    if met is None:
        return Cell(ABSENT, f"{edge}none")
    return Cell("met", f"{edge}met") if met else Cell("not met", f"{edge}missed")


def _verdict(study: Study) -> str:
    if study.reference != OBSERVED:
        return "Nothing here says that a model is right."
    marks = []
    for family in FAMILIES:
        for afferent in AFFERENTS:
            cells = [
                cell_of(study.cells, OBSERVED, source, family.name, afferent)
                for source in (study.judged.name, TOUCHSIM)
            ]
            marks.append(_marks(cells))
    counted = [mark for mark in marks if mark[0] is not None]
    paper, touchsim = (sum(bool(mark[k]) for mark in counted) for k in (0, 1))
    return (
        f"The paper’s bar ({PAPER_GOAL}) is met in {paper} of the {len(counted)} rows "
        f"that have observed rates, R² is 0.9 or more and RMSE below TouchSim’s "
        f"in {touchsim}."
    )


def number_head(number: str) -> str:
    """Give the head of a column of numbers, with its unit."""
    return f"{number}\n(ips)" if number in NUMBERS[2:] else number


def _marked(words: Sequence[_Word]) -> list[tuple[bool, _Word]]:
    """Tell of each whether it is the first."""
    return [(not place, word) for place, word in enumerate(words)]
