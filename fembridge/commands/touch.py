"""Press, vibrate or slide a shape on a whole fingertip: every afferent's spikes.

The stored pad of the reference finger needs no solver; `fembridge pad` makes that of
another finger. Written are
  population.csv  unit,afferent,x_mm,z_mm,depth_mm,deviate
  spikes.csv      stimulus,afferent,unit,repeat,spike_time_ms
  rates.csv       stimulus,afferent,unit,rate_ips
  touch.csv       time_ms,depth_um,force_n
  pad.png         the pad from above: who fires how much, pressure, depth and force
  raster.png      every unit that fires
A shape is punch, sphere, cylinder, plate, bar, edge, grating, dots, braille or letters,
with sizes as in bar:width_mm=3,length_mm=10, or a height map: a picture (white is
raised) or a CSV in mm.
"""

import argparse
from pathlib import Path
from typing import Any

from fembridge.commands import Content, write_files, written
from fembridge.commands.options import (
    ABOVE_ZERO,
    NUMBERS,
    Number,
    Use,
    add_export_option,
    add_from,
    add_output_option,
    names_a_file,
    words_of,
)
from fembridge.terminal import log, print_table

EXAMPLE = "fembridge touch --shape braille:text=b --press-n 0.3 -o out"

_OF_A_SHAPE = "--shape --at-mm --angle-deg --pixel-mm --relief-mm --friction"
_OF_A_WAVEFORM = "--stimulus or --pins, whose waveforms begin at that depth"

USES = (
    Use(_OF_A_SHAPE, "a shape, not for --pins", lambda args: args.pins is None),
    Use(
        "--pixel-mm",
        "--shape FILE, a height map",
        lambda args: _is_height_map(args.shape),
    ),
    Use(
        "--relief-mm",
        "--shape FILE, a picture",
        lambda args: _is_height_map(args.shape) and not names_a_file([args.shape], ".csv", ".txt"),
    ),
    Use("--preindent-um", _OF_A_WAVEFORM, lambda args: args.stimulus or args.pins),
    Use(
        "--ramp-ms --hold-ms",
        "--press-um or --press-n without --slide-mm-per-s",
        lambda args: _is_pressed(args) and args.slide_mm_per_s is None,
    ),
    Use(
        "--direction-deg --duration-ms",
        "--slide-mm-per-s",
        lambda args: args.slide_mm_per_s is not None,
    ),
    Use(
        "--friction",
        "a shape that slides: --slide-mm-per-s, --path, or --stimulus FILE.csv with aside_um",
        lambda args: (
            args.slide_mm_per_s is not None
            or args.path
            or names_a_file([args.stimulus or ""], ".csv")
        ),
    ),
    Use("--seed", "--noise-mv more than 0", lambda args: args.noise_mv),
)


def _is_height_map(shape: str) -> bool:
    """Whether `shape` is no known name, with sizes or without, but a file."""
    from fembridge.touching.shape import SHAPES

    return shape.partition(":")[0] not in SHAPES


def _is_pressed(args: argparse.Namespace) -> bool:
    """Whether a depth or a force says how the shape moves."""
    ways = (args.stimulus, args.path, args.pins)
    pressed = args.press_um is not None or args.press_n is not None
    return pressed and not any(way is not None for way in ways)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    from fembridge.touching.touch import DEFAULTS, touch

    default = {name: f"default: {value}".removesuffix(".0") for name, value in DEFAULTS.items()}
    what = parser.add_argument_group("what touches")
    add_from(what, touch, shape=("SHAPE|FILE", "punch is a 1 mm pin"))
    what.add_argument(
        "--at-mm",
        type=NUMBERS["at_mm"],
        nargs=2,
        metavar=("X", "Z"),
        help="where its middle is at first, across and along the finger (default: 0 0)",
    )
    relief = "white over black in a picture, negative: black over white (default: 0.5)"
    add_from(
        what,
        touch,
        angle_deg=("DEG", f"how far it is rotated ({default['angle_deg']})"),
        pixel_mm=("MM", "of a height map"),
        relief_mm=("MM", relief),
        friction=("MU", f"while it slides ({default['friction']})"),
        pins=("CSV", "in place of a shape, pins x_mm,z_mm,diameter_mm,stimulus"),
    )
    how = parser.add_argument_group("how it moves")
    add_from(
        how,
        touch,
        "preindent_um",
        stimulus=({"also": "--waveform", "metavar": "ID|FILE"}, "its depth: sine_20_250"),
        press_um=("UM", "to this depth, or"),
        press_n=("N", "with this force: ramp and hold"),
        ramp_ms=("MS", default["ramp_ms"]),
        hold_ms=("MS", default["hold_ms"]),
        slide_mm_per_s=(
            {"type": Number(ABOVE_ZERO, 1000), "metavar": "V"},
            "slides at this speed, pressed all the time",
        ),
        direction_deg=(
            "DEG",
            f"0 is to the right, 90 towards the tip ({default['direction_deg']})",
        ),
        duration_ms=("MS", default["duration_ms"]),
        path=("CSV", "time_ms,x_mm,z_mm and depth_um or force_n"),
    )
    who = parser.add_argument_group("who feels it")
    words = "fingertip, grid, line, one_each (as fingertip:seed=3) or a table "
    words += "unit,afferent,x_mm,z_mm,depth_mm"
    parameters = "a set's name or a TOML file (default: fitted_pad, of a plane pad fitted)"
    add_from(
        who,
        touch,
        "endings_mm",
        "sa_von_mises",
        "pad",
        population=("NAME|FILE", words),
        parameters=("NAME", parameters),
    )
    add_from(
        who,
        touch,
        repeats=("N", "trials"),
        noise_mv=(
            "MV",
            "noise of the membrane, mV after 1 ms, by which trials differ; "
            "recorded timing bounds it to 0.1 or so (docs/touch_evidence.md)",
        ),
        seed=("N", "of the noise"),
    )
    add_output_option(parser, default="out")
    parser.add_argument(
        "--animate",
        nargs="?",
        const="touch.gif",
        metavar="NAME",
        help="also a moving picture, touch.gif or another .gif or .mp4",
    )
    add_export_option(parser)
    parser.add_argument("--no-plot", action="store_true", help="draw no pictures")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Touch; the summary holds the mean rate of each class."""
    from fembridge.plots.pad import PICTURES, check_movie, write_movie
    from fembridge.recording import EXPORTED, Recording, exports, require_libraries
    from fembridge.store import remove_file
    from fembridge.touching.touch import TOUCH_FILE, touch

    require_libraries(args.export)
    if args.animate:
        check_movie(Path(args.animate))
    result = touch(**words_of(args, touch), log=log)
    note = result.origin.get("note", "")  # a warning, too
    files: dict[str, Content] = {**result.tables()}
    if not args.no_plot:
        files |= {f"{name}.png": draw(result) for name, draw in PICTURES.items()}
    if args.export:
        files |= exports(Recording.of(result), args.export)
    write_files(args.output, files, last=TOUCH_FILE)
    names = list(files)
    if args.no_plot:
        for name in PICTURES:
            remove_file(args.output / f"{name}.png")  # of other spikes than those beside it
    if args.animate:
        write_movie(args.output / args.animate, result)
        names.append(args.animate)
    classes = result.summary()
    rows = [
        (
            name,
            *(f"{row[n]:d}" for n in ("units", "firing")),
            *(f"{row[n]:.1f}" for n in ("mean_ips", "most_ips")),
        )
        for name, row in classes.items()
    ]
    print_table(("class", "units", "fire", "mean (ips)", "most (ips)"), rows)
    depth_um, force_n = float(result.depth_um.max()), float(result.force_n.max())
    unit = "N/mm" if result.solved.nodes.pad.plane else "N"
    print(f"{result.way.name}: up to {depth_um:.0f} um, {force_n:.3g} {unit}")
    return {
        **written(args.output, names, ["touch.gif", *EXPORTED]),
        "way": result.way.name,
        "note": note,
        "depth_um": depth_um,
        "force_n": force_n,
        "classes": classes,
    }
