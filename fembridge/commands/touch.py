"""Press, vibrate or slide a shape on a whole fingertip: the spikes of every afferent.

The stored pad of the reference finger needs no solver; `fembridge pad` makes that of another
finger. A shape is punch, sphere, cylinder, plate, bar, edge, grating, dots, braille or letters,
with sizes as in bar:width_mm=3,length_mm=10, or a height map: a picture (white is raised) or a
CSV in mm.
"""

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fembridge.commands import Content, write_files, written
from fembridge.commands.options import (
    NUMBERS,
    Number,
    Use,
    add_export_option,
    add_from,
    add_output_option,
    names_a_file,
    words_of,
)
from fembridge.host.terminal import print_table

if TYPE_CHECKING:
    from fembridge.touching.trajectory import Trajectory

EXAMPLE = "fembridge touch --shape braille:text=b --press-n 0.25 -o out"

_SHAPE_OPTIONS = "--shape --at-mm --angle-deg --tilt-deg --pixel-mm --relief-mm --tile --friction"
_TRAJECTORIES = ("stimulus", "path", "pins")

USES = (
    Use(_SHAPE_OPTIONS, "a shape, not for --pins", lambda args: args.pins is None),
    Use(
        "--pixel-mm",
        "--shape FILE, a height map",
        lambda args: _is_height_map(args.shape),
    ),
    Use(
        "--event-grid-mm",
        "--export events or aedat4",
        lambda args: {"events", "aedat4"} & {*args.export},
    ),
    Use("--tile", "--shape FILE, a height map", lambda args: _is_height_map(args.shape)),
    Use(
        "--relief-mm",
        "--shape FILE, a picture",
        lambda args: _is_height_map(args.shape) and not names_a_file([args.shape], ".csv", ".txt"),
    ),
    Use(
        "--preindent-um",
        "--stimulus or --pins, whose waveforms begin at that depth",
        lambda args: args.stimulus or args.pins,
    ),
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
    """Whether `shape` is a file: no known name, with or without sizes."""
    from fembridge.touching.shape import SHAPES

    return shape.partition(":")[0] not in SHAPES


def _is_pressed(args: argparse.Namespace) -> bool:
    """Whether a depth or a force describes the trajectory."""
    is_pressed = args.press_um is not None or args.press_n is not None
    return is_pressed and all(getattr(args, name) is None for name in _TRAJECTORIES)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.touching.population import Population
    from fembridge.touching.touch import FRICTION, touch
    from fembridge.touching.trajectory import SPEED_MM_PER_S, Trajectory

    shape = parser.add_argument_group("shape")
    add_from(shape, touch, shape=("SHAPE|FILE", "punch is a pin of 1 mm"))
    shape.add_argument(
        "--at-mm",
        type=NUMBERS["at_mm"],
        nargs=2,
        default=(0.0, 0.0),
        metavar=("X", "Z"),
        help="position of its middle, across and along the finger (default: 0 0)",
    )
    add_from(
        shape,
        touch,
        angle_deg=("DEG", "rotation, counter-clockwise"),
        friction=("MU", f"friction while it slides (default: {FRICTION:g})"),
    )
    add = shape.add_argument
    add(
        "--tilt-deg",
        type=NUMBERS["tilt_deg"],
        nargs=2,
        default=(0.0, 0.0),
        metavar=("ACROSS", "ALONG"),
        help="direction from which it comes, from above: positive from the right, and from the tip;"
        " its middle then aims at the skin at --at-mm (pads of your own model; default: 0 0)",
    )
    add("--pixel-mm", type=NUMBERS["pixel_mm"], metavar="MM", help="size of a pixel of a FILE")
    relief = "height of white over black in a picture; negative: black over white (default: 0.5)"
    add("--relief-mm", type=NUMBERS["relief_mm"], metavar="MM", help=relief)
    add("--tile", action="store_true", help="repeat a FILE without end")
    add(
        "--pins",
        metavar="CSV",
        help="instead of a shape, pins with columns x_mm,z_mm,diameter_mm,stimulus",
    )
    trajectory = parser.add_argument_group("trajectory")
    add_from(
        trajectory,
        touch,
        "preindent_um",
        stimulus=({"also": "--waveform", "metavar": "ID|FILE"}, "depth over time: sine_20_250"),
        press_um=("UM", "ramp and hold at a depth, or"),
        press_n=("N", "at a force"),
    )
    add_from(
        trajectory,
        Trajectory.press,
        ramp_ms=("MS", "duration of a ramp"),
        hold_ms=("MS", "duration of the hold"),
    )
    trajectory.add_argument(
        "--slide-mm-per-s",
        type=Number.within(SPEED_MM_PER_S),
        metavar="V",
        help="slide at this speed, pressed all the time",
    )
    add_from(
        trajectory,
        Trajectory.slide,
        direction_deg=("DEG", "0 is to the right, 90 towards the tip"),
        duration_ms=("MS", "duration of the slide"),
    )
    trajectory.add_argument(
        "--path",
        metavar="CSV",
        help="path over the skin: time_ms,x_mm,z_mm and depth_um or force_n",
    )
    afferents = parser.add_argument_group("afferents")
    population = "fingertip, grid, line, one_each (as fingertip:seed=3) or a table "
    population += "unit,afferent,x_mm,z_mm,depth_mm"
    parameters = "parameter set or TOML file (default: fitted_pad; on a plane pad fitted)"
    add_from(
        afferents,
        touch,
        "pad",
        finger=("FILE.toml", "the pad's finger with Prony terms, by which its skin relaxes"),
        ridges=(
            "NAME",
            "fingerprint ridges: loop, whorl, across or along (as whorl:period_mm=0.5,seed=3), or "
            "none (default: loop on the pad of a smooth finger)",
        ),
        population=("NAME|FILE", population),
        parameters=("NAME", parameters),
    )
    add_from(afferents, Population, "endings_mm", "sa_von_mises")
    add_from(
        afferents,
        touch,
        trials=("N", "number of trials"),
        noise_mv=(
            "MV",
            "noise of the membrane, mV after 1 ms, by which trials differ; "
            "recorded timing limits it to about 0.1 (docs/science/touch_evidence.md)",
        ),
        seed=("N", "seed of the noise"),
    )
    add_output_option(parser, default="out")
    parser.add_argument(
        "--animate",
        nargs="?",
        const="touch.gif",
        metavar="NAME",
        help="also write a moving picture, touch.gif or another .gif or .mp4",
    )
    add_export_option(parser)
    grid = "with --export events or aedat4: pixel of the events, by the position of the units "
    grid += "(default: a pixel for each unit)"
    parser.add_argument("--event-grid-mm", type=NUMBERS["event_grid_mm"], metavar="MM", help=grid)
    parser.add_argument("--no-plot", action="store_true", help="draw no pictures")


def _trajectory(args: argparse.Namespace, preindent_um: float) -> "Trajectory | None":
    """The trajectory of ``--pins``, ``--path``, ``--slide-mm-per-s`` or a press."""
    from fembridge.errors import UsageError
    from fembridge.touching.trajectory import Trajectory

    given = [name for name in _TRAJECTORIES if getattr(args, name) is not None]
    if args.slide_mm_per_s is not None:
        given.append("slide_mm_per_s")
    pressed = [name for name in ("press_um", "press_n") if getattr(args, name) is not None]
    others = given if "slide_mm_per_s" in given and len(given) == 1 else [*given, *pressed]
    options = [f"--{name.replace('_', '-')}" for name in (*_TRAJECTORIES, "slide_mm_per_s")]
    if not given and not pressed:
        expected = f"--press-um, --press-n, {', '.join(options)}"
        raise UsageError(f"no trajectory: expected one of {expected}", expected=expected)
    if args.slide_mm_per_s is not None and not pressed:
        raise UsageError("is missing, and so is --press-n", argument="press_um")
    if given and len(others) > 1:
        raise UsageError(
            f"cannot be combined with --{others[0].replace('_', '-')}", argument=others[1]
        )
    makers: dict[str, Callable[[], Trajectory]] = {
        "pins": partial(Trajectory.from_pins, args.pins, preindent_um=preindent_um),
        "path": partial(Trajectory.from_table, args.path),
        "slide_mm_per_s": lambda: Trajectory.slide(**words_of(args, Trajectory.slide)),
    }
    if given and given[0] in makers:
        return makers[given[0]]()
    is_press = pressed and not given
    return Trajectory.press(**words_of(args, Trajectory.press)) if is_press else None


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Touch; the summary has the mean rate of each class."""
    from fembridge.host.store import remove_file, write_toml
    from fembridge.io.recording import EXPORTED, exports, require_libraries
    from fembridge.plots.touch_view import PICTURES, check_movie
    from fembridge.touching.pad_file import resolve_pad
    from fembridge.touching.population import resolve_population
    from fembridge.touching.shape import resolve_shape
    from fembridge.touching.touch import parameters_on, touch
    from fembridge.touching.touch_result import CONTACT_FILE, RECORD_FILE

    require_libraries(args.export)
    if args.animate:
        check_movie(Path(args.animate))
    pad = resolve_pad(args.pad)
    parameters = parameters_on(pad, args.parameters)
    depth_um = parameters.preindent_um if args.preindent_um is None else args.preindent_um
    trajectory = _trajectory(args, depth_um)
    units = resolve_population(args.population, pad)
    words = words_of(args, touch) | {
        "at_mm": tuple(args.at_mm),
        "tilt_deg": tuple(args.tilt_deg),
        "pad": pad,
        "parameters": parameters,
        "population": units.with_endings(args.endings_mm, sa_von_mises=args.sa_von_mises),
        "trajectory": trajectory,
    }
    if args.pins is None:
        words["shape"] = resolve_shape(args.shape, args.pixel_mm, args.relief_mm, tile=args.tile)
    if trajectory is not None:
        words |= {"stimulus": None, "press_um": None, "press_n": None}
    result = touch(**words)
    files: dict[str, Content] = {**result.tables()}
    if not args.no_plot:
        files |= {f"{name}.png": result.plot(name) for name in PICTURES}
    if args.export:
        files |= exports(result.to_recording(), args.export, args.event_grid_mm)
    files |= {
        CONTACT_FILE: result.write_contact,
        RECORD_FILE: lambda path: write_toml(
            path, {"command": args.command_line, **result.provenance}
        ),
    }
    write_files(args.output, files, last=RECORD_FILE)
    names = list(files)
    if args.no_plot:
        for name in PICTURES:
            remove_file(args.output / f"{name}.png")  # of other spikes than those in the tables
    if args.animate:
        result.animate(args.output / args.animate)
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
    print(f"{result.trajectory.name}: up to {depth_um:.0f} um, {force_n:.3g} {result.force_unit}")
    return {
        **written(args.output, names, ["touch.gif", *EXPORTED]),
        "trajectory": result.trajectory.name,
        "warnings": result.origin["warnings"],
        "depth_um": depth_um,
        "force_n": force_n,
        "classes": classes,
    }
