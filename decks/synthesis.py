"""Samples of a stimulus: the depth of the probe every 0.5 ms.

Stimuli of the paper last 250 ms; the id of a ramp contains its duration. Sinusoids start at
phase 0. Noise is Gaussian, filtered without delay, and rises from zero during the first 5 ms,
which no window includes. Samples are rounded to 1e-6 um: far below the resolution of a solver
and far above rounding differences between machines, so that all machines write the same bytes.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from decks.stimuli import (
    DECIMALS,
    DT_MS,
    DURATION_MS,
    LONG_WINDOW_MS,
    MAX_AMPLITUDE_UM,
    Entry,
    Noise,
    Ramp,
    resolve,
)
from fembridge.errors import StimulusError
from fembridge.stimulus import Stimulus
from fembridge.trace import resample
from fembridge.typing import FloatArray

SAMPLES = round(DURATION_MS / DT_MS) + 1
"""Samples of a stimulus of the paper, every 0.5 ms."""
SAMPLING_HZ = 1000.0 / DT_MS

BUTTERWORTH_ORDER = 4
TAPER_MS = LONG_WINDOW_MS[0]
"""Length of the raised cosine at the start of noise: the part before the window."""

MARGIN_SAMPLES = 4000
"""Noise samples drawn and discarded on each side, 2 s: the filter is circular, and after
2 s the effect of the seam has decayed to 1e-7 in the slowest band of the catalogue."""


def make_stimulus(
    entry: Entry | str,
    preindent_um: float = 0.0,
    seed: int | None = None,
    dt_ms: float = DT_MS,
) -> Stimulus:
    """Displacement of the probe for `entry`.

    Parameters
    ----------
    entry
        A stimulus of the catalogue, as `resolve` gives it, or its id.
    preindent_um
        Pre-indentation: depth of the probe before time 0 in um, >= 0 (default 0). It is
        added to every sample; the first sample equals `preindent_um`.
    seed
        Seed of noise, >= 0; by default the seed of the entry (CRC-32 of its id), so
        that the id determines the samples. Ignored by other families.
    dt_ms
        Time between two samples in ms: 0.5 (default) or a whole part of it. The samples every
        0.5 ms are the same for every step.

    Returns
    -------
    Stimulus
        Samples in um, positive into the skin, the first at time 0; 501 of them every 0.5 ms
        except for a ramp. `origin` has the family, the numbers and, for noise, the seed.

    Raises
    ------
    StimulusError
        An id of no or several stimuli, a negative `preindent_um` or `seed`, or samples that all
        round to zero.

    Examples
    --------
    >>> import fembridge as fb
    >>> stimulus = fb.make_stimulus("sine_20_250", preindent_um=75)
    >>> stimulus.displacement_um.size, float(stimulus.displacement_um.max())
    (501, 325.0)
    """
    finer = round(DT_MS / dt_ms) if 0 < dt_ms <= DT_MS else 0
    if not finer or abs(finer * dt_ms - DT_MS) > 1e-9:
        expected = f"{DT_MS:g} or a whole part of it"
        raise StimulusError(argument="dt_ms", found=dt_ms, expected=expected)
    if isinstance(entry, str):
        entries = resolve(entry)
        if len(entries) > 1:
            expected = "the id of one stimulus"
            raise StimulusError(argument="entry", found=entry, expected=expected)
        [entry] = entries
    if not 0 <= preindent_um <= MAX_AMPLITUDE_UM:
        raise StimulusError(
            argument="preindent_um", found=preindent_um, expected=f"0 to {MAX_AMPLITUDE_UM:g}"
        )
    preindent_um = round(preindent_um, DECIMALS)
    origin: dict[str, object] = {"family": entry.family, **entry.numbers()}
    if isinstance(entry, Noise):
        noise_seed = entry.seed if seed is None else seed
        if noise_seed < 0:
            raise StimulusError(argument="seed", found=noise_seed, expected="0 or more")
        origin["seed"] = noise_seed
        wave_um = band_noise(entry, np.random.default_rng(noise_seed), finer)
    else:
        times_ms = np.arange(round(_duration_ms(entry) / DT_MS) * finer + 1) * (DT_MS / finer)
        wave_um = WAVES[entry.family](entry, times_ms.astype(np.float64))
    wave_um = np.round(wave_um, DECIMALS)
    if not wave_um.any():
        raise StimulusError(
            f"{entry.id}: all samples at {DT_MS:g} ms round to 0 at 1e-{DECIMALS} um"
        )
    return Stimulus(
        id=entry.id,
        displacement_um=np.round(preindent_um + wave_um, DECIMALS),
        dt_ms=DT_MS / finer,
        window_ms=entry.window_ms,
        preindent_um=preindent_um,
        origin=origin,
    )


def band_noise(entry: Noise, rng: np.random.Generator, finer: int = 1) -> FloatArray:
    """Gaussian noise in the band of `entry`, ``(500 finer + 1,)`` in um, before rounding.

    With `finer` above 1 there are that many samples per 0.5 ms, by zero padding of the spectrum.

    Notes
    -----
    The paper filters Gaussian noise "using Python" and scales it to the RMS; it does not
    specify the filter. We use a 4th-order Butterworth band-pass, forward and backward, as in
    SciPy's ``sosfiltfilt(butter(4, (low, high), "bandpass"))``: no delay, and an amplitude
    gain of ``|H|^2``, one half at both cutoffs. Applied as a gain to the spectrum, it needs
    no SciPy and has no onset.

    The RMS is taken over all 501 samples, after the taper. Their mean is not removed: the
    gain at 0 Hz is zero, but the mean of a slow wave over 250 ms need not be.
    """
    white_noise = rng.standard_normal(SAMPLES + 2 * MARGIN_SAMPLES)
    spectrum = np.fft.rfft(white_noise)
    frequency_hz = np.fft.rfftfreq(white_noise.size, DT_MS / 1000.0).astype(np.float64)
    spectrum *= _butterworth_power(frequency_hz, entry.low_hz, entry.high_hz)
    filtered = np.fft.irfft(spectrum, white_noise.size * finer) * finer
    first, samples = MARGIN_SAMPLES * finer, (SAMPLES - 1) * finer + 1
    phase = np.minimum(np.arange(samples) * (DT_MS / finer) / TAPER_MS, 1.0)
    taper = 0.5 * (1.0 - np.cos(np.pi * phase))
    wave: FloatArray = filtered[first : first + samples] * taper
    wave *= entry.rms_um / math.sqrt(np.mean(wave[::finer] ** 2))
    return wave


def _butterworth_power(frequency_hz: FloatArray, low_hz: float, high_hz: float) -> FloatArray:
    """Power gain ``|H|^2`` of the digital Butterworth band, same shape as input.

    The bilinear transform maps f to ``W = tan(pi f / fs)``; the prototype's
    ``|H|^2 = 1 / (1 + w^(2N))`` is taken at ``w = (W^2 - Wl Wh) / (W (Wh - Wl))``.
    Exactly 0 at 0 Hz.
    """
    low, high = np.tan(np.pi * np.array([low_hz, high_hz]) / SAMPLING_HZ)
    gain = np.zeros_like(frequency_hz)
    inside = (frequency_hz > 0) & (frequency_hz < SAMPLING_HZ / 2)
    warped = np.tan(np.pi * frequency_hz[inside] / SAMPLING_HZ)
    prototype = (warped**2 - low * high) / (warped * (high - low))
    gain[inside] = 1.0 / (1.0 + prototype ** (2 * BUTTERWORTH_ORDER))
    return gain


def _duration_ms(entry: Entry) -> float:
    return entry.window_ms[1] if isinstance(entry, Ramp) else DURATION_MS


def at_step(stimulus: Stimulus, dt_ms: float) -> Stimulus:
    """`stimulus` with a sample every `dt_ms`, or unchanged if its step is as fine.

    Stimuli of the catalogue are computed anew; other waveforms are interpolated by
    PCHIP, which stays between its samples: the probe goes no deeper.
    The step must be a whole part of that of `stimulus`, otherwise it stays unchanged.
    """
    finer = round(stimulus.dt_ms / dt_ms)
    if finer < 2 or abs(finer * dt_ms - stimulus.dt_ms) > 1e-9:
        return stimulus
    exact = _of_catalogue(stimulus, dt_ms) if stimulus.dt_ms == DT_MS else None
    if exact is not None and np.array_equal(
        exact.displacement_um[::finer], stimulus.displacement_um
    ):
        wave_um = exact.displacement_um
    else:
        wave_um = _interpolated(stimulus.displacement_um, finer)
    aside_um = None if stimulus.aside_um is None else _interpolated(stimulus.aside_um, finer)
    return replace(stimulus, displacement_um=wave_um, aside_um=aside_um, dt_ms=dt_ms)


def _of_catalogue(stimulus: Stimulus, dt_ms: float) -> Stimulus | None:
    """The stimulus of the catalogue with the id of `stimulus`, None if there is none."""
    if stimulus.origin.get("family") not in (*WAVES, Noise.family):
        return None
    try:
        entries = resolve(stimulus.id)
    except StimulusError:
        return None
    seed: Any = stimulus.origin.get("seed")
    return make_stimulus(entries[0], stimulus.preindent_um, seed, dt_ms)


def _interpolated(samples: FloatArray, finer: int) -> FloatArray:
    """`samples` with `finer` steps for each of theirs, never beyond them."""
    _, fine = resample(np.arange(float(len(samples))), samples, 1.0 / finer)
    fine[::finer] = samples
    return fine


def _sine(frequency_hz: float, times_ms: FloatArray) -> FloatArray:
    wave: FloatArray = np.sin(2.0 * np.pi * (frequency_hz * times_ms / 1000.0))
    return wave


WAVES: dict[str, Callable[[Any, FloatArray], FloatArray]] = {
    "sine": lambda sine, times_ms: sine.amplitude_um * _sine(sine.frequency_hz, times_ms),
    "diharm": lambda pair, times_ms: (
        pair.amplitude1_um * _sine(pair.frequency1_hz, times_ms)
        + pair.amplitude2_um * _sine(pair.frequency2_hz, times_ms)
    ),
    "ramp": lambda ramp, times_ms: np.interp(
        times_ms, ramp.corners_ms, (0.0, ramp.depth_um, ramp.depth_um, 0.0)
    ),
}
"""Samples in um of the deterministic families at times in ms, ``(T,)``."""
