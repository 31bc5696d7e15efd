"""Comparison of a model with the paper and with recorded afferents, and its result."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from fembridge.errors import ResultError, UsageError
from fembridge.evidence import DISTANCE, HUMAN, THRESHOLDS, read_evidence
from fembridge.evidence.recorded_folder import (
    COLUMNS,
    joined_rates,
    read_recorded_folder,
    read_recorded_table,
)
from fembridge.host.store import check_output, filling, read_toml, sha256_of, write_text, write_toml
from fembridge.io.observed_rates import read_observed
from fembridge.io.spike_table import read_spikes
from fembridge.plots.shown import Shown
from fembridge.typing import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from decks.finger import Finger
    from fembridge.plots.style import Panels
    from fembridge.reporting.validation_data import ValidationData
    from fembridge.response.response_map import ResponseLike
    from fembridge.touching.pad import Pad
    from fembridge.touching.pad_probe import PadProbe
    from neural import ParameterSet

PathLike: TypeAlias = str | Path

EVIDENCE_SETS = {"thresholds": THRESHOLDS, "impulses": HUMAN, "distance": DISTANCE}
"""Set of `fembridge.evidence` that each table of the argument `evidence` replaces."""

_TABLE_ENDING = ".csv"


class Validation(Shown):
    """Comparison of a model with the paper and with recorded afferents, result of `validate`.

    Parameters
    ----------
    tables
        The numbers of the page by name, such as ``rates``, ``agreement``, ``thresholds``,
        ``locking``, ``tuning``, ``timing`` and ``recorded_sets``.
    provenance
        Versions, response, parameter sets and observed rates with checksums.
    data
        Complete results, for pictures and the page. Default: None, as after `read`.

    Examples
    --------
    >>> import fembridge as fb
    >>> validation = fb.validate()  # doctest: +SKIP
    >>> validation.plot("tuning")  # doctest: +SKIP
    """

    def __init__(
        self,
        tables: Mapping[str, DataFrame],
        provenance: Table,
        data: ValidationData | None = None,
    ) -> None:
        self.tables, self.provenance, self.data = tables, provenance, data

    @property
    def judged(self) -> str:
        """Name of the judged parameter set."""
        return str(self.provenance["judged"])

    @property
    def finger(self) -> str:
        """Name of the finger of the response."""
        finger = self.provenance["response"]["finger"]
        return str(finger.get("name", "own") if isinstance(finger, Mapping) else finger)

    @property
    def reference(self) -> str:
        """Source of the rates with which the models are compared: observed, or TouchSim."""
        return str(self.provenance["reference"])

    @property
    def rates(self) -> DataFrame:
        """Rate of each source, class and stimulus, in impulses/s."""
        return self.tables["rates"]

    @property
    def agreement(self) -> DataFrame:
        """R², RMSE and bias of each source, by family, set and class."""
        return self.tables["agreement"]

    def _lines(self) -> list[str]:
        lines = [f"Validation of {self.judged!r} on the finger {self.finger!r}"]
        rows = self.agreement[
            (self.agreement["source"] == self.judged)
            & (self.agreement["reference"] == self.reference)
            & (self.agreement["set"] == "all")
        ]
        for family, part in rows.reset_index(drop=True).groupby("family", sort=False):
            errors = [
                f"{name} {rmse_ips:.1f}"
                for name, rmse_ips in zip(part["afferent"], part["rmse_ips"], strict=True)
            ]
            text = ", ".join(errors)
            lines.append(f"  {family}, RMSE to {self.reference} in impulses/s: {text}")
        return lines

    def plot(self, kind: str | None = None, ax: Panels | None = None) -> Figure:
        """Picture of the page.

        Parameters
        ----------
        kind
            Name of a figure of the page, as ``rates_sine``, ``regression_sine``, ``rasters``,
            ``tuning``, ``phases``, ``human``, ``distance``, ``ramp`` or ``skin_deflection``.
            Default: ``rates_sine``.
        ax
            Axes to draw into, one per panel in reading order; an error states their number. The
            legend and a waveform above the spikes are left out. Default: a new figure.

        Raises
        ------
        UsageError
            Another kind, another number of axes, or a validation that was read from files,
            which have the figures as SVG.
        """
        from fembridge.reporting.validation_page import figure_functions

        if self.data is None:
            raise UsageError("a validation from files has no data to draw: see its SVG files")
        functions = figure_functions(self.data)
        name = kind or "rates_sine"
        if name not in functions:
            raise UsageError(argument="kind", found=kind, expected=", ".join(functions))
        return functions[name](axes=ax)

    def write(self, folder: PathLike, command: str = "fembridge validate") -> tuple[str, ...]:
        """Names of the files written into `folder`: the page, its figures, tables and record.

        A validation that was read from files has no page and figures.

        Parameters
        ----------
        folder
            Folder of the files.
        command
            Command line on the page that makes it again. Default: ``fembridge validate``.
        """
        from fembridge.reporting.validation_page import RECORD, write_report

        if self.data is not None:
            return write_report(Path(folder), self.data, command)
        with filling(Path(folder), last=RECORD) as draft:
            for name, frame in self.tables.items():
                text = frame.to_csv(index=False, lineterminator="\n")
                write_text(draft / f"{name}{_TABLE_ENDING}", text)
            files = {path.name: sha256_of(path) for path in sorted(draft.iterdir())}
            write_toml(draft / RECORD, {"command": command, **self.provenance, "files": files})
            return tuple(sorted(path.name for path in draft.iterdir()))

    @classmethod
    def read(cls, folder: PathLike) -> Validation:
        """Tables and provenance from a folder that `write` or ``fembridge validate`` wrote.

        Parameters
        ----------
        folder
            Folder with ``validation.toml`` and the tables.

        Raises
        ------
        ResultError
            A file is missing or is not one of `write`.
        """
        import pandas

        from fembridge.reporting.validation_page import RECORD

        path = Path(folder) / RECORD
        provenance = read_toml(path, ResultError.at(path))
        tables = {}
        provenance.pop("command", None)
        for name in provenance.pop("files", {}):
            if name.endswith(_TABLE_ENDING):
                table_path = Path(folder) / name
                try:
                    tables[table_path.stem] = pandas.read_csv(table_path)
                except (OSError, ValueError) as error:
                    raise ResultError("is not a table of a validation", table_path) from error
        return cls(tables, provenance)


def validate(
    output: PathLike | None = None,
    *,
    finger: str | Finger = "quick",
    response: ResponseLike | None = None,
    pad: str | Path | Pad | PadProbe | None = None,
    observed: PathLike | DataFrame | None = None,
    parameters: PathLike | ParameterSet | None = None,
    evidence: Mapping[str, PathLike | DataFrame] | None = None,
    recorded: PathLike | None = None,
) -> Validation:
    """Comparison of a model with the paper's figures and tables and with recorded afferents.

    Parameters
    ----------
    output
        Folder for the page, see `Validation.write`. Default: None, nothing is written.
    finger
        ``quick``, ``paper``, or a TOML file or `Finger`, whose response is then solved.
        Default: ``quick``.
    response
        Response map, or its file or folder as `fembridge.simulate` writes it, instead of
        that of `finger`. Default: None.
    pad
        Pad whose default probe gives the stress, as in `touch`, or a `PadProbe`: another probe,
        position or skin. Instead of `finger`. Default: None.
    observed
        Observed rates in impulses/s of any of the paper's 82 stimuli: a DataFrame or the path
        of a table ``stimulus, afferent, rate_ips``. Default: None, TouchSim is the reference.
    parameters
        Parameter set to judge: ``fitted``, ``fitted_pad``, ``published``, a TOML file or a
        `ParameterSet`. Default: None, ``fitted``, on a pad ``fitted_pad``.
    evidence
        Tables (DataFrames or paths) instead of published ones, by name: ``thresholds``
        (``afferent, criterion, frequency_hz, amplitude_um``), ``impulses`` (``afferent,
        frequency_hz, amplitude_um, impulses_per_cycle``), ``distance`` (``distance_mm,
        amplitude_um``), ``spikes`` (recorded spikes under sinusoids, ``stimulus, afferent,
        trial, spike_time_ms``). In files, lines with # are the source. In addition, recorded
        responses to touches: ``ramps_sa``, ``ramps_ra``, ``textures``, ``bars`` and ``fields``,
        with the columns of `fembridge.evidence.recorded_folder`. Default: None.
    recorded
        Folder with tables of recorded responses, recognised by their columns: rates in addition to
        `observed`, and responses to touches in addition to `evidence`. Default: None.

    Returns
    -------
    Validation
        ``tables`` has the numbers of the page as DataFrames.

    Raises
    ------
    UsageError
        An unknown name in `evidence`, or `observed` without any of the paper's stimuli.
    TableError, ParameterError, FingerError
        An invalid file, with its line or key.
    MissingError
        No solver, and no response is stored for `finger`.

    Examples
    --------
    >>> import fembridge as fb
    >>> validation = fb.validate()
    >>> print(repr(validation).splitlines()[0])
    Validation of 'fitted' on the finger 'quick'
    """
    from fembridge.reporting import validation_data
    from fembridge.reporting.validation_page import PAGE, csv_tables, input_record
    from fembridge.touching.pad_probe import pad_probe

    tables = dict(evidence or {})
    spikes = tables.pop("spikes", None)
    for name in tables:
        if name not in EVIDENCE_SETS and name not in COLUMNS:
            expected = f"one of {', '.join((*EVIDENCE_SETS, 'spikes', *COLUMNS))}"
            raise UsageError(argument="evidence", found=name, expected=expected)
    facts = {
        EVIDENCE_SETS[name]: read_evidence(table, EVIDENCE_SETS[name])
        for name, table in tables.items()
        if name in EVIDENCE_SETS
    }
    folder_rates, touches = ([], {}) if recorded is None else read_recorded_folder(recorded)
    touches |= {
        name: read_recorded_table(_path_or_frame(table), name)
        for name, table in tables.items()
        if name in COLUMNS
    }
    trains = () if spikes is None else read_spikes(_path_or_frame(spikes))
    if observed is not None:
        folder_rates.insert(0, read_observed(_path_or_frame(observed), complete=False))
    rates = joined_rates(folder_rates)
    if parameters is None:
        parameters = "fitted" if pad is None else validation_data.FINGERTIP_SET
    models = validation_data.judged_models(parameters)
    if output is not None:
        check_output(Path(output), PAGE)
    probe = None if pad is None else pad_probe(pad)
    solved = validation_data.response_of(finger, response, models, probe)
    skin = None if probe is None else probe.skin()
    data = validation_data.compute_validation(solved, models, rates, facts, trains, skin, touches)
    result = Validation(csv_tables(data), input_record(data), data)
    if output is not None:
        result.write(output)
    return result


def _path_or_frame(table: PathLike | DataFrame) -> Path | DataFrame:
    return Path(table) if isinstance(table, str) else table
