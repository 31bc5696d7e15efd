"""Files of a stimulus: for a solver, a shaker, a sound card or another program, and back.

``csv``         ``time_ms,displacement_um``, a row a sample, shortest exact decimals
``npy``         displacement alone, ``(T,)`` float64 in um, one sample every `dt_ms`
``wav``         16-bit mono; its comment states the displacement in um of 32767
``marc-table``  a ``table`` of a Marc deck: time in s, displacement in mm

Displacement is positive into the skin and holds the whole depth in all four. A user's own
waveform has one of the same formats, with any length and steps, also uneven ones; it is
resampled to steps of 0.5 ms, those of the catalogue.
"""

import io
import logging
import re
import struct
import warnings
from collections.abc import Callable, Mapping
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from decks.stimuli import (
    DECIMALS,
    DT_MS,
    MAX_AMPLITUDE_UM,
    MAX_SAMPLES,
)
from fembridge.errors import StimulusError, TraceError, warn
from fembridge.host.memory import check_memory
from fembridge.host.store import near_hint, read_bytes, replacing, write_text
from fembridge.io.npz import read_array_header
from fembridge.io.number import parse_number, parse_whole_number
from fembridge.io.run_folder import COLUMNS
from fembridge.io.text_table import MAX_TABLE_BYTES, read_table, warn_if_cut
from fembridge.stimulus import Stimulus
from fembridge.trace import STEP_TOLERANCE, doubt_of_gaps, doubt_of_step, mean_step, resample
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    import pandas

_LOGGER = logging.getLogger(__name__)

MM_PER_UM = 1.0e-3
S_PER_MS = 1.0e-3
PCM16_PEAK = 32767
_REAL_WIDTH = 20  # columns of a real in a Marc table's extended format
_SCALE = re.compile(rb"fembridge: 32767 is (\S{1,40}) um\0")
_LONGEST_NAME = 60
# Vibrations of 250 Hz are felt from about 0.1 um; a much smaller waveform is in another unit.
_LEAST_FELT_UM = 0.01
# Largest delay of the last sample, as a share of a step, with rounded times.
_LATE_SAMPLES = 0.05
# Steps too long for a touch, with more samples than the corners of a simple waveform.
_LONG_STEP_MS, _FEW_CORNERS = 20.0, 10
# Peak of resident memory while a WAV or NPY is read and resampled, measured with 19 million.
_BYTES_PER_SAMPLE = 64
_TIME_COLUMNS = {"time_ms": 1.0, "time_s": 1.0 / S_PER_MS}
_DEPTH_COLUMNS = {"displacement_um": 1.0, "displacement_mm": 1.0 / MM_PER_UM}
# A load is kept as um: 1 mN or 1 kPa is one um, until a deck or a map says what it is there.
LOAD_PER_UM = 1.0e-3
_LOAD_COLUMNS = {
    "force_n": ("force", 1.0 / LOAD_PER_UM),
    "force_mn": ("force", 1.0),
    "pressure_mpa": ("pressure", 1.0 / LOAD_PER_UM),
    "pressure_kpa": ("pressure", 1.0),
}


def read_stimulus(
    path: Path,
    preindent_um: float = 0.0,
    dt_ms: float | None = None,
    full_scale_um: float | None = None,
) -> Stimulus:
    """The waveform of a file, named after it; spikes are counted in all of it.

    Resampling, a start deeper than 0 and unused columns are logged. A last line that may be
    cut, samples that seem to be lost and power that resampling loses are a
    `FembridgeWarning`.

    Parameters
    ----------
    path
        A table with ``time_ms`` or ``time_s`` and ``displacement_um`` or ``displacement_mm``
        (and ``aside_um`` of a probe that slides), or a load in ``force_n``, ``force_mn``,
        ``pressure_mpa`` or ``pressure_kpa``; a mono WAV, an NPY ``(T,)`` in um, or a
        Marc table as `write_stimulus` writes it. Time counts from the first sample.
    preindent_um
        Depth of the probe in um before time 0, added to a waveform that starts at 0. A
        waveform that starts deeper holds its whole depth: its first sample is the depth
        before time 0. Default: 0.
    dt_ms
        Time between two samples of an NPY in ms. Default: None.
    full_scale_um
        Displacement in um at full scale of a WAV. Default: None, as its comment states.

    Raises
    ------
    StimulusError, TableError
        No such file, or a file without a waveform.
    """
    content = read_bytes(path, MAX_TABLE_BYTES, StimulusError)
    suffix = path.suffix.lower()
    if suffix not in _READERS:
        raise StimulusError(f"expected a waveform in one of {', '.join(_READERS)}", path)
    try:
        samples = _READERS[suffix](path, content, dt_ms, full_scale_um)
    except StimulusError as error:
        raise StimulusError.from_error(error, path) from error
    name = path.name.removesuffix(path.suffix).removesuffix(".marc")
    origin = {"family": "own", "file": path.name, "sha256": sha256(content).hexdigest()}
    return stimulus_from_samples(samples, preindent_um, name, origin, path)


class Samples(NamedTuple):
    """Times in ms, depth in um and path aside in um of a waveform, each ``(T,)``.

    `load` is ``"force"`` or ``"pressure"`` where `depth_um` stands for a load, `LOAD_PER_UM` N or
    MPa for each um.
    """

    times_ms: FloatArray
    depth_um: FloatArray
    aside_um: FloatArray | None = None
    load: str = ""


def stimulus_from_samples(
    samples: Samples,
    preindent_um: float,
    name: str,
    origin: Mapping[str, object],
    path: Path | None = None,
) -> Stimulus:
    """The stimulus of `samples` at any times, on steps of 0.5 ms; see `read_stimulus`.

    Raises
    ------
    StimulusError
        Fewer than two samples, a sample that is not finite, a waveform that is too long, too
        deep, or begins outside the skin.
    """
    times_ms, depth_um, aside_um, load = samples
    if load:
        origin = {**origin, "load": {"quantity": load, "per_um": LOAD_PER_UM}}
    try:
        samples_um = np.stack([depth_um] if aside_um is None else [depth_um, aside_um], -1)
        if samples_um.shape[0] < 2:
            count, expected = samples_um.shape[0], "two or more"
            raise StimulusError(
                f"{count} samples, expected {expected}", found=count, expected=expected
            )
        if not np.isfinite(samples_um).all():
            raise StimulusError("a sample is not finite")
        length_ms, longest_ms = float(times_ms[-1] - times_ms[0]), (MAX_SAMPLES - 1) * DT_MS
        if not 0 < length_ms <= longest_ms * (1 + STEP_TOLERANCE):
            expected = f"at most {longest_ms:g} ms"
            raise StimulusError(
                f"{length_ms:g} ms long, expected {expected}: cut it into parts",
                found=length_ms,
                expected=expected,
            )
        samples_um = _every_half_ms(times_ms, samples_um, path or Path(name))
        depth_um, first_um = samples_um[:, 0], round(float(samples_um[0, 0]), DECIMALS)
        deepest_um = round(float(np.abs(depth_um).max()), DECIMALS)
        if not 0 < deepest_um <= MAX_AMPLITUDE_UM:
            expected = f"more than 0, at most {MAX_AMPLITUDE_UM:g} um"
            raise StimulusError(
                f"goes {deepest_um:g} um deep, expected {expected}",
                found=deepest_um,
                expected=expected,
            )
        if first_um < 0:
            raise StimulusError(
                f"starts at {first_um:g} um, expected 0 or deeper, the depth of the probe before "
                "time 0: add samples that lead there from 0, or remove the offset",
                found=first_um,
                expected="0 or deeper",
            )
    except (StimulusError, TraceError) as error:
        section = None if path else name
        raise StimulusError.from_error(error, path, section) from error
    if deepest_um < _LEAST_FELT_UM:
        warn(f"{name} is {deepest_um:g} um deep at most: are its samples in um?", path)
    if first_um > 0:
        _LOGGER.info(
            f"{path or name}: starts {first_um:g} um deep: the probe is that deep before time 0"
        )
        preindent_um = first_um
    else:
        depth_um = depth_um + preindent_um
    return Stimulus(
        id=re.sub(r"[^A-Za-z0-9_.-]", "_", name)[:_LONGEST_NAME],
        displacement_um=np.round(depth_um, DECIMALS),
        dt_ms=DT_MS,
        window_ms=(0.0, (depth_um.size - 1) * DT_MS),
        preindent_um=preindent_um,
        origin=origin,
        aside_um=None if aside_um is None else samples_um[:, 1] - samples_um[0, 1],
    )


def write_stimulus(
    stimulus: Stimulus, path: Path, format_name: str, full_scale_um: float | None = None
) -> float | None:
    """Write `stimulus` to `path`, whole or not at all, in one of `FORMATS`.

    Returns
    -------
    float or None
        Displacement in um of 32767 in a WAV: `full_scale_um`, by default the largest one.
    """
    if format_name == "wav":
        return write_wav(stimulus, path, full_scale_um)
    _, write = FORMATS[format_name]
    write(stimulus, path)
    return None


def write_csv(stimulus: Stimulus, path: Path) -> None:
    """Write ``time_ms,displacement_um``, for a probe that slides also ``aside_um``.

    Reading the file gives the same floats.
    """
    columns = [stimulus.times_ms, stimulus.displacement_um]
    if stimulus.aside_um is not None:
        columns.append(stimulus.aside_um)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    lines = [",".join(COLUMNS[: len(columns)]), *(",".join(map(repr, r)) for r in rows)]
    write_text(path, "\n".join(lines) + "\n")


def write_npy(stimulus: Stimulus, path: Path) -> None:
    """Write the displacement, ``(T,)`` float64 in um, for ``numpy.load``."""
    with replacing(path) as draft, draft.open("wb") as file:
        np.save(file, stimulus.displacement_um, allow_pickle=False)


def write_wav(stimulus: Stimulus, path: Path, full_scale_um: float | None = None) -> float:
    """Write 16-bit mono PCM; the displacement in um of 32767, which its comment states."""
    full_scale_um = full_scale_um or float(np.abs(stimulus.displacement_um).max()) or 1.0  # flat
    pcm = np.rint(stimulus.displacement_um / full_scale_um * PCM16_PEAK).astype("<i2").tobytes()
    comment = f"fembridge: 32767 is {full_scale_um!r} um\0".encode()
    comment += b"\0" * (len(comment) % 2)
    rate_hz = round(1000.0 / stimulus.dt_ms)
    chunks = {
        b"fmt ": struct.pack("<HHIIHH", 1, 1, rate_hz, 2 * rate_hz, 2, 16),
        b"LIST": b"INFOICMT" + struct.pack("<I", len(comment)) + comment,
        b"data": pcm,
    }
    packed = [name + struct.pack("<I", len(chunk)) + chunk for name, chunk in chunks.items()]
    content = b"WAVE" + b"".join(packed)
    with replacing(path) as draft:
        draft.write_bytes(b"RIFF" + struct.pack("<I", len(content)) + content)
    return full_scale_um


def write_marc_table(stimulus: Stimulus, path: Path) -> None:
    """Write the ``table`` option of a Marc deck, in extended format.

    The layout is the one Mentat 2021 writes: table 1, one variable (time), one
    point a sample. A boundary condition multiplies its own value by the table,
    so that value is 1, or -1 if the axis of the deck points out of the skin.
    """
    from decks.marc.write import time_table

    lines = [
        f"$ {stimulus.id}: time in s, displacement of the probe in mm, positive into",
        "$ the skin, 0 at first touch; reals in extended format (20 columns)",
        *time_table(
            stimulus.id, stimulus.times_ms * S_PER_MS, stimulus.displacement_um * MM_PER_UM
        ),
    ]
    write_text(path, "\n".join(lines) + "\n")


FORMATS: dict[str, tuple[str, Callable[[Stimulus, Path], object]]] = {
    "csv": (".csv", write_csv),
    "wav": (".wav", write_wav),
    "npy": (".npy", write_npy),
    "marc-table": (".marc.dat", write_marc_table),
}
"""Suffix and writer of each format."""


# ---- Reading


def _csv(path: Path, content: bytes, dt_ms: float | None, full_scale_um: float | None) -> Samples:
    return read_samples(path)


def read_samples(source: "Path | pandas.DataFrame") -> Samples:
    """Samples of a table.

    Raises
    ------
    StimulusError, TableError
        A column that is missing, a cell that is no number, times that do not rise.
    """
    table = read_table(source)

    def column(factors: Mapping[str, float]) -> FloatArray:
        names = [name for name in table.header if name in factors]
        if len(names) != 1:
            hints = (near_hint(name, table.header) for name in factors if not names)
            columns, expected = ",".join(table.header)[:80], f"one {' or '.join(factors)}"
            raise StimulusError(
                f"the columns are {columns}, expected {expected}{next(filter(None, hints), '')}",
                found=columns,
                expected=expected,
            )
        numbers: FloatArray = table.numbers(names[0], factor=factors[names[0]])
        return numbers

    loads = [name for name in table.header if name in _LOAD_COLUMNS]
    factors = _DEPTH_COLUMNS
    if loads and not any(name in _DEPTH_COLUMNS for name in table.header):
        factors = {name: factor for name, (_, factor) in _LOAD_COLUMNS.items()}
    times_ms, depth_um = column(_TIME_COLUMNS), column(factors)
    load = "" if factors is _DEPTH_COLUMNS else _LOAD_COLUMNS[loads[0]][0]
    table.check_columns(
        (*_TIME_COLUMNS, *factors),
        COLUMNS[2:],
        lambda line: _LOGGER.info(f"{table.path}: {line}"),
    )
    with np.errstate(over="ignore"):  # of 1e308
        table.refuse(np.diff(times_ms, prepend=-np.inf) <= 0, lambda row: "time does not rise")
    has_aside = COLUMNS[2] in table.header
    aside_um = table.numbers(COLUMNS[2]) if has_aside else None
    return Samples(times_ms, depth_um, aside_um, load)


def _npy(path: Path, content: bytes, dt_ms: float | None, full_scale_um: float | None) -> Samples:
    try:
        stream = io.BytesIO(content)
        shape, kind = read_array_header(stream)
        if len(shape) != 1 or kind.kind not in "iuf":
            raise ValueError(f"{kind} {shape}, expected numbers (T,)")
        begin, stated = stream.tell(), shape[0] * kind.itemsize
        if stated != len(content) - begin:
            raise ValueError(f"{len(content) - begin} bytes of samples, the header says {stated}")
        depth_um = np.frombuffer(content, kind, offset=begin)
    except Exception as error:  # whatever a damaged header makes of the parser
        raise StimulusError(f"not an NPY of samples in um: {_short(error)}") from error
    if dt_ms is None or not 0 < dt_ms < np.inf:
        required = "is required: an NPY file has no time step"
        problem = required if dt_ms is None else f"is {dt_ms}, expected more than 0"
        raise StimulusError(problem, argument="dt_ms")
    _check_samples(depth_um.size)
    with np.errstate(over="ignore", invalid="ignore"):  # of 1e308, and of 16 bytes
        times_ms = np.arange(depth_um.size, dtype=np.float64) * dt_ms
        return Samples(times_ms, depth_um.astype(np.float64))


def _wav(path: Path, content: bytes, dt_ms: float | None, full_scale_um: float | None) -> Samples:
    from scipy.io import wavfile  # slow to import

    try:
        end = _check_chunks(content)
        _check_samples(len(content))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)  # a chunk of others
            rate_hz, samples = wavfile.read(io.BytesIO(content))
        if samples.ndim != 1 or not rate_hz > 0:
            raise ValueError(f"{samples.shape} samples every second {rate_hz}, expected mono")
    except StimulusError:
        raise
    except Exception as error:  # whatever a damaged header makes of the parser
        raise StimulusError(f"not a WAV: {_short(error)}") from error
    if (rest := content[end:]) and not (end % 2 and rest == b"\0"):
        problem = f"{len(rest)} bytes after the end in its header: damaged?"
        warn(problem, path)
    stated = _SCALE.search(content)
    scale_um = full_scale_um
    if stated and not scale_um:
        with suppress(ValueError):
            scale_um = parse_number(stated[1].decode("latin-1"))
    if scale_um is None or not 0 < scale_um < np.inf:
        required = "is required: the WAV file does not state its scale"
        problem = required if scale_um is None else f"is {scale_um}, expected more than 0"
        raise StimulusError(problem, argument="full_scale_um")
    samples, peak = (samples.astype(np.float64), samples.dtype)
    if peak.kind == "u":  # 8 bits
        samples -= 128.0
    peaks = {"u1": 127.0, "i2": float(PCM16_PEAK), "i4": 2.0**31 - 1}
    with np.errstate(over="ignore"):  # refused as not finite
        samples *= scale_um / peaks.get(f"{peak.kind}{peak.itemsize}", 1.0)
    times_ms: FloatArray = np.arange(samples.size) * (1000.0 / rate_hz)
    return Samples(times_ms, samples)


def _check_chunks(content: bytes) -> int:
    """The end of a WAV in its header, which its chunks must fill.

    Raises
    ------
    ValueError
        The file is cut, or its sizes are damaged.
    """
    if content[:4] != b"RIFF" or content[8:12] != b"WAVE":
        raise ValueError("cut, or no RIFF")
    end = 8 + int(struct.unpack("<I", content[4:8])[0])
    if end > len(content):
        raise ValueError(f"cut: {len(content)} bytes, its header says {end}")
    begin, names = 12, []
    while begin < end:
        name, size = content[begin : begin + 4], content[begin + 4 : min(begin + 8, end)]
        stop = begin + 8 + int.from_bytes(size, "little")
        if len(size) < 4 or not name.isascii() or not name.decode().isprintable() or stop > end:
            raise ValueError(f"cut, or damaged in the chunk at byte {begin}")
        names.append(name)
        begin = stop + stop % 2
    for name in (b"fmt ", b"data"):
        if names.count(name) != 1:
            raise ValueError(f"{names.count(name)} chunks {name.decode()!r}, expected one")
    return end


def _check_samples(count: int) -> None:
    check_memory(count * _BYTES_PER_SAMPLE, f"a waveform of {count} samples", StimulusError)


def _short(error: Exception) -> str:
    """The message of another library, in one line."""
    return " ".join(str(error).split())[:120] or type(error).__name__


def _marc_table(
    path: Path, content: bytes, dt_ms: float | None, full_scale_um: float | None
) -> Samples:
    from decks.marc.grammar import parse_real

    warn_if_cut(path, content[-1:])
    lines = [line for line in content.decode("latin-1").splitlines() if line[:1] != "$"]
    try:
        if not lines[0].startswith("table") or parse_whole_number(lines[2][10:20]) != len(
            lines[3:]
        ):
            raise ValueError
        if any(len(line.rstrip()) != _REAL_WIDTH * 2 for line in lines[3:]):
            raise ValueError
        pairs = [
            [parse_real(line[:_REAL_WIDTH].strip()), parse_real(line[_REAL_WIDTH:].strip())]
            for line in lines[3:]
        ]
    except (ValueError, IndexError):
        raise StimulusError("not one whole table as `fembridge stimuli` exports it") from None
    time_s, depth_mm = np.array(pairs, dtype=np.float64).reshape(-1, 2).T
    with np.errstate(over="ignore"):  # refused as not finite
        return Samples(time_s / S_PER_MS, depth_mm / MM_PER_UM)


_READERS: dict[str, Callable[[Path, bytes, float | None, float | None], Samples]] = {
    ".csv": _csv,
    ".wav": _wav,
    ".npy": _npy,
    ".dat": _marc_table,
}


def _every_half_ms(times_ms: FloatArray, samples_um: FloatArray, path: Path) -> FloatArray:
    """Samples ``(T, column)`` on steps of 0.5 ms: unchanged, or resampled by PCHIP."""
    with np.errstate(over="ignore", invalid="ignore"):  # of 1e308
        step_ms, odd = mean_step(times_ms)
    if odd is None and abs(step_ms / DT_MS - 1.0) * times_ms.size <= _LATE_SAMPLES:
        return samples_um
    resampled: FloatArray = resample(times_ms, samples_um, DT_MS)[1]
    how = f"one every {step_ms:g} ms" if odd is None else "uneven times"
    _LOGGER.info(
        f"{path}: {times_ms.size} samples, {how}, resampled to {len(resampled)}, "
        f"one every {DT_MS:g} ms"
    )
    warning = None
    if odd is not None:
        warning = doubt_of_gaps(times_ms)
    elif step_ms < DT_MS:
        warning = doubt_of_step(samples_um[:, 0], step_ms, DT_MS)
    elif step_ms > _LONG_STEP_MS and times_ms.size > _FEW_CORNERS:
        warning = f"{times_ms.size} samples, one every {step_ms:g} ms: in which unit is the time?"
    if warning:
        warn(warning, path)
    return resampled
