"""Spikes and firing rates of stress traces from a table, a simulation or a run folder.

A command reads the signature for its options: the function imports what it needs when it is
called, so that ``--help`` costs nothing.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas

    from fembridge.io.run_folder import RunFolder
    from fembridge.simulation.calibrate import Calibration
    from fembridge.simulation.encoding import Encoding
    from fembridge.simulation.simulation import Simulation
    from fembridge.trace import StressTrace
    from neural import ParameterSet


def encode(
    traces: str
    | os.PathLike[str]
    | RunFolder
    | Simulation
    | pandas.DataFrame
    | StressTrace
    | Sequence[StressTrace],
    *,
    parameters: str | ParameterSet | None = None,
    stimulus: str | None = None,
    afferents: str | Sequence[str] | None = None,
    window_ms: tuple[float, float] | None = None,
    derivative: str = "backward",
    columns: Mapping[str, str | Sequence[str]] | None = None,
    gain_pa: float | Mapping[str, float] | None = None,
    calibration: str | os.PathLike[str] | Calibration | None = None,
    resample_ms: float | None = None,
) -> Encoding:
    """Spikes and firing rates of stress traces.

    Parameters
    ----------
    traces
        The path of a table ``time_ms,afferent,node,von_mises_pa``, of a folder or
        ``traces.npz`` of `simulate`, or of a run folder; a `Simulation`; a `RunFolder` of
        `build_deck`; a DataFrame of such columns; a `StressTrace` or a list of these, each with
        the class of its afferent. ``unit`` and ``stimulus`` distinguish traces of one class.
    parameters
        Neural parameters: ``"fitted"``, ``"published"`` (Table 2 of the paper), the path of a
        TOML file, or a `ParameterSet`. Default: None, those of the run, else ``"fitted"``,
        which hold for a probe at a pre-indentation of 75 um.
    stimulus
        Name of the stimulus in the results, or the one to encode of several. Default: None,
        that of the run, else the name of the file, else ``"traces"``.
    afferents
        Class or classes to encode; a trace without a class is encoded as each of them.
        Default: None, the classes of the traces; of traces without a class, all.
    window_ms
        Start and end in ms of the window in which spikes count, the start excluded.
        Default: None, that of the run or of the catalogue stimulus `stimulus`, else the
        whole trace.
    derivative
        Scheme of the stress derivatives: ``"backward"``, ``"central"`` or ``"forward"``.
        Default: ``"backward"``.
    columns
        Names of the columns of another table, as of a robot's sensor:
        ``{"time": "t_s", "value": ["f1", "f2"]}``. Default: None: in a table without
        ``von_mises_pa``, a column that is named as a time, and each other column of numbers as a
        channel, which becomes a unit.
    gain_pa
        Stress in Pa of a value of 1, of all classes or by class. Default: None, as the end of the
        column's name states.
    calibration
        Gains and offset of a sensor: a `Calibration` of `calibrate`, or the path of its file.
        Default: None.
    resample_ms
        Step in ms of an even grid for samples at uneven times. Default: None: samples of a sensor
        are put on 0.5 ms, or 0.1 ms if they come faster; others are refused.

    Returns
    -------
    Encoding
        ``spikes`` and ``rates`` are DataFrames; several cells of a class are numbered, and
        the rate is their mean.

    Raises
    ------
    UsageError, ParameterError, TableError
        A sensor without a gain, parameters that read strain energy, `window_ms` outside a
        trace, a row that is no sample.

    Warns
    -----
    FembridgeWarning
        The parameters were fitted on other mechanics; stress in another unit; no spikes; a sensor
        that is too slow for PC.

    Examples
    --------
    >>> import fembridge as fb
    >>> result = fb.simulate("sine_20_250", stored=True)
    >>> encoding = fb.encode(result)
    >>> encoding.spikes.equals(result.spikes), encoding.rates.equals(result.rates)
    (True, True)
    """
    from fembridge.simulation.encoding import encode_stress
    from neural.parameter_sets import parameter_set

    return encode_stress(
        traces,
        # A wrong name is refused before the traces are read.
        None if parameters is None else parameter_set(parameters),
        stimulus,
        Path(traces).stem if isinstance(traces, str | os.PathLike) else "traces",
        afferents,
        window_ms,
        derivative,
        columns,
        gain_pa,
        calibration,
        resample_ms,
    )
