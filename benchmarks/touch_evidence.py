"""What is known of real afferents beside what the fingertip does: fields, distance, edges.

``python -m benchmarks.touch_evidence``: receptive-field areas at 4.5 times threshold
(Vallbo & Johansson 1980), amplitude for one impulse a cycle against distance (Johnson
1974, Fig. 7), bars and gaps pressed by 1 mm, and dots scanned at 40 mm/s.
"""

from dataclasses import replace

import numpy as np

import fembridge as fb
from decks.stimuli import DT_MS
from fembridge.touching.pad import pad_named
from fembridge.touching.population import Population
from fembridge.touching.shape import Shape
from fembridge.touching.touch import touch_skin
from fembridge.touching.way import Way
from neural import parameter_set

PAD = pad_named("reference")
PARAMETERS = parameter_set("fitted_pad").parameters
# mm and um, read from the figure: RA at 40 Hz, probe radius 1 mm, pre-indented by 0.55 mm.
JOHNSON = (
    (0.25, 44), (0.75, 52), (1.27, 35), (1.78, 36), (2.30, 55), (2.82, 79), (3.34, 134),
    (3.90, 160), (4.39, 191), (4.96, 273), (5.46, 242), (6.06, 326), (6.89, 409), (7.18, 352),
    (7.78, 541),
)  # fmt: skip
HUMAN_MM2 = {"SA": 11.0, "RA": 12.6, "PC": 101.3}


def fields():
    print("receptive fields at 4.5 times threshold")
    for name, human in HUMAN_MM2.items():
        for probe_mm, criterion, endings_mm in (
            (0.5, 0.1, 0.0), (0.5, 1e-6, 0.0), (1.0, 0.1, 0.0), (1.0, 1e-6, 0.0), (0.5, 0.1, 0.5)
        ):  # fmt: skip
            field = fb.receptive_field(
                name,
                depth_um=[],
                times_threshold=[4.5],
                probe_diameter_mm=probe_mm,
                criterion=criterion,
                endings_mm=endings_mm,
            )
            area, whole = field.areas[["area_mm2", "whole"]].iloc[0]
            print(
                f"  {name}, probe {probe_mm:g} mm, {'a tenth' if criterion == 0.1 else 'any'}, "
                f"endings within {endings_mm:g} mm: "
                f"threshold {field.threshold_um:.0f} um, {'' if whole else 'over '}"
                f"{area:.1f} mm2, in man {human}"
            )


def distance(probe_mm=2.0, preindent_um=550.0, endings_mm=0.0):
    print(
        f"RA, 40 Hz, {probe_mm:g} mm, {preindent_um:g} um deep, endings within {endings_mm:g} mm: "
        "um for an impulse a cycle by mm"
    )
    times_ms = np.arange(501) * DT_MS
    sine = np.sin(2 * np.pi * 40 * times_ms / 1000)
    units = Population.line(step_mm=0.25, half_length_mm=8.0, afferents=("RA",))
    branched = replace(units, endings_mm=endings_mm)
    amplitudes = np.geomspace(15, 900, 28)
    counts = []
    for amplitude in amplitudes:
        way = Way("sine", DT_MS, (50.0, 250.0), preindent_um + amplitude * sine)
        touched = touch_skin(PAD, Shape.punch(probe_mm), way, branched, PARAMETERS)
        counts.append(touched.rate_ips / 40)
    reached = np.array(counts) >= 0.99
    needed = np.where(reached.any(axis=0), amplitudes[reached.argmax(axis=0)], np.inf)
    for mm, um in JOHNSON:
        ours = np.interp(mm, units.z_mm, needed)
        print(f"  {mm:.2f} mm: {ours:.0f} um, observed {um}")


def bars(sa_compression=False):
    print(f"SA, {'compression' if sa_compression else 'von Mises stress'}")
    print("bars pressed by 1 mm, impulses/s every 0.5 mm from the middle of the bar")
    units = Population.line(step_mm=0.5, half_length_mm=5.0, afferents=("SA",))
    units = replace(units, sa_compression=sa_compression)
    for width in (0.5, 1.0, 2.0, 3.0, 5.0):
        held = touch_skin(PAD, Shape.bar(width, 14.0), Way.hold(press_um=1000), units, PARAMETERS)
        rates = held.rate_ips[units.z_mm >= 0]
        print(f"  {width:g} mm wide:", " ".join(f"{rate:.0f}" for rate in rates))
    print("ridges of 4 mm with gaps between, every 0.5 mm from the middle of a gap")
    for gap in (0.5, 1.0, 2.0, 3.0, 5.0):
        shape = Shape.grating(gap, 4.0, relief_mm=2.0)
        held = touch_skin(PAD, shape, Way.hold(press_um=1000), units, PARAMETERS)
        rates = held.rate_ips[units.z_mm >= 0]
        print(f"  {gap:g} mm wide:", " ".join(f"{rate:.0f}" for rate in rates))


def dots():
    print("dots 0.5 mm wide, 40 mm/s, 0.3 N: impulses a dot of the median unit in the middle")
    units = Population.one_each()
    for spacing in (1.0, 1.5, 2.0, 3.0, 4.0, 6.0):
        way = Way.slide(40.0, press_n=0.3, duration_ms=900)
        shape = Shape.dots(spacing)
        scanned = touch_skin(PAD, shape, way, units, PARAMETERS)
        passed = 36.0 / spacing
        spikes = np.bincount(scanned.fired.unit, minlength=3) / passed
        named = zip(units.afferent, spikes, strict=True)
        print(f"  {spacing:g} mm apart:", ", ".join(f"{name} {each:.1f}" for name, each in named))


if __name__ == "__main__":
    fields()
    distance()
    distance(endings_mm=0.5)
    distance(endings_mm=1.0)
    distance(probe_mm=1.0, preindent_um=75.0)
    bars()
    bars(sa_compression=True)
    dots()
