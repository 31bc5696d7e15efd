"""The skin around a thin probe, and how the answer depends on the mesh: Fig. 2 (c)."""

import numpy as np

from fembridge.plots.deflection import deflection_figure
from fembridge.validation.album import Album, file_name
from fembridge.validation.command_lines import CommandLines
from fembridge.validation.number_text import digits_text
from fembridge.validation.page import (
    Caption,
    Cell,
    Made,
    Section,
    TableText,
    figure_block,
    table_block,
)
from fembridge.validation.report_tables import CONVERGENCE, DEFLECTION
from fembridge.validation.study import Study

_NAME = "skin_deflection"
_HALF = 0.5


def deflection_section(study: Study, lines: CommandLines, album: Album) -> Section:
    """Give the profile of all meshes and, where there are several, their table."""
    finest = study.deflections[-1]
    apex_mm = float(finest.at(0.0))
    half_mm = float(np.interp(-_HALF * apex_mm, -finest.deflection_mm, finest.distance_mm))
    caption = Caption(
        "Skin deflection under a 50 µm probe at 1 mm (as Fig. 2c).",
        "Left: how far the skin goes down, against the distance from the probe, on "
        "each mesh; dots every 0.5 mm as in the paper. Middle: difference from the "
        "finest mesh. Right: force on the probe on its way down. On the finest mesh "
        f"({finest.name}) the skin is {apex_mm:.2f} mm down at the probe, "
        f"{float(finest.at(1.0)):.2f} mm at 1 mm and half of that depth at "
        f"{half_mm:.1f} mm: greatest at the probe, then falling gradually, as the "
        "paper reports. The paper prints no numbers for this figure, so the shape is "
        "all that is compared.",
    )
    drawing = album.keep(deflection_figure(study.deflections), _NAME)
    files = (file_name(_NAME), DEFLECTION)
    blocks = [figure_block(drawing, _NAME, caption, Made(lines.deflections(), files))]
    if study.convergence:
        blocks.append(_table(study, lines))
    return Section("deflection-section", "Skin deflection", tuple(blocks))


def _table(study: Study, lines: CommandLines) -> str:
    heads = (
        (
            Cell("Quantity", "words"),
            Cell("Unit", "words"),
            *(Cell(f"{mesh.name}\n{mesh.elements} elements") for mesh in study.deflections),
            Cell("last step\n(%)"),
            Cell("limit"),
            Cell("order"),
        ),
    )
    rows = []
    for row in study.convergence:
        unit, name = _named(row.quantity)
        rows.append(
            (
                Cell(name),
                Cell(unit, "words"),
                *(Cell(digits_text(value, 4)) for value in row.values),
                Cell(digits_text(row.change_percent, 2)),
                Cell(digits_text(row.limit, 4)),
                Cell(digits_text(row.order, 1)),
            )
        )
    steps = [abs(row.change_percent) for row in study.convergence]
    finer = study.deflections[-2:]
    caption = Caption(
        "Convergence with the mesh.",
        f"From {finer[0].name} to {finer[1].name} no value changes by more than "
        f"{max(steps):.2f} %. Limit and order are Richardson’s, from the three finest "
        "meshes; a dash stands where the values do not close in from one side.",
    )
    made = Made(lines.deflections(), (CONVERGENCE,))
    return table_block(TableText(heads, tuple(rows)), "convergence", caption, made)


def _named(quantity: str) -> tuple[str, str]:
    """Give unit and words for a row of `fembridge.deflection.profile`."""
    if quantity.startswith("deflection_mm"):
        return "mm", quantity.replace("deflection_mm", "deflection")
    return "N/mm", "force on the probe"
