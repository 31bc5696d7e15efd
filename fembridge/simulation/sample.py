"""Sample inputs and results that travel with the package: a first try needs no solver and no data.

The results of CalculiX (``frd``) are a recorded run: finger ``quick``, the first 100 ms of
``sine_50_250`` at a pre-indentation of 75 um, solved by CalculiX 2.20. The other samples are
computed when they are written.
"""

import tarfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fembridge.errors import UsageError
from fembridge.host.store import filling, near_hint, write_text

RUN = Path(__file__).with_name("sample_run.tar.xz")
FOLDER = "sample"


@dataclass(frozen=True, slots=True)
class Sample:
    """A sample: what it is, its main file, the command that reads it, and what writes it.

    In `commands`, ``{file}`` is the path of the main file, ``{folder}`` its folder.
    """

    contents: str
    file: str
    commands: tuple[str, ...]
    write: Callable[[Path], None]


def sample(name: str = "frd", folder: str | Path = FOLDER) -> Path:
    """Write a sample into `folder`; the path of its main file.

    Parameters
    ----------
    name
        ``frd`` (run folder with results of CalculiX), ``deck`` (a finger model as a CalculiX
        deck), ``pressure`` (a robot's pressure signal), ``press`` (a robot's
        sensors under a known press), ``waveform`` (depth of a probe over
        time), ``rates`` (firing rates of 37 sinusoids, by TouchSim) or ``touches`` (a study of
        twelve touches). Default: ``frd``.
    folder
        Folder of the files, which is made. Default: ``sample``.

    Raises
    ------
    UsageError
        There is no sample `name`.
    OutputError
        `folder` cannot be made or written.

    Examples
    --------
    >>> import fembridge as fb
    >>> traces = fb.read(fb.sample("frd"))
    >>> len(traces)
    3
    """
    if name not in SAMPLES:
        expected = f"one of {', '.join(SAMPLES)}"
        problem = f"is {name!r}, expected {expected}{near_hint(name, SAMPLES)}"
        raise UsageError(problem, argument="name", found=name, expected=expected)
    chosen = SAMPLES[name]
    with filling(Path(folder), last=chosen.file) as draft:
        chosen.write(draft)
    return Path(folder) / chosen.file


def _write_run(folder: Path) -> None:
    # File by file: `extractall` warns without a filter, which Python 3.11.2 does not have yet.
    with tarfile.open(RUN) as archive:
        for member in archive:
            content = archive.extractfile(member)
            assert content is not None
            (folder / member.name).write_bytes(content.read())


def _write_deck(folder: Path) -> None:
    """The deck of the recorded run alone, as a user's own."""
    with tarfile.open(RUN) as archive:
        deck = archive.extractfile("job.inp")
        assert deck is not None
        write_text(folder / "finger.inp", deck.read().decode("utf-8"))


def _write_pressure(folder: Path) -> None:
    """A press of 20 kPa in 100 ms, held for 400 ms, with a vibration of 2 kPa at 100 Hz."""
    time_s = np.arange(0, 0.6, 0.0005)
    held_kpa = 20 * np.interp(time_s, [0, 0.1, 0.5, 0.6], [0, 1, 1, 0])
    vibration_kpa = 2 * np.sin(2 * np.pi * 100 * time_s) * ((time_s > 0.2) & (time_s < 0.4))
    rows = zip(time_s.tolist(), (held_kpa + vibration_kpa).tolist(), strict=True)
    lines = [f"{time:.4f},{pressure:.5f}" for time, pressure in rows]
    write_text(folder / "pressure.csv", "\n".join(["time_s,pressure_kpa", *lines, ""]))


def _write_press(folder: Path) -> None:
    """A press of 0.05 N on the left of two sensors in volts, and a grasp with a slip at 60 Hz."""
    time_s = np.arange(0, 1, 0.0005)
    volts = 0.4 + 0.8 * np.interp(time_s, [0.2, 0.4, 0.6, 0.8], [0, 1, 1, 0])
    lines = [f"{time:.4f},{value:.4f},0.3800" for time, value in zip(time_s, volts, strict=True)]
    write_text(folder / "press.csv", "\n".join(["t,left,right", *lines, ""]))
    grasp = np.interp(time_s, [0.1, 0.15, 0.7, 0.75], [0, 0.6, 0.6, 0])
    grasp += 0.05 * np.sin(2 * np.pi * 60 * time_s) * ((time_s > 0.3) & (time_s < 0.5))
    rows = zip(time_s.tolist(), (0.4 + grasp).tolist(), (0.38 + 0.7 * grasp).tolist(), strict=True)
    lines = [f"{time:.4f},{left:.4f},{right:.4f}" for time, left, right in rows]
    write_text(folder / "robot.csv", "\n".join(["t,left,right", *lines, ""]))


def _write_waveform(folder: Path) -> None:
    """Two taps of 200 um, smooth, 50 ms each."""
    time_ms = np.arange(0, 200.5, 0.5)
    inside = (time_ms % 100) < 50
    depth_um = np.where(inside, 100 * (1 - np.cos(2 * np.pi * (time_ms % 100) / 50)), 0.0)
    rows = zip(time_ms.tolist(), depth_um.tolist(), strict=True)
    lines = [f"{time:g},{depth:.4f}" for time, depth in rows]
    write_text(folder / "taps.csv", "\n".join(["time_ms,displacement_um", *lines, ""]))


def _write_rates(folder: Path) -> None:
    """TouchSim's stored rates of the sinusoids: observed rates with nothing to be licensed."""
    from fembridge.evidence import touchsim_rates

    rates = [rate for rate in touchsim_rates() if rate.stimulus.startswith("sine_")]
    lines = [f"{rate.stimulus},{rate.afferent},{rate.rate_ips:g}" for rate in rates]
    write_text(folder / "rates.csv", "\n".join(["stimulus,afferent,rate_ips", *lines, ""]))


_TOUCHES = """\
name = "letters"

[touches]                       # settings of every touch
population = "grid:step_mm=2"
press_um = 250
ramp_ms = 20
hold_ms = 100

[touches.product]               # every combination: 3 letters, 4 positions
shape = ["braille:text=a", "braille:text=b", "braille:text=c"]
x_mm = [-1, -0.5, 0.5, 1]
"""


def _write_touches(folder: Path) -> None:
    write_text(folder / "touches.toml", _TOUCHES)


SAMPLES: Mapping[str, Sample] = {
    "frd": Sample(
        "run folder of CalculiX with deck and results: a sinusoid of 50 Hz on a finger",
        "job.frd",
        ("fembridge ingest {file} -o traces.csv", "fembridge encode traces.csv"),
        _write_run,
    ),
    "deck": Sample(
        "a finger model as a deck of CalculiX, to be read as your own",
        "finger.inp",
        ("fembridge check {file}",),
        _write_deck,
    ),
    "pressure": Sample(
        "signal of a robot's pressure sensor at 2 kHz: a press and a vibration",
        "pressure.csv",
        ("fembridge encode {file}",),
        _write_pressure,
    ),
    "press": Sample(
        "two sensors of a gripper in volts: a press of 0.05 N on one, and a grasp (robot.csv)",
        "press.csv",
        (
            "fembridge calibrate {file} --force-n 0.05",
            "fembridge encode {folder}/robot.csv --calibration calibration.toml",
        ),
        _write_press,
    ),
    "waveform": Sample(
        "depth of a probe over time: two taps",
        "taps.csv",
        ("fembridge simulate --waveform {file}",),
        _write_waveform,
    ),
    "rates": Sample(
        "rates of SA, RA and PC for 37 sinusoids, by TouchSim, to be fitted",
        "rates.csv",
        ("fembridge fit --observed {file} --afferent SA --evaluations 400",),
        _write_rates,
    ),
    "touches": Sample(
        "study of twelve touches: three Braille letters at four positions",
        "touches.toml",
        ("fembridge sweep {file}",),
        _write_touches,
    ),
}
"""Each sample by its name."""
