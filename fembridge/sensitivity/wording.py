"""Effects as Markdown tables, and the words and units in which quantities are shown."""

import math
from collections.abc import Callable

import pandas as pd

from fembridge.io.formatting import ABSENT, markdown, number, split_unit
from fembridge.sensitivity.effects import (
    _LABEL_PATTERNS,
    _LARGE,
    _LAYERS,
    _PA_PER_KPA,
    _PARAMETER_LABELS,
    ALL,
    OUTPUT,
    RATE,
    STRESS,
    SweptFingers,
    _Row,
    ordered_parameters,
)


def effects_markdown(effects: pd.DataFrame) -> str:
    """One Markdown table per class: range, change of rates and stress; ``~``: not monotone."""

    def change(effect: _Row) -> str:
        quantity = effect["quantity"]
        reference = effect["at_low"] if math.isnan(effect["at_base"]) else effect["at_base"]
        text = number(
            to_display_unit(quantity, effect["change"]), f"+.{_digits(reference, quantity)}f"
        )
        percent = number(effect["change_percent"], "+.0f")
        share = "" if percent == ABSENT else f" ({percent} %)"
        return f"{text}{share}{'' if effect['monotone'] else ' ~'}"

    def head(effect: _Row) -> str:
        at_base = effect["at_base"]
        text = _output_label(effect)
        return (
            text
            if math.isnan(at_base)
            else f"{text} ({_format_answer(at_base, effect['quantity'])})"
        )

    def add_spans(class_effects: pd.DataFrame, cells: pd.DataFrame) -> None:
        spans_of = class_effects.groupby("parameter")[["low", "high"]].first()
        ends = spans_of.loc[cells.index].itertuples()
        spans = [
            f"{end.low:.4g}, {end.high:.4g} {split_unit(str(end.Index))[1]}".rstrip()
            for end in ends
        ]
        cells.insert(0, "from, to", spans)

    return _class_tables(effects, head, change, add_spans)


def regressions_markdown(swept: SweptFingers, regressions: pd.DataFrame) -> str:
    """One Markdown table per class: coefficients, bold if their interval excludes 0."""

    def coefficient(fit: _Row) -> str:
        text = number(fit["coefficient"], "+.2f")
        return f"**{text}**" if fit["low_95"] > 0 or fit["high_95"] < 0 else text

    def add_fits(class_fits: pd.DataFrame, text: pd.DataFrame) -> None:
        fits, spans = [], []
        for fit in class_fits.drop_duplicates(OUTPUT).to_dict("records"):
            r_squared = f"{fit['r_squared']:.2f} ({fit['adjusted_r_squared']:.2f})"
            fits.append("no variation" if math.isnan(fit["r_squared"]) else r_squared)
            answers = swept.answers[tuple(fit[name] for name in OUTPUT)]
            low, high = (
                _format_answer(end, fit["quantity"]) for end in (answers.min(), answers.max())
            )
            spans.append(f"{low.partition(' ')[0]} to {high}")
        text.loc["R² (adjusted)"], text.loc["over all fingers"] = fits, spans

    return _class_tables(regressions, _output_label, coefficient, add_fits)


def _class_tables(
    table: pd.DataFrame,
    head: Callable[[_Row], str],
    cell: Callable[[_Row], str],
    complete: Callable[[pd.DataFrame, pd.DataFrame], None],
) -> str:
    """One Markdown table per class: one row per parameter, one column per output.

    `complete` adds rows or columns to a table.
    """
    selected = table[(table["quantity"] == RATE) | (table["stimuli"] == ALL)]
    blocks = []
    for afferent, class_rows in selected.groupby("afferent", sort=False):
        class_rows = class_rows.sort_values(
            "quantity", key=lambda quantity: quantity != RATE, kind="stable"
        )
        rows = class_rows.to_dict("records")
        long = class_rows.assign(head=[*map(head, rows)], cell=[*map(cell, rows)])
        wide = long.pivot(index="parameter", columns="head", values="cell")  # noqa: PD010 - nothing to aggregate
        cells = wide.loc[ordered_parameters(class_rows), long["head"].unique()]
        complete(class_rows, cells)
        labelled = cells.rename(index=parameter_words).rename_axis("parameter").reset_index()
        blocks.append(f"**{afferent}**\n\n{markdown(labelled)}\n")
    return "\n".join(blocks)


def _output_label(row: _Row) -> str:
    return "peak stress" if row["quantity"] == STRESS else group_label(row["stimuli"])


def _format_answer(value: float, quantity: str) -> str:
    unit = " kPa" if quantity == STRESS else ""
    return f"{to_display_unit(quantity, value):.{_digits(value, quantity)}f}{unit}"


def _digits(value: float, quantity: str) -> int:
    if quantity == STRESS:
        return 2 if abs(value) >= _PA_PER_KPA else 3
    return 0 if abs(value) >= _LARGE else 1


def parameter_words(name: str) -> str:
    """Label of a parameter, as ``dermis modulus``; unknown parameters keep their name."""
    for pattern, label in _LABEL_PATTERNS:
        if (match := pattern.fullmatch(name)) is not None:
            return label.format(_LAYERS.get(match[1], match[1]))
    return _PARAMETER_LABELS.get(name, name)


def group_label(group: str) -> str:
    """Label of a group of stimuli, as ``20 Hz`` or ``diharmonic``."""
    family, _, frequency_hz = group.partition("_")
    if family == "sine" and frequency_hz:
        return f"{frequency_hz} Hz"
    return {"diharm": "diharmonic"}.get(group, group)


def quantity_label(quantity: str) -> str:
    """Label of a quantity with the unit of `to_display_unit`."""
    return {RATE: "rate (impulses/s)", STRESS: "peak stress (kPa)"}[quantity]


def to_display_unit(quantity: str, number: float) -> float:
    """Value of a quantity in the unit of its label."""
    return number / _PA_PER_KPA if quantity == STRESS else number
