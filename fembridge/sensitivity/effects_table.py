"""Effects as tables: long CSV for programs, Markdown for people."""

import csv
import io
import math
from collections.abc import Sequence

from fembridge.sensitivity.ranks import RankRegression, regressions_in_order
from fembridge.sensitivity.single import Effect, effects_in_order
from fembridge.sensitivity.swept import ALL, RATE, STRESS, Output, SweptFingers
from fembridge.sensitivity.words import group_words, parameter_words, signed, unit_of
from fembridge.typing import Table

# A table for people has no decimals where a number is large anyway.
_LARGE = 100.0
_KPA = 1000.0


def effect_rows(effects: Sequence[Effect]) -> list[Table]:
    """Give a row a parameter and output; a percentage that cannot be is None."""
    return [
        {
            "parameter": each.parameter,
            "low": each.low,
            "base": each.base,
            "high": each.high,
            "afferent": each.output.afferent,
            "quantity": each.output.quantity,
            "stimuli": each.output.group,
            "at_low": each.at_low,
            "at_base": each.at_base,
            "at_high": each.at_high,
            "change": each.change,
            "change_percent": None if math.isnan(each.percent) else each.percent,
            "monotone": each.is_monotone,
        }
        for each in effects
    ]


def regression_rows(swept: SweptFingers, regressions: Sequence[RankRegression]) -> list[Table]:
    """Give a row a parameter and output; without variation numbers are None."""
    return [
        {
            "parameter": name,
            "low": float(swept.value[:, row].min()),
            "high": float(swept.value[:, row].max()),
            "afferent": each.output.afferent,
            "quantity": each.output.quantity,
            "stimuli": each.output.group,
            "coefficient": float(each.coefficient[row]) if each.varies else None,
            "low_95": float(each.low[row]) if each.varies else None,
            "high_95": float(each.high[row]) if each.varies else None,
            "r_squared": each.r_squared if each.varies else None,
            "adjusted_r_squared": each.adjusted_r_squared if each.varies else None,
        }
        for row, name in enumerate(swept.names)
        for each in regressions
    ]


def csv_text(rows: Sequence[Table]) -> str:
    """Write rows as CSV; None is an empty cell, a truth value ``yes`` or ``no``."""
    out = io.StringIO(newline="")
    table = csv.writer(out, lineterminator="\n")
    table.writerow(rows[0])
    for row in rows:
        table.writerow([_cell(value) for value in row.values()])
    return out.getvalue()


def effects_markdown(swept: SweptFingers, effects: Sequence[Effect]) -> str:
    """Give a table a class: from low to high, change of rates and of stress."""
    found = {(each.parameter, each.output): each for each in effects}
    lines: list[str] = []
    for afferent in swept.afferents:
        columns = _columns(swept, afferent)
        first = effects[0].parameter
        bases = [found[first, output].at_base for output in columns]
        told = [
            f"{_words(output)} ({_number(base, output.quantity)})"
            for output, base in zip(columns, bases, strict=True)
        ]
        lines += _head(afferent, ["parameter", "from, to", *told])
        mine = [each for each in effects if each.output.afferent == afferent]
        for name in effects_in_order(mine):
            one = found[name, columns[0]]
            cells = [_change(found[name, output]) for output in columns]
            span = f"{one.low:.4g}, {one.high:.4g} {unit_of(name)}".rstrip()
            lines.append(_line([parameter_words(name), span, *cells]))
    return "\n".join(lines).strip() + "\n"


def regressions_markdown(swept: SweptFingers, regressions: Sequence[RankRegression]) -> str:
    """Give a table a class: coefficients, bold where their interval leaves out 0."""
    found = {each.output: each for each in regressions}
    lines: list[str] = []
    for afferent in swept.afferents:
        columns = _columns(swept, afferent)
        told = [_words(output) for output in columns]
        mine = [each for each in regressions if each.output.afferent == afferent]
        lines += _head(afferent, ["parameter", *told])
        for row in regressions_in_order(mine):
            cells = [_coefficient(found[output], row) for output in columns]
            lines.append(_line([parameter_words(swept.names[row]), *cells]))
        fits = [found[output] for output in columns]
        lines.append(
            _line(
                [
                    "R² (adjusted)",
                    *(
                        f"{each.r_squared:.2f} ({each.adjusted_r_squared:.2f})"
                        if each.varies
                        else "no variation"
                        for each in fits
                    ),
                ]
            )
        )
        spans = [_span(swept, output) for output in columns]
        lines.append(_line(["over all fingers", *spans]))
    return "\n".join(lines).strip() + "\n"


def _columns(swept: SweptFingers, afferent: str) -> list[Output]:
    """Give the outputs of a table: all rates of a class, and its mean stress."""
    mine = [output for output in swept.outputs if output.afferent == afferent]
    rates = [output for output in mine if output.quantity == RATE]
    stress = [o for o in mine if o.quantity == STRESS and o.group == ALL]
    return [*rates, *stress]


def _words(output: Output) -> str:
    """Name a column: the group of a rate, or that it is stress."""
    return "peak stress" if output.quantity == STRESS else group_words(output.group)


def _span(swept: SweptFingers, output: Output) -> str:
    column = swept.column(output)
    least, most = float(column.min()), float(column.max())
    low = _number(least, output.quantity).partition(" ")[0]
    return f"{low} to {_number(most, output.quantity)}"


def _head(afferent: str, cells: Sequence[str]) -> list[str]:
    rule = "|---" * len(cells) + "|"
    return ["", f"**{afferent}**", "", _line(cells), rule]


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _change(effect: Effect) -> str:
    number = effect.change / _KPA if effect.output.quantity == STRESS else effect.change
    told = signed(number, _digits(effect.at_base, effect.output.quantity))
    percent = "" if math.isnan(effect.percent) else f" ({signed(effect.percent, 0)} %)"
    return f"{told}{percent}{'' if effect.is_monotone else ' ~'}"


def _coefficient(each: RankRegression, row: int) -> str:
    if not each.varies:
        return "–"
    told = signed(float(each.coefficient[row]), 2)
    return f"**{told}**" if each.is_sure(row) else told


def _number(number: float, quantity: str) -> str:
    told = number / _KPA if quantity == STRESS else number
    unit = " kPa" if quantity == STRESS else ""
    return f"{told:.{_digits(number, quantity)}f}{unit}"


def _digits(number: float, quantity: str) -> int:
    if quantity == STRESS:
        return 2 if abs(number) >= _KPA else 3
    return 0 if abs(number) >= _LARGE else 1


def _cell(value: object) -> object:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else value
