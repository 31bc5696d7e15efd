"""Rates of the paper's 82 stimuli from several sources, and the tables computed from them.

Stimuli are grouped as in the paper's figures: a family per figure, a set per panel. A set has
all levels at the same frequencies (``sine_20``, ``noise_25_250``). The level is the amplitude
of a sinusoid, the amplitude of a diharmonic's first component, or the root mean square of a
noise.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby, product
from typing import TYPE_CHECKING, Any

import numpy as np

from decks.stimuli import CATALOGUE, Entry, set_name, set_title
from fembridge.io.spike_table import Rate, SpikeTrain
from fembridge.trace import AFFERENTS
from fembridge.typing import FloatArray
from neural import agreement
from neural.rates import EDGE_MS
from neural.threshold import (
    CRITERION_IPS,
    entrainment_plateau,
    threshold_amplitude_um,
)
from neural.timing import vector_strength

if TYPE_CHECKING:
    from pandas import DataFrame, Series

OBSERVED = "observed"
TOUCHSIM = "TouchSim"
# Source name of the whole-fingertip parameters under a pin on the pad; shown on every page.
FINGERTIP = "fingertip"
ALL_SETS = "all"
STIMULI = tuple(entry.id for entry in CATALOGUE)

# Section 4.2: "R² was almost greater than 0.8 for the regression line of all plots of
# each tactile afferent"; "P values of the regression were less than 0.05".
PAPER_R_SQUARED = 0.8
PAPER_P_VALUE = 0.05
# This project's own goal, with an RMSE below TouchSim's.
GOAL_R_SQUARED = 0.9
# Goal for the RMSE of frequencies that were left out of a fit.
HELD_OUT_GOAL_IPS = {"SA": 3.0, "RA": 8.0, "PC": 15.0}

AGREEMENT_COLUMNS = (
    "count",
    "slope",
    "intercept_ips",
    "r_squared",
    "p_value",
    "rmse_ips",
    "bias_ips",
)


class StimulusSet:
    """All levels at the same frequencies, the weakest first; `title` names the frequencies."""

    def __init__(self, name: str, entries: Iterable[Entry]) -> None:
        self.name, self.entries = name, tuple(entries)
        self.title = set_title(self.entries[0])
        self.stimuli = tuple(entry.id for entry in self.entries)
        self.level_um = tuple(entry.level_um for entry in self.entries)

    @property
    def frequency_hz(self) -> float:
        """Frequency of a set of sinusoids."""
        return float(self.entries[0].numbers()["frequency_hz"])


class Family:
    """Sets of one kind of stimulus, with the titles used on a page."""

    def __init__(self, name: str, title: str, figure: str, table: str) -> None:
        self.name, self.title, self.figure, self.table = name, title, figure, table
        entries = (entry for entry in CATALOGUE if entry.family == name)
        self.sets = tuple(StimulusSet(*group) for group in groupby(entries, set_name))
        self.stimuli = tuple(id_ for group in self.sets for id_ in group.stimuli)


FAMILIES = (
    Family("sine", "Sinusoids", "Fig. 3b", "Fig. 3c"),
    Family("diharm", "Diharmonics", "Fig. 4a–c", "Fig. 4d"),
    Family("noise", "Band-pass noises", "Fig. 5a–c", "Fig. 5d"),
)
SINES = FAMILIES[0]


class RateTable:
    """Rates of several sources for the paper's 82 stimuli; other stimuli are left out.

    `sources` are in page order and include those without rates; `frame` is a long table
    ``source, stimulus, afferent, rate_ips, family, set, level_um``.
    """

    def __init__(self, sources: Mapping[str, Iterable[Rate]]) -> None:
        from pandas import DataFrame

        self.sources = tuple(sources)
        self._rates_ips = {
            (source, rate.afferent, rate.stimulus): float(rate.rate_ips)
            for source, rates in sources.items()
            for rate in rates
        }
        rows = [
            (source, entry.id, afferent, rate_ips, family.name, group.name, entry.level_um)
            for source, family in product(sources, FAMILIES)
            for group in family.sets
            for entry, afferent in product(group.entries, AFFERENTS)
            if (rate_ips := self._rates_ips.get((source, afferent, entry.id))) is not None
        ]
        columns = ["source", "stimulus", "afferent", "rate_ips", "family", "set", "level_um"]
        self.frame = DataFrame(rows, columns=columns)

    def rates_ips(self, source: str, afferent: str, stimuli: Sequence[str]) -> FloatArray:
        """Rates ``(S,)`` of a source and class under `stimuli`, NaN where a rate is missing."""
        values_ips = (self._rates_ips.get((source, afferent, id_), np.nan) for id_ in stimuli)
        return np.fromiter(values_ips, dtype=np.float64)

    def sources_with_rates(self, stimuli: Sequence[str]) -> tuple[str, ...]:
        """Sources with a rate under at least one of `stimuli`."""
        available = set(self.frame.source[self.frame.stimulus.isin(stimuli)])
        return tuple(source for source in self.sources if source in available)

    def compared_with(self, reference: str) -> tuple[str, ...]:
        """Models on the judged response, and TouchSim, without `reference` itself."""
        excluded = (OBSERVED, FINGERTIP, reference)
        return tuple(source for source in self.sources if source not in excluded)

    def reference(self, stimuli: Sequence[str] = STIMULI) -> str:
        """Reference source under `stimuli`: observed rates if available, otherwise TouchSim."""
        return OBSERVED if OBSERVED in self.sources_with_rates(stimuli) else TOUCHSIM

    def largest_ips(self, afferent: str, stimuli: Sequence[str]) -> float:
        """Largest rate of a class under `stimuli` from any source."""
        selected = (self.frame.afferent == afferent) & self.frame.stimulus.isin(stimuli)
        return float(self.frame.rate_ips[selected].max())


def agreement_table(rates: RateTable) -> "DataFrame":
    """Agreement of every computed source with observed rates, if any, and with TouchSim's.

    One row per ``reference, source, family, set, afferent``, which are also the index; `set` is
    a set of the family or ``all``. Without a common stimulus the count is 0 and the other
    numbers are NaN. Observed rates are only a reference, never a source.
    ``meets_paper``: R² and p reach the values that the paper reports; ``meets_goal``: R² is
    at least `GOAL_R_SQUARED` and RMSE is below TouchSim's; both None without observed rates.
    """
    from pandas import DataFrame

    rows = []
    for reference, source in product((OBSERVED, TOUCHSIM), rates.sources):
        if reference not in rates.sources or source in (reference, OBSERVED):
            continue
        for family in FAMILIES:
            sets = {group.name: group.stimuli for group in family.sets}
            sets[ALL_SETS] = family.stimuli
            for (name, stimuli), afferent in product(sets.items(), AFFERENTS):
                target = rates.rates_ips(reference, afferent, stimuli)
                predicted = rates.rates_ips(source, afferent, stimuli)
                both = np.isfinite(target) & np.isfinite(predicted)
                numbers: dict[str, float] = {"count": 0}
                if both.any():
                    numbers = agreement(target[both], predicted[both]).to_row()
                values = (numbers.get(number, np.nan) for number in AGREEMENT_COLUMNS)
                rows.append((reference, source, family.name, name, afferent, *values))
    keys = ["reference", "source", "family", "set", "afferent"]
    table = DataFrame(rows, columns=[*keys, *AGREEMENT_COLUMNS]).set_index(keys, drop=False)
    observed = (table.reference == OBSERVED) & (table["count"] > 0)
    touchsim_rmse_ips = table.rmse_ips[table.source == TOUCHSIM].droplevel("source")
    index: Any = table.index
    touchsim_ips = touchsim_rmse_ips.reindex(index.droplevel("source")).to_numpy()
    paper = (table.r_squared > PAPER_R_SQUARED) & (table.p_value < PAPER_P_VALUE)
    goal = (table.r_squared >= GOAL_R_SQUARED) & (table.rmse_ips < touchsim_ips)
    return table.assign(
        meets_paper=paper.astype(object).where(observed, None),
        meets_goal=goal.astype(object).where(observed & np.isfinite(touchsim_ips), None),
    )


def held_out_table(
    held_out: Mapping[str, Mapping[str, Any]], rates: RateTable, judged: str
) -> "DataFrame":
    """Errors at frequencies that were left out of a fit, and errors of the complete fit.

    Parameters
    ----------
    held_out
        Results of `fembridge fit --held-out` by class: ``rmse_ips``, and ``rates_ips`` by
        stimulus.
    rates
        Rates of all sources.
    judged
        Source name of the complete fit.

    Returns
    -------
    DataFrame
        One row ``afferent, frequency_hz, count, fitted_rmse_ips, held_out_rmse_ips,
        held_out_bias_ips, touchsim_rmse_ips`` per frequency, and one for all frequencies, with
        frequency_hz NaN. Without observed rates only the latter, with the error that the fit
        reported.
    """
    from pandas import DataFrame

    rows: list[tuple[Any, ...]] = []
    for afferent, of_class in held_out.items():
        predicted_ips: Mapping[str, float] = of_class["rates_ips"]
        if OBSERVED not in rates.sources_with_rates(SINES.stimuli):
            reported = (len(predicted_ips), np.nan, of_class["rmse_ips"], np.nan, np.nan)
            rows.append((afferent, np.nan, *reported))
            continue
        stimuli = [stimulus for stimulus in SINES.stimuli if stimulus in predicted_ips]
        target = rates.rates_ips(OBSERVED, afferent, stimuli)
        errors_ips = DataFrame(
            {
                "fitted": rates.rates_ips(judged, afferent, stimuli) - target,
                "held_out": np.array([predicted_ips[stimulus] for stimulus in stimuli]) - target,
                "touchsim": rates.rates_ips(TOUCHSIM, afferent, stimuli) - target,
            },
            [float(stimulus.split("_")[1]) for stimulus in stimuli],
        )[np.isfinite(target)]
        groups = [*errors_ips.groupby(level=0), (np.nan, errors_ips)] if len(errors_ips) else ()
        for frequency_hz, group in groups:
            rmse_ips, bias_ips = np.sqrt((group**2).mean()), group["held_out"].mean()
            numbers = (rmse_ips["fitted"], rmse_ips["held_out"], bias_ips, rmse_ips["touchsim"])
            rows.append((afferent, frequency_hz, len(group), *numbers))
    columns = ["afferent", "frequency_hz", "count", "fitted_rmse_ips", "held_out_rmse_ips"]
    return DataFrame(rows, columns=[*columns, "held_out_bias_ips", "touchsim_rmse_ips"])


def row_of(table: "DataFrame", *key: Any) -> "Series[Any]":  # noqa: ANN401 - labels
    """Row of a table by its index."""
    rows: Any = table.loc
    row: Series[Any] = rows[key]
    return row


def threshold_table(rates: RateTable) -> "DataFrame":
    """Thresholds and entrainment from each rate curve of a sinusoid, see `neural.threshold`.

    Rates cover amplitudes from `lowest_tried_um` to `highest_tried_um`. A threshold equal to
    the lowest may be lower; an infinite one is above the highest. Index ``source, afferent,
    frequency_hz``.
    """
    from pandas import DataFrame

    rows = []
    for source, afferent, group in product(rates.sources, AFFERENTS, SINES.sets):
        rate_ips = rates.rates_ips(source, afferent, group.stimuli)
        finite = np.isfinite(rate_ips)
        if not finite.any():
            continue
        amplitude_um, rate_ips = np.array(group.level_um)[finite], rate_ips[finite]
        frequency_hz = group.frequency_hz
        plateau = entrainment_plateau(amplitude_um, rate_ips, frequency_hz)
        entrained_um = threshold_amplitude_um(amplitude_um, rate_ips, frequency_hz)
        rows.append(
            {
                "source": source,
                "afferent": afferent,
                "frequency_hz": frequency_hz,
                "criterion_ips": CRITERION_IPS,
                "lowest_tried_um": float(amplitude_um.min()),
                "highest_tried_um": float(amplitude_um.max()),
                "threshold_um": threshold_amplitude_um(amplitude_um, rate_ips),
                "entrainment_threshold_um": entrained_um,
                "plateau_low_um": plateau.low_um if plateau else np.nan,
                "plateau_high_um": plateau.high_um if plateau else np.nan,
                "plateau_decades": plateau.decades if plateau else np.nan,
            }
        )
    return DataFrame(rows).set_index(["source", "afferent", "frequency_hz"], drop=False)


def locking_table(rates: RateTable, trains: Mapping[str, Iterable[SpikeTrain]]) -> "DataFrame":
    """Impulses per cycle and vector strength of each source, class and sinusoid.

    `trains` are the spikes of the models, by source. The vector strength is the mean over the
    cells that fired; NaN if no cell fired, and for a source with rates only.
    """
    from pandas import DataFrame

    entries = {entry.id: entry for group in SINES.sets for entry in group.entries}
    strengths: dict[tuple[str, str, str], list[float]] = {}
    for source, of_source in trains.items():
        for train in of_source:
            if (entry := entries.get(train.stimulus)) is not None:
                start_ms, end_ms = (end + EDGE_MS for end in entry.window_ms)
                times_ms = train.times_ms[(train.times_ms > start_ms) & (train.times_ms <= end_ms)]
                if times_ms.size:
                    strength = vector_strength(times_ms, entry.numbers()["frequency_hz"])
                    strengths.setdefault((source, train.afferent, entry.id), []).append(strength)
    rows = [
        (*key, *entry.numbers().values(), rate_ips / entry.numbers()["frequency_hz"],
         float(np.mean(strengths.get(key, [np.nan]))))
        for source, afferent in product(rates.sources, AFFERENTS)
        for entry, rate_ips in zip(
            entries.values(), rates.rates_ips(source, afferent, SINES.stimuli).tolist(), strict=True
        )
        if not np.isnan(rate_ips) and (key := (source, afferent, entry.id))
    ]  # fmt: skip
    columns = ["frequency_hz", "amplitude_um", "impulses_per_cycle", "vector_strength"]
    return DataFrame(rows, columns=["source", "afferent", "stimulus", *columns])
