"""Spikes under three amplitudes at 20 Hz, five repeats: Fig. 3 (a)."""

from fembridge.validation.album import Album, file_name
from fembridge.validation.command_lines import CommandLines
from fembridge.validation.page import Caption, Made, Section, figure_block
from fembridge.validation.repeat_raster import (
    RASTER_STIMULI,
    REPEATS,
    cells_of,
    raster_figure,
    repeated_trains,
)
from fembridge.validation.report_tables import RASTERS
from fembridge.validation.study import Study

_NAME = "rasters"


def raster_section(study: Study, lines: CommandLines, album: Album) -> Section:
    """Give the raster of the judged model."""
    simulation = study.simulations[study.judged.name]
    trains = repeated_trains(simulation)
    stimuli = [one for one in simulation.stimuli if one.id in RASTER_STIMULI]
    cells = cells_of(simulation)
    silent = [
        f"{train.afferent} at {stimulus.displacement_um.max():.0f} µm"
        for stimulus in stimuli
        for train in trains
        if train.stimulus == stimulus.id and train.repeat == 1
        if not any(
            one.times_ms.size
            for one in trains
            if (one.stimulus, one.afferent) == (stimulus.id, train.afferent)
        )
    ]
    repeats = (
        f"The model has one cell a class and no noise, so that {REPEATS} repeats are "
        f"{REPEATS} equal rows."
        if cells == 1
        else f"The rows are {REPEATS} of the {cells} cells of each class, which differ "
        "in their parameters; the model has no noise."
    )
    nothing = f"No spikes: {', '.join(silent)}." if silent else "Every class fires."
    caption = Caption(
        f"Spikes of this model at 20 Hz, {REPEATS} repeats (as Fig. 3a).",
        f"Above, the depth of the probe. {repeats} {nothing} Spikes keep to one phase "
        "of the vibration where they stand in columns one period, 50 ms, apart.",
    )
    drawing = album.keep(raster_figure(trains, stimuli), _NAME)
    made = Made(
        (lines.whole, *lines.simulations(",".join(RASTER_STIMULI))[:1]), (file_name(_NAME), RASTERS)
    )
    return Section("raster-section", "Rasters", (figure_block(drawing, _NAME, caption, made),))
