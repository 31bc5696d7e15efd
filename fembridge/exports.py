"""A stimulus as a file: for a solver, a shaker, a sound card or another program.

``csv``         ``time_ms,displacement_um``, a row a sample, shortest exact decimals
``npy``         displacement alone, ``(T,)`` float64 in um, one sample every `dt_ms`
``wav``         16-bit mono; a file without units, so the scale is printed on the side
``marc-table``  a ``table`` of a Marc deck: time in s, displacement in mm

Displacement is positive into the skin and holds the whole depth in all four.
"""

import wave
from collections.abc import Callable
from pathlib import Path

import numpy as np

from fembridge.run_folder import COLUMNS
from fembridge.stimulus import Stimulus
from fembridge.store import replacing, write_text

MM_PER_UM = 1.0e-3
S_PER_MS = 1.0e-3
PCM16_PEAK = 32767


def write_stimulus(stimulus: Stimulus, path: Path, format_name: str) -> float | None:
    """Write `stimulus` to `path`, whole or not at all, in one of `FORMATS`.

    Returns
    -------
    float or None
        Of a WAV the displacement in um that 32767 is.
    """
    _, write = FORMATS[format_name]
    return write(stimulus, path)


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


def write_wav(stimulus: Stimulus, path: Path) -> float:
    """Write 16-bit mono PCM; the displacement in um that 32767 is."""
    full_scale_um = float(np.abs(stimulus.displacement_um).max()) or 1.0  # flat
    pcm = np.rint(stimulus.displacement_um / full_scale_um * PCM16_PEAK)
    with replacing(path) as draft, wave.open(str(draft), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(round(1000.0 / stimulus.dt_ms))
        file.writeframes(pcm.astype("<i2").tobytes())
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


FORMATS: dict[str, tuple[str, Callable[[Stimulus, Path], float | None]]] = {
    "csv": (".csv", write_csv),
    "wav": (".wav", write_wav),
    "npy": (".npy", write_npy),
    "marc-table": (".marc.dat", write_marc_table),
}
"""Suffix and writer of each format."""
