"""Draw a picture of a model, a response, or what came out of a run.

Each picture is made for a page of a journal and saved in the format that its
suffix names: .png, .pdf, .svg and others that Matplotlib knows.
"""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fembridge.commands.options import FINGER, add_options

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fembridge.stimulus import Stimulus

EXAMPLE = "fembridge plot mesh --finger paper -o mesh.pdf"

_TABLES = (".csv", ".md")
# Each picture: what it shows, an example, and its own arguments.
_PICTURES: dict[str, tuple[str, str, dict[str, dict[str, Any]]]] = {
    "mesh": (
        "the finger's layers and elements, its afferents, and the probe",
        "mesh --finger paper -o mesh.pdf",
        {},
    ),
    "response": (
        "stress at each afferent and the probe's force against its depth",
        "response --finger quick -o response.pdf",
        {
            "file": {
                "nargs": "?",
                "type": Path,
                "metavar": "FILE",
                "help": "a response.toml, as `fembridge simulate` leaves it",
            },
            "--finger": {
                "metavar": "NAME",
                "help": "the stored response of this finger (default, without FILE: quick)",
            },
        },
    ),
    "trace": (
        "stress over time, a panel an afferent",
        "trace traces.csv --stimulus sine_20_250",
        {
            "table": {"type": Path, "metavar": "CSV", "help": "table of traces"},
            "--stimulus": {"metavar": "ID", "help": "draw the waveform that made them above"},
        },
    ),
    "raster": (
        "spikes: a panel a class, a row a stimulus",
        "raster spikes.csv --stimulus sine_20",
        {
            "table": {"type": Path, "metavar": "CSV", "help": "table of spikes"},
            "--stimulus": {
                "action": "append",
                "metavar": "ID",
                "help": "rows from top to bottom, silent ones too; a single one is drawn above "
                "(default: those of the table)",
            },
            "--afferent": {
                "choices": ("SA", "RA", "PC"),
                "nargs": "+",
                "help": "panels from left to right (default: those of the table)",
            },
            "--window-ms": {
                "type": float,
                "nargs": 2,
                "metavar": ("START", "END"),
                "help": "leave white only the time in which spikes were counted",
            },
        },
    ),
    "stimulus": (
        "the probe's depth over time, a panel a stimulus",
        "stimulus noise_25_250 sine_20_250 -o waveforms.svg",
        {
            "ids": {
                "nargs": "+",
                "metavar": "ID",
                "help": "sine_20_250, a set as sine_20, noise or all; commas join several",
            },
            "--preindent-um": {
                "type": float,
                "default": 0.0,
                "metavar": "DEPTH",
                "help": "depth of the probe before time 0 (default: 0)",
            },
            "--seed": {"type": int, "help": "draw other noise than the catalogue's (>= 0)"},
        },
    ),
    "sensitivity": (
        "which parameter of a sweep's fingers moves rates and stress how much",
        "sensitivity sweep/results.csv --table effects.md",
        {
            "table": {
                "type": Path,
                "metavar": "CSV",
                "help": "results.csv of a sweep with a design (docs/sweeps.md), or its --fingers",
            },
            "--table": {
                "dest": "effects",
                "type": Path,
                "metavar": "FILE",
                "help": "write the numbers too: .csv has all, .md a table a class",
            },
            "--fingers": {
                "type": Path,
                "metavar": "FILE.csv",
                "help": "write a row a finger: parameters, and mean answers by set of stimuli",
            },
        },
    ),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands: a picture, then its own options."""
    pictures = parser.add_subparsers(
        dest="picture", metavar="PICTURE", required=True, title="pictures"
    )
    for name, (shows, example, options) in _PICTURES.items():
        picture = pictures.add_parser(
            name,
            help=shows,
            description=f"{shows[0].upper()}{shows[1:]}.",
            epilog=f"example: fembridge plot {example}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        picture.add_argument(
            "-o",
            "--output",
            type=Path,
            default=Path(f"{name}.png"),
            metavar="FILE",
            help=f"its suffix chooses the format (default: {name}.png)",
        )
        # The verb has it too; unset here, so as not to undo it there.
        picture.add_argument(
            "--json",
            action="store_true",
            default=argparse.SUPPRESS,
            help="print a summary a program can read",
        )
        if name == "mesh":
            add_options(picture, FINGER)
        for words, settings in options.items():
            picture.add_argument(words, **settings)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Draw; the summary holds what is in the picture and where it is."""
    from fembridge.plots.mesh import MESH_DPI
    from fembridge.plots.style import DPI, check_suffix, save_figure

    check_suffix(args.output)
    figure, summary = {
        "mesh": _mesh,
        "response": _response,
        "trace": _trace,
        "raster": _raster,
        "stimulus": _stimulus,
        "sensitivity": _sensitivity,
    }[args.picture](args)
    save_figure(figure, args.output, MESH_DPI if args.picture == "mesh" else DPI)
    if not args.json:
        print(args.output)
    return {"picture": args.picture, "file": str(args.output), **summary}


def _mesh(args: argparse.Namespace) -> "tuple[Figure, dict[str, Any]]":
    from decks.presets import mesh_of, read_finger
    from fembridge.commands.options import probe_from
    from fembridge.plots.mesh import afferent_nodes, mesh_figure

    finger = read_finger(args.finger)
    mesh = mesh_of(finger)
    return mesh_figure(finger, mesh, probe_from(args)), {
        "finger": finger.name,
        "elements": len(mesh.quad),
        "nodes": len(mesh.node_mm),
        "afferents": {
            place.afferent: {
                "node": place.node,
                "layer": place.layer,
                "x_mm": place.x_mm,
                "depth_mm": place.depth_mm,
            }
            for place in afferent_nodes(finger, mesh)
        },
    }


def _response(args: argparse.Namespace) -> "tuple[Figure, dict[str, Any]]":
    from decks.presets import read_finger
    from decks.probe import Probe
    from fembridge.errors import UsageError
    from fembridge.plots.response import response_figure
    from fembridge.response.response_map import read_map, stored_response

    if args.file is None:
        response = stored_response(read_finger(args.finger or "quick"), Probe(), "CPE4")
    elif args.finger is None:
        response = read_map(args.file)
    else:
        raise UsageError(f"{args.file} and --finger {args.finger}: expected one")
    return response_figure(response), {
        "afferents": [place.afferent for place in response.places],
        "depths": response.depth_um.size,
        "deepest_um": response.deepest_um,
        "closure_percent": response.closure_percent,
    }


def _trace(args: argparse.Namespace) -> "tuple[Figure, dict[str, Any]]":
    from fembridge.errors import UsageError
    from fembridge.plots.trace import trace_figure
    from fembridge.tables import read_traces

    traces = read_traces(args.table)
    stimuli = _stimuli([args.stimulus]) if args.stimulus else []
    if len(stimuli) > 1:
        raise UsageError(f"{args.stimulus} names {len(stimuli)} stimuli, expected one")
    return trace_figure(traces, waveform=stimuli[0] if stimuli else None), {
        "traces": [
            {
                "afferent": trace.afferent,
                "node": trace.node,
                "peak_pa": float(trace.stress_pa.max()),
            }
            for trace in traces
        ]
    }


def _raster(args: argparse.Namespace) -> "tuple[Figure, dict[str, Any]]":
    from fembridge.errors import UsageError
    from fembridge.plots.raster import raster_figure
    from fembridge.tables import AFFERENTS, read_spikes

    trains = read_spikes(args.table)
    present = {train.afferent for train in trains}
    classes = args.afferent or [n for n in AFFERENTS if n in present] or AFFERENTS
    stimuli = _stimuli(args.stimulus) if args.stimulus else []
    tabled = list(dict.fromkeys(train.stimulus for train in trains))
    rows = [stimulus.id for stimulus in stimuli] or tabled
    if not rows:
        raise UsageError(f"{args.table}: no spikes; --stimulus ID gives silent rows")
    shown = [train for train in trains if train.stimulus in rows]
    waveform = stimuli[0] if len(stimuli) == 1 else None
    counted_ms = waveform.window_ms if waveform else None
    window_ms = tuple(args.window_ms) if args.window_ms else counted_ms
    if silent := [name for name in rows if name not in tabled]:
        note = f"no spike of {', '.join(silent)}: silent, or not in it"
        print(f"{args.table}: {note}", file=sys.stderr)
    figure = raster_figure(
        shown, stimuli=rows, afferents=classes, window_ms=window_ms, waveform=waveform
    )
    spikes = sum(train.times_ms.size for train in shown if train.afferent in classes)
    return figure, {"stimuli": rows, "silent": silent, "spikes": spikes}


def _stimulus(args: argparse.Namespace) -> "tuple[Figure, dict[str, Any]]":
    from fembridge.plots.waveform import waveform_figure

    stimuli = _stimuli(args.ids, args.preindent_um, args.seed)
    return waveform_figure(stimuli), {"stimuli": [stimulus.id for stimulus in stimuli]}


def _sensitivity(args: argparse.Namespace) -> "tuple[Figure, dict[str, Any]]":
    """Draw, and write the tables; the summary holds every number of them."""
    from fembridge import sensitivity
    from fembridge.errors import UsageError
    from fembridge.plots.sensitivity import effects_figure, regressions_figure
    from fembridge.store import write_text

    if args.effects is not None and args.effects.suffix.lower() not in _TABLES:
        raise UsageError(f"{args.effects}: expected {' or '.join(_TABLES)}")
    swept = sensitivity.read_swept(args.table)
    for cause in swept.causes:
        print(f"{args.table}: a finger is left out: {cause}", file=sys.stderr)
    single = sensitivity.is_one_at_a_time(swept)
    if single:
        table = sensitivity.single_effects(swept)
        people, figure = sensitivity.effects_markdown(table), effects_figure(table)
    else:
        table = sensitivity.rank_regressions(swept)
        people = sensitivity.regressions_markdown(swept, table)
        figure = regressions_figure(table, len(swept.parameters))
    if args.effects is not None:
        is_csv = args.effects.suffix.lower() == ".csv"
        write_text(args.effects, sensitivity.csv_text(table) if is_csv else people)
    if args.fingers is not None:
        write_text(args.fingers, swept.to_csv())
    return figure, {
        "kind": "one-at-a-time" if single else "rank regression",
        "fingers": len(swept.parameters),
        "left_out": len(swept.causes),
        "parameters": list(swept.parameters),
        "effects": table.astype(object).where(table.notna(), None).to_dict("records"),
    }


def _stimuli(
    words: list[str], preindent_um: float = 0.0, seed: int | None = None
) -> "list[Stimulus]":
    from decks.stimuli import resolve
    from decks.waveform import make_stimulus

    return [make_stimulus(entry, preindent_um, seed) for entry in resolve(words)]
