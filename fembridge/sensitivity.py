"""Which parameter of a finger moves the answers how much, read off a sweep's table.

`read_swept` takes the table, ``results.csv`` or its summary, a row a finger. Where one
parameter was moved at a time, `single_effects` has what each does alone; where all
were, `rank_regressions` has what each does among all. Both are tables with a row a
parameter and output.
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from decks.stimuli import resolve
from fembridge.errors import StimulusError, TableError, UsageError
from fembridge.number import parse_number
from fembridge.tables import TextTable, read_table
from fembridge.typing import BoolArray, FloatArray
from fembridge.words import ABSENT, markdown, number, split_unit

ALL = "all"
"""In the place of a group: the mean over all stimuli."""

RATE = "rate_ips"
STRESS = "peak_stress_pa"
QUANTITIES = (RATE, STRESS)
OUTPUT = ["afferent", "quantity", "stimuli"]
"""An output: the mean of one quantity of one afferent over a group of stimuli."""

RESULT_COLUMNS = ("stimulus", "afferent", RATE, STRESS, "status", "cause")
_OF_AN_ITEM = ("spikes", "run")

RESAMPLES = 2000
SHARE = 0.95
"""Of resamples inside an interval."""

# A column of the summary, as SA:rate_ips:sine_20.
_OUTPUT = re.compile(rf"([A-Z][A-Z0-9_]*):({'|'.join(QUANTITIES)}):(\S+)")
# Of a correlation matrix: below this, parameters of a resample go together.
_SINGULAR = 1e-9
# A table for people has no decimals where a number is large anyway.
_LARGE = 100.0
_PA_PER_KPA = 1000.0


@dataclass(frozen=True, slots=True, eq=False)
class SweptFingers:
    """A row a finger: its `parameters`, and its `answers`, a column an output.

    Parameters that are the same in all fingers are left out. `causes` are why fingers
    were left out, one each.
    """

    parameters: pd.DataFrame
    answers: pd.DataFrame
    causes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(self.parameters) < 2:
            lost = f", {len(self.causes)} failed" if self.causes else ""
            raise UsageError(f"fingers: {len(self.parameters)}{lost}, expected two or more")
        if not self.parameters.columns.size:
            raise UsageError("no parameter is different from finger to finger")

    def to_csv(self) -> str:
        """Summary with a column ``SA:rate_ips:sine_20`` for each output; six digits."""
        answers = self.answers.set_axis(
            [":".join(map(str, output)) for output in self.answers.columns.to_flat_index()], axis=1
        )
        return csv_text(self.parameters.join(answers))


def read_swept(path: Path) -> SweptFingers:
    """Fingers of ``results.csv`` of a sweep, or of a summary of one.

    A finger of which anything failed is left out; its cause is kept. Raises TableError: neither of
    them, or a cell that is no number where one is expected. UsageError: nothing to compare.
    """
    table = read_table(path)
    if "stimulus" in table.header:
        table.check_header(RESULT_COLUMNS)
        parameters = table.header[: table.header.index("stimulus")]
        table.check_columns((*parameters, *RESULT_COLUMNS), _OF_AN_ITEM)
        return _from_results(table)
    found = {name: match.groups() for name in table.header if (match := _OUTPUT.fullmatch(name))}
    if not found:
        raise TableError(
            "neither results.csv of a sweep, with a column stimulus, nor a summary of "
            "one, with columns as SA:rate_ips:all",
            path,
            1,
        )
    numbers = pd.DataFrame({name: table.numbers(name) for name in table.header})
    answers = numbers[list(found)]
    answers.columns = pd.MultiIndex.from_tuples(found.values(), names=OUTPUT)
    return SweptFingers(numbers.drop(columns=list(found)), answers)


def group_of(stimulus: str) -> str:
    """Set of a stimulus: ``sine_20`` by its frequency, or its family."""
    try:
        [entry] = resolve([stimulus])
    except (StimulusError, ValueError):
        return stimulus
    return stimulus.rpartition("_")[0] if entry.family == "sine" else entry.family


def _from_results(table: TextTable) -> SweptFingers:
    """The rows of each finger gathered: its parameters stand before the column stimulus."""
    names = table.header[: table.header.index("stimulus")]
    cells = pd.DataFrame({name: table.column(name) for name in names}, range(table.size))
    finger = np.zeros(table.size, dtype=int)
    if names:
        finger = cells.groupby(list(names), sort=False).ngroup().to_numpy()
    failed = table.choices("status", ("done", "failed")) == "failed"
    causes = pd.Series(table.column("cause"), dtype=str)[failed].groupby(finger[failed]).first()
    done = table.where(~failed)
    rows = pd.DataFrame(
        {
            "finger": finger[~failed],
            "stimulus": done.words("stimulus"),
            "afferent": done.words("afferent"),
            **{quantity: done.numbers(quantity, least=0) for quantity in QUANTITIES},
        }
    )
    done.refuse_duplicates(rows[["stimulus", "afferent", "finger"]])
    rows = rows[~rows["finger"].isin(causes.index)]
    answers = _means(rows, table.path)
    values = cells.groupby(finger).first().loc[answers.index]
    return SweptFingers(
        _parameters(values, table.path).reset_index(drop=True),
        answers.reset_index(drop=True),
        tuple(causes),
    )


def _parameters(cells: pd.DataFrame, path: Path) -> pd.DataFrame:
    """What is not the same in all fingers, as numbers."""
    cells = cells.loc[:, (cells != cells.iloc[:1].squeeze()).any()]
    for name, column in cells.items():
        try:
            cells[name] = [parse_number(cell) for cell in column]
            continue
        except ValueError:
            pass
        shown = ", ".join(repr(cell) for cell in column.unique()[:3])
        raise TableError(f"{name} is {shown}: expected one for all, or different numbers", path)
    return cells.astype(float)


def _means(rows: pd.DataFrame, path: Path) -> pd.DataFrame:
    """Means over groups of stimuli: a row a finger, a column an output."""
    found = rows.set_index(["finger", "stimulus", "afferent"]).unstack([1, 2])  # noqa: PD010 - no mean
    odd = found.columns[np.isnan(found.to_numpy()).any(axis=0)].to_flat_index()
    if odd.size:
        raise TableError(f"{' '.join(odd[0][1:])} is not there for all fingers", path)
    group = {stimulus: group_of(stimulus) for stimulus in rows["stimulus"].unique()}
    long = rows.melt(["finger", "stimulus", "afferent"], QUANTITIES, "quantity")
    of_group = long.assign(stimuli=long["stimulus"].map(group))
    means = pd.concat([long.assign(stimuli=ALL), of_group]).pivot_table("value", "finger", OUTPUT)
    groups = (ALL, *dict.fromkeys(group.values()))
    order = product(QUANTITIES, rows["afferent"].unique(), groups)
    outputs = [(afferent, quantity, each) for quantity, afferent, each in order]
    return means[[output for output in outputs if output in means]]


def is_one_at_a_time(swept: SweptFingers) -> bool:
    """Whether there is a finger from which every other differs in one parameter at most."""
    return bool(_centres(swept.parameters).any())


def base_of(swept: SweptFingers) -> int | None:
    """Row of the one finger from which every other differs in one parameter at most.

    None where there is none, or more than one: of a single parameter every finger is one.
    """
    rows = np.flatnonzero(_centres(swept.parameters))
    return int(rows[0]) if rows.size == 1 else None


def single_effects(swept: SweptFingers) -> pd.DataFrame:
    """What each parameter does to each output, from its low value to its high one.

    ``base`` and ``at_base`` are those of `base_of`, NaN where there is none.
    ``change_percent`` is that of the base's answer, without a base of the answer at the
    low value; NaN where that is 0. ``monotone``: between neighbouring values the answer
    never goes the other way.
    """
    effects, base_row, answers = [], base_of(swept), swept.answers
    centre = int(_centres(swept.parameters).argmax())
    for name in swept.parameters:
        others = swept.parameters.drop(columns=name)
        mine = swept.parameters[name][(others == others.iloc[centre]).all(axis=1)]
        mine = mine.sort_values(kind="stable")
        low, high = (answers.loc[mine.index[end]] for end in (0, -1))
        at_base = math.nan * low if base_row is None else answers.loc[base_row]
        whole = low if base_row is None else at_base
        steps = answers.loc[mine.index].diff()[1:]
        effect = pd.DataFrame(
            {
                "at_low": low,
                "at_base": at_base,
                "at_high": high,
                "change": high - low,
                "change_percent": 100 * (high - low) / whole.replace(0.0, math.nan),
                "monotone": (steps >= 0).all() | (steps <= 0).all(),
            }
        ).reset_index()
        base = math.nan if base_row is None else mine[base_row]
        ends = {"parameter": name, "low": mine.iloc[0], "base": base, "high": mine.iloc[-1]}
        for place, (column, value) in enumerate(ends.items()):
            effect.insert(place, column, value)
        effects.append(effect)
    return pd.concat(effects, ignore_index=True)


def _centres(parameters: pd.DataFrame) -> BoolArray:
    """Of each row whether all others differ from it in one parameter at most ``(finger,)``."""
    value = parameters.to_numpy()
    centre: BoolArray = (value != value[0]).sum(axis=1) <= 1  # no other row can be one
    for row in np.flatnonzero(centre) if value.shape[1] > 1 else ():
        centre[row] = ((value != value[row]).sum(axis=1) <= 1).all()
    return centre


def rank_regressions(
    swept: SweptFingers, *, resamples: int = RESAMPLES, seed: int = 0
) -> pd.DataFrame:
    """Standardised rank regression of every output, with 95 % intervals.

    ``low`` and ``high`` are the ends of a parameter, ``low_95`` and ``high_95`` those
    of the coefficients of resampled fingers. ``adjusted_r_squared`` is without what so
    many parameters explain by chance, at least 0. All are NaN for an output that does
    not vary.

    Raises
    ------
    UsageError
        Fewer than ``2 (parameters + 1)`` fingers, or two parameters of one order.

    Notes
    -----
    Parameters and answer are replaced by their ranks, these put to mean 0 and variance
    1, and a plane is fitted. Its coefficients are how far the answer moves in its order
    when one parameter moves in its own and the others stay; R² is how much of the order
    they explain together. An R² well below 1 says that a part is not monotone, goes by
    two parameters together, or is noise (Iman & Conover 1979, Technometrics 21:499;
    Saltelli & Marivoet 1990, Reliab. Eng. Syst. Saf. 28:229). The same seed draws the
    same resamples.
    """
    fingers, parameters = swept.parameters.shape
    least = 2 * (parameters + 1)
    if fingers < least:
        raise UsageError(f"{fingers} fingers for {parameters} parameters, expected {least} or more")
    value, answer = swept.parameters.to_numpy(), swept.answers.to_numpy()
    x = _standardised(value)
    for row, column in np.argwhere(np.tril(np.abs(x.T @ x) / fingers > 1 - _SINGULAR, k=-1)):
        both = " and ".join(swept.parameters.columns[[column, row]])
        raise UsageError(f"{both} rise and fall together: their effects cannot be separated")
    coefficient, r_squared = _fitted(value, answer)
    rows = np.random.default_rng(seed).integers(fingers, size=(resamples, fingers))
    drawn, _ = _fitted(value[rows], answer[rows])
    tail = 0.5 * (1 - SHARE)
    low, high = np.quantile(drawn, [tail, 1 - tail], axis=0)
    adjusted = np.maximum(0.0, 1 - (1 - r_squared) * (fingers - 1) / (fingers - parameters - 1))
    outputs = swept.answers.columns
    table = pd.DataFrame(
        {
            "parameter": np.repeat(swept.parameters.columns, len(outputs)),
            "low": np.repeat(value.min(axis=0), len(outputs)),
            "high": np.repeat(value.max(axis=0), len(outputs)),
            **{name: np.tile(outputs.get_level_values(name), parameters) for name in OUTPUT},
            "coefficient": coefficient.ravel(),
            "low_95": low.ravel(),
            "high_95": high.ravel(),
            "r_squared": np.tile(r_squared, parameters),
            "adjusted_r_squared": np.tile(adjusted, parameters),
        }
    )
    still = np.tile((answer == answer[0]).all(axis=0), parameters)
    table.loc[still, "coefficient":] = math.nan
    return table


def _fitted(value: FloatArray, answer: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Coefficients ``(…, parameter, output)`` and R² ``(…, output)`` of ranks.

    `value` is ``(…, finger, parameter)``, `answer` ``(…, finger, output)``. What does
    not vary has no part in the fit.
    """
    x, y = _standardised(value), _standardised(answer)
    fingers = value.shape[-2]
    between_parameters = x.swapaxes(-1, -2) @ x / fingers
    with_outputs = x.swapaxes(-1, -2) @ y / fingers
    inverse = np.linalg.pinv(between_parameters, rcond=_SINGULAR, hermitian=True)
    coefficient: FloatArray = inverse @ with_outputs
    r_squared: FloatArray = np.clip((coefficient * with_outputs).sum(axis=-2), 0.0, 1.0)
    return coefficient, r_squared


def _standardised(array: FloatArray) -> FloatArray:
    """Ranks over the fingers, mean 0 and variance 1; 0 where all are equal."""
    from scipy.stats import rankdata

    ranks = rankdata(array, axis=-2)
    centred = ranks - ranks.mean(axis=-2, keepdims=True)
    spread = np.sqrt((centred**2).mean(axis=-2, keepdims=True))
    standard: FloatArray = np.divide(centred, spread, out=np.zeros_like(centred), where=spread > 0)
    return standard


def in_order(table: pd.DataFrame) -> list[str]:
    """Parameters of effects or regressions, the one that moves a mean rate most first.

    Most in percent of the base's rate, or by its coefficient, whichever class of the
    table that is; of equals the one that moves the stress more.
    """
    column = "change_percent" if "change_percent" in table else "coefficient"
    mean = table[table["stimuli"] == ALL]
    most = mean[column].abs().groupby([mean["parameter"], mean["quantity"]]).max().to_dict()

    def strength(name: str) -> list[float]:
        found = (most.get((name, quantity), 0.0) for quantity in QUANTITIES)
        return [0.0 if math.isnan(each) else each for each in found]

    return sorted(table["parameter"].unique(), key=strength, reverse=True)


def csv_text(table: pd.DataFrame) -> str:
    """A table as CSV, six digits that count; a truth value is ``yes`` or ``no``."""
    words = table.replace({True: "yes", False: "no"}) if "monotone" in table else table
    return words.to_csv(index=False, float_format="%.6g", lineterminator="\n")


def effects_markdown(effects: pd.DataFrame) -> str:
    """A table a class: from low to high, change of rates and of stress; ``~``: it comes back."""

    def change(each: _Row) -> str:
        quantity = each["quantity"]
        whole = each["at_low"] if math.isnan(each["at_base"]) else each["at_base"]
        words = number(shown(quantity, each["change"]), f"+.{_digits(whole, quantity)}f")
        percent = number(each["change_percent"], "+.0f")
        share = "" if percent == ABSENT else f" ({percent} %)"
        return f"{words}{share}{'' if each['monotone'] else ' ~'}"

    def head(each: _Row) -> str:
        at_base = each["at_base"]
        words = _output_words(each)
        return words if math.isnan(at_base) else f"{words} ({_answer(at_base, each['quantity'])})"

    def add_spans(mine: pd.DataFrame, words: pd.DataFrame) -> None:
        ends = mine.groupby("parameter")[["low", "high"]].first().loc[words.index].itertuples()
        spans = [f"{e.low:.4g}, {e.high:.4g} {split_unit(str(e.Index))[1]}".rstrip() for e in ends]
        words.insert(0, "from, to", spans)

    return _class_tables(effects, head, change, add_spans)


def regressions_markdown(swept: SweptFingers, regressions: pd.DataFrame) -> str:
    """A table a class: coefficients, bold where their interval leaves out 0."""

    def coefficient(each: _Row) -> str:
        words = number(each["coefficient"], "+.2f")
        return f"**{words}**" if each["low_95"] > 0 or each["high_95"] < 0 else words

    def add_fits(mine: pd.DataFrame, words: pd.DataFrame) -> None:
        fits, spans = [], []
        for each in mine.drop_duplicates(OUTPUT).to_dict("records"):
            fit = f"{each['r_squared']:.2f} ({each['adjusted_r_squared']:.2f})"
            fits.append("no variation" if math.isnan(each["r_squared"]) else fit)
            answers = swept.answers[tuple(each[name] for name in OUTPUT)]
            low, high = (_answer(end, each["quantity"]) for end in (answers.min(), answers.max()))
            spans.append(f"{low.partition(' ')[0]} to {high}")
        words.loc["R² (adjusted)"], words.loc["over all fingers"] = fits, spans

    return _class_tables(regressions, _output_words, coefficient, add_fits)


_Row: TypeAlias = Mapping[Any, Any]


def _class_tables(
    table: pd.DataFrame,
    head: Callable[[_Row], str],
    cell: Callable[[_Row], str],
    complete: Callable[[pd.DataFrame, pd.DataFrame], None],
) -> str:
    """Markdown, a table a class: a row a parameter, a column an output, completed."""
    wanted = table[(table["quantity"] == RATE) | (table["stimuli"] == ALL)]
    blocks = []
    for afferent, mine in wanted.groupby("afferent", sort=False):
        mine = mine.sort_values("quantity", key=lambda each: each != RATE, kind="stable")
        rows = mine.to_dict("records")
        long = mine.assign(head=[*map(head, rows)], cell=[*map(cell, rows)])
        wide = long.pivot(index="parameter", columns="head", values="cell")  # noqa: PD010 - nothing to aggregate
        words = wide.loc[in_order(mine), long["head"].unique()]
        complete(mine, words)
        named = words.rename(index=parameter_words).rename_axis("parameter").reset_index()
        blocks.append(f"**{afferent}**\n\n{markdown(named)}\n")
    return "\n".join(blocks)


def _output_words(each: _Row) -> str:
    return "peak stress" if each["quantity"] == STRESS else group_words(each["stimuli"])


def _answer(value: float, quantity: str) -> str:
    unit = " kPa" if quantity == STRESS else ""
    return f"{shown(quantity, value):.{_digits(value, quantity)}f}{unit}"


def _digits(value: float, quantity: str) -> int:
    if quantity == STRESS:
        return 2 if abs(value) >= _PA_PER_KPA else 3
    return 0 if abs(value) >= _LARGE else 1


_LAYERS = {"stratum_corneum": "stratum corneum", "subcutaneous_tissue": "subcutaneous tissue"}
_PLAIN = {
    "ridges.height_mm": "ridge height",
    "ridges.spacing_mm": "ridge spacing",
    "papillae.height_mm": "papilla height",
    "contact.friction": "friction",
    "contact_friction": "friction",
    "probe_diameter_mm": "probe diameter",
    "probe_x_mm": "probe aside",
    "preindent_um": "pre-indentation",
}
_MADE = (
    (re.compile(r"skin\.(\w+)_mm"), "{} thickness"),
    (re.compile(r"materials\.(\w+)\.young_mpa"), "{} modulus"),
    (re.compile(r"materials\.(\w+)\.poisson"), "{} Poisson’s ratio"),
    (re.compile(r"afferents\.(\w+)\.to_boundary_mm"), "{} to boundary"),
    (re.compile(r"afferents\.(\w+)\.depth_mm"), "{} depth"),
)


def parameter_words(name: str) -> str:
    """A parameter as people call it: ``dermis modulus``; others keep their name."""
    for pattern, words in _MADE:
        if (match := pattern.fullmatch(name)) is not None:
            return words.format(_LAYERS.get(match[1], match[1]))
    return _PLAIN.get(name, name)


def group_words(group: str) -> str:
    """A group of stimuli as people call it: ``20 Hz``, ``diharmonic``."""
    family, _, frequency_hz = group.partition("_")
    if family == "sine" and frequency_hz:
        return f"{frequency_hz} Hz"
    return {"diharm": "diharmonic"}.get(group, group)


def quantity_words(quantity: str) -> str:
    """A quantity with the unit that `shown` gives it."""
    return {RATE: "rate (impulses/s)", STRESS: "peak stress (kPa)"}[quantity]


def shown(quantity: str, number: float) -> float:
    """An answer in the unit that it is shown in."""
    return number / _PA_PER_KPA if quantity == STRESS else number
