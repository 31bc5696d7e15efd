"""Which parameter of a finger moves the answers how much, read off a sweep's table.

`read_swept` takes the table, ``results.csv`` or its summary, a row a finger. Where one
parameter was moved at a time, `single_effects` has what each does alone; where all
were, `rank_regressions` has what each does among all.
"""

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from decks.stimuli import resolve
from fembridge.errors import StimulusError, TableError, UsageError
from fembridge.tables import TextTable, read_table
from fembridge.typing import FloatArray, Table

ALL = "all"
"""In the place of a group: the mean over all stimuli."""

RATE = "rate_ips"
STRESS = "peak_stress_pa"
QUANTITIES = (RATE, STRESS)

RESULT_COLUMNS = ("stimulus", "afferent", RATE, STRESS, "status", "cause")

RESAMPLES = 2000
SHARE = 0.95
"""Of resamples inside an interval."""

# A column of the summary, as SA:rate_ips:sine_20.
_OUTPUT = re.compile(rf"([A-Z][A-Z0-9_]*):({'|'.join(QUANTITIES)}):(\S+)")
# Of a correlation matrix: below this, parameters of a resample go together.
_SINGULAR = 1e-9
# A table for people has no decimals where a number is large anyway.
_LARGE = 100.0

_Finger: TypeAlias = tuple[str, ...]
"""The cells of a row that tell its finger from others."""

_PA_PER_KPA = 1000.0


@dataclass(frozen=True, slots=True)
class Output:
    """The mean of one quantity of one afferent over a group of stimuli."""

    afferent: str
    quantity: str
    group: str


@dataclass(frozen=True, slots=True, eq=False)
class SweptFingers:
    """Parameters `value` ``(finger, parameter)``, answers ``(finger, output)``.

    `names` are those of parameters that are not the same in all fingers. `causes`
    are why fingers were left out, one each.

    Raises
    ------
    UsageError
        Fewer than two fingers, or no parameter that is different.
    """

    names: tuple[str, ...]
    value: FloatArray
    outputs: tuple[Output, ...]
    answer: FloatArray
    causes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("value", "answer"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if len(self.value) < 2:
            lost = f", {len(self.causes)} failed" if self.causes else ""
            raise UsageError(f"fingers: {len(self.value)}{lost}, expected two or more")
        if not self.names:
            raise UsageError("no parameter is different from finger to finger")

    @property
    def afferents(self) -> tuple[str, ...]:
        """Names of the afferents, in the order of the table."""
        return tuple(dict.fromkeys(each.afferent for each in self.outputs))

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of stimuli, the mean over all first."""
        return tuple(dict.fromkeys(each.group for each in self.outputs))

    def column(self, output: Output) -> FloatArray:
        """Answers of all fingers to `output`, ``(finger,)``."""
        column: FloatArray = self.answer[:, self.outputs.index(output)]
        return column


def read_swept(path: Path) -> SweptFingers:
    """Fingers of ``results.csv`` of a sweep, or of what `swept_text` made of one.

    A finger of which anything failed is left out; its cause is kept.

    Raises
    ------
    TableError
        Neither of them, or a cell that is no number where one is expected.
    UsageError
        Nothing to compare.
    """
    table = read_table(path)
    if "stimulus" in table.header:
        return _from_results(read_table(path, RESULT_COLUMNS))
    found = {name: _OUTPUT.fullmatch(name) for name in table.header}
    outputs = {name: Output(*match.groups()) for name, match in found.items() if match is not None}
    if not outputs:
        raise TableError(
            "neither results.csv of a sweep, with a column stimulus, nor a summary of "
            "one, with columns as SA:rate_ips:all",
            path,
            1,
        )
    names = [name for name in table.header if name not in outputs]
    value, answer = (
        np.array([table.numbers(each) for each in columns]).reshape(len(columns), table.size).T
        for columns in (names, list(outputs))
    )
    return SweptFingers(tuple(names), value, tuple(outputs.values()), answer)


def swept_text(swept: SweptFingers) -> str:
    """Summary of a sweep: a row a finger, six digits that count.

    It has the parameters, and a column ``SA:rate_ips:sine_20`` for each output.
    """
    outputs = [f"{o.afferent}:{o.quantity}:{o.group}" for o in swept.outputs]
    rows = (
        [f"{number:.6g}" for number in (*values, *answers)]
        for values, answers in zip(swept.value, swept.answer, strict=True)
    )
    return _csv([*swept.names, *outputs], rows)


def group_of(stimulus: str) -> str:
    """Set of a stimulus: ``sine_20`` by its frequency, or its family."""
    try:
        [entry] = resolve([stimulus])
    except (StimulusError, ValueError):
        return stimulus
    return stimulus.rpartition("_")[0] if entry.family == "sine" else entry.family


def _from_results(table: TextTable) -> SweptFingers:
    """Gather the rows of each finger, its parameters before the column stimulus."""
    parameters = table.header[: table.header.index("stimulus")]
    cells = [table.column(name) for name in parameters]
    fingers: list[_Finger] = [tuple(each[row] for each in cells) for row in range(table.size)]
    failed = table.choices("status", ("done", "failed")) == "failed"
    causes: dict[_Finger, str] = {}
    for row in np.flatnonzero(failed).tolist():
        causes.setdefault(fingers[row], table.column("cause")[row])
    done = table.where(~failed)
    asked = list(zip(done.words("stimulus"), done.words("afferent"), strict=True))
    numbers = np.stack([done.numbers(quantity, least=0) for quantity in QUANTITIES], axis=1)
    answers: dict[_Finger, dict[tuple[str, str], FloatArray]] = {each: {} for each in fingers}
    for row, place in enumerate(np.flatnonzero(~failed).tolist()):
        mine = answers[fingers[place]]
        if asked[row] in mine:
            raise done.error(row, f"duplicate: {', '.join(asked[row])} of the same finger")
        mine[asked[row]] = numbers[row]
    whole = {finger: rows for finger, rows in answers.items() if finger not in causes}
    names, value = _parameters(table.path, parameters, list(whole))
    outputs, answer = _means(table.path, list(whole.values()))
    return SweptFingers(names, value, outputs, answer, tuple(causes.values()))


def _parameters(
    path: Path, names: Sequence[str], fingers: Sequence[_Finger]
) -> tuple[tuple[str, ...], FloatArray]:
    """Names and values ``(finger, parameter)`` of what is not the same in all."""
    columns: dict[str, list[float]] = {}
    for name, cells in zip(names, zip(*fingers, strict=True), strict=False):
        if len(set(cells)) == 1:
            continue
        try:
            columns[name] = [float(cell) for cell in cells]
            if not np.isfinite(columns[name]).all():
                raise ValueError
        except ValueError:
            shown = ", ".join(repr(cell) for cell in list(dict.fromkeys(cells))[:3])
            raise TableError(
                f"{name} is {shown}: expected one for all, or different numbers", path
            ) from None
    values = np.array(list(columns.values())).reshape(len(columns), len(fingers))
    return tuple(columns), values.T


def _means(
    path: Path, fingers: Sequence[Mapping[tuple[str, str], FloatArray]]
) -> tuple[tuple[Output, ...], FloatArray]:
    """Outputs and their means ``(finger, output)`` over groups of stimuli."""
    if not fingers:
        return (), np.zeros((0, 0))
    asked = list(fingers[0])
    for rows in fingers:
        if set(rows) != set(asked):
            odd = next(iter(set(rows) ^ set(asked)))
            raise TableError(f"{' '.join(odd)} is not there for all fingers", path)
    groups = {stimulus: group_of(stimulus) for stimulus, _ in asked}
    means: dict[Output, FloatArray] = {}
    for column, quantity in enumerate(QUANTITIES):
        numbers = np.array([[rows[key][column] for key in asked] for rows in fingers])
        for afferent in dict.fromkeys(name for _, name in asked):
            for group in (ALL, *dict.fromkeys(groups.values())):
                members = [
                    place
                    for place, (stimulus, name) in enumerate(asked)
                    if name == afferent and group in (ALL, groups[stimulus])
                ]
                means[Output(afferent, quantity, group)] = numbers[:, members].mean(axis=1)
    return tuple(means), np.stack(list(means.values()), axis=1)


@dataclass(frozen=True, slots=True)
class Effect:
    """One parameter from `low` to `high`, the others as in the base: one output.

    `is_monotone`: between neighbouring values the answer never goes the other way.
    """

    parameter: str
    low: float
    base: float
    high: float
    output: Output
    at_low: float
    at_base: float
    at_high: float
    is_monotone: bool

    @property
    def change(self) -> float:
        """From low to high."""
        return self.at_high - self.at_low

    @property
    def percent(self) -> float:
        """The change in percent of the base's answer; NaN where that is 0."""
        return 100 * self.change / self.at_base if self.at_base else math.nan


def is_one_at_a_time(swept: SweptFingers) -> bool:
    """Whether every finger differs from the first in one parameter at most."""
    return bool(((swept.value != swept.value[0]).sum(axis=1) <= 1).all())


def single_effects(swept: SweptFingers) -> list[Effect]:
    """Effect of each parameter on each output, in the order of `swept`.

    The first finger is the base; the others differ from it in one parameter.
    """
    effects = []
    for place, name in enumerate(swept.names):
        others = np.delete(swept.value, place, axis=1)
        mine = np.flatnonzero((others == others[0]).all(axis=1))
        mine = mine[swept.value[mine, place].argsort(kind="stable")]
        low, *_, high = swept.value[mine, place].tolist()
        for output in swept.outputs:
            answers = swept.column(output)
            steps = np.diff(answers[mine])
            effects.append(
                Effect(
                    name,
                    low,
                    float(swept.value[0, place]),
                    high,
                    output,
                    float(answers[mine[0]]),
                    float(answers[0]),
                    float(answers[mine[-1]]),
                    bool((steps >= 0).all() or (steps <= 0).all()),
                )
            )
    return effects


def effects_in_order(effects: Sequence[Effect]) -> list[str]:
    """Parameters, the one first that moves a class's mean rate most.

    Most in percent of the base's rate, whichever class of `effects` that is; of equals
    the one that moves the stress more.
    """
    strength: dict[str, list[float]] = {}
    for effect in effects:
        most = strength.setdefault(effect.parameter, [0.0, 0.0])
        if effect.output.group == ALL and not math.isnan(effect.percent):
            place = QUANTITIES.index(effect.output.quantity)
            most[place] = max(most[place], abs(effect.percent))
    return sorted(strength, key=strength.__getitem__, reverse=True)


@dataclass(frozen=True, slots=True, eq=False)
class RankRegression:
    """How one output depends on all parameters; arrays are ``(parameter,)``.

    `low` and `high` hold 95 % of the coefficients of resampled fingers. Without
    variation of the output (`varies` is False) all are 0.
    """

    output: Output
    coefficient: FloatArray
    low: FloatArray
    high: FloatArray
    r_squared: float
    fingers: int
    varies: bool = True

    @property
    def adjusted_r_squared(self) -> float:
        """R² without what so many parameters explain by chance; at least 0."""
        free = self.fingers - len(self.coefficient) - 1
        return max(0.0, 1 - (1 - self.r_squared) * (self.fingers - 1) / free)

    def is_sure(self, parameter: int) -> bool:
        """Whether the interval of the coefficient leaves out 0."""
        return bool(self.low[parameter] > 0 or self.high[parameter] < 0)


def rank_regressions(
    swept: SweptFingers, *, resamples: int = RESAMPLES, seed: int = 0
) -> list[RankRegression]:
    """Standardised rank regression of every output of `swept`, with intervals.

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
    fingers, parameters = swept.value.shape
    least = 2 * (parameters + 1)
    if fingers < least:
        raise UsageError(f"{fingers} fingers for {parameters} parameters, expected {least} or more")
    _check_apart(swept)
    coefficient, r_squared = _fitted(swept.value, swept.answer)
    rng = np.random.default_rng(seed)
    rows = rng.integers(fingers, size=(resamples, fingers))
    drawn, _ = _fitted(swept.value[rows], swept.answer[rows])
    tail = 0.5 * (1 - SHARE)
    low, high = np.quantile(drawn, [tail, 1 - tail], axis=0)
    varies = (swept.answer != swept.answer[0]).any(axis=0)
    return [
        RankRegression(
            output,
            coefficient[:, k],
            low[:, k],
            high[:, k],
            float(r_squared[k]),
            fingers,
            bool(varies[k]),
        )
        for k, output in enumerate(swept.outputs)
    ]


def regressions_in_order(regressions: Sequence[RankRegression]) -> list[int]:
    """Rows of parameters, the one first with the largest coefficient of a rate.

    The mean rate over all stimuli counts, of whichever class of `regressions`; of
    equals the coefficient of the stress.
    """
    most = np.zeros((len(QUANTITIES), len(regressions[0].coefficient)))
    for each in regressions:
        if each.output.group == ALL:
            place = QUANTITIES.index(each.output.quantity)
            most[place] = np.maximum(most[place], abs(each.coefficient))
    strength = most.T.tolist()
    return sorted(range(len(strength)), key=strength.__getitem__, reverse=True)


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


def _check_apart(swept: SweptFingers) -> None:
    """Refuse parameters that no fit can tell apart."""
    x = _standardised(swept.value)
    correlation = np.abs(x.T @ x) / len(x)
    for row, name in enumerate(swept.names):
        same = np.flatnonzero(correlation[row, :row] > 1 - _SINGULAR)
        if same.size:
            raise UsageError(
                f"{swept.names[same[0]]} and {name} rise and fall together: their "
                "effects cannot be told apart"
            )


def effect_rows(effects: Sequence[Effect]) -> list[Table]:
    """A row a parameter and output; a percentage that cannot be is None."""
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
    """A row a parameter and output; without variation numbers are None."""
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
    """Rows as CSV; None is an empty cell, a truth value ``yes`` or ``no``."""
    return _csv(list(rows[0]), ([_cell(value) for value in row.values()] for row in rows))


def effects_markdown(swept: SweptFingers, effects: Sequence[Effect]) -> str:
    """A table a class: from low to high, change of rates and of stress."""
    found = {(each.parameter, each.output): each for each in effects}
    lines: list[str] = []
    for afferent in swept.afferents:
        columns = _columns(swept, afferent)
        heads = []
        for output in columns:
            base = found[swept.names[0], output].at_base
            heads.append(f"{_output_words(output)} ({_number(base, output.quantity)})")
        lines += _head(afferent, ["parameter", "from, to", *heads])
        for name in effects_in_order([e for e in effects if e.output.afferent == afferent]):
            one = found[name, columns[0]]
            span = f"{one.low:.4g}, {one.high:.4g} {unit_of(name)}".rstrip()
            cells = [_change(found[name, output]) for output in columns]
            lines.append(_line([parameter_words(name), span, *cells]))
    return "\n".join(lines).strip() + "\n"


def regressions_markdown(swept: SweptFingers, regressions: Sequence[RankRegression]) -> str:
    """A table a class: coefficients, bold where their interval leaves out 0."""
    found = {each.output: each for each in regressions}
    lines: list[str] = []
    for afferent in swept.afferents:
        columns = _columns(swept, afferent)
        lines += _head(afferent, ["parameter", *map(_output_words, columns)])
        mine = [each for each in regressions if each.output.afferent == afferent]
        for row in regressions_in_order(mine):
            cells = [_coefficient(found[output], row) for output in columns]
            lines.append(_line([parameter_words(swept.names[row]), *cells]))
        fits = [
            f"{fit.r_squared:.2f} ({fit.adjusted_r_squared:.2f})" if fit.varies else "no variation"
            for fit in (found[output] for output in columns)
        ]
        lines.append(_line(["R² (adjusted)", *fits]))
        lines.append(_line(["over all fingers", *(_span(swept, output) for output in columns)]))
    return "\n".join(lines).strip() + "\n"


def _columns(swept: SweptFingers, afferent: str) -> list[Output]:
    """Outputs of a table for people: all rates of a class, and its mean stress."""
    mine = [output for output in swept.outputs if output.afferent == afferent]
    rates = [output for output in mine if output.quantity == RATE]
    return [*rates, *(o for o in mine if o.quantity == STRESS and o.group == ALL)]


def _output_words(output: Output) -> str:
    return "peak stress" if output.quantity == STRESS else group_words(output.group)


def _span(swept: SweptFingers, output: Output) -> str:
    column = swept.column(output)
    low = _number(float(column.min()), output.quantity).partition(" ")[0]
    return f"{low} to {_number(float(column.max()), output.quantity)}"


def _head(afferent: str, cells: Sequence[str]) -> list[str]:
    return ["", f"**{afferent}**", "", _line(cells), "|---" * len(cells) + "|"]


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _change(effect: Effect) -> str:
    quantity = effect.output.quantity
    change = signed(shown(quantity, effect.change), _digits(effect.at_base, quantity))
    percent = "" if math.isnan(effect.percent) else f" ({signed(effect.percent, 0)} %)"
    return f"{change}{percent}{'' if effect.is_monotone else ' ~'}"


def _coefficient(each: RankRegression, row: int) -> str:
    if not each.varies:
        return "–"
    number = signed(float(each.coefficient[row]), 2)
    return f"**{number}**" if each.is_sure(row) else number


def _number(number: float, quantity: str) -> str:
    unit = " kPa" if quantity == STRESS else ""
    return f"{shown(quantity, number):.{_digits(number, quantity)}f}{unit}"


def _digits(number: float, quantity: str) -> int:
    if quantity == STRESS:
        return 2 if abs(number) >= _PA_PER_KPA else 3
    return 0 if abs(number) >= _LARGE else 1


def _cell(value: object) -> object:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else value


def _csv(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    out = io.StringIO(newline="")
    table = csv.writer(out, lineterminator="\n")
    table.writerow(header)
    table.writerows(rows)
    return out.getvalue()


_MINUS = "\N{MINUS SIGN}"
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
_LAYERS = {
    "stratum_corneum": "stratum corneum",
    "subcutaneous_tissue": "subcutaneous tissue",
}
_UNITS = {"_mm": "mm", "_mpa": "MPa", "_um": "µm", "_deg": "°"}


def parameter_words(name: str) -> str:
    """A parameter as people call it: ``dermis modulus``; others keep their name."""
    if name in _PLAIN:
        return _PLAIN[name]
    for pattern, words in _MADE:
        if (match := pattern.fullmatch(name)) is not None:
            return words.format(_LAYERS.get(match[1], match[1]))
    return name


def unit_of(name: str) -> str:
    """Unit that a parameter's name ends in, or nothing."""
    return next((unit for end, unit in _UNITS.items() if name.endswith(end)), "")


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


def signed(number: float, digits: int) -> str:
    """A number with its sign; what rounds to nothing has none."""
    if math.isnan(number):
        return "–"
    text = f"{number:+.{digits}f}"
    return text.replace("-", _MINUS) if float(text) else f"{0:.{digits}f}"
