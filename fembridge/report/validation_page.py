"""A validation as a folder: the page, its figures, its numbers, what it was made of.

The words of the page are in ``validation.html.j2``; here are the numbers and the sentences
that depend on them.
"""

import importlib.metadata
import math
import platform
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge import __version__
from fembridge.plots.deflection import deflection_figure
from fembridge.plots.style import AFFERENT_COLOURS, FAINT, INK, SHADE, WHITE, save_figure
from fembridge.report.rates import (
    EVERY_SET,
    FAMILIES,
    GOAL_R_SQUARED,
    OBSERVED,
    PAPER_P_VALUE,
    PAPER_R_SQUARED,
    SINES,
    STIMULI,
    TOUCHSIM,
    Family,
    beats,
    meets_paper,
    row_of,
    times_apart,
)
from fembridge.report.validate import (
    PUBLISHED_NAME,
    RASTER_STIMULI,
    REPEATS,
    Validation,
    cells_of,
    repeated_trains,
)
from fembridge.report.validation_figures import (
    raster_figure,
    rate_figure,
    regression_figure,
    source_title,
    threshold_figure,
)
from fembridge.store import filling, sha256_of, write_text
from fembridge.tables import AFFERENTS, SPIKE_COLUMNS
from fembridge.touchsim import TABLE
from fembridge.typing import Table
from neural.parameter_sets import parameters_to_table
from neural.threshold import CRITERION_IPS, PLATEAU

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.figure import Figure
    from pandas import DataFrame, Series

PAGE = "index.html"
RECORD = "validation.toml"
# An RMSE above this share of the mean rate is a shortfall even where R² is high.
RMSE_SHARE = 0.5
# A threshold this many times too high or too low is a shortfall.
THRESHOLD_FACTOR = 2.0

_TEMPLATE = "validation.html.j2"
_LIBRARIES = ("numpy", "scipy", "matplotlib")
_ABSENT = "–"
_LEAST_P = 0.001
_STORED = "# TouchSim: its rates are stored, see fembridge/touchsim/README.md"
# Colours that a page has under a name, one value for light and one for dark. White
# is the paper and what lies on it: the faces of open marks.
_NAMED = {
    INK: "ink",
    FAINT: "faint",
    SHADE: "shade",
    WHITE: "paper",
    **{colour: name.lower() for name, colour in AFFERENT_COLOURS.items()},
}
_SVG, _XLINK = "http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"


def write_report(folder: Path, study: Validation, command: str) -> tuple[str, ...]:
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
        write_text(draft / PAGE, page_text(study, command, draft))
        for name, frame in csv_tables(study).items():
            write_text(draft / f"{name}.csv", frame.to_csv(index=False, lineterminator="\n"))
        write_text(draft / RECORD, tomli_w.dumps(_record(study, command, draft)))
        names = sorted(path.name for path in draft.iterdir())
    return (PAGE, *(name for name in names if name != PAGE))


def page_text(study: Validation, command: str, folder: Path) -> str:
    """The page; its figures are written as SVG into `folder`, which exists."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("fembridge.report", "."),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": _number, "rows": _table_html}
    figures = {
        name: _inline_svg(figure, folder / f"{name}.svg") for name, figure in _figures(study)
    }
    return environment.get_template(_TEMPLATE).render(
        study=study,
        command=command,
        figures=figures,
        families=[_family_words(study, family) for family in FAMILIES],
        observed=study.rates.reference() == OBSERVED,
        simulate=lambda stimuli: [command, *_simulations(study, stimuli), _STORED],
        raster_command=_simulations(study, ",".join(RASTER_STIMULI))[0],
        constants={
            "paper_r_squared": PAPER_R_SQUARED,
            "paper_p": PAPER_P_VALUE,
            "repeats": REPEATS,
            "criterion_ips": CRITERION_IPS,
            "plateau": PLATEAU,
            "factor": THRESHOLD_FACTOR,
        },
        summary=_agreement_frame(study, study.rates.reference()),
        touchsim=_agreement_frame(study, TOUCHSIM),
        goals_met=_goals_met(study),
        shortfalls=shortfalls(study),
        sources=_source_frame(study),
        raster=_raster_words(study),
        near=_near_thresholds(study),
        tables=_threshold_frames(study),
        deflection=_deflection_words(study),
        convergence=_convergence_frame(study),
    )


def _figures(study: Validation) -> Iterator[tuple[str, "Figure"]]:
    judged = study.judged.name
    simulation = study.simulations[judged]
    stimuli = [one for one in simulation.stimuli if one.id in RASTER_STIMULI]
    yield "skin_deflection", deflection_figure(study.deflections)
    yield "rasters", raster_figure(repeated_trains(simulation), stimuli)
    for family in FAMILIES:
        reference = study.rates.reference(family.stimuli)
        yield f"rates_{family.name}", rate_figure(study.rates, family, judged)
        yield (
            f"regression_{family.name}",
            regression_figure(study.rates, study.agreement, family, reference, judged),
        )
    yield "thresholds", threshold_figure(study.thresholds, judged)


def _inline_svg(figure: "Figure", path: Path) -> "Markup":
    """Write a figure, and turn it into an element of a page.

    It has the page's colours, ids of its own, since a page holds several figures, and no
    size: it is as wide as its place.
    """
    from xml.etree import ElementTree

    from markupsafe import Markup

    save_figure(figure, path)
    ElementTree.register_namespace("", _SVG)
    ElementTree.register_namespace("xlink", _XLINK)
    root = ElementTree.parse(path).getroot()
    root.attrib.pop("width")
    root.attrib.pop("height")
    root.set("role", "img")
    for metadata in root.findall(f"{{{_SVG}}}metadata"):
        root.remove(metadata)
    for element in root.iter():
        for key, value in element.attrib.items():
            if key == "id":
                changed = f"{path.stem}-{value}"
            elif key.endswith("href"):
                changed = value.replace("#", f"#{path.stem}-")
            else:
                changed = value.replace("url(#", f"url(#{path.stem}-")
                for colour, name in _NAMED.items():
                    changed = changed.replace(colour.lower(), f"var(--{name})")
            element.set(key, changed)
    return Markup(ElementTree.tostring(root, encoding="unicode"))


def csv_tables(study: Validation) -> dict[str, "DataFrame"]:
    """Every number of a report as long tables, by name."""
    from pandas import DataFrame

    thresholds = study.thresholds
    keys = ["source", "afferent", "frequency_hz"]
    tried = ["criterion_ips", "lowest_tried_um", "highest_tried_um", "threshold_um"]
    spikes = [
        (name, train.stimulus, train.afferent, train.repeat, time_ms)
        for name, simulation in study.simulations.items()
        for train in repeated_trains(simulation)
        for time_ms in train.times_ms.tolist()
    ]
    profiles = [
        (mesh.name, mesh.elements, *point)
        for mesh in study.deflections
        for point in zip(mesh.distance_mm.tolist(), mesh.deflection_mm.tolist(), strict=True)
    ]
    converged = [
        (row.quantity, mesh.name, mesh.elements, value, row.change_percent, row.limit, row.order)
        for row in study.convergence
        for mesh, value in zip(study.deflections, row.values, strict=True)
    ]
    return {
        "rates": study.rates.frame,
        "agreement": study.agreement,
        "rasters": DataFrame(spikes, columns=["source", *SPIKE_COLUMNS]),
        "thresholds": thresholds[keys + tried],
        "entrainment": thresholds.drop(columns=tried),
        "locking": study.locking,
        "deflection": DataFrame(
            profiles, columns=["mesh", "elements", "distance_mm", "deflection_mm"]
        ),
        "deflection_convergence": DataFrame(
            converged,
            columns=[
                *("quantity", "mesh", "elements", "value"),
                *("last_change_percent", "limit", "order"),
            ],
        ),
    }


def _number(value: float, spec: str) -> str:
    """A number, or a dash for one that does not exist."""
    return _ABSENT if math.isnan(value) else format(value, spec).replace("-", "\N{MINUS SIGN}")


def _amplitude(value_um: float) -> str:
    return f"{value_um:#.3g}".removesuffix(".")


def _table_html(frame: "DataFrame", look: str = "") -> "Markup":
    """Rows of a table; cells that are no `Markup` are escaped."""
    from markupsafe import Markup, escape
    from pandas import option_context

    words = frame.map(escape).rename(index=escape, columns=escape)
    with option_context("display.max_colwidth", None):
        return Markup(words.to_html(escape=False, border=0, classes=look, na_rep=""))


def _simulations(study: Validation, stimuli: str) -> list[str]:
    """A line for each model that fires it under `stimuli`."""
    return [
        shlex.join(
            (
                *("fembridge", "simulate", "--stimulus", stimuli),
                *("--finger", study.finger, "--stored"),
                *("--parameters", model.word),
                *("--preindent-um", f"{model.preindent_um:g}"),
                *("-o", f"{model.name}_{stimuli.partition(',')[0]}"),
            )
        )
        for model in study.models
    ]


def _cell(
    study: Validation,
    source: str,
    family: Family,
    afferent: str,
    *,
    reference: str | None = None,
    set_: str = EVERY_SET,
) -> "Series[Any]":
    """A row of the agreement table; against what the family is compared with by default."""
    reference = reference or study.rates.reference(family.stimuli)
    return row_of(study.agreement, reference, source, family.name, set_, afferent)


def _numbers(cell: "Series[Any]") -> list[str]:
    """R², p, RMSE and bias of a cell, or that there are none."""
    if cell["count"] == 0:
        return ["none", "", "", ""]
    bias = f"{cell.bias_ips:+.1f}" if round(cell.bias_ips, 1) else "0.0"
    return [
        _number(cell.r_squared, ".2f"),
        "<0.001" if cell.p_value < _LEAST_P else _number(cell.p_value, ".3f"),
        _number(cell.rmse_ips, ".1f"),
        bias.replace("-", "\N{MINUS SIGN}"),
    ]


def _predicting(study: Validation, reference: str) -> list[str]:
    return [source for source in study.rates.sources if source not in (OBSERVED, reference)]


_HEADS = ("R²", "p", "RMSE (ips)", "bias (ips)")


def _agreement_frame(study: Validation, reference: str) -> "DataFrame":
    """All families against `reference`; where rates were observed, which goals are met."""
    from pandas import DataFrame, MultiIndex

    sources = _predicting(study, reference)
    columns = list(product((source_title(s, study.judged.name) for s in sources), _HEADS))
    if reference == OBSERVED:
        paper = f"R² > {PAPER_R_SQUARED:g}, p < {PAPER_P_VALUE:g}"
        ours = f"R² ≥ {GOAL_R_SQUARED:g}, RMSE below TouchSim"
        columns += [("Goals of this model", paper), ("Goals of this model", ours)]
    rows = {}
    for family, afferent in product(FAMILIES, AFFERENTS):
        cells = [_cell(study, s, family, afferent, reference=reference) for s in sources]
        words = [word for cell in cells for word in _numbers(cell)]
        if reference == OBSERVED:
            words += [_mark(met) for met in _goals(study, family, afferent)]
        rows[f"{family.title} ({len(family.stimuli)} stimuli)", afferent] = words
    frame = DataFrame(list(rows.values()), columns=MultiIndex.from_tuples(columns))
    return frame.set_axis(MultiIndex.from_tuples(rows), axis=0)


def _goals(study: Validation, family: Family, afferent: str) -> tuple[bool | None, bool | None]:
    """Whether the judged model meets the paper's bar, and ours; None without observed rates."""
    mine, touchsims = (
        _cell(study, source, family, afferent, reference=OBSERVED)
        for source in (study.judged.name, TOUCHSIM)
    )
    return meets_paper(mine), beats(mine, touchsims)


def _mark(met: bool | None) -> str:
    from markupsafe import Markup

    if met is None:
        return _ABSENT
    return Markup('<span class="{}">{}</span>').format(
        *(("met", "met"), ("missed", "not met"))[not met]
    )


def _goals_met(study: Validation) -> list[int]:
    """Cells that meet the paper's bar, that meet ours, and all that have observed rates."""
    if study.rates.reference() != OBSERVED:
        return []
    marks = [_goals(study, family, afferent) for family, afferent in product(FAMILIES, AFFERENTS)]
    known = [mark for mark in marks if mark[0] is not None]
    return [sum(bool(mark[k]) for mark in known) for k in (0, 1)] + [len(known)]


def _family_words(study: Validation, family: Family) -> dict[str, Any]:
    """What the page says of one family of stimuli, beside its figures."""
    judged, reference = study.judged.name, study.rates.reference(family.stimuli)
    looks = {
        OBSERVED: "black dots: observed",
        PUBLISHED_NAME: "thin: the published model",
        TOUCHSIM: "grey dashes: TouchSim",
        judged: "thick: this model",
    }
    shares, worst = [], []
    for afferent in AFFERENTS:
        cell = _cell(study, judged, family, afferent)
        if cell["count"]:
            shares.append(f"{afferent} {_number(cell.r_squared, '.2f')}")
            worst.append(f"{afferent} at {_worst_set(study, family, afferent)}")
    return {
        "name": family.name,
        "title": family.title,
        "figure": family.figure,
        "table": family.table,
        "observed": reference == OBSERVED,
        "shown": "; ".join(looks[s] for s in study.rates.known(family.stimuli)),
        "shares": ", ".join(shares),
        "worst": "; ".join(worst),
        "agreement": _family_frame(study, family, reference),
    }


def _family_frame(study: Validation, family: Family, reference: str) -> "DataFrame":
    from pandas import DataFrame, MultiIndex

    titles = {one.name: one.title for one in family.sets} | {EVERY_SET: "all"}
    rows = {
        (source_title(source, study.judged.name), title): [
            word
            for afferent in AFFERENTS
            for word in _numbers(
                _cell(study, source, family, afferent, reference=reference, set_=name)
            )
        ]
        for source, (name, title) in product(_predicting(study, reference), titles.items())
    }
    columns = MultiIndex.from_product([AFFERENTS, _HEADS])
    frame = DataFrame(list(rows.values()), columns=columns)
    return frame.set_axis(MultiIndex.from_tuples(rows), axis=0)


def _worst_set(study: Validation, family: Family, afferent: str) -> str:
    """Set with the largest mean error, how far and to which side: in words."""
    cells = {
        one.title: _cell(study, study.judged.name, family, afferent, set_=one.name)
        for one in family.sets
    }
    biases_ips = {title: float(cell.bias_ips) for title, cell in cells.items() if cell["count"]}
    title = max(biases_ips, key=lambda title: abs(biases_ips[title]))
    side = "high" if biases_ips[title] > 0 else "low"
    return f"{title}, {abs(biases_ips[title]):.1f} impulses/s too {side} on average"


def shortfalls(study: Validation) -> tuple[str, ...]:
    """A sentence for each cell and class where the model is not good enough."""
    cells = (_cell_shortfall(study, *place) for place in product(FAMILIES, AFFERENTS))
    thresholds = (_threshold_shortfall(study, afferent) for afferent in AFFERENTS)
    return tuple(sentence for sentence in (*cells, *thresholds) if sentence)


def _cell_shortfall(study: Validation, family: Family, afferent: str) -> str:
    reference = study.rates.reference(family.stimuli)
    cell = _cell(study, study.judged.name, family, afferent)
    if cell["count"] == 0:
        return ""
    against = "" if reference == OBSERVED else ", against TouchSim"
    name = f"{afferent}, {family.title.lower()}{against}"
    predicted = study.rates.of(study.judged.name, afferent, family.stimuli)
    target = study.rates.of(reference, afferent, family.stimuli)
    top_ips, mean_ips = float(np.nanmax(target)), float(np.nanmean(target))
    if not np.nanmax(predicted) > 0 and top_ips > 0:
        return f"{name}: silent throughout, where {reference} reaches {top_ips:.1f} impulses/s."
    near = cell.rmse_ips <= RMSE_SHARE * mean_ips
    if near and (cell.r_squared > PAPER_R_SQUARED or mean_ips == 0):
        return ""
    worst = _worst_set(study, family, afferent).replace(", ", " ", 1)
    return (
        f"{name}: R² {_number(cell.r_squared, '.2f')}, RMSE {cell.rmse_ips:.1f} impulses/s where "
        f"the mean rate is {mean_ips:.1f}; at {worst}."
    )


def _threshold_shortfall(study: Validation, afferent: str) -> str:
    reference = study.rates.reference(SINES.stimuli)
    words = [
        f"{_threshold_words(mine)} µm instead of "
        f"{_threshold_words(theirs)} µm at {frequency_hz:g} Hz"
        for frequency_hz, mine, theirs in _threshold_pairs(study, afferent)
        if times_apart(mine.threshold_um, theirs.threshold_um) > THRESHOLD_FACTOR
    ]
    whose = "the observed" if reference == OBSERVED else "TouchSim’s"
    opening = f"{afferent}, thresholds off by more than {THRESHOLD_FACTOR:g} times from {whose}"
    return f"{opening}: {', '.join(words)}." if words else ""


def _threshold_pairs(study: Validation, afferent: str) -> Iterator[tuple[float, Any, Any]]:
    """Thresholds of the judged model and of what it is compared with, by frequency."""
    reference = study.rates.reference(SINES.stimuli)
    for one in SINES.sets:
        frequency_hz = one.entries[0].numbers()["frequency_hz"]
        if (reference, afferent, frequency_hz) in study.thresholds.index:
            mine, theirs = (
                row_of(study.thresholds, source, afferent, frequency_hz)
                for source in (study.judged.name, reference)
            )
            yield frequency_hz, mine, theirs


def _near_thresholds(study: Validation) -> list[int]:
    """How many thresholds are near the reference's, of how many."""
    apart = [
        times_apart(mine.threshold_um, theirs.threshold_um)
        for afferent in AFFERENTS
        for _, mine, theirs in _threshold_pairs(study, afferent)
    ]
    return [sum(ratio <= THRESHOLD_FACTOR for ratio in apart), len(apart)]


def _amplitude_words(row: Any, amplitude_um: float) -> str:  # noqa: ANN401 - a row
    """An amplitude of a row of thresholds: ``≤ 6.71``, ``23.0``, ``> 250``."""
    if math.isinf(amplitude_um):
        return f"> {_amplitude(row.highest_tried_um)}"
    sign = "≤ " if amplitude_um <= row.lowest_tried_um else ""
    return f"{sign}{_amplitude(amplitude_um)}"


def _threshold_words(row: Any) -> str:  # noqa: ANN401 - a row
    return _amplitude_words(row, row.threshold_um)


def _entrainment_words(row: Any) -> str:  # noqa: ANN401 - a row
    words = _amplitude_words(row, row.entrainment_threshold_um)
    if math.isnan(row.plateau_low_um):
        return words
    ends = map(_amplitude, (row.plateau_low_um, row.plateau_high_um))
    return f"{words} ({'–'.join(dict.fromkeys(ends))})"


def _threshold_frames(study: Validation) -> dict[str, "DataFrame"]:
    """Thresholds, entrainment and locking by source, class and frequency."""
    strongest = {
        one.entries[-1].id: one.entries[-1].numbers()["frequency_hz"] for one in SINES.sets
    }
    locked = study.locking[study.locking.stimulus.isin(list(strongest))]
    strengths = locked.set_index(["source", "afferent", "frequency_hz"]).vector_strength
    words: dict[str, tuple[Iterable[str], Callable[[Any], str]]] = {
        "thresholds": (
            study.rates.known(SINES.stimuli),
            lambda key: _threshold_words(row_of(study.thresholds, *key)),
        ),
        "entrainment": (
            study.rates.known(SINES.stimuli),
            lambda key: _entrainment_words(row_of(study.thresholds, *key)),
        ),
        "locking": (
            (model.name for model in study.models),
            lambda key: _number(strengths[key], ".2f"),
        ),
    }
    return {
        name: _by_frequency(study, sources, list(strongest.values()), word)
        for name, (sources, word) in words.items()
    }


def _by_frequency(
    study: Validation,
    sources: Iterable[str],
    frequencies_hz: Sequence[float],
    word: Callable[[Any], str],
) -> "DataFrame":
    from pandas import DataFrame, MultiIndex

    known = set(study.thresholds.index)
    places = list(product(sources, AFFERENTS))
    rows = [
        [word(key) if (key := (*place, hz)) in known else _ABSENT for hz in frequencies_hz]
        for place in places
    ]
    index = [(source_title(source, study.judged.name), afferent) for source, afferent in places]
    frame = DataFrame(rows, columns=[f"{hz:g} Hz" for hz in frequencies_hz])
    return frame.set_axis(MultiIndex.from_tuples(index), axis=0)


def _source_frame(study: Validation) -> "DataFrame":
    """What each source is, how many rates it has, of how many cells."""
    from pandas import DataFrame

    models = {model.name: model for model in study.models}
    rows = {}
    for source in study.rates.sources:
        if source == OBSERVED and study.observed is not None:
            digest = study.observed.sha256[:12]
            what = f"file {study.observed.path.name}, SHA-256 {digest}"
            cells, preindent = "as in the file", "as in the file"
        elif source == TOUCHSIM:
            what = "Saal et al. 2017, computed for this project and stored; a model, not data"
            cells, preindent = "4 SA, 9 RA, 4 PC", "0"
        else:
            model = models[source]
            what = model.source if source == PUBLISHED_NAME else f"{source}: {model.source}"
            cells = str(cells_of(study.simulations[source]))
            preindent = f"{model.preindent_um:g}"
        known = int((study.rates.frame.source == source).sum())
        rates = f"{known} of {len(STIMULI) * len(AFFERENTS)}"
        rows[source_title(source, study.judged.name)] = (what, rates, cells, preindent)
    heads = ["What it is", "Rates", "Cells a class", "Pre-indentation (µm)"]
    return DataFrame(list(rows.values()), columns=heads, index=list(rows))


def _raster_words(study: Validation) -> dict[str, Any]:
    simulation = study.simulations[study.judged.name]
    trains = repeated_trains(simulation)
    depth_um = {one.id: float(one.displacement_um.max()) for one in simulation.stimuli}
    silent = [
        f"{afferent} at {depth_um[stimulus]:.0f} µm"
        for stimulus, afferent in product(RASTER_STIMULI, AFFERENTS)
        if not any(
            train.times_ms.size
            for train in trains
            if (train.stimulus, train.afferent) == (stimulus, afferent)
        )
    ]
    return {"cells": cells_of(simulation), "silent": silent}


def _deflection_words(study: Validation) -> dict[str, Any]:
    finest = study.deflections[-1]
    apex_mm = float(finest.at(0.0))
    half_mm = float(np.interp(-0.5 * apex_mm, -finest.deflection_mm, finest.distance_mm))
    return {
        "finest": finest.name,
        "apex_mm": apex_mm,
        "at_1_mm": float(finest.at(1.0)),
        "half_mm": half_mm,
        "last": [mesh.name for mesh in study.deflections[-2:]],
        "largest_percent": max((abs(row.change_percent) for row in study.convergence), default=0.0),
    }


def _convergence_frame(study: Validation) -> "DataFrame":
    from pandas import DataFrame

    rows = {}
    for row in study.convergence:
        deflection = row.quantity.startswith("deflection_mm")
        name = row.quantity.replace("deflection_mm", "deflection")
        rows[name if deflection else "force on the probe"] = [
            "mm" if deflection else "N/mm",
            *(_number(value, ".4f") for value in row.values),  # noqa: PD011 - no frame
            _number(row.change_percent, ".2f"),
            _number(row.limit, ".4f"),
            _number(row.order, ".1f"),
        ]
    meshes = [f"{mesh.name}, {mesh.elements} elements" for mesh in study.deflections]
    heads = ["Unit", *meshes, "last step (%)", "limit", "order"]
    return DataFrame(list(rows.values()), columns=heads, index=list(rows))


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
        "touchsim": {"sha256": sha256_of(TABLE)},
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
                **{
                    name: mesh.origin[name]
                    for name in wanted
                    if isinstance(mesh.origin, Mapping) and name in mesh.origin
                },
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
