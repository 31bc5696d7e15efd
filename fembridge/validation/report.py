"""A study as a folder: the page, its figures, its numbers, what it was made of."""

from pathlib import Path

from fembridge.store import filling, write_text
from fembridge.validation.album import Album
from fembridge.validation.command_lines import command_lines
from fembridge.validation.compared_rates import OBSERVED
from fembridge.validation.deflection_section import deflection_section
from fembridge.validation.family import FAMILIES
from fembridge.validation.family_section import family_section
from fembridge.validation.page import Section, page
from fembridge.validation.raster_section import raster_section
from fembridge.validation.record import record_of
from fembridge.validation.report_tables import report_tables
from fembridge.validation.source_section import RECORD, source_section, touchsim_section
from fembridge.validation.study import Study
from fembridge.validation.summary_section import summary_section
from fembridge.validation.threshold_section import threshold_section

PAGE = "index.html"


def write_report(folder: Path, study: Study, command: str) -> tuple[str, ...]:
    """Write the report of `study` into `folder`: all of it or nothing.

    Parameters
    ----------
    command
        The command line that made it; it is shown under every number.

    Returns
    -------
    tuple of str
        Names of the files, the page first.

    Raises
    ------
    OutputError
        `folder` cannot be written. What stood there before is untouched.
    """
    import tomli_w

    with filling(folder, last=RECORD) as draft:
        sections = _sections(study, command, Album(draft))
        text = page(_title(study), _lead(study), sections)
        write_text(draft / PAGE, text)
        for table in report_tables(study):
            table.write(draft)
        record = record_of(study, command, draft)
        write_text(draft / RECORD, tomli_w.dumps(record))
        names = sorted(path.name for path in draft.iterdir())
    return (PAGE, *(name for name in names if name != PAGE))


def _sections(study: Study, command: str, album: Album) -> list[Section]:
    lines = command_lines(study, command)
    sine, *others = (family_section(study, one, lines, album) for one in FAMILIES)
    sections = [
        summary_section(study, lines),
        source_section(study, lines),
        deflection_section(study, lines, album),
        raster_section(study, lines, album),
        sine,
        *others,
        threshold_section(study, lines, album),
    ]
    if study.reference == OBSERVED:
        sections.append(touchsim_section(study, lines))
    return sections


def _title(study: Study) -> str:
    return f"Validation of the model “{study.judged.name}”"


def _lead(study: Study) -> tuple[str, ...]:
    against = "observed firing rates" if study.reference == OBSERVED else "TouchSim’s rates"
    return (
        "From a probe on a fingertip, through finite elements, to the spikes of SA, RA "
        "and PC afferents: the paper’s figures and tables made again, against "
        f"{against}.",
        f"Finger “{study.finger}”, 82 stimuli, pre-indentation "
        f"{study.judged.preindent_um:g} µm. The command that made each number stands "
        "under it; the numbers lie beside this page as CSV, the figures as SVG.",
    )
