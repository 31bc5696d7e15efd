"""What stands beside what on the page, and where each comes from."""

from fembridge.tables import AFFERENTS
from fembridge.validation.command_lines import CommandLines
from fembridge.validation.compared_rates import OBSERVED, TOUCHSIM
from fembridge.validation.judged_model import PUBLISHED_NAME
from fembridge.validation.page import (
    Caption,
    Cell,
    Made,
    Section,
    TableText,
    paragraph,
    table_block,
)
from fembridge.validation.repeat_raster import cells_of
from fembridge.validation.source_style import source_title
from fembridge.validation.study import STIMULI, Study
from fembridge.validation.summary_section import agreement_block

RECORD = "validation.toml"


def source_section(study: Study, lines: CommandLines) -> Section:
    """Give a table of the sources, and what they have in common."""
    rows = [_row(study, source) for source in study.compared.sources]
    heads = (
        (
            Cell("Source", "words"),
            Cell("What it is", "words"),
            Cell("Rates"),
            Cell("Cells a class"),
            Cell("Pre-indentation (µm)"),
        ),
    )
    caption = Caption(
        "Sources of rates.",
        "All rates are impulses a second (ips) in the window of the stimulus: 100 to "
        "200 ms of a sinusoid, 5 to 250 ms of one at 20 Hz, a diharmonic or a noise. "
        "Noise has the paper’s bands and levels; its samples are drawn here, since the "
        "paper’s are not printed.",
    )
    files = (RECORD,)
    blocks = [
        table_block(TableText(heads, tuple(rows)), "sources", caption, Made((lines.whole,), files)),
        paragraph(_stress(study)),
    ]
    if study.left_out:
        blocks.append(
            paragraph(
                "Left out of the observed rates, since the paper has no such stimulus: "
                f"{', '.join(study.left_out)}."
            )
        )
    return Section("source-section", "What is compared", tuple(blocks))


def touchsim_section(study: Study, lines: CommandLines) -> Section:
    """Give the agreement with TouchSim, for where there are observed rates as well."""
    block = agreement_block(
        study,
        lines,
        TOUCHSIM,
        "touchsim_agreement",
        "It says how alike the models are, not how good they are.",
    )
    return Section("touchsim-section", "Agreement with TouchSim", (block,))


def _row(study: Study, source: str) -> tuple[Cell, ...]:
    row = study.compared.sources.index(source)
    known = study.compared.rate_ips[row]
    rates = int((known == known).sum())
    told = f"{rates} of {len(STIMULI) * len(AFFERENTS)}"
    name = source_title(source, study.judged.name)
    if source == OBSERVED and study.observed is not None:
        digest = study.observed.sha256[:12]
        what = f"file {study.observed.path.name}, SHA-256 {digest}"
        return _cells(name, what, told, "as in the file", "as in the file")
    if source == TOUCHSIM:
        what = "Saal et al. 2017, computed for this project and stored; a model, not data"
        return _cells(name, what, told, "4 SA, 9 RA, 4 PC", "0")
    [model] = [model for model in study.models if model.name == source]
    what = model.source if source == PUBLISHED_NAME else f"{source}: {model.source}"
    cells = str(cells_of(study.simulations[source]))
    return _cells(name, what, told, cells, f"{model.preindent_um:g}")


def _cells(name: str, what: str, rates: str, cells: str, preindent: str) -> tuple[Cell, ...]:
    return (Cell(name, "words"), Cell(what, "prose"), *map(Cell, (rates, cells, preindent)))


def _stress(study: Study) -> str:
    return (
        f"Stress comes from the stored response of finger “{study.finger}”: one "
        f"indentation, solved with CalculiX, that answers every stimulus down to "
        f"{study.response.deepest_um:g} µm. Unloading came back to loading within "
        f"{max(study.response.closure_percent, 0.01):.2g} %."
    )
