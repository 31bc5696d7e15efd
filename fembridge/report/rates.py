"""Rates of the paper's 82 stimuli from several sources, and what follows from them.

The stimuli come as the paper's figures show them: families, and a panel a set. A set is
all levels at the same frequencies (``sine_20``, ``noise_25_250``). Its level is the
amplitude of a sinusoid, that of a diharmonic's first component, or the root mean square
of a noise.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby, product
from typing import TYPE_CHECKING, Any

import numpy as np

from decks.stimuli import CATALOGUE, Entry, set_name, set_title
from fembridge.tables import AFFERENTS, Rate, SpikeTrain
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
# The parameters of the whole fingertip under a pin on the pad, beside whatever is judged.
FINGERTIP = "fingertip"
EVERY_SET = "all"
STIMULI = tuple(entry.id for entry in CATALOGUE)

# Section 4.2: "R² was almost greater than 0.8 for the regression line of all plots of
# each tactile afferent"; "P values of the regression were less than 0.05".
PAPER_R_SQUARED = 0.8
PAPER_P_VALUE = 0.05
# This project's own goal, with an RMSE below TouchSim's.
GOAL_R_SQUARED = 0.9
# And the RMSE of frequencies that a fit did not see.
HELD_OUT_GOAL_IPS = {"SA": 3.0, "RA": 8.0, "PC": 15.0}

NUMBERS = ("count", "slope", "intercept_ips", "r_squared", "p_value", "rmse_ips", "bias_ips")


class StimulusSet:
    """All levels at the same frequencies, the weakest first; `title` is its band."""

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
    """Sets of one kind of stimulus, and the words that name them on a page."""

    def __init__(self, name: str, title: str, figure: str, table: str) -> None:
        self.name, self.title, self.figure, self.table = name, title, figure, table
        mine = (entry for entry in CATALOGUE if entry.family == name)
        self.sets = tuple(StimulusSet(*each) for each in groupby(mine, set_name))
        self.stimuli = tuple(id_ for one in self.sets for id_ in one.stimuli)


FAMILIES = (
    Family("sine", "Sinusoids", "Fig. 3b", "Fig. 3c"),
    Family("diharm", "Diharmonics", "Fig. 4a–c", "Fig. 4d"),
    Family("noise", "Band-pass noises", "Fig. 5a–c", "Fig. 5d"),
)
SINES = FAMILIES[0]


class RateTable:
    """Rates of several sources; those of other than the paper's 82 stimuli are left out.

    `sources` are in the order in which a page shows them, one without any rate counts; `frame`
    is a long table ``source, stimulus, afferent, rate_ips, family, set, level_um``.
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
            (source, entry.id, afferent, rate_ips, family.name, one.name, entry.level_um)
            for source, family in product(sources, FAMILIES)
            for one in family.sets
            for entry, afferent in product(one.entries, AFFERENTS)
            if (rate_ips := self._rates_ips.get((source, afferent, entry.id))) is not None
        ]
        columns = ["source", "stimulus", "afferent", "rate_ips", "family", "set", "level_um"]
        self.frame = DataFrame(rows, columns=columns)

    def of(self, source: str, afferent: str, stimuli: Sequence[str]) -> FloatArray:
        """Rates ``(S,)`` of a source and class under `stimuli`, NaN where none is."""
        mine = (self._rates_ips.get((source, afferent, one), np.nan) for one in stimuli)
        return np.fromiter(mine, dtype=np.float64)

    def known(self, stimuli: Sequence[str]) -> tuple[str, ...]:
        """Sources that have a rate under at least one of `stimuli`."""
        there = set(self.frame.source[self.frame.stimulus.isin(stimuli)])
        return tuple(source for source in self.sources if source in there)

    def compared(self, reference: str) -> tuple[str, ...]:
        """Models of the same response, and TouchSim, but for the `reference` itself."""
        apart = (OBSERVED, FINGERTIP, reference)
        return tuple(source for source in self.sources if source not in apart)

    def reference(self, stimuli: Sequence[str] = STIMULI) -> str:
        """What models are compared with: observed rates, or else TouchSim's."""
        return OBSERVED if OBSERVED in self.known(stimuli) else TOUCHSIM

    def largest_ips(self, afferent: str, stimuli: Sequence[str]) -> float:
        """Largest rate of a class under `stimuli` from any source."""
        mine = (self.frame.afferent == afferent) & self.frame.stimulus.isin(stimuli)
        return float(self.frame.rate_ips[mine].max())


def agreement_table(rates: RateTable) -> "DataFrame":
    """Every computed source against observed rates, if any, and TouchSim's, cell by cell.

    A row for each ``reference, source, family, set, afferent``, which are the index as well;
    `set` is one of the family's, or ``all``. Where the two have no stimulus in common, the count
    is 0 and the other numbers NaN. Observed rates are predicted by nobody.
    ``meets_paper``: R² and p are what the paper reports; ``meets_goal``: R² is
    `GOAL_R_SQUARED` or more, and RMSE below TouchSim's; None without observed rates.
    """
    from pandas import DataFrame

    rows = []
    for reference, source in product((OBSERVED, TOUCHSIM), rates.sources):
        if reference not in rates.sources or source in (reference, OBSERVED):
            continue
        for family in FAMILIES:
            sets = {one.name: one.stimuli for one in family.sets} | {EVERY_SET: family.stimuli}
            for (name, stimuli), afferent in product(sets.items(), AFFERENTS):
                target = rates.of(reference, afferent, stimuli)
                predicted = rates.of(source, afferent, stimuli)
                both = np.isfinite(target) & np.isfinite(predicted)
                numbers: dict[str, float] = {"count": 0}
                if both.any():
                    numbers = agreement(target[both], predicted[both]).to_row()
                found = (numbers.get(number, np.nan) for number in NUMBERS)
                rows.append((reference, source, family.name, name, afferent, *found))
    keys = ["reference", "source", "family", "set", "afferent"]
    table = DataFrame(rows, columns=[*keys, *NUMBERS]).set_index(keys, drop=False)
    known = (table.reference == OBSERVED) & (table["count"] > 0)
    of_touchsim = table.rmse_ips[table.source == TOUCHSIM].droplevel("source")
    index: Any = table.index
    theirs_ips = of_touchsim.reindex(index.droplevel("source")).to_numpy()
    paper = (table.r_squared > PAPER_R_SQUARED) & (table.p_value < PAPER_P_VALUE)
    goal = (table.r_squared >= GOAL_R_SQUARED) & (table.rmse_ips < theirs_ips)
    return table.assign(
        meets_paper=paper.astype(object).where(known, None),
        meets_goal=goal.astype(object).where(known & np.isfinite(theirs_ips), None),
    )


def held_out_table(
    held_out: Mapping[str, Mapping[str, Any]], rates: RateTable, judged: str
) -> "DataFrame":
    """Errors of sinusoids whose frequency a fit did not see, beside the model that saw all.

    `held_out` is what `fembridge fit --held-out` keeps of each class: ``rmse_ips`` and
    ``rates_ips`` by stimulus. A row ``afferent, frequency_hz, count, fitted_rmse_ips,
    held_out_rmse_ips, held_out_bias_ips, touchsim_rmse_ips`` for each frequency, and for all
    together, where frequency_hz is NaN. Without observed rates only the last is there, with
    the error that the fit found.
    """
    from pandas import DataFrame

    rows: list[tuple[Any, ...]] = []
    for afferent, found in held_out.items():
        left_ips: Mapping[str, float] = found["rates_ips"]
        if OBSERVED not in rates.known(SINES.stimuli):
            known = (len(left_ips), np.nan, found["rmse_ips"], np.nan, np.nan)
            rows.append((afferent, np.nan, *known))
            continue
        stimuli = [stimulus for stimulus in SINES.stimuli if stimulus in left_ips]
        target = rates.of(OBSERVED, afferent, stimuli)
        off = DataFrame(
            {
                "fitted": rates.of(judged, afferent, stimuli) - target,
                "left": np.array([left_ips[stimulus] for stimulus in stimuli]) - target,
                "touchsim": rates.of(TOUCHSIM, afferent, stimuli) - target,
            },
            [float(stimulus.split("_")[1]) for stimulus in stimuli],
        )[np.isfinite(target)]
        for frequency_hz, mine in [*off.groupby(level=0), (np.nan, off)] if len(off) else ():
            rmse_ips, bias_ips = np.sqrt((mine**2).mean()), mine["left"].mean()
            numbers = (rmse_ips["fitted"], rmse_ips["left"], bias_ips, rmse_ips["touchsim"])
            rows.append((afferent, frequency_hz, len(mine), *numbers))
    columns = ["afferent", "frequency_hz", "count", "fitted_rmse_ips", "held_out_rmse_ips"]
    return DataFrame(rows, columns=[*columns, "held_out_bias_ips", "touchsim_rmse_ips"])


def row_of(table: "DataFrame", *key: Any) -> "Series[Any]":  # noqa: ANN401 - labels
    """Row of a table under its index."""
    rows: Any = table.loc
    found: Series[Any] = rows[key]
    return found


def threshold_table(rates: RateTable) -> "DataFrame":
    """Thresholds and entrainment from each rate curve of a sinusoid, see `neural.threshold`.

    Rates are known from `lowest_tried_um` to `highest_tried_um`. A threshold that equals
    the lowest may be lower, one that is infinite is above the highest. Index ``source,
    afferent, frequency_hz``.
    """
    from pandas import DataFrame

    rows = []
    for source, afferent, one in product(rates.sources, AFFERENTS, SINES.sets):
        rate_ips = rates.of(source, afferent, one.stimuli)
        there = np.isfinite(rate_ips)
        if not there.any():
            continue
        amplitude_um, rate_ips = np.array(one.level_um)[there], rate_ips[there]
        hz = one.frequency_hz
        plateau = entrainment_plateau(amplitude_um, rate_ips, hz)
        rows.append(
            {
                "source": source,
                "afferent": afferent,
                "frequency_hz": hz,
                "criterion_ips": CRITERION_IPS,
                "lowest_tried_um": float(amplitude_um.min()),
                "highest_tried_um": float(amplitude_um.max()),
                "threshold_um": threshold_amplitude_um(amplitude_um, rate_ips),
                "entrainment_threshold_um": threshold_amplitude_um(amplitude_um, rate_ips, hz),
                "plateau_low_um": plateau.low_um if plateau else np.nan,
                "plateau_high_um": plateau.high_um if plateau else np.nan,
                "plateau_decades": plateau.decades if plateau else np.nan,
            }
        )
    return DataFrame(rows).set_index(["source", "afferent", "frequency_hz"], drop=False)


def locking_table(rates: RateTable, trains: Mapping[str, Iterable[SpikeTrain]]) -> "DataFrame":
    """Impulses a cycle and vector strength of each source, class and sinusoid.

    The vector strength is the mean over the cells that fired; NaN where none did, and
    where a source has rates only: `trains` are those of the models.
    """
    from pandas import DataFrame

    entries = {entry.id: entry for one in SINES.sets for entry in one.entries}
    found: dict[tuple[str, str, str], list[float]] = {}
    for source, mine in trains.items():
        for train in mine:
            if (entry := entries.get(train.stimulus)) is not None:
                start_ms, end_ms = (end + EDGE_MS for end in entry.window_ms)
                times_ms = train.times_ms[(train.times_ms > start_ms) & (train.times_ms <= end_ms)]
                if times_ms.size:
                    strength = vector_strength(times_ms, entry.numbers()["frequency_hz"])
                    found.setdefault((source, train.afferent, entry.id), []).append(strength)
    rows = [
        (*key, *entry.numbers().values(), rate_ips / entry.numbers()["frequency_hz"],
         float(np.mean(found.get(key, [np.nan]))))
        for source, afferent in product(rates.sources, AFFERENTS)
        for entry, rate_ips in zip(
            entries.values(), rates.of(source, afferent, SINES.stimuli).tolist(), strict=True
        )
        if not np.isnan(rate_ips) and (key := (source, afferent, entry.id))
    ]  # fmt: skip
    columns = ["frequency_hz", "amplitude_um", "impulses_per_cycle", "vector_strength"]
    return DataFrame(rows, columns=["source", "afferent", "stimulus", *columns])
