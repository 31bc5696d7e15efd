"""The waveform in an own deck: the data lines of the amplitude that moves the probe."""

from decks.inp.lines import fixed, pair_lines
from decks.motion import Motion
from decks.own_model.inp_drive import Drive
from decks.own_model.inp_edits import Edit, in_place_of

# As our own decks have them: times to 0.1 us, depths to a picometre where that is
# exact, and in the shortest exact text where it is not.
_TIME_DIGITS = 7
_VALUE_DIGITS = 9
_AXES = " xyz"


def waveform_edits(drive: Drive, motion: Motion, length_mm: float) -> tuple[list[Edit], list[str]]:
    """Put `motion` into the amplitude; also remarks on what was done.

    An amplitude that counts total time begins where the step does, and holds 0
    before.
    """
    curve = drive.amplitude
    rows = curve.rows()
    lines = list(pair_lines(_pairs(drive, motion, length_mm)))
    edits = in_place_of(curve.text, curve.card, rows, lines)
    return edits, _remarks(drive, motion, length_mm, len(rows))


def _pairs(drive: Drive, motion: Motion, length_mm: float) -> list[tuple[str, str]]:
    scale = length_mm * drive.factor
    values = (motion.depth_mm / scale + 0.0).tolist()
    start_s = (drive.start_s or 0.0) if drive.total_time else 0.0
    times_s = (motion.time_s + start_s).tolist()
    if start_s > 0:
        times_s, values = [0.0, *times_s], [0.0, *values]
    return [
        (fixed(time_s, _TIME_DIGITS), fixed(value, _VALUE_DIGITS))
        for time_s, value in zip(times_s, values, strict=True)
    ]


def _remarks(drive: Drive, motion: Motion, length_mm: float, rows: int) -> list[str]:
    curve, first = drive.amplitude, drive.push[0]
    name = curve.word("NAME")
    clock = "total time" if drive.total_time else "step time"
    remarks = [
        f"{curve.where}: amplitude {name} ({clock}) holds the waveform, "
        f"{len(motion.time_s)} samples in place of {rows} data lines"
    ]
    signs = {push.magnitude > 0 for push in drive.push}
    for push in drive.push if len(signs) > 1 else (first,):
        sign = "+" if push.magnitude > 0 else "-"
        remarks.append(f"{push.where}: depth moves {push.what} along {sign}{_AXES[push.axis]}")
    if drive.factor != 1:
        remarks.append(
            f"{first.where}: magnitude {first.magnitude:g}: the waveform is divided by "
            f"{drive.factor:g}"
        )
    if length_mm != 1:
        remarks.append(f"one length unit of the deck is {length_mm:g} mm")
    if drive.start_s is None:
        remarks.append(f"{drive.step.head.where}: at what total time the step begins is not known")
    elif drive.start_s > 0:
        before = "; the amplitude is 0 before" if drive.total_time else ""
        remarks.append(
            f"{drive.step.head.where}: the step begins at {drive.start_s:g} s of total "
            f"time, and the waveform with it{before}"
        )
    later = [step for step in drive.steps if step.number > drive.step.number]
    if later:
        remarks.append(
            f"{later[0].head.where}: the steps after the waveform's hold its last "
            "depth unless they say otherwise, and end the run later than it ends"
        )
    return remarks
