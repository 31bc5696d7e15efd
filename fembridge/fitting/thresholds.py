"""Threshold amplitude of each afferent class against vibration frequency.

The *absolute* threshold of a cell is the smallest amplitude with a spike; the threshold of
*one impulse per cycle* is the smallest amplitude with as many spikes as complete cycles after
the first. Recorded thresholds are means over units, so the threshold of a class is that of
its median cell; under a probe on ridged skin each position has the cells of the class. A
vibration starts at phase 0 with full amplitude, as the paper's stimuli, from the
pre-indentation of the parameters.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from fembridge.errors import ResultError, UsageError
from fembridge.evidence import CRITERIA, HIGHEST_HZ, LOWEST_HZ, THRESHOLDS, published, read_evidence
from fembridge.fitting.response_source import response_source
from fembridge.host.progress import advance
from fembridge.host.store import check_output, filling, read_toml, write_toml
from fembridge.io.number import parse_number
from fembridge.io.text_table import read_table, write_table
from fembridge.plots.shown import Shown
from fembridge.response.response_map import ResponseLike, ResponseMap
from fembridge.solver.mechanics import check_mechanics
from fembridge.stimulus import Stimulus
from fembridge.trace import model_id
from fembridge.typing import BoolArray, FloatArray, Table
from fembridge.version import __version__
from neural import ParameterSet, parameter_set
from neural.encoder import encode_cells
from neural.models import model_of
from neural.parameters import DT_MS, AfferentParameters

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from decks.finger import Finger
    from fembridge.plots.style import Panels
    from fembridge.touching.pad import Pad
    from fembridge.touching.pad_probe import PadProbe

PathLike: TypeAlias = str | Path

COLUMNS = ("afferent", "criterion", "frequency_hz", "amplitude_um")
RANGE_COLUMNS = ("most_sensitive_um", "least_sensitive_um")
FORCE_COLUMNS = ("force_mn", "force_amplitude_mn")
"""Columns of a probe on a pad."""
TABLE_FILE, PICTURE_FILE, RECORD_FILE = "thresholds.csv", "thresholds.png", "thresholds.toml"

# Preferred numbers of ISO 266.
THIRD_OCTAVES_HZ = tuple(
    float(step * 10**decade)
    for decade in (0, 1, 2)
    for step in (1, 1.25, 1.6, 2, 2.5, 3.15, 4, 5, 6.3, 8)
    if LOWEST_HZ <= step * 10**decade <= HIGHEST_HZ
)

_MIN_AMPLITUDE_UM = 0.01

# Number of amplitudes in the first pass, amplitudes between two neighbours in the next
# passes, and number of next passes: the ratio of neighbours falls from 1.45 to 1.08 to 1.015.
_FIRST_PASS, _NEXT_PASSES, _PASSES = 28, 4, 2

# A vibration lasts 100 ms or five cycles, whichever is longer, as those of Muniak et al.
# (2007), with at least ten samples per cycle.
_MIN_DURATION_MS, _MIN_CYCLES, _MIN_SAMPLES_PER_CYCLE = 100.0, 5.0, 10.0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Thresholds(Shown):
    """Threshold amplitudes of afferent classes, the result of `threshold`.

    Parameters
    ----------
    table
        ``afferent, criterion, frequency_hz, amplitude_um, most_sensitive_um,
        least_sensitive_um``: zero-to-peak amplitudes in um of the median, the most sensitive and
        the least sensitive cell of a class; NaN where even the strongest vibration that the
        response reaches is too weak. ``criterion`` is ``absolute`` (the first impulse) or
        ``one_impulse_a_cycle``. Under a probe on a pad also ``force_mn``, the largest force of the
        vibration at the median threshold in mN, and ``force_amplitude_mn``, by how much that is
        above the force of the pre-indentation.
    observed
        Observed thresholds with the first four columns, for the picture. Default: those of
        Freeman and Johnson (1982).
    provenance
        Version, parameter set, pre-indentation and response. Default: empty.

    Examples
    --------
    >>> import fembridge as fb
    >>> thresholds = fb.threshold(["PC"], [20, 250])
    >>> thresholds.write("thresholds")
    >>> fb.Thresholds.read("thresholds").table.equals(thresholds.table)
    True
    """

    table: pandas.DataFrame
    observed: pandas.DataFrame = field(default_factory=lambda: published(THRESHOLDS).table)
    provenance: Table = field(default_factory=dict)

    def _lines(self) -> list[str]:
        classes = dict.fromkeys(self.table["afferent"])
        frequencies_hz = self.table["frequency_hz"]
        lines = [
            f"Thresholds of {', '.join(classes)} at {frequencies_hz.nunique()} frequencies, "
            f"{frequencies_hz.min():g} to {frequencies_hz.max():g} Hz"
        ]
        absolute = self.table[self.table["criterion"] == CRITERIA[0]]
        for name, rows in absolute.groupby("afferent", sort=False):
            reached = rows.dropna(subset="amplitude_um")
            if reached.empty:
                lines.append(f"  {name}: above the strongest vibration of the response")
                continue
            best = reached.iloc[int(reached["amplitude_um"].argmin())]
            lines.append(
                f"  {name}: lowest {best['amplitude_um']:.3g} um at {best['frequency_hz']:g} Hz"
            )
        return lines

    def plot(self, kind: str | None = None, ax: Panels | None = None) -> Figure:
        """Curves of the model and observed thresholds, one panel per class.

        Parameters
        ----------
        kind
            ``thresholds``, the only kind. Default: ``thresholds``.
        ax
            Axes to draw into, one per class. Default: a new figure.

        Raises
        ------
        UsageError
            Another kind, or another number of axes.
        """
        from fembridge.plots.rate_comparison import thresholds_figure

        if kind not in (None, "thresholds"):
            raise UsageError(argument="kind", found=kind, expected="thresholds")
        return thresholds_figure(self.table, self.observed, ax)

    def write(self, folder: PathLike) -> None:
        """Write ``thresholds.csv``, ``thresholds.png`` and ``thresholds.toml`` into `folder`.

        Parameters
        ----------
        folder
            Folder of the files, which is made.

        Raises
        ------
        OutputError
            The folder cannot be written.
        """
        from fembridge.plots.style import save_figure

        with filling(Path(folder), last=TABLE_FILE) as draft:
            save_figure(self.plot(), draft / PICTURE_FILE)
            observed = {name: self.observed[name].tolist() for name in COLUMNS}
            record = {**self.provenance, "observed_thresholds": observed}
            write_toml(draft / RECORD_FILE, record)
            rows = self.table.to_numpy().tolist()
            write_table(draft / TABLE_FILE, [*map(str, self.table)], rows)

    @classmethod
    def read(cls, folder: PathLike) -> Thresholds:
        """Thresholds from the files of `write`.

        Parameters
        ----------
        folder
            Folder that `write` or ``fembridge threshold`` wrote.

        Raises
        ------
        TableError, ResultError
            A file is missing or is not one of `write`.
        """
        import pandas

        folder = Path(folder)
        path = folder / RECORD_FILE
        columns: tuple[str, ...] = (*COLUMNS, *RANGE_COLUMNS)
        table = read_table(folder / TABLE_FILE, columns, FORCE_COLUMNS)
        columns += tuple(name for name in FORCE_COLUMNS if name in table.header)
        values = {
            name: table.words(name)
            if name in COLUMNS[:2]
            else [float(text or "nan") for text in table.column(name)]
            for name in columns
        }
        provenance = read_toml(path, ResultError.at(path))
        observed = pandas.DataFrame(provenance.pop("observed_thresholds"))
        return cls(pandas.DataFrame(values), observed, provenance)


def threshold(
    afferents: str | Sequence[str] = ("SA", "RA", "PC"),
    frequencies_hz: str | float | Sequence[float] = "2:800",
    *,
    parameters: PathLike | ParameterSet | None = None,
    preindent_um: float | None = None,
    finger: str | Finger | None = None,
    response: ResponseLike | None = None,
    unit: str | Sequence[str] = (),
    pad: str | Path | Pad | PadProbe | None = None,
    thresholds: PathLike | pandas.DataFrame = THRESHOLDS,
    output: PathLike | None = None,
) -> Thresholds:
    """Threshold amplitude of each class against vibration frequency.

    For each frequency: the smallest zero-to-peak amplitude with an impulse, and that of one
    impulse per cycle, of the median cell of a class.

    Parameters
    ----------
    afferents
        Class or classes. Default: SA, RA and PC.
    frequencies_hz
        Frequencies in Hz, 2 to 800: a number, a sequence, ``"10,50,200"``, or ``"5:800"`` for the
        third octaves of a range. Default: ``"2:800"``.
    parameters
        Parameter set: ``fitted``, ``fitted_pad``, ``published``, a TOML file or a `ParameterSet`.
        Default: None, ``fitted``, on a pad ``fitted_pad``.
    preindent_um
        Depth of the probe before time 0, in um. Default: None, the depth at which the
        parameter set was fitted; 0 of a deck of yours.
    finger
        Preset finger whose stored response gives the stress, ``quick`` or ``paper``.
        Default: None, ``quick``.
    response
        Response map or `DeckResponse`, or its file or folder as `fembridge.simulate` or
        `fembridge.map_response` writes it, instead of `finger`. Default: None.
    unit
        Units of classes that have several in `response`, as ``["SA=12", "RA=40"]``, one of a
        class. Default: (), of each class the one with the largest stress.
    pad
        Pad whose default probe vibrates, as in `touch`, or a `PadProbe`: another probe, position
        or skin. Instead of `finger`. Default: None.
    thresholds
        Observed thresholds for the picture: a DataFrame or the path of a table ``afferent,
        criterion, frequency_hz, amplitude_um``, or the name of a set of `fembridge.evidence`.
        Default: those of Freeman and Johnson (1982).
    output
        Folder for the result, see `Thresholds.write`. Default: None, nothing is written.

    Returns
    -------
    Thresholds
        ``table`` has a row per class, criterion and frequency.

    Raises
    ------
    UsageError
        An unknown class, or a frequency outside 2 to 800 Hz.

    Examples
    --------
    >>> import fembridge as fb
    >>> result = fb.threshold(["PC"], [20, 250])
    >>> absolute = result.table.query("criterion == 'absolute'")
    >>> absolute["amplitude_um"].is_monotonic_decreasing
    True
    """
    import pandas

    if isinstance(afferents, str):
        afferents = [afferents]
    if isinstance(frequencies_hz, int | float):
        frequencies_hz = [frequencies_hz]
    source = response_source(finger, response, [unit] if isinstance(unit, str) else unit, pad)
    encoding_parameters = parameter_set(source.parameters if parameters is None else parameters)
    available = encoding_parameters.parameters
    for name in afferents:
        if name not in available:
            raise UsageError(
                argument="afferents", found=name, expected=f"one of {', '.join(available)}"
            )
    default_um = 0.0 if source.response.is_of_deck else encoding_parameters.preindent_um
    depth_um = default_um if preindent_um is None else preindent_um
    check_mechanics(encoding_parameters, model_id(source.response.origin), {depth_um})
    observed = read_evidence(thresholds, THRESHOLDS).table
    if isinstance(frequencies_hz, str):
        frequencies_hz = parse_frequencies(frequencies_hz)
    if output is not None:
        check_output(Path(output), TABLE_FILE, PICTURE_FILE, RECORD_FILE)
    tables = [
        class_thresholds(source.response, available[name], frequencies_hz, depth_um)
        for name in dict.fromkeys(afferents)
    ]
    provenance = {
        "fembridge": __version__,
        "parameters": encoding_parameters.to_table(),
        "preindent_um": float(depth_um),
        "response": source.to_table(),
    }
    result = Thresholds(pandas.concat(tables, ignore_index=True), observed, provenance)
    if output is not None:
        result.write(output)
    return result


def parse_frequencies(text: str) -> list[float]:
    """Frequencies in Hz: ``5:800``, the third octaves of a range, or ``10,50,200``."""
    low, colon, high = text.partition(":")
    try:
        if not colon:
            return [parse_number(item) for item in text.split(",")]
        lowest_hz, highest_hz = parse_number(low), parse_number(high)
    except ValueError:
        raise UsageError(
            argument="frequencies_hz", found=text, expected="a form as 5:800 or 10,50,200"
        ) from None
    if not LOWEST_HZ <= lowest_hz <= highest_hz <= HIGHEST_HZ:
        raise UsageError(
            argument="frequencies_hz",
            found=text,
            expected=f"a range inside {LOWEST_HZ:g}:{HIGHEST_HZ:g}, the recorded frequencies",
        )
    frequencies_hz = [
        frequency_hz for frequency_hz in THIRD_OCTAVES_HZ if lowest_hz <= frequency_hz <= highest_hz
    ]
    if not frequencies_hz:
        raise UsageError(
            argument="frequencies_hz", found=text, expected="a range with a third octave"
        )
    return frequencies_hz


def vibration(
    frequency_hz: float,
    amplitude_um: float,
    preindent_um: float,
    dt_ms: float = DT_MS,
    cycles: float = _MIN_CYCLES,
) -> Stimulus:
    """Sinusoid of 100 ms or `cycles` (default: 5), whichever is longer, every `dt_ms` (0.5).

    Frequency in Hz, zero-to-peak amplitude and pre-indentation in um.
    """
    duration_ms = max(_MIN_DURATION_MS, cycles * 1000.0 / frequency_hz)
    times_ms = np.arange(math.ceil(duration_ms / dt_ms - 1e-9) + 1) * dt_ms
    wave_um = amplitude_um * np.sin(2.0 * np.pi * frequency_hz * times_ms / 1000.0)
    return Stimulus(
        id=f"sine_{frequency_hz:g}_{amplitude_um:g}",
        displacement_um=preindent_um + wave_um,
        dt_ms=dt_ms,
        window_ms=(0.0, float(times_ms[-1])),
        preindent_um=preindent_um,
    )


def step_ms(frequency_hz: float, parameters: AfferentParameters) -> float:
    """Time step in ms with ten samples per cycle; that of the parameters where it is fixed."""
    dt_ms = parameters.dt_ms
    if model_of(parameters).any_step:
        while dt_ms > 1000.0 / (_MIN_SAMPLES_PER_CYCLE * frequency_hz):
            dt_ms /= 2.0
    return dt_ms


def class_thresholds(
    response: ResponseMap,
    parameters: AfferentParameters,
    frequencies_hz: Sequence[float],
    preindent_um: float = 0.0,
) -> pandas.DataFrame:
    """Threshold amplitudes of a class.

    Parameters
    ----------
    response
        Response map with the stress of the class.
    parameters
        Parameters of the class.
    frequencies_hz
        Frequencies of the vibrations.
    preindent_um
        Depth of the probe before time 0, in um. Default: 0.

    Returns
    -------
    DataFrame
        ``afferent, criterion, frequency_hz, amplitude_um, most_sensitive_um,
        least_sensitive_um``: thresholds of the median, the most and the least sensitive
        cell. NaN where even the strongest vibration that `response` reaches is too weak. Of a
        probe on a pad also `FORCE_COLUMNS`.

    Raises
    ------
    UsageError, ResponseError
        A frequency outside 2 to 800 Hz; a class that `response` lacks.
    """
    import pandas

    for frequency_hz in frequencies_hz:
        if not LOWEST_HZ <= frequency_hz <= HIGHEST_HZ:
            raise UsageError(
                argument="frequencies_hz",
                found=frequency_hz,
                expected=f"{LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz",
            )
    rows = []
    for number, frequency_hz in enumerate(frequencies_hz):
        advance(f"thresholds of {parameters.afferent}", number / len(frequencies_hz))
        ranked_um = _ranked_thresholds(response, parameters, frequency_hz, preindent_um)
        for criterion, (lowest_um, *middle_um, highest_um) in zip(CRITERIA, ranked_um, strict=True):
            median_um = float(np.mean(middle_um))
            rows.append(
                (
                    parameters.afferent,
                    criterion,
                    float(frequency_hz),
                    median_um,
                    lowest_um,
                    highest_um,
                )
            )
    advance(f"thresholds of {parameters.afferent}", 1.0)
    frame = pandas.DataFrame(rows, columns=[*COLUMNS, *RANGE_COLUMNS])
    frame = frame.replace(math.inf, math.nan)
    if response.force_n.size:
        amplitude_um = frame["amplitude_um"].to_numpy(np.float64)
        force_mn = 1000.0 * response.force_at_n(preindent_um + amplitude_um)
        at_rest_mn = 1000.0 * response.force_at_n(np.array(preindent_um))
        values = force_mn, force_mn - at_rest_mn
        frame = frame.assign(**dict(zip(FORCE_COLUMNS, values, strict=True)))
    return frame


def _ranked_thresholds(
    response: ResponseMap,
    parameters: AfferentParameters,
    frequency_hz: float,
    preindent_um: float,
) -> FloatArray:
    """Thresholds by both criteria of the most sensitive, two middle and least sensitive cell.

    ``(2, 4)`` in µm; infinity where there is none. Only brackets of these cells are refined.
    """
    most_um = response.deepest_um - preindent_um
    tried_um = np.geomspace(_MIN_AMPLITUDE_UM, most_um, _FIRST_PASS)
    fires = _fires(response, parameters, frequency_hz, preindent_um, tried_um)
    below_um, above_um = _bracket(tried_um, fires)
    last_cell = fires.shape[2] - 1
    ranks = [0, last_cell // 2, (last_cell + 1) // 2, last_cell]
    shares = np.arange(1, _NEXT_PASSES + 1) / (_NEXT_PASSES + 1)
    for _ in range(_PASSES):
        ranked_above_um = np.take_along_axis(
            above_um, np.argsort(above_um, axis=1)[:, ranks], axis=1
        )
        open_brackets = np.isfinite(above_um) & (below_um < above_um)
        open_brackets &= np.isin(above_um, ranked_above_um)
        if not open_brackets.any():
            break
        pairs = np.unique(
            np.stack([below_um[open_brackets], above_um[open_brackets]], axis=-1), axis=0
        )
        between_um = np.concatenate([low * (high / low) ** shares for low, high in pairs])
        tried_um = np.unique(np.concatenate([between_um, pairs.reshape(-1)]))
        fires = _fires(response, parameters, frequency_hz, preindent_um, tried_um)
        lower_um, upper_um = _bracket(tried_um, fires, below_um)
        below_um = np.where(open_brackets, lower_um, below_um)
        above_um = np.where(open_brackets, upper_um, above_um)
    thresholds_um = np.where(np.isfinite(above_um), np.sqrt(below_um * above_um), math.inf)
    ranked_um: FloatArray = np.sort(thresholds_um, axis=1)[:, ranks]
    return ranked_um


def _bracket(
    tried_um: FloatArray, fires: BoolArray, least_um: FloatArray | float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Last amplitude below the threshold and first at it, above `least_um`, from ``(A, ...)``."""
    column = tried_um.reshape(-1, *[1] * (fires.ndim - 1))
    reached = fires & (column > least_um)
    first = reached.argmax(axis=0)
    above_um = np.where(reached.any(axis=0), tried_um[first], math.inf)
    below_um = tried_um[np.maximum(first - 1, 0)]
    return np.where(first > 0, below_um, above_um), above_um


def _fires(
    response: ResponseMap,
    parameters: AfferentParameters,
    frequency_hz: float,
    preindent_um: float,
    amplitudes_um: FloatArray,
) -> BoolArray:
    """Whether each criterion is met, ``(amplitude, criterion, cell x position)``."""
    dt_ms = step_ms(frequency_hz, parameters)
    unit_wave = vibration(frequency_hz, 1.0, 0.0, dt_ms)
    waves_um = preindent_um + np.multiply.outer(unit_wave.displacement_um, amplitudes_um)
    joined = replace(
        unit_wave,
        displacement_um=waves_um.reshape(-1),
        window_ms=(0.0, dt_ms),
        preindent_um=preindent_um,
    )
    stress_pa = response.stress_pa(parameters, [joined]).reshape(len(waves_um), -1)
    spikes = encode_cells(stress_pa, dt_ms, replace(parameters, dt_ms=dt_ms))
    positions = stress_pa.shape[1] // amplitudes_um.size
    cycle_ms = 1000.0 / frequency_hz
    cycles = math.floor(unit_wave.window_ms[1] / cycle_ms + 1e-9) - 1
    ends_ms = np.array([cycle_ms, (cycles + 1) * cycle_ms]) + 1e-6
    fires = np.empty((len(spikes), 2, parameters.cells), np.bool_)
    for row, cells in enumerate(spikes):
        for cell, times_ms in enumerate(cells):
            before, until = times_ms.searchsorted(ends_ms, side="right")
            fires[row, :, cell] = times_ms.size > 0, until - before >= cycles
    by_position = fires.reshape(amplitudes_um.size, positions, 2, parameters.cells)
    return np.moveaxis(by_position, 1, 2).reshape(amplitudes_um.size, 2, -1)


def compare_with_evidence(
    predicted: pandas.DataFrame, observed: pandas.DataFrame
) -> pandas.DataFrame:
    """`observed` thresholds with columns for the model's thresholds and their ratio.

    `predicted` must have the frequencies of `observed`; columns ``model_um`` and ``ratio``
    (model over observed) are added.
    """
    keys = ["afferent", "criterion", "frequency_hz"]
    merged = observed.merge(predicted[[*keys, "amplitude_um"]], on=keys, suffixes=("", "_model"))
    merged = merged.rename(columns={"amplitude_um_model": "model_um"})
    return merged.assign(ratio=merged["model_um"] / merged["amplitude_um"])
