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

from fembridge.commands.options import add_options, add_output_option, words_of

EXAMPLE = "fembridge touch --shape braille:text=b --press-n 0.3 -o out"

_SHAPE = ("at_mm", "angle_deg", "pixel_mm", "relief_mm", "friction")
_WHO = (
    "population", "endings_mm", "sa_von_mises", "pad", "parameters", "repeats", "noise_mv",
    "seed",
)  # fmt: skip
_WAY = (
    "stimulus", "press_um", "press_n", "ramp_ms", "hold_ms", "slide_mm_per_s",
    "direction_deg", "duration_ms", "path", "pins", "preindent_um",
)  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    what = parser.add_argument_group("what touches")
    what.add_argument(
        "--shape", default="punch", metavar="SHAPE|FILE", help="default: punch, a 1 mm pin"
    )
    what.add_argument(
        "--at-mm",
        type=float,
        nargs=2,
        default=(0.0, 0.0),
        metavar=("X", "Z"),
        help="where its middle is at first, across and along the finger (default: 0 0)",
    )
    what.add_argument("--angle-deg", type=float, default=0.0, help="how far it is rotated")
    what.add_argument("--pixel-mm", type=float, metavar="MM", help="of a height map")
    what.add_argument(
        "--relief-mm",
        type=float,
        metavar="MM",
        help="white over black in a picture, negative: black over white (default: 0.5)",
    )
    what.add_argument("--friction", type=float, default=0.4, help="while it slides (default: 0.4)")
    what.add_argument(
        "--pins",
        type=Path,
        metavar="CSV",
        help="in place of a shape, pins x_mm,z_mm,diameter_mm,stimulus",
    )
    how = parser.add_argument_group("how it moves")
    add_options(how, ("stimulus",), action="store", required=False, help="its depth: sine_20_250")
    add_options(how, ("preindent_um",))
    how.add_argument("--press-um", type=float, metavar="UM", help="to this depth, or")
    how.add_argument("--press-n", type=float, metavar="N", help="with this force: ramp and hold")
    how.add_argument("--ramp-ms", type=float, default=50.0, metavar="MS", help="default: 50")
    how.add_argument("--hold-ms", type=float, default=500.0, metavar="MS", help="default: 500")
    add_options(how, ("slide_mm_per_s",), help="slides at this speed, pressed all the time")
    how.add_argument(
        "--direction-deg",
        type=float,
        default=-90.0,
        metavar="DEG",
        help="0 is to the right, 90 towards the tip (default: -90)",
    )
    how.add_argument(
        "--duration-ms", type=float, default=1000.0, metavar="MS", help="default: 1000"
    )
    how.add_argument(
        "--path", type=Path, metavar="CSV", help="time_ms,x_mm,z_mm and depth_um or force_n"
    )
    who = parser.add_argument_group("who feels it")
    who.add_argument(
        "--population",
        default="fingertip",
        metavar="NAME|FILE",
        help="fingertip, grid, line, one_each (as fingertip:seed=3) or a table unit,afferent,"
        "x_mm,z_mm,depth_mm (default: fingertip)",
    )
    add_options(who, ("endings_mm", "sa_von_mises"))
    who.add_argument(
        "--pad", default="reference", metavar="NAME|FILE.npz", help="default: reference"
    )
    add_options(who, ("parameters",), default="fitted_pad")
    who.add_argument("--repeats", type=int, default=1, metavar="N", help="trials (default: 1)")
    who.add_argument(
        "--noise-mv",
        type=float,
        default=0.0,
        metavar="MV",
        help="noise of the membrane, mV after 1 ms, by which trials differ (default: 0)",
    )
    who.add_argument("--seed", type=int, default=0, help="of the noise (default: 0)")
    add_output_option(parser, default="out")
    parser.add_argument(
        "--animate",
        nargs="?",
        const="touch.gif",
        metavar="NAME",
        help="also a moving picture, touch.gif or another .gif or .mp4",
    )
    add_options(parser, ("export",))
    parser.add_argument("--no-plot", action="store_true", help="draw no pictures")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Touch; the summary holds the mean rate of each class."""
    import sys

    from fembridge.errors import UsageError
    from fembridge.recording import Recording, export, require_libraries
    from fembridge.touching.touch import touch

    if args.seed < 0:
        raise UsageError(f"seed is {args.seed}, expected 0 or more")
    require_libraries(args.export)
    result = touch(
        **words_of(args, "shape", *_SHAPE, *_WAY),
        **words_of(args, *_WHO),
        log=lambda line: print(line, file=sys.stderr),
    )
    if note := result.origin.get("note"):
        print(note, file=sys.stderr)
    output = Path(args.output)
    files = result.write(output)
    if args.export:
        files += export(Recording.of(result), output, args.export)
    if not args.no_plot:
        from fembridge.plots.pad import PICTURES
        from fembridge.plots.style import save_figure

        for picture, draw in PICTURES.items():
            save_figure(draw(result), output / f"{picture}.png")
            files.append(f"{picture}.png")
    if args.animate:
        from fembridge.plots.pad_movie import write_movie

        write_movie(output / args.animate, result)
        files.append(args.animate)
    classes = result.summary()
    if not args.json:
        print(f"{'class':<6}{'units':>7}{'fire':>7}{'mean':>8}{'most':>8}   impulses/s")
        for name, row in classes.items():
            print(
                f"{name:<6}{row['units']:>7}{row['firing']:>7}{row['mean_ips']:>8.1f}"
                f"{row['most_ips']:>8.1f}"
            )
        print(
            f"{result.way.name}: up to {result.depth_um.max():.0f} um, {result.force_n.max():.3g} N"
        )
        print(f"{', '.join(files)}: {output}")
    return {
        "output": str(output),
        "files": files,
        "way": result.way.name,
        "note": result.origin.get("note", ""),
        "depth_um": float(result.depth_um.max()),
        "force_n": float(result.force_n.max()),
        "classes": classes,
    }
