"""A validation as a folder: the page, its figures, its numbers, what it was made of.

The words of the page are in ``validation.html.j2``; here are the numbers, the tables with
their numbers as words, and the figures that only a validation has. A source looks the same in
all of them: observed rates are black, TouchSim is grey, a model has the colour of the class,
the judged one filled.
"""

import importlib.metadata
import math
import platform
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.evidence import RAMP, TOUCHSIM_MODELS, TOUCHSIM_TABLE, published, touchsim_rates
from fembridge.plots.rates import OWN, PUBLISHED, rates_figure, thresholds_figure
from fembridge.plots.response import deflection_figure
from fembridge.plots.spikes import raster_figure
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    GREY,
    HAIR_PT,
    INK,
    LINE_PT,
    MARKERS,
    SHADE,
    TEXT_PT,
    WHITE,
    class_style,
    dots,
    in_style,
    legend_above,
    log_axis,
    marks,
    new_figure,
    note,
    save_figure,
)
from fembridge.report import rates, validate
from fembridge.report.rates import (
    EVERY_SET,
    FAMILIES,
    FINGERTIP,
    OBSERVED,
    PAPER_R_SQUARED,
    SINES,
    STIMULI,
    TOUCHSIM,
    Family,
    RateTable,
    row_of,
)
from fembridge.report.recorded import Evidence
from fembridge.report.shortfalls import fingertip_shortfalls, shortfalls
from fembridge.report.validate import PUBLISHED_NAME, RASTER_STIMULI, Validation, repeated_trains
from fembridge.stimulus import Stimulus
from fembridge.store import filling, sha256_of, write_text, write_toml
from fembridge.tables import AFFERENTS, SPIKE_COLUMNS, SpikeTrain, spikes_frame
from fembridge.typing import Table
from fembridge.version import __version__
from fembridge.words import ABSENT, number, rendered, worded
from neural import threshold
from neural.parameter_sets import parameters_to_table

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

PAGE = "index.html"
RECORD = "validation.toml"

_RATES_IN = 1.25
_TIMING_HEADS = {
    "impulses_per_cycle": "impulses a cycle",
    "model_unit_impulses": "most alike cell",
    "model_unit_place": "its place",
    "model_impulses_per_cycle": "mean of cells",
    "strength_f": "strength at f",
    "model_strength_f": "model",
    "strength_2f": "at 2 f",
    "model_strength_2f": "model ",
    "strengths_near": "strengths within 0.25",
}
_CONVERGENCE_HEADS = {"change_percent": "last step (%)", "limit": "limit", "order": "order"}
_LIBRARIES = ("numpy", "scipy", "matplotlib")
_LEAST_P = 0.001
_HEADS = {
    "r_squared": "R²",
    "p_value": "p",
    "rmse_ips": "RMSE (ips)",
    "bias_ips": "bias (ips)",
}
# Colours that a page has under a name, one value for light and one for dark. White
# is the paper and what lies on it: the faces of open marks.
_NAMED = {
    INK: "ink",
    FAINT: "faint",
    SHADE: "shade",
    WHITE: "paper",
    **{colour: name.lower() for name, colour in AFFERENT_COLOURS.items()},
}

# Figures.
_ROOM = 1.06
# Regression.
_MARK_PT = 3.8
_REGRESSION: dict[str, Any] = {"linewidth": 1.5 * LINE_PT, "dashes": (3.5, 1.6), "zorder": 2}
_EQUAL: dict[str, Any] = {"color": FAINT, "linewidth": 1.6 * HAIR_PT}
# Beside recorded afferents; the tuning curves are `fembridge.plots.rates`.
_EVIDENCE_IN = 2.1


def write_report(folder: Path, study: Validation, command: str) -> tuple[str, ...]:
    """Write the report of `study` into `folder`, all of it or nothing; its files, the page first.

    `command` is the line that made it, which is shown under every number.
    """
    with filling(folder, last=RECORD) as draft:
        write_text(draft / PAGE, page_text(study, command, draft))
        for name, frame in csv_tables(study).items():
            write_text(draft / f"{name}.csv", frame.to_csv(index=False, lineterminator="\n"))
        write_toml(draft / RECORD, _record(study, command, draft))
        names = sorted(path.name for path in draft.iterdir())
    return (PAGE, *(name for name in names if name != PAGE))


def page_text(study: Validation, command: str, folder: Path) -> str:
    """The page; its figures are written as SVG into `folder`, which exists."""
    finest = study.deflections[-1]
    half_mm = np.interp(-0.5 * finest.at(0.0), -finest.deflection_mm, finest.distance_mm)
    observed = study.rates.reference() == OBSERVED
    cells = study.agreement
    judged = (cells.source == study.judged.name) & (cells["set"] == EVERY_SET)
    return rendered(
        "validation.html.j2",
        {"rows": _table_html, "timing": _timing_frame, "tuning": _tuning_frame},
        study=study,
        command=command,
        figures={
            name: _inline_svg(figure, folder / f"{name}.svg") for name, figure in _figures(study)
        },
        families=[_family(study, family) for family in FAMILIES],
        observed=observed,
        constants={**vars(rates), **vars(validate), **vars(threshold)},
        known=study.evidence,
        summary=_summary_frame(study, study.rates.reference()),
        touchsim=_summary_frame(study, TOUCHSIM),
        goals=cells[judged & cells.meets_paper.notna()],
        shortfalls=shortfalls(study),
        sources=_source_frame(study),
        raster_cells=validate.cells_of(study.simulations[study.judged.name]),
        tables=_threshold_frames(study),
        half_mm=float(half_mm),
        convergence=_convergence_frame(study),
        unlike=study.judged.unlike(study.response),
        held_out=_held_out_frame(study),
        fingertip_shortfalls=fingertip_shortfalls(study),
        fingertip_agreement=_fingertip_frame(study),
        ramp_facts=_ramp_facts(),
    )


def _figures(study: Validation) -> Iterator[tuple[str, "Figure"]]:
    judged, known = study.judged.name, study.evidence
    mine = study.simulations[judged]
    yield "skin_deflection", deflection_figure(study.deflections)
    strongest = next(one for one in mine.stimuli if one.id == RASTER_STIMULI[-1])
    yield "rasters", rasters_figure(repeated_trains(mine), strongest, known.trains)
    draw_rates = partial(
        rates_figure,
        observed=study.observed.rates() if study.observed else (),
        touchsim=touchsim_rates(),
    )
    published = study.simulations[PUBLISHED_NAME].mean_rates if judged != PUBLISHED_NAME else ()
    for family in FAMILIES:
        of_family = [rate for rate in mine.mean_rates if rate.stimulus in family.stimuli]
        names = {OWN: "this model"}
        figure = draw_rates(of_family, published=published, names=names, panel_in=_RATES_IN)
        yield f"rates_{family.name}", figure
        reference = study.rates.reference(family.stimuli)
        yield (
            f"regression_{family.name}",
            regression_figure(study.rates, study.agreement, family, reference, judged),
        )
    names = {OWN: "whole fingertip", PUBLISHED: "this model, on the section"}
    of_fingertip = study.simulations[FINGERTIP].mean_rates
    yield "fingertip_rates", draw_rates(of_fingertip, published=mine.mean_rates, names=names)
    yield "tuning", thresholds_figure(known.judged.curves, known.judged.tuning)
    yield "fingertip_tuning", thresholds_figure(known.fingertip.curves, known.fingertip.tuning)
    yield "phases", phase_figure(known)
    yield "man", man_figure(known)
    yield "distance", distance_figure(known)
    yield "ramp", raster_figure(known.ramp, waveform=known.ramp_stimulus)


def _inline_svg(figure: "Figure", path: Path) -> "Markup":
    """Write a figure, and turn it into an element of a page.

    It has the page's colours, ids of its own, since a page holds several figures, and no
    size: it is as wide as its place.
    """
    from markupsafe import Markup

    save_figure(figure, path)
    _, _, drawing = path.read_text(encoding="utf-8").partition("<svg ")
    head, _, drawing = drawing.partition(">")
    drawing = re.sub(r"<metadata>.*?</metadata>", "", drawing, count=1, flags=re.DOTALL)
    drawing = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{path.stem}-", drawing)
    for colour, name in _NAMED.items():
        drawing = drawing.replace(colour.lower(), f"var(--{name})")
    head = re.sub(r'\b(width|height)="[^"]*"', "", head)
    return Markup(f'<svg role="img" {head}>{drawing}')


def csv_tables(study: Validation) -> dict[str, "DataFrame"]:
    """Every number of a report as long tables, by name."""
    from pandas import DataFrame, concat

    thresholds = study.thresholds
    keys = ["source", "afferent", "frequency_hz"]
    tried = ["criterion_ips", "lowest_tried_um", "highest_tried_um", "threshold_um"]
    rasters = [
        spikes_frame(repeated_trains(simulation)).assign(source=name)
        for name, simulation in study.simulations.items()
    ]
    profiles = [
        DataFrame({"distance_mm": mesh.distance_mm, "deflection_mm": mesh.deflection_mm}).assign(
            mesh=mesh.name, elements=mesh.elements
        )
        for mesh in study.deflections
    ]
    converged = [
        (
            row["quantity"],
            mesh.name,
            mesh.elements,
            value,
            *(row[name] for name in _CONVERGENCE_HEADS),
        )
        for row in study.convergence
        for mesh, value in zip(study.deflections, row["values"], strict=True)
    ]
    columns = ["quantity", "mesh", "elements", "value", "last_change_percent", "limit", "order"]
    beside = {
        f"{prefix}{name}": table
        for prefix, found in (("", study.evidence.judged), ("fingertip_", study.evidence.fingertip))
        for name, table in (
            ("timing", found.timing),
            ("tuning", found.tuning),
            ("tuning_curves", found.curves),
        )
    }
    return {
        "rates": study.rates.frame,
        "agreement": study.agreement.drop(columns=["meets_paper", "meets_goal"]),
        "rasters": concat(rasters)[["source", *SPIKE_COLUMNS]],
        "thresholds": thresholds[keys + tried],
        "entrainment": thresholds.drop(columns=tried),
        "locking": study.locking,
        "deflection": concat(profiles)[["mesh", "elements", "distance_mm", "deflection_mm"]],
        "deflection_convergence": DataFrame(converged, columns=columns),
        "phases": study.evidence.phases,
        **beside,
        **({} if study.held_out.empty else {"held_out": study.held_out}),
        "distance": study.evidence.distance,
        "impulses_in_man": study.evidence.man,
        "ramp_and_hold": spikes_frame(study.evidence.ramp),
    }


def _table_html(frame: "DataFrame", look: str = "") -> "Markup":
    """Rows of a table; cells that are no `Markup` are escaped."""
    from markupsafe import Markup, escape
    from pandas import option_context

    words = frame.map(escape).rename(index=escape, columns=escape)
    with option_context("display.max_colwidth", None):
        return Markup(words.to_html(escape=False, border=0, classes=look, na_rep=""))


def _in_words(agreement: "DataFrame") -> "DataFrame":
    """R², p, RMSE and bias of each cell, or that there are none."""
    words = worded(agreement[[*_HEADS]], ".2f|.3f|.1f|+.1f").rename(columns=_HEADS)
    words.loc[agreement.p_value < _LEAST_P, "p"] = f"<{_LEAST_P:g}"
    words[agreement["count"] == 0] = ["none", "", "", ""]
    return words.rename_axis(columns="number")


def _laid_out(words: Any, *across: str) -> "DataFrame":  # noqa: ANN401 - pandas' stubs
    """`words`, some levels of their index as columns; both in the order in which they come."""
    down = [name for name in words.index.names if name not in across]
    rows, columns = (words.index.droplevel(levels).unique() for levels in ([*across], down))
    wide: DataFrame = words.unstack([*across]).reindex(index=rows, columns=columns)  # noqa: PD010
    wide.index.names, wide.columns.names = [None] * rows.nlevels, [None] * columns.nlevels
    return wide


def _agreement_frame(
    study: Validation, cells: "DataFrame", across: str, **titles: Mapping[str, str]
) -> "DataFrame":
    """`cells` of the agreement in words; `titles` for the values of each level that is shown."""
    words: Any = _in_words(cells).stack()  # noqa: PD013 - by their order
    for level, names in {"source": _titles(study), **titles}.items():
        words = words.rename(names, level=level)
    shown = {"source", "afferent", "number", *titles}
    words.index = words.index.droplevel([name for name in words.index.names if name not in shown])
    return _laid_out(words, across, "number").fillna("")


def _titles(study: Validation) -> dict[str, str]:
    return {source: source_title(source, study.judged.name) for source in study.rates.sources}


def _summary_frame(study: Validation, reference: str) -> "DataFrame":
    """All families against `reference`; where rates were observed, which goals are met."""
    cells = study.agreement.loc[[reference]]
    cells = cells[cells.source.isin(study.rates.compared(reference)) & (cells["set"] == EVERY_SET)]
    names = {one.name: f"{one.title} ({len(one.stimuli)} stimuli)" for one in FAMILIES}
    frame = _agreement_frame(study, cells, "source", family=names)
    if reference == OBSERVED:
        mine = cells[cells.source == study.judged.name]
        paper = f"R² > {PAPER_R_SQUARED:g}, p < {rates.PAPER_P_VALUE:g}"
        ours = f"R² ≥ {rates.GOAL_R_SQUARED:g}, RMSE below TouchSim"
        for goal, met in ((paper, mine.meets_paper), (ours, mine.meets_goal)):
            frame["Goals of this model", goal] = [_mark(one) for one in met]
    return frame


def _fingertip_frame(study: Validation) -> "DataFrame":
    """The whole fingertip beside the judged model, against observed rates where there are any."""
    references = {one.name: study.rates.reference(one.stimuli) for one in FAMILIES}
    names = {
        one.name: one.title + " (against TouchSim)" * (references[one.name] == TOUCHSIM)
        for one in FAMILIES
    }
    heads = {**_titles(study), study.judged.name: "This model, on the section"}
    cells = study.agreement[study.agreement["set"] == EVERY_SET]
    cells = cells[cells.source.isin([study.judged.name, FINGERTIP, TOUCHSIM])]
    cells = cells[cells.reference == cells.family.map(references)]
    return _agreement_frame(study, cells, "source", family=names, source=heads)


def _mark(met: bool | None) -> str:
    from markupsafe import Markup

    words = {True: '<span class="met">met</span>', False: '<span class="missed">not met</span>'}
    return ABSENT if met is None else Markup(words[met])


def _family(study: Validation, family: Family) -> dict[str, Any]:
    """One family of stimuli, what it is compared with, and how that went."""
    reference = study.rates.reference(family.stimuli)
    titles = {one.name: one.title for one in family.sets} | {EVERY_SET: "all"}
    cells = study.agreement.loc[[reference]]
    cells = cells[
        cells.source.isin(study.rates.compared(reference)) & (cells.family == family.name)
    ]
    return {
        "of": family,
        "observed": reference == OBSERVED,
        "sources": [one for one in study.rates.known(family.stimuli) if one != FINGERTIP],
        "agreement": _agreement_frame(study, cells, "afferent", set=titles),
    }


def _amplitude_words(row: Any, amplitude_um: float) -> str:  # noqa: ANN401 - a row
    """An amplitude of a row of thresholds: ``≤ 6.71``, ``23.0``, ``> 250``."""
    sign = "> " if math.isinf(amplitude_um) else "≤ " * (amplitude_um <= row.lowest_tried_um)
    return f"{sign}{min(amplitude_um, row.highest_tried_um):#.3g}".removesuffix(".")


def _threshold_frames(study: Validation) -> dict[str, "DataFrame"]:
    """Thresholds, entrainment and locking by source, class and frequency."""
    strongest = {one.entries[-1].id: one.frequency_hz for one in SINES.sets}
    locked = study.locking[study.locking.stimulus.isin(list(strongest))]
    strengths = locked.set_index(["source", "afferent", "frequency_hz"]).vector_strength
    named = {"thresholds": "threshold_um", "entrainment": "entrainment_threshold_um"}
    tables = {
        name: study.thresholds.apply(lambda row, of=of: _amplitude_words(row, row[of]), axis=1)
        for name, of in named.items()
    }
    tables["locking"] = strengths.map(lambda value: number(value, ".2f")).loc[[*study.simulations]]
    return {
        name: _laid_out(words.rename(_titles(study), level="source"), "frequency_hz")
        .fillna(ABSENT)
        .rename(columns="{:g} Hz".format)
        for name, words in tables.items()
    }


def _source_frame(study: Validation) -> "DataFrame":
    """What each source is, how many rates it has, of how many cells."""
    from pandas import DataFrame

    rows = {
        model.name: (
            model.source if model.name == PUBLISHED_NAME else f"{model.name}: {model.source}",
            str(validate.cells_of(study.simulations[model.name])),
            f"{model.preindent_um:g}",
        )
        for model in study.models
    }
    rows[TOUCHSIM] = (
        "Saal et al. 2017, a model, not data: fitted unit by unit on recordings of these "
        "experiments, sinusoids, diharmonics and noises; computed here and stored",
        ", ".join(f"{count} {name}" for name, count in TOUCHSIM_MODELS.items()),
        "0",
    )
    if study.observed is not None:
        what = f"file {study.observed.path.name}, SHA-256 {study.observed.sha256[:12]}"
        rows[OBSERVED] = (what, "as in the file", "as in the file")
    heads = ["What it is", "Cells a class", "Pre-indentation (µm)"]
    frame = DataFrame([rows[name] for name in study.rates.sources], columns=heads)
    known = study.rates.frame.source.value_counts().reindex(study.rates.sources, fill_value=0)
    frame.insert(1, "Rates", [f"{count} of {len(STIMULI) * len(AFFERENTS)}" for count in known])
    return frame.set_axis(list(_titles(study).values()))


def _held_out_frame(study: Validation) -> "DataFrame":
    """RMSE by frequency of rates whose frequency was fitted, or left out, and TouchSim's."""
    titles = {
        "fitted_rmse_ips": "all fitted",
        "held_out_rmse_ips": "left out",
        "touchsim_rmse_ips": "TouchSim",
    }
    heads = [f"{hz:g} Hz".replace("nan Hz", "all") for hz in study.held_out.frequency_hz]
    table = study.held_out.assign(head=heads).set_index(["afferent", "head"]).rename(columns=titles)
    words = table[list(titles.values())].map(lambda value: number(value, ".1f"))
    return _laid_out(words.rename_axis(columns="of").stack(), "head")  # noqa: PD013 - by order


def _timing_frame(table: "DataFrame") -> "DataFrame":
    """Recorded and predicted timing, a row a class and vibration."""
    names = [
        f"{row.afferent}, {row.frequency_hz:g} Hz, {row.amplitude_um:g} µm"
        for row in table.itertuples()
    ]
    near = table["strengths_near"].map({True: "yes", False: "no"})
    shown = table.assign(strengths_near=near).set_axis(names)[list(_TIMING_HEADS)]
    return shown.rename(columns=_TIMING_HEADS)


def _tuning_frame(tuning: "DataFrame") -> "DataFrame":
    """How far thresholds are off, a row a class."""
    from pandas import concat

    known = tuning.dropna(subset="ratio")
    times = np.exp(np.abs(np.log(known["ratio"]))).set_axis(known["afferent"])
    every = concat([times, times.set_axis(["all"] * times.size)])
    numbers: DataFrame = every.groupby(level=0, sort=False).agg(["size", "median", "max"])
    return numbers.set_axis(["Thresholds", "median factor", "largest factor"], axis=1)


def _ramp_facts() -> "DataFrame":
    table = published(RAMP).table
    heads = {"fact": "What is known", "source": "Source"}
    return table.set_index("afferent").rename_axis(None).rename(columns=heads)


def _convergence_frame(study: Validation) -> "DataFrame":
    from pandas import DataFrame

    frame = DataFrame(study.convergence, columns=["quantity", *_CONVERGENCE_HEADS, "values"])
    meshes = [f"{mesh.name}, {mesh.elements} elements" for mesh in study.deflections]
    values = DataFrame(frame.pop("values").tolist(), columns=meshes)
    units = ["mm" if "_mm at" in name else "N/mm" for name in frame["quantity"]]
    names = [
        name.replace("deflection_mm", "deflection").replace("force_n_per_mm", "force on the probe")
        for name in frame.pop("quantity")
    ]
    values.insert(0, "Unit", units)
    return values.join(frame.rename(columns=_CONVERGENCE_HEADS)).set_axis(names)


def _record(study: Validation, command: str, folder: Path) -> Table:
    """What a report was made of, and what its files should hold; no date, no place."""
    wanted = ("mesh_sha256", "version", "law")
    table: Table = {
        "fembridge": __version__,
        "command": command,
        "judged": study.judged.name,
        "reference": study.rates.reference(),
        "versions": {
            "python": platform.python_version(),
            **{name: importlib.metadata.version(name) for name in _LIBRARIES},
        },
        "touchsim": {"sha256": sha256_of(TOUCHSIM_TABLE)},
        "response": {
            "finger": study.finger,
            "closure_percent": study.response.closure_percent,
            **study.response.origin,
        },
        "models": {
            model.name: {
                "source": model.source,
                **({"origin": dict(model.origin)} if model.origin else {}),
                "preindent_um": model.preindent_um,
                "parameters": parameters_to_table(model.parameters),
            }
            for model in study.models
        },
        "deflection": {
            mesh.name: {
                "elements": mesh.elements,
                **{name: mesh.origin[name] for name in wanted if name in (mesh.origin or ())},
            }
            for mesh in study.deflections
        },
        "files": {path.name: sha256_of(path) for path in sorted(folder.iterdir())},
    }
    if study.observed is not None:
        table["observed"] = {
            "file": study.observed.path.name,
            "sha256": study.observed.sha256,
            "stimuli": len(study.observed.stimuli),
            "left_out": list(study.left_out),
        }
    return table


def source_title(source: str, judged: str) -> str:
    """Words for a source in figures and tables."""
    titles = {OBSERVED: "Observed", PUBLISHED_NAME: "Published model", FINGERTIP: "Whole fingertip"}
    return titles.get(source, "This model" if source == judged else source)


@in_style
def regression_figure(
    rates: RateTable, agreement: "DataFrame", family: Family, reference: str, judged: str
) -> "Figure":
    """Predicted against reference rates: a column a class, a row a predicting source.

    Points, the line through them, and the line of equal rates.
    """
    from matplotlib.ticker import MaxNLocator

    sources = rates.compared(reference)
    height_in = 0.8 + len(sources) * 1.85
    figure, panels = new_figure(height_in, len(sources), len(AFFERENTS), sharex="col", sharey="col")
    for column, afferent in zip(panels.T, AFFERENTS, strict=True):
        for panel, source in zip(column, sources, strict=True):
            cell = row_of(agreement, reference, source, family.name, EVERY_SET, afferent)
            _draw_points(panel, rates, family, cell)
            panel.axline((0, 0), slope=1.0, zorder=1, **_EQUAL)
        top_ips = _ROOM * max(1.0, rates.largest_ips(afferent, family.stimuli))
        column[0].set(xlim=(0.0, top_ips), ylim=(0.0, top_ips))
        for axis in (column[0].xaxis, column[0].yaxis):
            axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        style = class_style(afferent, TEXT_PT + 1)
        note(column[0], afferent, (0.5, 1.0), (0, 20), ha="center", **style)
    for panel, source in zip(panels[:, 0], sources, strict=True):
        panel.set_ylabel(source_title(source, judged), fontsize=TEXT_PT)
    across = "Observed rate" if reference == OBSERVED else "TouchSim’s rate"
    figure.supxlabel(f"{across} (impulses/s)", fontsize=TEXT_PT)
    figure.supylabel("Predicted rate (impulses/s)", fontsize=TEXT_PT)
    samples = [marks(marker, INK, _MARK_PT) for marker in MARKERS[: len(family.sets)]]
    names = [*(one.title for one in family.sets), "regression", "equal rates"]
    legend_above(figure, [*samples, _REGRESSION, _EQUAL], names, handlelength=1.8)
    return figure


def _draw_points(panel: "Axes", rates: RateTable, family: Family, cell: Any) -> None:  # noqa: ANN401 - row
    words = "no rates to compare"
    if cell["count"]:
        colour = GREY if cell.source == TOUCHSIM else AFFERENT_COLOURS[cell.afferent]
        pair = (cell.reference, cell.source)
        for marker, one in zip(MARKERS, family.sets, strict=False):
            points_ips = (rates.of(source, cell.afferent, one.stimuli) for source in pair)
            panel.plot(*points_ips, **marks(marker, colour, _MARK_PT))
        if math.isfinite(cell.slope):
            all_ips = rates.of(cell.reference, cell.afferent, family.stimuli)
            ends_ips = np.array([np.nanmin(all_ips), np.nanmax(all_ips)])
            line_ips = cell.slope * ends_ips + cell.intercept_ips
            panel.plot(ends_ips, line_ips, color=colour, **_REGRESSION)
        words = f"R² {number(cell.r_squared, '.2f')}, RMSE {cell.rmse_ips:.1f} ips"
    panel.set_title(words, loc="left", pad=5)


def rasters_figure(
    trains: Sequence[SpikeTrain],
    strongest: Stimulus,
    recorded: Sequence[SpikeTrain] = (),
) -> "Figure":
    """Spikes of Fig. 3 (a), `recorded` trains of the same stimuli in rows of their own."""
    order = list(dict.fromkeys(train.stimulus for train in trains))
    mine = [train for train in recorded if train.stimulus in order]
    every = [*trains, *(replace(one, stimulus=f"{one.stimulus}, {OBSERVED}") for one in mine)]
    rows = dict.fromkeys(train.stimulus for train in every)
    stimuli = sorted(rows, key=lambda row: order.index(row.partition(",")[0]))
    return raster_figure(every, stimuli=stimuli, waveform=strongest)


@in_style
def phase_figure(found: Evidence) -> "Figure":
    """Shares of the spikes by phase of the cycle: recorded as steps, the model's filled."""
    keys = ["afferent", "frequency_hz", "amplitude_um"]
    cells: list[tuple[Any, Any]] = [*found.phases.groupby(keys, sort=False)]
    figure, [panels] = new_figure(_EVIDENCE_IN, columns=len(cells), sharey=True)
    for panel, ((name, frequency_hz, amplitude_um), rows) in zip(panels, cells, strict=True):
        edges_ms = [*rows["phase_ms"], 1000.0 / frequency_hz]
        panel.stairs(rows["model"], edges_ms, fill=True, color=AFFERENT_COLOURS[name], alpha=0.75)
        panel.stairs(rows["recorded"], edges_ms, color=INK)
        panel.set_xlim(edges_ms[0], edges_ms[-1])
        panel.set_xlabel("Phase (ms)")
        words = f"{name}\n{frequency_hz:g} Hz\n{amplitude_um:g} µm"
        note(panel, words, (0.98, 0.97), (0, 0), ha="right", va="top")
    panels[0].set_ylabel("Share of the spikes")
    model = [{"color": AFFERENT_COLOURS[one], "linewidth": 4} for one in AFFERENTS]
    legend_above(figure, [{"color": INK}, model], ["recorded", "this model"])
    return figure


@in_style
def man_figure(found: Evidence) -> "Figure":
    """Impulses a cycle against amplitude: medians of human units as dots, the model as lines."""
    figure, [panels] = new_figure(_EVIDENCE_IN, columns=len(AFFERENTS), sharey=True)
    fills = {8.0: 1.0, 32.0: 0.6, 128.0: 0.3}
    for panel, name in zip(panels, AFFERENTS, strict=True):
        colour = AFFERENT_COLOURS[name]
        for frequency_hz, rows in found.man[found.man["afferent"] == name].groupby("frequency_hz"):
            alpha = fills.get(float(str(frequency_hz)), 1.0)
            panel.plot("amplitude_um", "model", data=rows, color=colour, alpha=alpha)
            medians = dots(colour, 3.5, alpha=alpha)
            panel.plot("amplitude_um", "impulses_per_cycle", data=rows, **medians)
        log_axis(panel, 6.0, 400.0)
        panel.set_xlabel("Amplitude (µm)")
        note(panel, name, (0.04, 0.9), (0, 0), **class_style(name))
    panels[0].set_ylabel("Impulses a cycle")
    samples = [*({"color": INK, "alpha": alpha} for alpha in fills.values()), dots(INK, 3.5)]
    legend_above(figure, samples, [*(f"model, {hz:g} Hz" for hz in fills), "medians in man"])
    return figure


@in_style
def distance_figure(found: Evidence) -> "Figure":
    """Amplitude for one impulse a cycle against distance: recorded as dots, RA's as lines."""
    figure, [[panel]] = new_figure(_EVIDENCE_IN)
    colour = AFFERENT_COLOURS["RA"]
    styles: dict[str, dict[str, Any]] = {
        "amplitude_um": dots(INK, 3.5),
        "model_um": {"color": colour},
        "keenest_um": {"color": colour, "dashes": (3, 2)},
    }
    for name, style in styles.items():
        panel.plot("distance_mm", name, data=found.distance, **style)
    panel.set_yscale("log")
    panel.set_yticks([50, 100, 200, 500], ["50", "100", "200", "500"])
    panel.set_yticks([], minor=True)
    panel.set_xlabel("Distance from the probe’s centre (mm)")
    panel.set_ylabel("Amplitude (µm)")
    legend_above(figure, styles.values(), ["recorded", "median cell", "keenest cell"])
    return figure
