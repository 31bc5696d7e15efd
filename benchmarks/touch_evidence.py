"""What is known of real afferents beside what the fingertip does: fields, distance, edges.

``python -m benchmarks.touch_evidence textures RATES.csv [RIDGES ...]``: rates and swings of stress
under scanned gratings and dots, beside recorded rates (columns ``shape,afferent,rate_ips``).
Without arguments: receptive-field areas at 4.5 times threshold
(Vallbo & Johansson 1980), amplitude for one impulse a cycle against distance (Johnson
1974, Fig. 7), bars and gaps pressed by 1 mm, and dots scanned at 40 mm/s.
"""

import sys
from dataclasses import replace

import numpy as np
import pandas
from scipy.stats import norm

import fembridge as fb
from decks.stimuli import DT_MS
from fembridge.touching.contact import press_to
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.population import ENDINGS_MM, Population
from fembridge.touching.ridged_pad import with_ridges
from fembridge.touching.shape import Shape
from fembridge.touching.stress import von_mises_pa
from fembridge.touching.touch import touch_skin
from fembridge.touching.trajectory import Trajectory
from neural import parameter_set

PAD = resolve_pad("reference")
PARAMETERS = parameter_set("fitted_pad")
# mm and um, read from the figure: RA at 40 Hz, probe radius 1 mm, pre-indented by 0.55 mm.
JOHNSON = (
    (0.25, 44), (0.75, 52), (1.27, 35), (1.78, 36), (2.30, 55), (2.82, 79), (3.34, 134),
    (3.90, 160), (4.39, 191), (4.96, 273), (5.46, 242), (6.06, 326), (6.89, 409), (7.18, 352),
    (7.78, 541),
)  # fmt: skip
# Fibres whose median or mean is printed: they differ in their endings.
UNITS = 12
# Of the ten cells of a class the most sensitive.
KEENEST = float(norm.ppf(0.05))
HUMAN_MM2 = {"SA": 11.0, "RA": 12.6, "PC": 101.3}


def fields():
    print("receptive fields at 4.5 times threshold")
    for name, human in HUMAN_MM2.items():
        for probe_mm, endings_mm, sa_von_mises in (
            (0.5, ENDINGS_MM, False), (1.0, ENDINGS_MM, False), (0.5, 0.0, False),
            (0.5, ENDINGS_MM, True), (0.5, 0.0, True),
        ):  # fmt: skip
            field = fb.receptive_field(
                name,
                depth_um=[],
                probe_diameter_mm=probe_mm,
                endings_mm=endings_mm,
                sa_von_mises=sa_von_mises,
                pad=PAD,
            )
            quartiles = field.summary.set_index("quantity").drop(columns="afferent")
            low, area, high = quartiles.loc["area_mm2 at 4.5 x threshold"]
            whole = field.areas["whole"].iloc[field.middle]
            print(
                f"  {name}, probe {probe_mm:g} mm, endings {endings_mm:g} mm around"
                f"{', von Mises' * sa_von_mises}: threshold "
                f"{quartiles.loc['threshold_um', 'median']:.0f} um, {'' if whole else 'over '}"
                f"{area:.1f} mm2 ({low:.1f} to {high:.1f}), in man {human}"
            )


def distance(probe_mm=2.0, preindent_um=550.0, endings_mm=ENDINGS_MM, deviate=0.0):
    print(
        f"RA of deviate {deviate:g}, 40 Hz, {probe_mm:g} mm, {preindent_um:g} um deep, endings "
        f"{endings_mm:g} mm around: um for an impulse a cycle by mm"
    )
    times_ms = np.arange(501) * DT_MS
    sine = np.sin(2 * np.pi * 40 * times_ms / 1000)
    line = Population.line(step_mm=0.25, half_length_mm=8.0, afferents=("RA",))
    count = UNITS if endings_mm else 1
    units = Population.at("RA", np.tile(line.x_mm, count), np.tile(line.z_mm, count))
    # Each fibre at all distances: its endings are drawn from one number.
    seeds = np.repeat(np.arange(count), len(line))
    units = replace(
        units, endings_mm=endings_mm, deviate=np.full(len(units), deviate), endings_seed=seeds
    )
    amplitudes = np.geomspace(15, 900, 40)
    counts = []
    for amplitude in amplitudes:
        trajectory = Trajectory(
            preindent_um + amplitude * sine, dt_ms=DT_MS, window_ms=(50.0, 250.0), name="sine"
        )
        touched = touch_skin(PAD, Shape.punch(probe_mm), trajectory, units, PARAMETERS)
        counts.append(touched.rate_ips / 40)
    reached = np.array(counts) >= 0.99
    needed = np.where(reached.any(axis=0), amplitudes[reached.argmax(axis=0)], np.inf)
    needed = np.median(needed.reshape(count, -1), axis=0)
    pairs = [f"{mm:.2f} {np.interp(mm, line.z_mm, needed):.0f} ({um})" for mm, um in JOHNSON]
    print("  mm, um, (observed):", ", ".join(pairs))


def decay():
    """Change of depth and of von Mises stress where RA sits, by a micrometre of a deep probe."""
    depth_um = np.array([510.0, 590.0])
    nodes, forces, _ = press_to(PAD, Shape.punch(2.0), depth_um)
    site = PAD.finger.afferents["RA"]
    z = np.array([0.0, 0.75, 1.25, 1.75, 2.25, 3.25, 5.0, 7.0])
    middle = PAD.x_mm.size // 2
    apart = np.abs(nodes.row[:, None] - np.round(z / PAD.spacing_mm).astype(int))
    down = 1000 * forces @ PAD.lattice_compliance[1][nodes.column[:, None], middle, apart]
    places = np.full(z.size, site.layer), 0 * z, z, np.full(z.size, site.depth_mm)
    stress = von_mises_pa(PAD.influence_pa(nodes, *places), forces)
    for name, values in (("depth (um)", down), ("stress at RA (Pa)", stress)):
        slopes = np.diff(values, axis=0)[0] / np.ptp(depth_um)
        print(
            f"  {name} by um:", ", ".join(f"{a:g} {b:.3g}" for a, b in zip(z, slopes, strict=True))
        )


def bars(sa_von_mises=False, endings_mm=ENDINGS_MM, pad=PAD):
    """Across the finger; on the plane pad along it."""
    plane = pad is not PAD
    count = UNITS if endings_mm else 1
    driven = ", von Mises stress" * sa_von_mises
    print(f"SA{driven}, endings {endings_mm:g} mm around, mean of {count}")
    print("bars, and gaps between ridges of 4 mm, pressed by 1 mm: impulses/s every 0.25 mm")
    step_mm, axis = (0.5, "x") if plane else (0.25, "z")
    line = Population.line(step_mm, 4.0, axis, ("SA",), finger=pad.finger)
    line = line[getattr(line, f"{axis}_mm") >= 0]
    classes = ["SA"] * count * len(line)
    units = Population.at(
        classes, np.tile(line.x_mm, count), np.tile(line.z_mm, count), finger=pad.finger
    )
    units = replace(units, sa_von_mises=sa_von_mises, endings_mm=endings_mm)
    parameters = parameter_set("fitted" if plane else "fitted_pad")
    for width in (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0):
        lines = []
        for shape in (Shape.bar(width, 14.0), Shape.grating(width, 4.0, relief_mm=2.0)):
            turned = shape.rotated(90.0 if plane else 0.0)
            held = touch_skin(pad, turned, Trajectory.press(press_um=1000), units, parameters)
            rates = held.rate_ips.reshape(count, -1).mean(axis=0)
            lines.append(" ".join(f"{rate:.0f}" for rate in rates[:17]))
        print(f"  {width:g} mm wide:", " | ".join(lines))


def dots(press_n=0.3):
    print(f"dots 0.5 mm wide, 40 mm/s, {press_n:g} N: impulses a dot, median unit and mean of ten")
    ten = norm.ppf((np.arange(10) + 0.5) / 10)
    deviate = np.tile(np.append(0.0, ten), 3)
    afferent = np.repeat(["SA", "RA", "PC"], 11).tolist()
    units = Population.at(afferent, np.zeros(33), np.zeros(33), deviate=deviate)
    for spacing in (1.0, 1.5, 2.0, 3.0, 4.0, 6.0):
        trajectory = Trajectory.slide(40.0, press_n=press_n, duration_ms=900)
        scanned = touch_skin(PAD, Shape.dots(spacing), trajectory, units, PARAMETERS)
        each = np.bincount(scanned.fired.unit, minlength=33).reshape(3, 11) * spacing / 36.0
        pairs = zip(("SA", "RA", "PC"), each[:, 0], each[:, 1:].mean(axis=1), strict=True)
        print(
            f"  {spacing:g} mm:", ", ".join(f"{n} {one:.1f} {all_:.1f}" for n, one, all_ in pairs)
        )


def textures(rates_csv, ridges, press_n=0.3, speed_mm_per_s=80.0, duration_ms=400.0):
    """Mean rates and median swings of stress of 15 units a class, after the first 100 ms."""
    recorded = pandas.read_csv(rates_csv).set_index(["shape", "afferent"])["rate_ips"]
    x, z = (grid.ravel() for grid in np.meshgrid(np.arange(-1, 1.1), np.arange(-1.5, 1.6, 0.75)))
    classes = ("SA", "RA", "PC")
    five = norm.ppf((np.arange(5) + 0.5) / 5)
    units = Population.at(
        np.repeat(classes, x.size).tolist(),
        np.tile(x, 3),
        np.tile(z, 3),
        deviate=np.tile(five[np.arange(x.size) % 5], 3),
    )
    slide = Trajectory.slide(
        speed_mm_per_s, press_n=press_n, direction_deg=90, duration_ms=duration_ms
    )
    first = round(100 / slide.dt_ms)
    skin = with_ridges(PAD, ridges)
    rates = {name: [] for name in classes}
    print(f"textures on {ridges}: model (recorded) impulses/s, swing in Pa at 15-50-150-400 Hz")
    shapes = list(dict.fromkeys(shape for shape, _ in recorded.index))
    for name in shapes:
        kind, period = name.split("_")
        half_mm = float(period) / 2
        grating = Shape.grating(half_mm, half_mm, 0.5)
        shape = grating if kind == "grating" else Shape.dots(float(period), 0.5, 0.4)
        touched = touch_skin(skin, shape, slide, units, PARAMETERS)
        late = touched.fired.unit[touched.fired.time_ms > 100]
        counts = np.bincount(late, minlength=len(units)).reshape(3, -1) * 1e3 / (duration_ms - 100)
        stress = touched.stress_pa[first:]
        window = np.hanning(len(stress))
        power = np.abs(np.fft.rfft((stress - stress.mean(axis=0)) * window[:, None], axis=0)) ** 2
        hz = np.fft.rfftfreq(len(stress), slide.dt_ms / 1e3)
        texts = []
        for afferent, count, of_class in zip(classes, counts, np.split(power, 3, 1), strict=True):
            rates[afferent].append((count.mean(), recorded[name, afferent]))
            bands = [
                np.sqrt(2 * of_class[(hz >= low) & (hz < high)].sum(axis=0) / len(stress))
                / np.sqrt(np.square(window).sum())
                for low, high in ((15, 50), (50, 150), (150, 400))
            ]
            swings = " ".join(f"{np.median(band):.0f}" for band in bands)
            texts.append(f"{afferent} {count.mean():.0f} ({recorded[name, afferent]:.0f}) {swings}")
        print(f"  {name}: {', '.join(texts)}")
    for afferent, pairs in rates.items():
        model, observed = np.array(pairs).T
        missed = np.square(model - observed).sum() / np.square(observed - observed.mean()).sum()
        print(
            f"  {afferent}: {model.sum() / observed.sum():.2f} of the recorded rates, R2 "
            f"{1 - missed:.2f}, correlation {np.corrcoef(model, observed)[0, 1]:.2f}"
        )


if __name__ == "__main__":
    if sys.argv[1:2] == ["textures"]:
        for ridges in sys.argv[3:] or ["none", "loop"]:
            textures(sys.argv[2], ridges)
        sys.exit()
    fields()
    decay()
    for deviate in (0.0, KEENEST):
        for endings_mm in (ENDINGS_MM, 0.0):
            distance(endings_mm=endings_mm, deviate=deviate)
    distance(probe_mm=1.0, preindent_um=75.0)
    bars()
    bars(endings_mm=0.0)
    bars(sa_von_mises=True)
    bars(pad=resolve_pad("plane"))
    dots()
    dots(press_n=0.6)
