"""A validation as a folder: page, figures, tables, and a record of the inputs.

The text of the page is in ``validation.html.j2``; this file has the tables, with formatted
numbers, and the figures that only a validation has. A source looks the same in all figures:
observed rates are black, TouchSim is grey, a model has the colour of the class, the judged
model is filled.
"""

import importlib.metadata
import math
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.evidence import RAMP, TOUCHSIM_MODELS, TOUCHSIM_TABLE, published, touchsim_rates
from fembridge.host.store import filling, sha256_of, write_text, write_toml
from fembridge.io.formatting import ABSENT, number, rendered, worded
from fembridge.io.spike_table import SpikeTrain, spikes_frame
from fembridge.plots.rate_comparison import MAIN, PUBLISHED, rates_figure, thresholds_figure
from fembridge.plots.response import deflection_figure
from fembridge.plots.spike_figures import raster_figure
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    GREY,
    HAIR_PT,
    INK,
    LINE_PT,
    MARKERS,
    TEXT_PT,
    class_style,
    dots,
    in_style,
    legend_above,
    log_axis,
    marks,
    new_figure,
    note,
)
from fembridge.reporting import rate_tables as rates
from fembridge.reporting import recorded, validation_data
from fembridge.reporting.rate_tables import (
    ALL_SETS,
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
from fembridge.reporting.recorded import STRENGTH_TOLERANCE, Comparison, Evidence
from fembridge.reporting.recorded_sets import OUYANG_SOURCE, RECORDED_SETS, RecordedSet
from fembridge.reporting.shortfalls import fingertip_shortfalls, shortfalls
from fembridge.reporting.svg import inline_svg
from fembridge.reporting.validation_data import (
    PUBLISHED_NAME,
    RASTER_STIMULI,
    ValidationData,
    repeated_trains,
)
from fembridge.stimulus import Stimulus
from fembridge.trace import AFFERENTS
from fembridge.typing import Table
from fembridge.version import __version__
from neural import threshold
from neural.parameter_sets import parameters_to_table

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from fembridge.plots.style import Panels

PAGE = "index.html"
RECORD = "validation.toml"

_RATES_IN = 1.25
_TIMING_HEADS = {
    "impulses_per_cycle": "impulses per cycle, recorded",
    "model_unit_impulses": "closest cell",
    "model_unit_place": "rank of that cell",
    "model_impulses_per_cycle": "mean of all cells",
    "strength_f": "vector strength at f, recorded",
    "model_strength_f": "model at f",
    "strength_2f": "at 2 f, recorded",
    "model_strength_2f": "model at 2 f",
    "strengths_near": f"both within {STRENGTH_TOLERANCE:g}",
}
# Quantities that `fembridge.response.deflection.convergence` compares: title and unit.
_CONVERGENCE_TITLES = {
    "deflection_mm": ("deflection", "mm"),
    "force_n_per_mm": ("force on the probe", "N/mm"),
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
# Figures.
_ROOM = 1.06
# Regression figure.
_MARK_PT = 3.8
_REGRESSION: dict[str, Any] = {"linewidth": 1.5 * LINE_PT, "dashes": (3.5, 1.6), "zorder": 2}
_EQUAL: dict[str, Any] = {"color": FAINT, "linewidth": 1.6 * HAIR_PT}
# Figures with recorded afferents; the tuning curves are in `fembridge.plots.rate_comparison`.
_EVIDENCE_IN = 2.1


def write_report(folder: Path, validation: ValidationData, command: str) -> tuple[str, ...]:
    """Names of the files of a report written to `folder`, the page first.

    A failure leaves `folder` unchanged. `command` is the command line that makes the report;
    the page shows it under every figure and table.
    """
    with filling(folder, last=RECORD) as draft:
        write_text(draft / PAGE, page_text(validation, command, draft))
        for name, frame in csv_tables(validation).items():
            write_text(draft / f"{name}.csv", frame.to_csv(index=False, lineterminator="\n"))
        write_toml(draft / RECORD, _record(validation, command, draft))
        names = sorted(path.name for path in draft.iterdir())
    return (PAGE, *(name for name in names if name != PAGE))


def page_text(validation: ValidationData, command: str, folder: Path) -> str:
    """Text of the page; writes its figures as SVG into `folder`, which must exist."""
    finest = validation.deflections[-1]
    half_mm = np.interp(-0.5 * finest.at(0.0), -finest.deflection_mm, finest.distance_mm)
    observed = validation.rates.reference() == OBSERVED
    cells = validation.agreement
    judged = (cells.source == validation.judged.name) & (cells["set"] == ALL_SETS)
    return rendered(
        "validation.html.j2",
        {"rows": _table_html, "timing": _timing_frame, "tuning": _tuning_frame},
        validation=validation,
        command=command,
        figures={
            name: inline_svg(figure, folder / f"{name}.svg")
            for name, figure in _figures(validation)
        },
        families=[_family(validation, family) for family in FAMILIES],
        observed=observed,
        constants={**vars(rates), **vars(validation_data), **vars(recorded), **vars(threshold)},
        evidence=validation.evidence,
        summary=_summary_frame(validation, validation.rates.reference()),
        touchsim=_summary_frame(validation, TOUCHSIM),
        goals=cells[judged & cells.meets_paper.notna()],
        shortfalls=shortfalls(validation),
        sources=_source_frame(validation),
        raster_cells=validation_data.cells_of(validation.simulations[validation.judged.name]),
        tables=_threshold_frames(validation),
        half_mm=float(half_mm),
        convergence=_convergence_frame(validation),
        fit_mismatch=validation.judged.fit_mismatch(validation.response),
        held_out=_held_out_frame(validation),
        fingertip_shortfalls=fingertip_shortfalls(validation),
        fingertip_agreement=None if validation.on_pad else _fingertip_frame(validation),
        ramp_facts=_ramp_facts(),
        recorded_sets=_recorded_frame(validation),
        missing_sets=_missing_sets(validation),
    )


def _figures(validation: ValidationData) -> Iterator[tuple[str, "Figure"]]:
    for name, draw in figure_functions(validation).items():
        yield name, draw()


def figure_functions(validation: ValidationData) -> dict[str, Callable[..., "Figure"]]:
    """Function that draws each figure of the page, by name, in the order of the page.

    `axes` of each function are panels in reading order that replace a new figure.
    """
    judged, evidence = validation.judged.name, validation.evidence
    simulation = validation.simulations[judged]
    strongest = next(
        stimulus for stimulus in simulation.stimuli if stimulus.id == RASTER_STIMULI[-1]
    )
    draw_rates = partial(
        rates_figure,
        observed=validation.observed.rates() if validation.observed else (),
        touchsim=touchsim_rates(),
    )
    published = (
        validation.simulations[PUBLISHED_NAME].mean_rates if judged != PUBLISHED_NAME else ()
    )
    functions: dict[str, Callable[..., Figure]] = {
        "skin_deflection": partial(deflection_figure, validation.deflections),
        "rasters": lambda axes=None: rasters_figure(
            repeated_trains(simulation), strongest, evidence.trains, axes
        ),
    }
    for family in FAMILIES:
        functions[f"rates_{family.name}"] = partial(
            draw_rates,
            [rate for rate in simulation.mean_rates if rate.stimulus in family.stimuli],
            published=published,
            names={MAIN: "this model"},
            panel_in=_RATES_IN,
        )
        functions[f"regression_{family.name}"] = partial(
            regression_figure,
            validation.rates,
            validation.agreement,
            family,
            validation.rates.reference(family.stimuli),
            judged,
        )
    if not validation.on_pad:
        functions["fingertip_rates"] = partial(
            draw_rates,
            validation.simulations[FINGERTIP].mean_rates,
            published=simulation.mean_rates,
            names={MAIN: "whole fingertip", PUBLISHED: "this model, on the section"},
        )
    for prefix, comparison in _comparisons(evidence).items():
        functions[f"{prefix}tuning"] = partial(
            thresholds_figure, comparison.curves, comparison.tuning
        )
    return {
        **functions,
        "phases": partial(phase_figure, evidence),
        "human": partial(human_figure, evidence),
        "distance": partial(distance_figure, evidence),
        "ramp": partial(raster_figure, evidence.ramp, waveform=evidence.ramp_stimulus),
    }


def _comparisons(evidence: Evidence) -> dict[str, Comparison]:
    """Comparison of each model by the prefix of its files."""
    fingertip = {} if evidence.fingertip is None else {"fingertip_": evidence.fingertip}
    return {"": evidence.judged, **fingertip}


def csv_tables(validation: ValidationData) -> dict[str, "DataFrame"]:
    """All numbers of a report as long tables, by file name."""
    from pandas import DataFrame, concat

    thresholds = validation.thresholds
    keys = ["source", "afferent", "frequency_hz"]
    tried = ["criterion_ips", "lowest_tried_um", "highest_tried_um", "threshold_um"]
    rasters = [
        spikes_frame(repeated_trains(simulation)).assign(source=name)
        for name, simulation in validation.simulations.items()
    ]
    profiles = [
        DataFrame({"distance_mm": mesh.distance_mm, "deflection_mm": mesh.deflection_mm}).assign(
            mesh=mesh.name, elements=mesh.elements
        )
        for mesh in validation.deflections
    ]
    converged = [
        (
            row["quantity"],
            mesh.name,
            mesh.elements,
            value,
            *(row[name] for name in _CONVERGENCE_HEADS),
        )
        for row in validation.convergence
        for mesh, value in zip(validation.deflections, row["values"], strict=True)
    ]
    columns = ["quantity", "mesh", "elements", "value", "last_change_percent", "limit", "order"]
    evidence = validation.evidence
    comparisons = {
        f"{prefix}{name}": table
        for prefix, comparison in _comparisons(evidence).items()
        for name, table in (
            ("timing", comparison.timing),
            ("tuning", comparison.tuning),
            ("tuning_curves", comparison.curves),
        )
    }
    tables = {
        "rates": validation.rates.frame,
        "agreement": validation.agreement.drop(columns=["meets_paper", "meets_goal"]),
        "rasters": concat(rasters)[["source", *rasters[0].columns[:-1]]],
        "thresholds": thresholds[keys + tried],
        "entrainment": thresholds.drop(columns=tried),
        "locking": validation.locking,
        "deflection": concat(profiles)[["mesh", "elements", "distance_mm", "deflection_mm"]],
        "deflection_convergence": DataFrame(converged, columns=columns),
        "phases": evidence.phases,
        **comparisons,
        **({} if validation.held_out.empty else {"held_out": validation.held_out}),
        "distance": evidence.distance,
        "human_impulses": evidence.human,
        "ramp_and_hold": spikes_frame(evidence.ramp),
        "recorded_sets": validation.recorded_sets,
        "recorded_points": validation.points,
    }
    return {name: table.reset_index(drop=True) for name, table in tables.items()}


def _table_html(frame: "DataFrame", look: str = "") -> "Markup":
    """HTML of a table with CSS class `look`; cells that are not `Markup` are escaped."""
    from markupsafe import Markup, escape
    from pandas import option_context

    escaped = frame.map(escape).rename(index=escape, columns=escape)
    with option_context("display.max_colwidth", None):
        return Markup(escaped.to_html(escape=False, border=0, classes=look, na_rep=""))


def _formatted(agreement: "DataFrame") -> "DataFrame":
    """R², p, RMSE and bias of each row as text; "none" without rates."""
    cells = worded(agreement[[*_HEADS]], ".2f|.3f|.1f|+.1f").rename(columns=_HEADS)
    cells.loc[agreement.p_value < _LEAST_P, "p"] = f"<{_LEAST_P:g}"
    cells[agreement["count"] == 0] = ["none", "", "", ""]
    return cells.rename_axis(columns="number")


def _unstacked(cells: Any, *levels: str) -> "DataFrame":  # noqa: ANN401 - pandas' stubs
    """`cells` with these index `levels` as columns; rows and columns keep their order."""
    down = [name for name in cells.index.names if name not in levels]
    rows, columns = (cells.index.droplevel(names).unique() for names in ([*levels], down))
    wide: DataFrame = cells.unstack([*levels]).reindex(index=rows, columns=columns)  # noqa: PD010
    wide.index.names, wide.columns.names = [None] * rows.nlevels, [None] * columns.nlevels
    return wide


def _agreement_frame(
    validation: ValidationData, rows: "DataFrame", across: str, **titles: Mapping[str, str]
) -> "DataFrame":
    """Agreement `rows` as text, level `across` as columns; `titles` by level, then value."""
    cells: Any = _formatted(rows).stack()  # noqa: PD013 - by their order
    for level, names in {"source": _titles(validation), **titles}.items():
        cells = cells.rename(names, level=level)
    shown = {"source", "afferent", "number", *titles}
    cells.index = cells.index.droplevel([name for name in cells.index.names if name not in shown])
    return _unstacked(cells, across, "number").fillna("")


def _titles(validation: ValidationData) -> dict[str, str]:
    return {
        source: source_title(source, validation.judged.name) for source in validation.rates.sources
    }


def _summary_frame(validation: ValidationData, reference: str) -> "DataFrame":
    """Agreement of all families with `reference`; with observed rates also the goals."""
    from pandas import Series

    cells = validation.agreement.loc[[reference]]
    cells = cells[
        cells.source.isin(validation.rates.compared_with(reference)) & (cells["set"] == ALL_SETS)
    ]
    counts = cells["count"].groupby(cells["family"].to_numpy()).max()
    names = {
        family.name: f"{family.title} ({_count_text(int(counts[family.name]), family)} stimuli)"
        for family in FAMILIES
    }
    frame = _agreement_frame(validation, cells, "source", family=names)
    if reference == OBSERVED:
        judged = cells[cells.source == validation.judged.name]
        paper = f"R² > {PAPER_R_SQUARED:g}, p < {rates.PAPER_P_VALUE:g}"
        project = f"R² ≥ {rates.GOAL_R_SQUARED:g}, RMSE below TouchSim"
        for goal, column in ((paper, judged.meets_paper), (project, judged.meets_goal)):
            # As objects: pandas with pyarrow would make `Markup` a plain text.
            marks = Series([_mark(met) for met in column], frame.index, dtype=object)
            frame["Goals of this model", goal] = marks
    return frame


def _count_text(count: int, family: Family) -> str:
    """Number of compared stimuli of a family, and of all if they are more."""
    total = len(family.stimuli)
    return str(total) if count in (0, total) else f"{count} of {total}"


def _fingertip_frame(validation: ValidationData) -> "DataFrame":
    """Agreement of the whole fingertip and of the judged model with the reference per family."""
    references = {family.name: validation.rates.reference(family.stimuli) for family in FAMILIES}
    names = {
        family.name: family.title + " (against TouchSim)" * (references[family.name] == TOUCHSIM)
        for family in FAMILIES
    }
    heads = {**_titles(validation), validation.judged.name: "This model, on the section"}
    cells = validation.agreement[validation.agreement["set"] == ALL_SETS]
    cells = cells[cells.source.isin([validation.judged.name, FINGERTIP, TOUCHSIM])]
    cells = cells[cells.reference == cells.family.map(references)]
    return _agreement_frame(validation, cells, "source", family=names, source=heads)


def _mark(is_met: bool | None) -> str:
    from markupsafe import Markup

    marks = {True: '<span class="met">met</span>', False: '<span class="missed">not met</span>'}
    return ABSENT if is_met is None else Markup(marks[is_met])


def _family(validation: ValidationData, family: Family) -> dict[str, Any]:
    """One family of stimuli: its sources, and their agreement with the reference."""
    reference = validation.rates.reference(family.stimuli)
    titles = {group.name: group.title for group in family.sets} | {ALL_SETS: "all"}
    cells = validation.agreement.loc[[reference]]
    cells = cells[
        cells.source.isin(validation.rates.compared_with(reference)) & (cells.family == family.name)
    ]
    counts = cells["count"].groupby(cells["set"].to_numpy(), sort=False).sum()
    cells = cells[cells["set"].map(counts) > 0]
    return {
        "family": family,
        "without_rates": [titles[str(name)] for name in counts.index[counts == 0]],
        "observed": reference == OBSERVED,
        "sources": [
            source
            for source in validation.rates.sources_with_rates(family.stimuli)
            if source != FINGERTIP
        ],
        "agreement": _agreement_frame(validation, cells, "afferent", set=titles),
    }


def _amplitude_text(row: Any, amplitude_um: float) -> str:  # noqa: ANN401 - a row
    """Text of an amplitude of a threshold row: ``≤ 6.71``, ``23.0``, ``> 250``."""
    sign = "> " if math.isinf(amplitude_um) else "≤ " * (amplitude_um <= row.lowest_tried_um)
    return f"{sign}{min(amplitude_um, row.highest_tried_um):#.3g}".removesuffix(".")


def _threshold_frames(validation: ValidationData) -> dict[str, "DataFrame"]:
    """Thresholds, entrainment and locking by source, class and frequency."""
    strongest = [group.entries[-1].id for group in SINES.sets]
    locked = validation.locking[validation.locking.stimulus.isin(strongest)]
    strengths = locked.set_index(["source", "afferent", "frequency_hz"]).vector_strength
    columns = {"thresholds": "threshold_um", "entrainment": "entrainment_threshold_um"}
    tables = {
        name: validation.thresholds.apply(
            lambda row, column=column: _amplitude_text(row, row[column]), axis=1
        )
        for name, column in columns.items()
    }
    tables["locking"] = strengths.map(lambda value: number(value, ".2f")).loc[
        [*validation.simulations]
    ]
    return {
        name: _unstacked(cells.rename(_titles(validation), level="source"), "frequency_hz")
        .fillna(ABSENT)
        .rename(columns="{:g} Hz".format)
        for name, cells in tables.items()
    }


def _source_frame(validation: ValidationData) -> "DataFrame":
    """Description of each source, with its number of rates and cells."""
    from pandas import DataFrame

    rows = {
        model.name: (
            model.source if model.name == PUBLISHED_NAME else f"{model.name}: {model.source}",
            str(validation_data.cells_of(validation.simulations[model.name])),
            f"{model.preindent_um:g}",
        )
        for model in validation.models
    }
    rows[TOUCHSIM] = (
        "Saal et al. 2017, a model, not data: each unit fitted to recordings of these "
        "experiments (sinusoids, diharmonics and noises); stored rates, computed by this project",
        ", ".join(f"{count} {name}" for name, count in TOUCHSIM_MODELS.items()),
        "0",
    )
    if validation.observed is not None:
        description = (
            f"file {validation.observed.path.name}, SHA-256 {validation.observed.sha256[:12]}"
        )
        rows[OBSERVED] = (description, "as in the file", "as in the file")
    heads = ["Description", "Cells per class", "Pre-indentation (µm)"]
    frame = DataFrame([rows[name] for name in validation.rates.sources], columns=heads)
    counts = validation.rates.frame.source.value_counts().reindex(
        validation.rates.sources, fill_value=0
    )
    frame.insert(1, "Rates", [f"{count} of {len(STIMULI) * len(AFFERENTS)}" for count in counts])
    return frame.set_axis(list(_titles(validation).values()))


def _held_out_frame(validation: ValidationData) -> "DataFrame":
    """RMSE by frequency: complete fit, fit without that frequency, and TouchSim."""
    titles = {
        "fitted_rmse_ips": "complete fit",
        "held_out_rmse_ips": "left out",
        "touchsim_rmse_ips": "TouchSim",
    }
    heads = ["all" if math.isnan(hz) else f"{hz:g} Hz" for hz in validation.held_out.frequency_hz]
    table = (
        validation.held_out.assign(head=heads)
        .set_index(["afferent", "head"])
        .rename(columns=titles)
    )
    cells = table[list(titles.values())].map(lambda value: number(value, ".1f"))
    return _unstacked(cells.rename_axis(columns="fit").stack(), "head")  # noqa: PD013 - by order


def _timing_frame(table: "DataFrame") -> "DataFrame":
    """Recorded and predicted timing, one row per class and vibration."""
    names = [
        f"{row.afferent}, {row.frequency_hz:g} Hz, {row.amplitude_um:g} µm"
        for row in table.itertuples()
    ]
    near = table["strengths_near"].map({True: "yes", False: "no"})
    shown = table.assign(strengths_near=near).set_axis(names)[list(_TIMING_HEADS)]
    return shown.rename(columns=_TIMING_HEADS)


def _tuning_frame(tuning: "DataFrame") -> "DataFrame":
    """Factors between predicted and recorded thresholds, one row per class."""
    from pandas import concat

    reached = tuning.dropna(subset="ratio")
    factors = np.exp(np.abs(np.log(reached["ratio"]))).set_axis(reached["afferent"])
    with_all = concat([factors, factors.set_axis(["all"] * factors.size)])
    numbers: DataFrame = with_all.groupby(level=0, sort=False).agg(["size", "median", "max"])
    return numbers.set_axis(["Thresholds", "median factor", "largest factor"], axis=1)


def _recorded_frame(validation: ValidationData) -> "DataFrame":
    """R², error and ratio of each source, one row per recorded set and class."""
    from pandas import DataFrame, MultiIndex

    table = validation.recorded_sets
    filled = table[table["missing"].isna()]
    sets = {recorded_set.name: recorded_set for recorded_set in RECORDED_SETS}
    rows, index = [], []
    for (name, afferent), group in filled.groupby(["set", "afferent"], sort=False):
        recorded_set = sets[str(name)]
        cells: dict[tuple[str, str], str] = {}
        for row in group.to_dict("records"):
            cells.update(_source_cells(row, recorded_set, validation.judged.name))
        rows.append(cells)
        index.append((f"{recorded_set.title} ({recorded_set.role})", str(afferent)))
    sources = (validation.judged.name, FINGERTIP, TOUCHSIM, OUYANG_SOURCE)
    titles = [source_title(source, validation.judged.name) for source in sources]
    heads = [(title, head) for title in titles for head in ("R²", "RMSE", "ratio")][:-1]
    counts = filled.drop_duplicates(["set", "afferent"])["recorded"]
    frame = DataFrame(
        rows, index=MultiIndex.from_tuples(index), columns=MultiIndex.from_tuples(heads)
    )
    frame = frame.dropna(axis="columns", how="all").astype(object).fillna("")
    frame.insert(0, ("", "n"), [str(count) for count in counts])
    return frame


def _source_cells(
    row: Mapping[Any, Any], recorded_set: RecordedSet, judged: str
) -> dict[tuple[str, str], str]:
    """Cells of one source in a row of `_recorded_frame`."""
    title = source_title(row["source"], judged)
    spec = ".2f" if recorded_set.unit in ("1", "per cycle", "impulses") else ".1f"
    rmse = number(row["rmse"], spec)
    if recorded_set.ratios:
        rmse = rmse if rmse == ABSENT else f"× {rmse}"
    falls = row["correlation"] < 0
    cells = {
        "R²": number(row["r_squared"], ".2f") + " (r < 0)" * falls,
        "RMSE": rmse,
        "ratio": number(row["ratio"], ".2f"),
    }
    if row["count"] < row["recorded"]:
        cells["ratio"] += f" ({row['count']:.0f})"
    if row["source"] == OUYANG_SOURCE:
        del cells["ratio"]
    return {(title, head): text for head, text in cells.items()}


def _missing_sets(validation: ValidationData) -> list[tuple[str, str]]:
    """Title of each recorded set without data, and the data that would fill it."""
    table = validation.recorded_sets
    missing = dict(zip(table["set"], table["missing"], strict=True))
    have = set(table["set"][table["missing"].isna()])
    return [
        (f"{recorded_set.title} ({recorded_set.role})", missing[recorded_set.name])
        for recorded_set in RECORDED_SETS
        if recorded_set.name not in have
    ]


def _ramp_facts() -> "DataFrame":
    table = published(RAMP).table
    heads = {"fact": "Observation", "source": "Source"}
    return table.set_index("afferent").rename_axis(None).rename(columns=heads)


def _convergence_frame(validation: ValidationData) -> "DataFrame":
    from pandas import DataFrame

    frame = DataFrame(validation.convergence, columns=["quantity", *_CONVERGENCE_HEADS, "values"])
    meshes = [f"{mesh.name}, {mesh.elements} elements" for mesh in validation.deflections]
    values = DataFrame(frame.pop("values").tolist(), columns=meshes)
    names, units = [], []
    for quantity in frame.pop("quantity"):
        column, _, position = quantity.partition(" at ")
        title, unit = _CONVERGENCE_TITLES[column]
        names.append(f"{title} at {position}" if position else title)
        units.append(unit)
    values.insert(0, "Unit", units)
    return values.join(frame.rename(columns=_CONVERGENCE_HEADS)).set_axis(names)


def _record(validation: ValidationData, command: str, folder: Path) -> Table:
    """Inputs of a report, its command and checksums of its files."""
    files = {path.name: sha256_of(path) for path in sorted(folder.iterdir())}
    return {"command": command, **input_record(validation), "files": files}


def input_record(validation: ValidationData) -> Table:
    """Inputs of a validation with checksums; no date, no path."""
    mesh_keys = ("mesh_sha256", "version", "law")
    table: Table = {
        "fembridge": __version__,
        "judged": validation.judged.name,
        "reference": validation.rates.reference(),
        "versions": {
            "python": platform.python_version(),
            **{name: importlib.metadata.version(name) for name in _LIBRARIES},
        },
        "touchsim": {"sha256": sha256_of(TOUCHSIM_TABLE)},
        "response": {
            "finger": validation.finger,
            "closure_percent": validation.response.closure_percent,
            **validation.response.origin,
        },
        "models": {
            model.name: {
                "source": model.source,
                **({"origin": dict(model.origin)} if model.origin else {}),
                "preindent_um": model.preindent_um,
                "parameters": parameters_to_table(model.parameters),
            }
            for model in validation.models
        },
        "deflection": {
            mesh.name: {
                "elements": mesh.elements,
                **{name: mesh.origin[name] for name in mesh_keys if name in (mesh.origin or ())},
            }
            for mesh in validation.deflections
        },
    }
    if validation.observed is not None:
        table["observed"] = {
            "file": validation.observed.path.name,
            "sha256": validation.observed.sha256,
            "stimuli": len(validation.observed.stimuli),
            "left_out": list(validation.left_out),
        }
    return table


def source_title(source: str, judged: str) -> str:
    """Title of a source in figures and tables."""
    titles = {OBSERVED: "Observed", PUBLISHED_NAME: "Published model", FINGERTIP: "Whole fingertip"}
    return titles.get(source, "This model" if source == judged else source)


@in_style
def regression_figure(
    rates: RateTable,
    agreement: "DataFrame",
    family: Family,
    reference: str,
    judged: str,
    axes: "Panels | None" = None,
) -> "Figure":
    """Predicted against reference rates: a column per class, a row per predicting source.

    Each panel has the points, their regression line and the line of equal rates. `axes` are drawn
    into instead of a new figure, without a legend.
    """
    from matplotlib.ticker import MaxNLocator

    sources = rates.compared_with(reference)
    height_in = 0.8 + len(sources) * 1.85
    figure, panels = new_figure(
        height_in, len(sources), len(AFFERENTS), sharex="col", sharey="col", axes=axes
    )
    for column, afferent in zip(panels.T, AFFERENTS, strict=True):
        for panel, source in zip(column, sources, strict=True):
            cell = row_of(agreement, reference, source, family.name, ALL_SETS, afferent)
            _draw_points(panel, rates, family, cell)
            panel.axline((0, 0), slope=1.0, zorder=1, **_EQUAL)
        compared = [
            stimulus
            for stimulus, rate_ips in zip(
                family.stimuli,
                rates.rates_ips(reference, afferent, family.stimuli),
                strict=True,
            )
            if np.isfinite(rate_ips)
        ]
        top_ips = _ROOM * max(1.0, rates.largest_ips(afferent, compared)) if compared else 1.0
        column[0].set(xlim=(0.0, top_ips), ylim=(0.0, top_ips))
        for axis in (column[0].xaxis, column[0].yaxis):
            axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        style = class_style(afferent, TEXT_PT + 1)
        note(column[0], afferent, (0.5, 1.0), (0, 20), ha="center", **style)
    for panel, source in zip(panels[:, 0], sources, strict=True):
        panel.set_ylabel(source_title(source, judged), fontsize=TEXT_PT)
    across = "Observed rate" if reference == OBSERVED else "TouchSim’s rate"
    if axes is not None:
        for panel in panels[-1]:
            panel.set_xlabel(f"{across} (impulses/s)")
        return figure
    figure.supxlabel(f"{across} (impulses/s)", fontsize=TEXT_PT)
    figure.supylabel("Predicted rate (impulses/s)", fontsize=TEXT_PT)
    samples = [marks(marker, INK, _MARK_PT) for marker in MARKERS[: len(family.sets)]]
    names = [*(group.title for group in family.sets), "regression", "equal rates"]
    legend_above(figure, [*samples, _REGRESSION, _EQUAL], names, handlelength=1.8)
    return figure


def _draw_points(panel: "Axes", rates: RateTable, family: Family, cell: Any) -> None:  # noqa: ANN401 - row
    title = "no rates to compare"
    if cell["count"]:
        colour = GREY if cell.source == TOUCHSIM else AFFERENT_COLOURS[cell.afferent]
        pair = (cell.reference, cell.source)
        for marker, group in zip(MARKERS, family.sets, strict=False):
            points_ips = (rates.rates_ips(source, cell.afferent, group.stimuli) for source in pair)
            panel.plot(*points_ips, **marks(marker, colour, _MARK_PT))
        if math.isfinite(cell.slope):
            all_ips = rates.rates_ips(cell.reference, cell.afferent, family.stimuli)
            ends_ips = np.array([np.nanmin(all_ips), np.nanmax(all_ips)])
            line_ips = cell.slope * ends_ips + cell.intercept_ips
            panel.plot(ends_ips, line_ips, color=colour, **_REGRESSION)
        title = f"R² {number(cell.r_squared, '.2f')}, RMSE {cell.rmse_ips:.1f} ips"
    panel.set_title(title, loc="left", pad=5)


def rasters_figure(
    trains: Sequence[SpikeTrain],
    strongest: Stimulus,
    recorded: Sequence[SpikeTrain] = (),
    axes: "Panels | None" = None,
) -> "Figure":
    """Spikes of Fig. 3 (a), and `recorded` trains of the same stimuli in separate rows.

    `axes`, one per class, are drawn into instead of a new figure.
    """
    stimuli = list(dict.fromkeys(train.stimulus for train in trains))
    labels = {stimulus: f"{stimulus}, {OBSERVED}" for stimulus in stimuli}
    relabelled = [
        replace(train, stimulus=labels[train.stimulus])
        for train in recorded
        if train.stimulus in labels
    ]
    observed = {train.stimulus for train in relabelled}
    rows = [
        row
        for stimulus, label in labels.items()
        for row in (stimulus, label)
        if row == stimulus or row in observed
    ]
    return raster_figure([*trains, *relabelled], stimuli=rows, waveform=strongest, axes=axes)


@in_style
def phase_figure(evidence: Evidence, axes: "Panels | None" = None) -> "Figure":
    """Shares of the spikes by phase of the cycle: recorded as steps, the model filled.

    `axes` are drawn into instead of a new figure, without a legend.
    """
    keys = ["afferent", "frequency_hz", "amplitude_um"]
    cells: list[tuple[Any, Any]] = [*evidence.phases.groupby(keys, sort=False)]
    figure, [panels] = new_figure(_EVIDENCE_IN, columns=len(cells), sharey=True, axes=axes)
    for panel, ((name, frequency_hz, amplitude_um), rows) in zip(panels, cells, strict=True):
        edges_ms = [*rows["phase_ms"], 1000.0 / frequency_hz]
        panel.stairs(rows["model"], edges_ms, fill=True, color=AFFERENT_COLOURS[name], alpha=0.75)
        panel.stairs(rows["recorded"], edges_ms, color=INK)
        panel.set_xlim(edges_ms[0], edges_ms[-1])
        panel.set_xlabel("Phase (ms)")
        label = f"{name}\n{frequency_hz:g} Hz\n{amplitude_um:g} µm"
        note(panel, label, (0.98, 0.97), (0, 0), ha="right", va="top")
    panels[0].set_ylabel("Share of the spikes")
    model = [{"color": AFFERENT_COLOURS[name], "linewidth": 4} for name in AFFERENTS]
    if axes is None:
        legend_above(figure, [{"color": INK}, model], ["recorded", "this model"])
    return figure


@in_style
def human_figure(evidence: Evidence, axes: "Panels | None" = None) -> "Figure":
    """Impulses per cycle against amplitude: medians of human units as dots, model as lines.

    `axes`, one per class, are drawn into instead of a new figure, without a legend.
    """
    figure, [panels] = new_figure(_EVIDENCE_IN, columns=len(AFFERENTS), sharey=True, axes=axes)
    fills = {8.0: 1.0, 32.0: 0.6, 128.0: 0.3}
    for panel, name in zip(panels, AFFERENTS, strict=True):
        colour = AFFERENT_COLOURS[name]
        of_class = evidence.human[evidence.human["afferent"] == name]
        for frequency_hz, rows in of_class.groupby("frequency_hz"):
            alpha = fills.get(float(str(frequency_hz)), 1.0)
            panel.plot("amplitude_um", "model", data=rows, color=colour, alpha=alpha)
            medians = dots(colour, 3.5, alpha=alpha)
            panel.plot("amplitude_um", "impulses_per_cycle", data=rows, **medians)
        log_axis(panel, 6.0, 400.0)
        panel.set_xlabel("Amplitude (µm)")
        note(panel, name, (0.04, 0.9), (0, 0), **class_style(name))
    panels[0].set_ylabel("Impulses per cycle")
    samples = [*({"color": INK, "alpha": alpha} for alpha in fills.values()), dots(INK, 3.5)]
    if axes is None:
        names = [*(f"model, {hz:g} Hz" for hz in fills), "medians of human units"]
        legend_above(figure, samples, names)
    return figure


@in_style
def distance_figure(evidence: Evidence, axes: "Panels | None" = None) -> "Figure":
    """Amplitude for one impulse per cycle against distance: recorded as dots, RA as lines.

    `axes`, one panel, are drawn into instead of a new figure, without a legend.
    """
    figure, [[panel]] = new_figure(_EVIDENCE_IN, axes=axes)
    colour = AFFERENT_COLOURS["RA"]
    styles: dict[str, dict[str, Any]] = {
        "amplitude_um": dots(INK, 3.5),
        "model_um": {"color": colour},
        "most_sensitive_um": {"color": colour, "dashes": (3, 2)},
    }
    for name, style in styles.items():
        panel.plot("distance_mm", name, data=evidence.distance, **style)
    panel.set_yscale("log")
    panel.set_yticks([50, 100, 200, 500], ["50", "100", "200", "500"])
    panel.set_yticks([], minor=True)
    panel.set_xlabel("Distance from the probe’s centre (mm)")
    panel.set_ylabel("Amplitude (µm)")
    if axes is None:
        legend_above(figure, styles.values(), ["recorded", "median cell", "most sensitive cell"])
    return figure
