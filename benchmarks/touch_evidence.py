"""The tables of ``docs/science/touch_evidence.md``: the fingertip beside recordings and TouchSim.

``python -m benchmarks.touch_evidence --observed RATES.csv --recorded FOLDER`` prints every table in
Markdown; a quarter of an hour on one core. ``--only NAME ...`` selects tables, ``--write
docs/science/touch_evidence.md`` replaces them in the page, between ``<!-- NAME -->`` and
``<!-- end -->``.
The observed and recorded tables (`docs/science/validation.md`) may not be distributed; the page has
only agreement with them. Without them the tables ``rows`` and ``texture_agreement`` are left out.
"""

import argparse
import math
import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas
from scipy.stats import norm

import fembridge as fb
from decks.stimuli import DT_MS
from fembridge.errors import FembridgeWarning
from fembridge.evidence import DISTANCE, published, touchsim_table
from fembridge.io.formatting import markdown
from fembridge.reporting.fingertip_responses import Fingertip
from fembridge.reporting.rate_tables import FINGERTIP, TOUCHSIM
from fembridge.reporting.recorded_sets import (
    HUMAN_FIELDS_MM2,
    OUYANG_SOURCE,
    RECORDED_SETS,
    _texture_points,
    recorded_rows,
)
from fembridge.touching.contact import press_to
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.population import ENDINGS_MM, Population
from fembridge.touching.ridged_pad import with_ridges
from fembridge.touching.shape import Shape
from fembridge.touching.stress import von_mises_pa
from fembridge.touching.touch import touch_skin
from fembridge.touching.trajectory import Trajectory
from fembridge.trace import AFFERENTS
from neural import parameter_set

PAD = resolve_pad("reference")
PARAMETERS = parameter_set("fitted_pad")
# Fibres whose median or mean is taken at each place: they differ in their endings.
FIBRES = 12
# Of the ten cells of a class the most sensitive.
MOST_SENSITIVE = float(norm.ppf(0.05))
WIDTHS_MM = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0)
TEXTURES = [f"grating_{p}" for p in (1, 3, 5, 8, 12)] + [f"dots_{p}" for p in (2, 3, 4, 5, 6)]
SPEED_MM_PER_S = 80.0
BANDS_HZ = ((15, 50), (50, 150), (150, 400))
DISTANCES_MM = (0.25, 1.27, 2.3, 3.34, 4.39, 5.46, 6.06, 6.89, 7.78)


def table(heads, rows):
    return markdown(pandas.DataFrame(rows, columns=heads, dtype=str))


def text(value, spec=".2f"):
    if value is None or not math.isfinite(value):
        return "–"
    return format(value, spec).replace("-", "−")


def agreement_text(row):
    """``R² (RMSE) ratio`` of a row of `recorded_rows`."""
    if row is None:
        return ""
    rmse = text(row["rmse"], ".3g")
    rmse = f"×{rmse}" if math.isnan(row["bias"]) and row["ratio"] == row["ratio"] else rmse
    fall = f", r {text(row['correlation'])}" if row["correlation"] < 0 else ""
    reached = "" if not row["count"] < row["recorded"] else f", {row['count']:.0f} reached"
    share = text(row["r_squared"])
    parts = [share, f"({rmse})"] if share != "–" else ["ratio"]
    parts.append(text(row["ratio"]) if row["source"] != OUYANG_SOURCE else "")
    return " ".join(filter(None, parts)) + fall + reached


def rows(validation):
    """A row for each recorded set and class."""
    sets = {recorded_set.name: recorded_set for recorded_set in RECORDED_SETS}
    lines = []
    found = validation.tables["recorded_sets"]
    for (name, afferent), group in found.groupby(["set", "afferent"], sort=False):
        by_source = {row["source"]: row for row in group.to_dict("records")}
        head = [f"{sets[name].title}, {sets[name].source}", afferent, sets[name].role]
        first = group.iloc[0]
        if isinstance(first["missing"], str):
            if afferent == sets[name].afferents[0]:
                head[1] = ", ".join(sets[name].afferents)
                lines.append([*head, "0", "no data", "", "", ""])
            continue
        sources = (validation.judged, FINGERTIP, TOUCHSIM, OUYANG_SOURCE)
        cells = [agreement_text(by_source.get(source)) for source in sources]
        lines.append([*head, str(first["recorded"]), *cells])
    heads = ["recorded set", "", "use", "n", "section", "fingertip", "TouchSim", "Ouyang"]
    return table(heads, lines)


def fields():
    """Median areas of receptive fields at 4.5 times threshold, in mm²."""
    lines = []
    for title, probe_mm, endings_mm, von_mises in (
        ("probe 0.5 mm", 0.5, ENDINGS_MM, False),
        ("probe 1 mm", 1.0, ENDINGS_MM, False),
        ("one ending per unit (`--endings-mm 0`)", 0.5, 0.0, False),
        ("SA driven by von Mises stress (`--sa-von-mises`)", 0.5, ENDINGS_MM, True),
        ("the same with one ending", 0.5, 0.0, True),
    ):
        cells = []
        for name in AFFERENTS if not von_mises else ("SA",):
            field = fb.receptive_field(
                name, depth_um=[], times_threshold=[4.5], probe_diameter_mm=probe_mm,
                endings_mm=endings_mm, sa_von_mises=von_mises, pad=PAD,
            )  # fmt: skip
            areas, threshold_um = field.areas, np.median(field.threshold_um)
            over = "" if areas["whole"].all() else "over "
            cells.append(f"{over}{areas['area_mm2'].median():.1f} ({threshold_um:.0f} µm)")
        lines.append([title, *cells, *[""] * (3 - len(cells))])
    medians = touchsim_table("fields").groupby("afferent")[["area_mm2", "threshold_um"]].median()
    pairs = (medians.loc[name] for name in AFFERENTS)
    lines.append(
        ["TouchSim, probe 0.5 mm", *(f"{a:.1f} ({t:.0f} µm)" for a, t in map(tuple, pairs))]
    )
    human = (f"{HUMAN_FIELDS_MM2[name]:g}" for name in AFFERENTS)
    lines.append(["human median, Vallbo & Johansson 1980", *human])
    return table(["mm² (threshold)", *AFFERENTS], lines)


def fibres(line, count):
    """`count` units at each place of `line`, each with the same endings at all places."""
    places = [np.tile(values, count) for values in (line.x_mm, line.z_mm, line.depth_mm)]
    seeds = np.repeat(np.arange(count), len(line))
    names = [str(number) for number in range(seeds.size)]
    units = Population(
        names, line.afferent * count, line.layer * count, *places, np.zeros(seeds.size)
    )
    return replace(units, endings_seed=seeds)


def amplitudes_um(endings_mm=ENDINGS_MM, deviate=0.0):
    """Amplitude for one impulse per cycle at `DISTANCES_MM`; infinite if none suffices."""
    times_ms = np.arange(501) * DT_MS
    sine = np.sin(2 * np.pi * 40 * times_ms / 1000)
    line = Population.line(step_mm=0.25, half_length_mm=8.0, afferents=("RA",))
    count = FIBRES if endings_mm else 1
    units = fibres(line, count)
    units = replace(units, endings_mm=endings_mm, deviate=np.full(len(units), deviate))
    amplitudes = np.geomspace(15, 900, 40)
    counts = []
    for amplitude in amplitudes:
        trajectory = Trajectory(
            550.0 + amplitude * sine, dt_ms=DT_MS, window_ms=(50.0, 250.0), name="sine"
        )
        counts.append(touch_skin(PAD, Shape.punch(2.0), trajectory, units, PARAMETERS).rate_ips)
    reached = np.array(counts) / 40 >= 0.99
    needed = np.where(reached.any(axis=0), amplitudes[reached.argmax(axis=0)], np.inf)
    return np.interp(DISTANCES_MM, line.z_mm, np.median(needed.reshape(count, -1), axis=0))


def distance():
    """Johnson 1974, Fig. 7: RA at 40 Hz, probe of 2 mm, 0.55 mm deep."""
    johnson, touchsim = published(DISTANCE).table, touchsim_table("distance")
    lines = [
        [title, *("over 900" if not um < 900 else f"{um:.0f}" for um in values)]
        for title, values in (
            ("median unit", amplitudes_um()),
            ("most sensitive of ten cells", amplitudes_um(deviate=MOST_SENSITIVE)),
            ("median unit, one ending", amplitudes_um(endings_mm=0.0)),
            *(
                (name, np.interp(DISTANCES_MM, stored["distance_mm"], stored[column]))
                for name, stored, column in (
                    ("TouchSim, median model", touchsim, "amplitude_um"),
                    ("TouchSim, most sensitive model", touchsim, "most_sensitive_um"),
                    ("Johnson 1974", johnson, "amplitude_um"),
                )
            ),
        )
    ]
    return table(["RA, µm", *(f"{mm:.3g} mm" for mm in DISTANCES_MM)], lines)


def decay():
    """Change of depth and of von Mises stress where RA sits, per um of a deep probe."""
    depth_um = np.array([510.0, 590.0])
    nodes, forces, _ = press_to(PAD, Shape.punch(2.0), depth_um)
    site = PAD.finger.afferents["RA"]
    z = np.array([0.0, 0.75, 1.25, 2.25, 3.25, 5.0, 7.0])
    middle = PAD.x_mm.size // 2
    apart = np.abs(nodes.row[:, None] - np.round(z / PAD.spacing_mm).astype(int))
    down = 1000 * forces @ PAD.lattice_compliance[1][nodes.column[:, None], middle, apart]
    places = np.full(z.size, site.layer), 0 * z, z, np.full(z.size, site.depth_mm)
    stress = von_mises_pa(PAD.influence_pa(nodes, *places), forces)
    lines = []
    for name, values in (("depth (µm)", down), ("stress at RA (Pa)", stress)):
        slopes = np.diff(values, axis=0)[0] / np.ptp(depth_um)
        lines.append([name, *(f"{slope:.3g}" for slope in slopes)])
    return table(["per µm of the probe", *(f"{mm:g} mm" for mm in z)], lines)


def profiles(endings_mm=ENDINGS_MM, pad=PAD, sa_von_mises=False):
    """Rates of SA from the middle outwards, by kind and width; along the plane pad."""
    plane = pad is not PAD
    step_mm, axis = (0.5, "x") if plane else (0.25, "z")
    line = Population.line(step_mm, 4.0, axis, ("SA",), finger=pad.finger)
    place_mm = getattr(line, f"{axis}_mm")
    shown = [int(np.argmin(np.abs(place_mm - mm))) for mm in np.arange(0, 3.1, 0.5)]
    count = 2 * FIBRES if endings_mm else 1
    units = replace(fibres(line[shown], count), sa_von_mises=sa_von_mises, endings_mm=endings_mm)
    parameters = parameter_set("fitted" if plane else "fitted_pad")
    results = {}
    for width in WIDTHS_MM:
        shapes = {"bar": Shape.bar(width, 14.0), "gap": Shape.grating(width, 4.0, relief_mm=2.0)}
        for kind, shape in shapes.items():
            turned = shape.rotated(90.0 if plane else 0.0)
            held = touch_skin(pad, turned, Trajectory.press(press_um=1000), units, parameters)
            means = held.rate_ips.reshape(count, -1).mean(axis=0)
            results[kind, width] = " ".join(f"{rate:.0f}" for rate in means)
    return results


def bars():
    """SA pressed by 1 mm; impulses/s every 0.5 mm from the middle of a bar or gap."""
    stored = touchsim_table("bars").set_index(["shape", "width_mm", "position_mm"])["rate_ips"]
    touchsim = {
        (kind, width): " ".join(f"{stored[kind, width, mm]:.0f}" for mm in np.arange(0, 3.1, 0.5))
        for kind in ("bar", "gap")
        for width in WIDTHS_MM
    }
    sources = {
        "": profiles(),
        ", one ending": profiles(endings_mm=0.0),
        ", ridged section": profiles(pad=resolve_pad("plane")),
        ", TouchSim": touchsim,
    }
    heads = ["mm", *(f"{kind}{title}" for kind in ("bar", "gap") for title in sources)]
    lines = [
        [
            f"{width:g}",
            *(source[kind, width] for kind in ("bar", "gap") for source in sources.values()),
        ]
        for width in WIDTHS_MM
    ]
    return table(heads, lines)


def dots():
    """Impulses per dot of 0.5 mm at 40 mm/s: median unit / mean of ten cells."""
    ten = norm.ppf((np.arange(10) + 0.5) / 10)
    deviate = np.tile(np.append(0.0, ten), 3)
    afferent = np.repeat(AFFERENTS, 11).tolist()
    units = Population.at(afferent, np.zeros(33), np.zeros(33), deviate=deviate)
    lines = []
    spacings = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
    for press_n in (0.3, 0.6):
        cells = []
        for spacing in spacings:
            trajectory = Trajectory.slide(40.0, press_n=press_n, duration_ms=900)
            scanned = touch_skin(PAD, Shape.dots(spacing), trajectory, units, PARAMETERS)
            each = np.bincount(scanned.fired.unit, minlength=33).reshape(3, 11) * spacing / 36.0
            pairs = zip(each[:, 0], each[:, 1:].mean(axis=1), strict=True)
            cells.append([f"{median:.1f} / {mean:.1f}" for median, mean in pairs])
        for row, name in enumerate(AFFERENTS):
            lines.append([f"{name}, {press_n:g} N", *(cell[row] for cell in cells)])
    return table(["dots apart", *(f"{spacing:g} mm" for spacing in spacings)], lines)


def ramps():
    """Ramps under a probe of 2 mm: mean of ten cells / TouchSim."""
    fingertip = Fingertip(PAD, PARAMETERS)
    windows = [(0, 100), (100, 200), (200, 500), (500, 1000)]
    sa = touchsim_table("ramps_sa").set_index("depth_mm")
    ra = touchsim_table("ramps_ra").pivot_table(
        index="speed_mm_per_s", columns="depth_mm", values="impulses"
    )
    lines = []
    for depth_mm in (0.4, 1.0, 2.0):
        pairs = zip(fingertip.ramp_rates_ips(depth_mm, windows), sa.loc[depth_mm], strict=True)
        lines.append(
            [f"SA, {depth_mm:g} mm at 40 mm/s: impulses/s in 0–100, 100–200, 200–500, 500–1000 ms",
             ", ".join(f"{model:.0f} / {touchsim:.0f}" for model, touchsim in pairs)]
        )  # fmt: skip
    for depth_mm in (1.0, 2.0):
        cells = [
            f"{fingertip.ramp_impulses(depth_mm, speed):.1f} / "
            f"{np.interp(np.log(speed), np.log(ra.index), ra[depth_mm]):.1f}"
            for speed in (5.0, 10.0, 20.0, 40.0, 70.0)
        ]
        head = f"RA, {depth_mm:g} mm: impulses on the ramp at 5, 10, 20, 40, 70 mm/s"
        lines.append([head, ", ".join(cells)])
    return table(["ramp and hold", "model / TouchSim"], lines)


def fingers(*names):
    """Fingers on which textures are scanned, ``macaque, ridged``, by name."""
    tips = {}
    for name in names:
        animal, skin = name.split(", ")
        pad = resolve_pad("macaque") if animal == "macaque" else PAD
        ridges = "none" if skin == "smooth" else "loop"
        tips[name] = Fingertip(with_ridges(pad, ridges), PARAMETERS)
    return tips


def textures():
    """Rates under ten textures at 80 mm/s, 0.3 N: macaque / human, ridged / TouchSim."""
    stored = touchsim_table("textures").set_index(["speed_mm_per_s", "shape", "afferent"])
    tips = fingers("macaque, ridged", "human, ridged")
    lines = []
    for shape in TEXTURES:
        rates = [tip.texture_rates_ips(shape, SPEED_MM_PER_S) for tip in tips.values()]
        cells = (
            [*(rate[name] for rate in rates), stored.loc[(SPEED_MM_PER_S, shape, name), "rate_ips"]]
            for name in AFFERENTS
        )
        kind, period = shape.split("_")
        title = f"grating, period {period} mm" if kind == "grating" else f"dots, {period} mm apart"
        lines.append([title, *(" / ".join(f"{rate:.0f}" for rate in cell) for cell in cells)])
    return table(["impulses/s", *AFFERENTS], lines)


def texture_agreement(recorded):
    """Agreement of both fingers, ridged and smooth, and TouchSim with recorded textures."""
    lines = []
    names = [
        f"{animal}, {skin}" for animal in ("macaque", "human") for skin in ("ridged", "smooth")
    ]
    for name, tip in fingers(*names).items():
        points = pandas.DataFrame(
            _texture_points(tip, recorded),
            columns=["set", "afferent", "condition", "recorded", "judged", FINGERTIP, TOUCHSIM],
        )
        found = recorded_rows(points, "judged")
        for row in found[found["source"].isin([FINGERTIP, TOUCHSIM])].to_dict("records"):
            numbers = (text(row[key]) for key in ("ratio", "correlation", "r_squared", "explained"))
            title = TOUCHSIM if row["source"] == TOUCHSIM else name
            line = [title, row["afferent"], *numbers, text(row["rmse"], ".0f")]
            if line not in lines:
                lines.append(line)
    heads = ["", "", "ratio", "correlation", "R²", "explained share", "RMSE"]
    return table(heads, lines)


def swings():
    """Rms swing of stress on the human finger: smooth / ridged, median unit, three bands, in Pa."""
    tips = fingers("human, smooth", "human, ridged")
    lines = []
    for shape in ("grating_3", "grating_8", "dots_3"):
        cells = {afferent: [] for afferent in AFFERENTS}
        for tip in tips.values():
            touched = tip.scanned(shape, SPEED_MM_PER_S)
            stress = touched.stress_pa[round(100 / touched.trajectory.dt_ms) :]
            window = np.hanning(len(stress))[:, None]
            power = np.abs(np.fft.rfft((stress - stress.mean(axis=0)) * window, axis=0)) ** 2
            hz = np.fft.rfftfreq(len(stress), touched.trajectory.dt_ms / 1e3)
            for afferent, of_class in zip(AFFERENTS, np.split(power, 3, 1), strict=True):
                bands = [
                    np.sqrt(2 * of_class[(hz >= low) & (hz < high)].sum(axis=0) / len(stress))
                    / np.sqrt(np.square(window).sum())
                    for low, high in BANDS_HZ
                ]
                cells[afferent].append(", ".join(f"{np.median(band):.0f}" for band in bands))
        lines.append([shape.replace("_", ", ") + " mm", *(" / ".join(c) for c in cells.values())])
    return table(["Pa at 15–50, 50–150, 150–400 Hz", *AFFERENTS], lines)


TABLES = {
    function.__name__: function
    for function in (fields, distance, decay, bars, dots, ramps, textures, swings)
}
RECORDED = ("rows", "texture_agreement")


def replaced(page, name, markdown_table):
    """Text of a page with another table between the marks of `name`."""
    marks = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end -->)", re.DOTALL)
    if not marks.search(page):
        raise SystemExit(f"the page has no <!-- {name} --> ... <!-- end -->")
    return marks.sub(lambda match: f"{match[1]}\n{markdown_table}\n\n{match[2]}", page)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--observed", type=Path)
    parser.add_argument("--recorded", type=Path)
    parser.add_argument("--only", nargs="+", choices=[*RECORDED, *TABLES], metavar="NAME")
    parser.add_argument("--write", type=Path, metavar="PAGE")
    args = parser.parse_args()
    warnings.simplefilter("ignore", FembridgeWarning)
    names = args.only or [*(RECORDED if args.recorded else ()), *TABLES]
    for name in names:
        if name == "rows":
            found = rows(fb.validate(observed=args.observed, recorded=args.recorded))
        elif name == "texture_agreement":
            from fembridge.evidence.recorded_folder import read_recorded_folder

            found = texture_agreement(read_recorded_folder(args.recorded)[1]["textures"])
        else:
            found = TABLES[name]()
        print(f"{name}\n\n{found}\n", flush=True)
        if args.write:
            page = replaced(args.write.read_text(encoding="utf-8"), name, found)
            args.write.write_text(page, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
