"""A stimulus as a file: for a solver, a shaker, a sound card or another program, and back.

``csv``         ``time_ms,displacement_um``, a row a sample, shortest exact decimals
``npy``         displacement alone, ``(T,)`` float64 in um, one sample every `dt_ms`
``wav``         16-bit mono; its comment says how many um 32767 is
``marc-table``  a ``table`` of a Marc deck: time in s, displacement in mm

Displacement is positive into the skin and holds the whole depth in all four. A waveform
of one's own comes in by the same four: it may have any length and step, also an uneven
one; what it becomes are samples every 0.5 ms, as of the stimuli of the catalogue.
"""

import io
import re
import struct
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import TypeAlias

import numpy as np

from decks.stimuli import (
    DECIMALS,
    DT_MS,
    MAX_AMPLITUDE_UM,
    MAX_SAMPLES,
    Noise,
    named,
)
from decks.waveform import make_stimulus
from fembridge.errors import FembridgeWarning, StimulusError, TraceError, UsageError
from fembridge.memory import check_memory
from fembridge.npz import read_array_header
from fembridge.number import parse_number, parse_whole_number
from fembridge.run_folder import COLUMNS
from fembridge.stimulus import Stimulus
from fembridge.store import near_hint, read_bytes, replacing, write_text
from fembridge.tables import MAX_TABLE_BYTES, read_table, warn_if_cut
from fembridge.trace import STEP_TOLERANCE, doubt_of_gaps, doubt_of_step, mean_step, resample
from fembridge.typing import FloatArray

Stimuli: TypeAlias = str | Path | Stimulus | Sequence[str | Path | Stimulus]
"""Ids as ``sine_20_250``, sets as ``noise_25_250`` or ``all``, or waveforms of one's own:
values, or paths of files."""

MM_PER_UM = 1.0e-3
S_PER_MS = 1.0e-3
PCM16_PEAK = 32767
_REAL_WIDTH = 20  # columns of a real in a Marc table's extended format
_SCALE = re.compile(rb"fembridge: 32767 is (\S{1,40}) um\0")
_LONGEST_NAME = 60
# By so much of a step the last sample may be late, where times are rounded.
_LATE_SAMPLES = 0.05
# Steps that are too long for a touch, of more samples than the corners of a shape.
_LONG_STEP_MS, _FEW_CORNERS = 20.0, 10
# Peak of resident memory while a WAV or NPY is read and resampled, measured with 19 million.
_BYTES_PER_SAMPLE = 64
_TIME_COLUMNS = {"time_ms": 1.0, "time_s": 1.0 / S_PER_MS}
_DEPTH_COLUMNS = {"displacement_um": 1.0, "displacement_mm": 1.0 / MM_PER_UM}


def stimuli_of(
    stimulus: Stimuli,
    preindent_um: float = 0.0,
    seed: int | None = None,
    slide_mm_per_s: float | None = None,
    *,
    dt_ms: float | None = None,
    full_scale_um: float | None = None,
    window_ms: tuple[float, float] | None = None,
    log: Callable[[str], None] = lambda line: None,
) -> list[Stimulus]:
    """The waveforms that `stimulus` names, each once: values, then files, then ids.

    `dt_ms` and `full_scale_um` are for files (`read_stimulus`); `window_ms` takes the place
    of each one's own counting window.

    Raises
    ------
    StimulusError, UsageError
        No such id, a negative seed or depth, two waveforms of one name.
    TableError
        A file with a row that is no sample.
    """
    if seed is not None and seed < 0:
        raise UsageError(f"seed is {seed}, expected 0 or more")
    given = [stimulus] if isinstance(stimulus, str | Path | Stimulus) else stimulus
    made = [one for one in given if isinstance(one, Stimulus)]
    words = [one for one in given if not isinstance(one, Stimulus)]
    if words or not made:
        files, entries = named(words)
        kinds = {one.suffix.lower() for one in files}
        for option, value, kind in (
            ("dt-ms", dt_ms, ".npy"),
            ("full-scale-um", full_scale_um, ".wav"),
        ):
            if value is not None and kind not in kinds:
                argument = option.replace("-", "_")
                raise UsageError(
                    f"--{option} ({argument}=) is for a waveform in {kind}, and none is named"
                )
        made += [read_stimulus(one, preindent_um, dt_ms, full_scale_um, log) for one in files]
        if seed is not None and not any(isinstance(entry, Noise) for entry in entries):
            raise UsageError("--seed (seed=) is for noise, and none is named")
        made += [make_stimulus(entry, preindent_um, seed) for entry in entries]
    names = [one.id for one in made]
    if len(set(names)) < len(names):
        raise UsageError(f"two waveforms are named {max(names, key=names.count)}: rename one")
    if window_ms is not None:
        made = [replace(one, window_ms=window_ms) for one in made]
    if slide_mm_per_s is not None:
        made = [one.sliding(slide_mm_per_s) for one in made]
    return made


def check_depth_is_used(stimuli: Sequence[Stimulus], preindent_um: float | None) -> None:
    """Refuse a `preindent_um` that a user chose and that none of `stimuli` has.

    Raises
    ------
    UsageError
        All of them hold their own depth before time 0, as a file that starts in the skin.
    """
    own_um = sorted({stimulus.preindent_um for stimulus in stimuli})
    if preindent_um is not None and preindent_um not in own_um:
        raise UsageError(
            f"--preindent-um (preindent_um=) is {preindent_um:g}, but {stimuli[0].id} holds its "
            f"own depth before time 0, {own_um[0]:g} um: leave it out"
        )


def read_stimulus(
    path: Path,
    preindent_um: float = 0.0,
    dt_ms: float | None = None,
    full_scale_um: float | None = None,
    log: Callable[[str], None] = lambda line: None,
) -> Stimulus:
    """A waveform of one's own, named after its file; spikes are counted in all of it.

    Parameters
    ----------
    path
        A table with ``time_ms`` or ``time_s`` and ``displacement_um`` or ``displacement_mm``
        (and ``aside_um`` of a probe that slides), a mono WAV, an NPY ``(T,)`` in um, or a
        Marc table as `write_stimulus` writes it. Time counts from the first sample.
    preindent_um
        Depth before time 0, added to a waveform that starts at 0. One that starts deeper
        holds its whole depth: its first sample is where the probe stands before.
    dt_ms
        Of an NPY: the time between two samples.
    full_scale_um
        Of a WAV: displacement in um that is its full scale, where it holds none itself.
    log
        Gets a line where it is resampled or starts deeper than 0, and about columns that are
        not used. A doubt is a `FembridgeWarning`: a last line that may be cut, samples that
        seem to be lost, power that resampling loses.

    Raises
    ------
    StimulusError, TableError
        No such file, or not such a waveform.
    """

    def say(line: str) -> None:
        log(f"{path}: {line}")

    content = read_bytes(path, MAX_TABLE_BYTES, StimulusError)
    kind = path.suffix.lower()
    if kind not in _READERS:
        expected = ", ".join(_READERS)
        raise StimulusError(f"{path}: expected a waveform in one of {expected}")
    try:
        times_ms, depth_um, aside_um = _READERS[kind](path, content, dt_ms, full_scale_um, say)
        samples_um = np.stack([depth_um] if aside_um is None else [depth_um, aside_um], -1)
        if samples_um.shape[0] < 2:
            raise StimulusError(f"{samples_um.shape[0]} samples, expected two or more")
        if not np.isfinite(samples_um).all():
            raise StimulusError("a sample is not finite")
        if not 0 < times_ms[-1] - times_ms[0] <= (MAX_SAMPLES - 1) * DT_MS * (1 + STEP_TOLERANCE):
            raise StimulusError(
                f"{times_ms[-1] - times_ms[0]:g} ms long, expected at most "
                f"{(MAX_SAMPLES - 1) * DT_MS:g} ms: cut it into parts"
            )
        samples_um = _every_half_ms(times_ms, samples_um, path, say)
        depth_um, first_um = samples_um[:, 0], round(float(samples_um[0, 0]), DECIMALS)
        most_um = round(float(np.abs(depth_um).max()), DECIMALS)
        if not 0 < most_um <= MAX_AMPLITUDE_UM:
            raise StimulusError(
                f"goes {most_um:g} um deep, expected more than 0, at most {MAX_AMPLITUDE_UM:g} um"
            )
        if first_um < 0:
            raise StimulusError(
                f"starts at {first_um:g} um, expected 0 or deeper, where the probe stands before: "
                "put samples in front that lead there from 0, or take the offset away"
            )
    except (StimulusError, TraceError) as error:
        raise StimulusError(f"{path}: {error}") from error
    if first_um > 0:
        log(f"{path}: starts {first_um:g} um deep, so the probe stands there before time 0")
        preindent_um = first_um
    else:
        depth_um = depth_um + preindent_um
    return Stimulus(
        id=re.sub(
            r"[^A-Za-z0-9_.-]", "_", path.name.removesuffix(path.suffix).removesuffix(".marc")
        )[:_LONGEST_NAME],
        displacement_um=np.round(depth_um, DECIMALS),
        dt_ms=DT_MS,
        window_ms=(0.0, (depth_um.size - 1) * DT_MS),
        preindent_um=preindent_um,
        origin={"family": "own", "file": path.name, "sha256": sha256(content).hexdigest()},
        aside_um=None if aside_um is None else samples_um[:, 1] - samples_um[0, 1],
    )


def write_stimulus(
    stimulus: Stimulus, path: Path, format_name: str, full_scale_um: float | None = None
) -> float | None:
    """Write `stimulus` to `path`, whole or not at all, in one of `FORMATS`.

    Returns
    -------
    float or None
        Of a WAV the displacement in um that 32767 is: `full_scale_um`, by default its own
        largest.
    """
    if format_name == "wav":
        return write_wav(stimulus, path, full_scale_um)
    _, write = FORMATS[format_name]
    write(stimulus, path)
    return None


def write_csv(stimulus: Stimulus, path: Path) -> None:
    """Write ``time_ms,displacement_um``; reading it back gives the same floats.

    Of a probe that slides ``aside_um`` follows.
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
    """Write 16-bit mono PCM; the displacement in um that 32767 is, which its comment says."""
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
    packed = [name + struct.pack("<I", len(each)) + each for name, each in chunks.items()]
    content = b"WAVE" + b"".join(packed)
    with replacing(path) as draft:
        draft.write_bytes(b"RIFF" + struct.pack("<I", len(content)) + content)
    return full_scale_um


def write_marc_table(stimulus: Stimulus, path: Path) -> None:
    """Write the ``table`` option of a Marc deck, in extended format.

    The layout is the one Mentat 2021 writes: table 1, one variable (time), one
    point a sample. A boundary condition multiplies its own value by the table,
    so that value is 1, or -1 where the deck's axis points out of the skin.
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


# ---- Reading: times in ms, depth in um, and the way aside if there is one

_Log: TypeAlias = Callable[[str], None]
_Samples: TypeAlias = tuple[FloatArray, FloatArray, FloatArray | None]


def _csv(
    path: Path, content: bytes, dt_ms: float | None, full_scale_um: float | None, log: _Log
) -> _Samples:
    table = read_table(path)

    def column(factors: Mapping[str, float]) -> FloatArray:
        names = [name for name in table.header if name in factors]
        if len(names) != 1:
            near = "".join(near_hint(name, table.header) for name in factors if not names)
            raise StimulusError(
                f"the columns are {','.join(table.header)[:80]}, expected one "
                f"{' or '.join(factors)}{near.partition('?')[0] + '?' if near else ''}"
            )
        numbers: FloatArray = table.numbers(names[0], factor=factors[names[0]])
        return numbers

    times_ms, depth_um = column(_TIME_COLUMNS), column(_DEPTH_COLUMNS)
    table.check_columns((*_TIME_COLUMNS, *_DEPTH_COLUMNS), COLUMNS[2:], log)
    with np.errstate(over="ignore"):  # of 1e308
        table.refuse(np.diff(times_ms, prepend=-np.inf) <= 0, lambda row: "time does not rise")
    aside = COLUMNS[2] in table.header
    return times_ms, depth_um, table.numbers(COLUMNS[2]) if aside else None


def _npy(
    path: Path, content: bytes, dt_ms: float | None, full_scale_um: float | None, log: _Log
) -> _Samples:
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
        raise StimulusError(
            "an NPY holds no time step: name it, more than 0, by --dt-ms of simulate, build-deck "
            "or stimuli (dt_ms=)"
        )
    _check_samples(depth_um.size)
    with np.errstate(over="ignore", invalid="ignore"):  # of 1e308, and of 16 bytes
        times_ms = np.arange(depth_um.size, dtype=np.float64) * dt_ms
        return times_ms, depth_um.astype(np.float64), None


def _wav(
    path: Path, content: bytes, dt_ms: float | None, full_scale_um: float | None, log: _Log
) -> _Samples:
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
        problem = f"{len(rest)} bytes behind the end that its header states: damaged?"
        warnings.warn(f"{path}: {problem}", FembridgeWarning, stacklevel=4)
    stated = _SCALE.search(content)
    scale_um = full_scale_um
    if stated and not scale_um:
        with suppress(ValueError):
            scale_um = parse_number(stated[1].decode("latin-1"))
    if scale_um is None or not 0 < scale_um < np.inf:
        raise StimulusError(
            "a WAV that does not say how many um its full scale is: --full-scale-um of simulate, "
            "build-deck or stimuli (full_scale_um=), more than 0"
        )
    samples, peak = (samples.astype(np.float64), samples.dtype)
    if peak.kind == "u":  # 8 bits
        samples -= 128.0
    peaks = {"u1": 127.0, "i2": float(PCM16_PEAK), "i4": 2.0**31 - 1}
    with np.errstate(over="ignore"):  # refused as not finite
        samples *= scale_um / peaks.get(f"{peak.kind}{peak.itemsize}", 1.0)
    times_ms: FloatArray = np.arange(samples.size) * (1000.0 / rate_hz)
    return times_ms, samples, None


def _check_chunks(content: bytes) -> int:
    """The end of a WAV as its header states it, which its chunks must fill.

    Raises
    ------
    ValueError
        It is cut, or its sizes are damaged.
    """
    if content[:4] != b"RIFF" or content[8:12] != b"WAVE":
        raise ValueError("cut, or no RIFF")
    end = 8 + int(struct.unpack("<I", content[4:8])[0])
    if end > len(content):
        raise ValueError(f"cut: {len(content)} bytes, its header says {end}")
    at, names = 12, []
    while at < end:
        name, size = content[at : at + 4], content[at + 4 : min(at + 8, end)]
        stop = at + 8 + int.from_bytes(size, "little")
        if len(size) < 4 or not name.isascii() or not name.decode().isprintable() or stop > end:
            raise ValueError(f"cut, or damaged in the chunk at byte {at}")
        names.append(name)
        at = stop + stop % 2
    for name in (b"fmt ", b"data"):
        if names.count(name) != 1:
            raise ValueError(f"{names.count(name)} chunks {name.decode()!r}, expected one")
    return end


def _check_samples(count: int) -> None:
    check_memory(count * _BYTES_PER_SAMPLE, f"a waveform of {count} samples", StimulusError)


def _short(error: Exception) -> str:
    """What another library says, in a line."""
    return " ".join(str(error).split())[:120] or type(error).__name__


def _marc_table(
    path: Path, content: bytes, dt_ms: float | None, full_scale_um: float | None, log: _Log
) -> _Samples:
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
        return time_s / S_PER_MS, depth_mm / MM_PER_UM, None


_READERS: dict[str, Callable[[Path, bytes, float | None, float | None, _Log], _Samples]] = {
    ".csv": _csv,
    ".wav": _wav,
    ".npy": _npy,
    ".dat": _marc_table,
}


def _every_half_ms(
    times_ms: FloatArray, samples_um: FloatArray, path: Path, log: _Log
) -> FloatArray:
    """Samples ``(T, column)`` at `times_ms` as they are every 0.5 ms, or by PCHIP."""
    with np.errstate(over="ignore", invalid="ignore"):  # of 1e308
        step_ms, odd = mean_step(times_ms)
    if odd is None and abs(step_ms / DT_MS - 1.0) * times_ms.size <= _LATE_SAMPLES:
        return samples_um
    resampled: FloatArray = resample(times_ms, samples_um, DT_MS)[1]
    how = f"one every {step_ms:g} ms" if odd is None else "uneven times"
    log(f"{times_ms.size} samples, {how}, resampled to {len(resampled)}, one every {DT_MS:g} ms")
    doubt = None
    if odd is not None:
        doubt = doubt_of_gaps(times_ms)
    elif step_ms < DT_MS:
        doubt = doubt_of_step(samples_um[:, 0], step_ms, DT_MS)
    elif step_ms > _LONG_STEP_MS and times_ms.size > _FEW_CORNERS:
        doubt = f"{times_ms.size} samples, one every {step_ms:g} ms: in which unit is the time?"
    if doubt:
        warnings.warn(f"{path}: {doubt}", FembridgeWarning, stacklevel=4)
    return resampled
