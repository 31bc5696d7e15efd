"""Effects of a finger's parameters on rates and stress, from the table of a sweep.

`read_swept` reads ``results.csv`` or its summary, which has one row per finger. If one
parameter was varied at a time, `single_effects` has the effect of each; if all were varied,
`rank_regressions` has their regression coefficients. Both are tables with one row per
parameter and output.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from decks.stimuli import resolve
from fembridge.errors import StimulusError, TableError, UsageError
from fembridge.io.number import parse_number
from fembridge.io.text_table import TextTable, read_table
from fembridge.typing import BoolArray, FloatArray

ALL = "all"
"""Group of all stimuli."""

RATE = "rate_ips"
STRESS = "peak_stress_pa"
QUANTITIES = (RATE, STRESS)
OUTPUT = ["afferent", "quantity", "stimuli"]
"""An output: the mean of one quantity of one afferent over a group of stimuli."""

RESULT_COLUMNS = ("stimulus", "afferent", RATE, STRESS, "status", "cause")
_OF_AN_ITEM = ("spikes", "run")

RESAMPLES = 2000
INTERVAL_SHARE = 0.95
"""Share of the resamples inside a confidence interval."""

# A column of the summary, as SA:rate_ips:sine_20.
_OUTPUT = re.compile(rf"([A-Z][A-Z0-9_]*):({'|'.join(QUANTITIES)}):(\S+)")
# Eigenvalue of a correlation matrix below which parameters are collinear.
_SINGULAR = 1e-9
# Rates from here on are printed without decimals.
_LARGE = 100.0
_PA_PER_KPA = 1000.0


@dataclass(frozen=True, slots=True, eq=False)
class SweptFingers:
    """Fingers of a sweep, one row each: `parameters`, and `answers` with one column per output.

    Only parameters that vary are included. `causes` has the failure of each omitted finger.

    Raises UsageError: fewer than two fingers, or no parameter varies.
    """

    parameters: pd.DataFrame
    answers: pd.DataFrame
    causes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(self.parameters) < 2:
            lost = f", {len(self.causes)} failed" if self.causes else ""
            raise UsageError(f"fingers: {len(self.parameters)}{lost}, expected two or more")
        if not self.parameters.columns.size:
            raise UsageError("no parameter varies between the fingers")

    def to_csv(self) -> str:
        """Summary as CSV, with columns as ``SA:rate_ips:sine_20``; six significant digits."""
        answers = self.answers.set_axis(
            [":".join(map(str, output)) for output in self.answers.columns.to_flat_index()], axis=1
        )
        return csv_text(self.parameters.join(answers))


def read_swept(path: Path) -> SweptFingers:
    """Fingers of ``results.csv`` of a sweep, or of its summary.

    A finger with a failed item is omitted, with its cause in `causes`. Raises TableError: another
    table, or a cell that is not a number. UsageError: nothing to compare.
    """
    table = read_table(path)
    if "stimulus" in table.header:
        table.check_header(RESULT_COLUMNS)
        parameters = table.header[: table.header.index("stimulus")]
        table.check_columns((*parameters, *RESULT_COLUMNS), _OF_AN_ITEM)
        return _fingers_of_results(table)
    outputs = {name: match.groups() for name in table.header if (match := _OUTPUT.fullmatch(name))}
    if not outputs:
        raise TableError(
            "neither results.csv of a sweep, with a column stimulus, nor a summary of "
            "one, with columns as SA:rate_ips:all",
            path,
            1,
        )
    numbers = pd.DataFrame({name: table.numbers(name) for name in table.header})
    answers = numbers[list(outputs)]
    answers.columns = pd.MultiIndex.from_tuples(outputs.values(), names=OUTPUT)
    return SweptFingers(numbers.drop(columns=list(outputs)), answers)


def group_of(stimulus: str) -> str:
    """Group of a stimulus: for a sinusoid its set, as ``sine_20``, otherwise its family."""
    try:
        [entry] = resolve([stimulus])
    except (StimulusError, ValueError):
        return stimulus
    return stimulus.rpartition("_")[0] if entry.family == "sine" else entry.family


def _fingers_of_results(table: TextTable) -> SweptFingers:
    """Fingers of ``results.csv``, whose parameters are the columns before ``stimulus``."""
    names = table.header[: table.header.index("stimulus")]
    cells = pd.DataFrame({name: table.column(name) for name in names}, range(table.size))
    finger = np.zeros(table.size, dtype=int)
    if names:
        finger = cells.groupby(list(names), sort=False).ngroup().to_numpy()
    failed = table.choices("status", ("done", "failed")) == "failed"
    causes = pd.Series(table.column("cause"), dtype=str)[failed].groupby(finger[failed]).first()
    finished = table.where(~failed)
    rows = pd.DataFrame(
        {
            "finger": finger[~failed],
            "stimulus": finished.words("stimulus"),
            "afferent": finished.words("afferent"),
            **{quantity: finished.numbers(quantity, least=0) for quantity in QUANTITIES},
        }
    )
    finished.refuse_duplicates(rows[["stimulus", "afferent", "finger"]])
    rows = rows[~rows["finger"].isin(causes.index)]
    answers = _group_means(rows, table.path)
    values = cells.groupby(finger).first().loc[answers.index]
    return SweptFingers(
        _varied_parameters(values, table.path).reset_index(drop=True),
        answers.reset_index(drop=True),
        tuple(causes),
    )


def _varied_parameters(cells: pd.DataFrame, path: Path) -> pd.DataFrame:
    """Columns that vary between fingers, as numbers."""
    cells = cells.loc[:, (cells != cells.iloc[:1].squeeze()).any()]
    for name, column in cells.items():
        try:
            cells[name] = [parse_number(cell) for cell in column]
            continue
        except ValueError:
            pass
        examples = ", ".join(repr(cell) for cell in column.unique()[:3])
        raise TableError(
            f"{name} is {examples}: expected one value for all fingers, or numbers", path
        )
    return cells.astype(float)


def _group_means(rows: pd.DataFrame, path: Path) -> pd.DataFrame:
    """Means over groups of stimuli: one row per finger, one column per output."""
    by_finger = rows.set_index(["finger", "stimulus", "afferent"]).unstack([1, 2])  # noqa: PD010 - no aggregation
    incomplete = by_finger.columns[np.isnan(by_finger.to_numpy()).any(axis=0)].to_flat_index()
    if incomplete.size:
        raise TableError(f"{' '.join(incomplete[0][1:])} is missing for some fingers", path)
    group = {stimulus: group_of(stimulus) for stimulus in rows["stimulus"].unique()}
    long = rows.melt(["finger", "stimulus", "afferent"], QUANTITIES, "quantity")
    of_group = long.assign(stimuli=long["stimulus"].map(group))
    means = pd.concat([long.assign(stimuli=ALL), of_group]).pivot_table("value", "finger", OUTPUT)
    groups = (ALL, *dict.fromkeys(group.values()))
    order = product(QUANTITIES, rows["afferent"].unique(), groups)
    outputs = [(afferent, quantity, stimuli) for quantity, afferent, stimuli in order]
    return means[[output for output in outputs if output in means]]


def is_one_at_a_time(swept: SweptFingers) -> bool:
    """Whether all fingers differ from one of them in at most one parameter."""
    return bool(_centres(swept.parameters).any())


def find_base(swept: SweptFingers) -> int | None:
    """Row of the base, from which all other fingers differ in at most one parameter.

    None if no finger or more than one qualifies, as in a sweep of a single parameter.
    """
    rows = np.flatnonzero(_centres(swept.parameters))
    return int(rows[0]) if rows.size == 1 else None


def single_effects(swept: SweptFingers) -> pd.DataFrame:
    """Change of each output from the low to the high value of each parameter.

    ``base`` and ``at_base`` are those of `find_base`, NaN without a base. ``change_percent`` is
    relative to the response of the base, without a base to that at the low value; NaN if that is
    0. ``monotone``: the response never changes direction between the values.
    """
    effects, base_row, answers = [], find_base(swept), swept.answers
    centre = int(_centres(swept.parameters).argmax())
    for name in swept.parameters:
        others = swept.parameters.drop(columns=name)
        values = swept.parameters[name][(others == others.iloc[centre]).all(axis=1)]
        values = values.sort_values(kind="stable")
        low, high = (answers.loc[values.index[end]] for end in (0, -1))
        at_base = math.nan * low if base_row is None else answers.loc[base_row]
        reference = low if base_row is None else at_base
        steps = answers.loc[values.index].diff()[1:]
        effect = pd.DataFrame(
            {
                "at_low": low,
                "at_base": at_base,
                "at_high": high,
                "change": high - low,
                "change_percent": 100 * (high - low) / reference.replace(0.0, math.nan),
                "monotone": (steps >= 0).all() | (steps <= 0).all(),
            }
        ).reset_index()
        base = math.nan if base_row is None else values[base_row]
        ends = {"parameter": name, "low": values.iloc[0], "base": base, "high": values.iloc[-1]}
        for index, (column, value) in enumerate(ends.items()):
            effect.insert(index, column, value)
        effects.append(effect)
    return pd.concat(effects, ignore_index=True)


def _centres(parameters: pd.DataFrame) -> BoolArray:
    """Whether all others differ from a finger in at most one parameter ``(finger,)``."""
    value = parameters.to_numpy()
    centre: BoolArray = (value != value[0]).sum(
        axis=1
    ) <= 1  # necessary; no other row can be a base
    for row in np.flatnonzero(centre) if value.shape[1] > 1 else ():
        centre[row] = ((value != value[row]).sum(axis=1) <= 1).all()
    return centre


def rank_regressions(
    swept: SweptFingers, *, resamples: int = RESAMPLES, seed: int = 0
) -> pd.DataFrame:
    """Standardised rank regression of every output, with 95 % intervals.

    ``low`` and ``high`` are the range of a parameter, ``low_95`` and ``high_95`` the interval of
    its coefficient over `resamples` (default 2000) bootstrap resamples, drawn by `seed`
    (default 0). ``adjusted_r_squared``, at least 0, is corrected for the number of parameters.
    Coefficients and R² are NaN for an output that does not vary.

    Raises
    ------
    UsageError
        Fewer than ``2 (parameters + 1)`` fingers, or two parameters with the same ranks.

    Notes
    -----
    Parameters and responses are replaced by their ranks, standardised to mean 0 and variance
    1, and a plane is fitted. A coefficient is the change of the response's rank with that of
    one parameter while the others are fixed; R² is the variance of the ranks that all
    parameters explain together. The rest is not monotone, an interaction of parameters, or
    noise (Iman & Conover 1979, Technometrics 21:499;
    Saltelli & Marivoet 1990, Reliab. Eng. Syst. Saf. 28:229). The same seed draws the
    same resamples.
    """
    fingers, parameters = swept.parameters.shape
    fewest = 2 * (parameters + 1)
    if fingers < fewest:
        raise UsageError(
            f"{fingers} fingers for {parameters} parameters, expected {fewest} or more"
        )
    value, answer = swept.parameters.to_numpy(), swept.answers.to_numpy()
    x = _standard_ranks(value)
    for row, column in np.argwhere(np.tril(np.abs(x.T @ x) / fingers > 1 - _SINGULAR, k=-1)):
        names = " and ".join(swept.parameters.columns[[column, row]])
        raise UsageError(f"{names} rise and fall together: their effects cannot be separated")
    coefficient, r_squared = _fit_planes(value, answer)
    rows = np.random.default_rng(seed).integers(fingers, size=(resamples, fingers))
    drawn, _ = _fit_planes(value[rows], answer[rows])
    tail = 0.5 * (1 - INTERVAL_SHARE)
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


def _fit_planes(value: FloatArray, answer: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Coefficients ``(…, parameter, output)`` and R² ``(…, output)`` of ranks.

    `value` is ``(…, finger, parameter)``, `answer` ``(…, finger, output)``. Constant columns
    have coefficients of 0.
    """
    x, y = _standard_ranks(value), _standard_ranks(answer)
    fingers = value.shape[-2]
    between_parameters = x.swapaxes(-1, -2) @ x / fingers
    with_outputs = x.swapaxes(-1, -2) @ y / fingers
    inverse = np.linalg.pinv(between_parameters, rcond=_SINGULAR, hermitian=True)
    coefficient: FloatArray = inverse @ with_outputs
    r_squared: FloatArray = np.clip((coefficient * with_outputs).sum(axis=-2), 0.0, 1.0)
    return coefficient, r_squared


def _standard_ranks(array: FloatArray) -> FloatArray:
    """Ranks over the fingers with mean 0 and variance 1; 0 if all values are equal."""
    from scipy.stats import rankdata

    ranks = rankdata(array, axis=-2)
    centred = ranks - ranks.mean(axis=-2, keepdims=True)
    spread = np.sqrt((centred**2).mean(axis=-2, keepdims=True))
    standard: FloatArray = np.divide(centred, spread, out=np.zeros_like(centred), where=spread > 0)
    return standard


def ordered_parameters(table: pd.DataFrame) -> list[str]:
    """Parameters of effects or regressions, sorted by their largest effect on a mean rate.

    The effect is the change in percent or the coefficient, the largest of all classes in the
    table; equal parameters are sorted by their effect on the stress.
    """
    column = "change_percent" if "change_percent" in table else "coefficient"
    mean = table[table["stimuli"] == ALL]
    largest = mean[column].abs().groupby([mean["parameter"], mean["quantity"]]).max().to_dict()

    def strength(name: str) -> list[float]:
        changes = (largest.get((name, quantity), 0.0) for quantity in QUANTITIES)
        return [0.0 if math.isnan(change) else change for change in changes]

    return sorted(table["parameter"].unique(), key=strength, reverse=True)


_Row: TypeAlias = Mapping[Any, Any]


_LAYERS = {"stratum_corneum": "stratum corneum", "subcutaneous_tissue": "subcutaneous tissue"}
_PARAMETER_LABELS = {
    "ridges.height_mm": "ridge height",
    "ridges.spacing_mm": "ridge spacing",
    "papillae.height_mm": "papilla height",
    "contact.friction": "friction",
    "contact_friction": "friction",
    "probe_diameter_mm": "probe diameter",
    "probe_x_mm": "probe aside",
    "preindent_um": "pre-indentation",
}
_LABEL_PATTERNS = (
    (re.compile(r"skin\.(\w+)_mm"), "{} thickness"),
    (re.compile(r"materials\.(\w+)\.young_mpa"), "{} modulus"),
    (re.compile(r"materials\.(\w+)\.poisson"), "{} Poisson’s ratio"),
    (re.compile(r"afferents\.(\w+)\.to_boundary_mm"), "{} to boundary"),
    (re.compile(r"afferents\.(\w+)\.depth_mm"), "{} depth"),
)


def csv_text(table: pd.DataFrame) -> str:
    """A table as CSV with six significant digits; booleans are ``yes`` or ``no``."""
    printed = table.replace({True: "yes", False: "no"}) if "monotone" in table else table
    return printed.to_csv(index=False, float_format="%.6g", lineterminator="\n")
