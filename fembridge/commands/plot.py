"""Draw a picture of a model, a response, or what came out of a run.

Each picture is made for a page of a journal and saved in the format that its
suffix names: .png, .pdf, .svg and others that Matplotlib knows.
"""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from fembridge.commands.options import FINGER, add_options

if TYPE_CHECKING:
    from fembridge.response.response_map import ResponseMap
    from fembridge.stimulus import Stimulus
    from fembridge.tables import SpikeTrain

EXAMPLE = "fembridge plot mesh --finger paper -o mesh.pdf"

_Pictures: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
_TABLES = (".csv", ".md")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands: a picture, then its own options."""
    pictures = parser.add_subparsers(
        dest="picture", metavar="PICTURE", required=True, title="pictures"
    )
    _add_mesh(pictures)
    _add_response(pictures)
    _add_trace(pictures)
    _add_raster(pictures)
    _add_stimulus(pictures)
    _add_sensitivity(pictures)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Draw; the summary holds what is in the picture and where it is."""
    from fembridge.plots.style import check_suffix

    check_suffix(args.output)
    draw = {
        "mesh": _draw_mesh,
        "response": _draw_response,
        "trace": _draw_trace,
        "raster": _draw_raster,
        "stimulus": _draw_stimulus,
        "sensitivity": _draw_sensitivity,
    }[args.picture]
    summary = draw(args)
    if not args.json:
        print(args.output)
    return {"picture": args.picture, "file": str(args.output), **summary}


def _draw_mesh(args: argparse.Namespace) -> dict[str, Any]:
    from decks.finger_file import read_finger
    from decks.presets import mesh_of
    from fembridge.commands.options import probe_from
    from fembridge.plots.mesh import MESH_DPI, afferent_nodes, mesh_figure
    from fembridge.plots.style import save_figure

    finger = read_finger(args.finger)
    mesh = mesh_of(finger)
    save_figure(mesh_figure(finger, mesh, probe_from(args)), args.output, MESH_DPI)
    return {
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


def _draw_response(args: argparse.Namespace) -> dict[str, Any]:
    from fembridge.plots.response import response_figure
    from fembridge.plots.style import save_figure

    response = _response(args)
    save_figure(response_figure(response), args.output)
    return {
        "afferents": [place.afferent for place in response.places],
        "depths": response.depth_um.size,
        "deepest_um": response.deepest_um,
        "closure_percent": response.closure_percent,
    }


def _response(args: argparse.Namespace) -> "ResponseMap":
    from fembridge.errors import UsageError

    if args.file is not None:
        from fembridge.response.response_map import read_map

        if args.finger is not None:
            raise UsageError(f"{args.file} and --finger {args.finger}: expected one")
        return read_map(args.file)
    from decks.finger_file import read_finger
    from decks.probe import Probe
    from fembridge.response.response_map import stored_response

    return stored_response(read_finger(args.finger or "quick"), Probe(), "CPE4")


def _draw_trace(args: argparse.Namespace) -> dict[str, Any]:
    from fembridge.plots.style import save_figure
    from fembridge.plots.trace import trace_figure
    from fembridge.tables import read_traces

    traces = read_traces(args.table)
    waveform = _one_stimulus(args.stimulus) if args.stimulus else None
    save_figure(trace_figure(traces, waveform=waveform), args.output)
    return {
        "traces": [
            {
                "afferent": trace.afferent,
                "node": trace.node,
                "peak_pa": float(trace.stress_pa.max()),
            }
            for trace in traces
        ]
    }


def _draw_raster(args: argparse.Namespace) -> dict[str, Any]:
    from fembridge.errors import UsageError
    from fembridge.plots.raster import raster_figure
    from fembridge.plots.style import save_figure
    from fembridge.tables import AFFERENTS, read_spikes

    trains = read_spikes(args.table)
    present = {train.afferent for train in trains}
    classes = args.afferent or [n for n in AFFERENTS if n in present] or AFFERENTS
    stimuli = _stimuli(args.stimulus) if args.stimulus else []
    rows = [stimulus.id for stimulus in stimuli] or _ids(trains)
    if not rows:
        raise UsageError(f"{args.table}: no spikes; --stimulus ID gives silent rows")
    shown = [train for train in trains if train.stimulus in rows]
    waveform = stimuli[0] if len(stimuli) == 1 else None
    window_ms = tuple(args.window_ms) if args.window_ms else None
    if window_ms is None and waveform is not None:
        window_ms = waveform.window_ms
    figure = raster_figure(
        shown, stimuli=rows, afferents=classes, window_ms=window_ms, waveform=waveform
    )
    save_figure(figure, args.output)
    silent = [name for name in rows if name not in _ids(shown)]
    if silent:
        print(
            f"{args.table}: no spike of {', '.join(silent)}: silent, or not in it", file=sys.stderr
        )
    return {
        "stimuli": rows,
        "silent": silent,
        "spikes": sum(t.times_ms.size for t in shown if t.afferent in classes),
    }


def _draw_stimulus(args: argparse.Namespace) -> dict[str, Any]:
    from fembridge.plots.style import save_figure
    from fembridge.plots.waveform import waveform_figure

    stimuli = _stimuli(args.ids, args.preindent_um, args.seed)
    save_figure(waveform_figure(stimuli), args.output)
    return {"stimuli": [stimulus.id for stimulus in stimuli]}


def _draw_sensitivity(args: argparse.Namespace) -> dict[str, Any]:
    """Draw; the summary holds every number of the tables."""
    from fembridge import sensitivity
    from fembridge.errors import UsageError
    from fembridge.plots.sensitivity import effects_figure, regressions_figure
    from fembridge.plots.style import save_figure
    from fembridge.store import write_text

    if args.effects is not None and args.effects.suffix.lower() not in _TABLES:
        raise UsageError(f"{args.effects}: expected {' or '.join(_TABLES)}")
    swept = sensitivity.read_swept(args.table)
    for cause in swept.causes:
        print(f"{args.table}: a finger is left out: {cause}", file=sys.stderr)
    single = sensitivity.is_one_at_a_time(swept)
    if single:
        table = sensitivity.single_effects(swept)
        people = sensitivity.effects_markdown(table)
        save_figure(effects_figure(table), args.output)
    else:
        table = sensitivity.rank_regressions(swept)
        people = sensitivity.regressions_markdown(swept, table)
        save_figure(regressions_figure(table, len(swept.parameters)), args.output)
    if args.effects is not None:
        is_csv = args.effects.suffix.lower() == ".csv"
        write_text(args.effects, sensitivity.csv_text(table) if is_csv else people)
    if args.fingers is not None:
        write_text(args.fingers, swept.to_csv())
    rows = table.astype(object).where(table.notna(), None)
    return {
        "kind": "one-at-a-time" if single else "rank regression",
        "fingers": len(swept.parameters),
        "left_out": len(swept.causes),
        "parameters": list(swept.parameters),
        "effects": rows.to_dict("records"),
    }


def _stimuli(
    words: list[str], preindent_um: float = 0.0, seed: int | None = None
) -> "list[Stimulus]":
    from decks.stimuli import resolve
    from decks.waveform import make_stimulus

    return [make_stimulus(entry, preindent_um, seed) for entry in resolve(words)]


def _one_stimulus(word: str) -> "Stimulus":
    from fembridge.errors import UsageError

    stimuli = _stimuli([word])
    if len(stimuli) != 1:
        raise UsageError(f"{word} names {len(stimuli)} stimuli, expected one")
    return stimuli[0]


def _ids(trains: "list[SpikeTrain]") -> list[str]:
    return list(dict.fromkeys(train.stimulus for train in trains))


def _add_mesh(pictures: _Pictures) -> None:
    """Which finger, and which probe on it."""
    parser = _add_picture(
        pictures,
        "mesh",
        "the finger's layers and elements, its afferents, and the probe",
        "fembridge plot mesh --finger paper -o mesh.pdf",
    )
    add_options(parser, FINGER)


def _add_response(pictures: _Pictures) -> None:
    """Which response map."""
    parser = _add_picture(
        pictures,
        "response",
        "stress at each afferent and the probe's force against its depth",
        "fembridge plot response --finger quick -o response.pdf",
    )
    parser.add_argument(
        "file",
        nargs="?",
        type=Path,
        metavar="FILE",
        help="a response.toml, as `fembridge simulate` leaves it",
    )
    parser.add_argument(
        "--finger",
        metavar="NAME",
        help="the stored response of this finger (default, without FILE: quick)",
    )


def _add_trace(pictures: _Pictures) -> None:
    """Which table, and what made it."""
    parser = _add_picture(
        pictures,
        "trace",
        "stress over time, a panel an afferent",
        "fembridge plot trace traces.csv --stimulus sine_20_250",
    )
    parser.add_argument("table", type=Path, metavar="CSV", help="table of traces")
    parser.add_argument("--stimulus", metavar="ID", help="draw the waveform that made them above")


def _add_raster(pictures: _Pictures) -> None:
    """Which table, rows and panels."""
    parser = _add_picture(
        pictures,
        "raster",
        "spikes: a panel a class, a row a stimulus",
        "fembridge plot raster spikes.csv --stimulus sine_20",
    )
    parser.add_argument("table", type=Path, metavar="CSV", help="table of spikes")
    parser.add_argument(
        "--stimulus",
        action="append",
        metavar="ID",
        help="rows from top to bottom, silent ones too; a single one is drawn above "
        "(default: those of the table)",
    )
    parser.add_argument(
        "--afferent",
        choices=("SA", "RA", "PC"),
        nargs="+",
        help="panels from left to right (default: those of the table)",
    )
    parser.add_argument(
        "--window-ms",
        type=float,
        nargs=2,
        metavar=("START", "END"),
        help="leave white only the time in which spikes were counted",
    )


def _add_stimulus(pictures: _Pictures) -> None:
    """Which waveforms."""
    parser = _add_picture(
        pictures,
        "stimulus",
        "the probe's depth over time, a panel a stimulus",
        "fembridge plot stimulus noise_25_250 sine_20_250 -o waveforms.svg",
    )
    parser.add_argument(
        "ids",
        nargs="+",
        metavar="ID",
        help="sine_20_250, a set as sine_20, noise or all; commas join several",
    )
    parser.add_argument(
        "--preindent-um",
        type=float,
        default=0.0,
        metavar="DEPTH",
        help="depth of the probe before time 0 (default: 0)",
    )
    parser.add_argument("--seed", type=int, help="draw other noise than the catalogue's (>= 0)")


def _add_sensitivity(pictures: _Pictures) -> None:
    """Which sweep, and where its tables go."""
    parser = _add_picture(
        pictures,
        "sensitivity",
        "which parameter of a sweep's fingers moves rates and stress how much",
        "fembridge plot sensitivity sweep/results.csv --table effects.md",
    )
    parser.add_argument(
        "table",
        type=Path,
        metavar="CSV",
        help="results.csv of a sweep with a design (docs/sweeps.md), or its --fingers",
    )
    parser.add_argument(
        "--table",
        dest="effects",
        type=Path,
        metavar="FILE",
        help="write the numbers too: .csv has all, .md a table a class",
    )
    parser.add_argument(
        "--fingers",
        type=Path,
        metavar="FILE.csv",
        help="write a row a finger: parameters, and mean answers by set of stimuli",
    )


def _add_picture(
    pictures: _Pictures, name: str, shows: str, example: str
) -> argparse.ArgumentParser:
    parser = pictures.add_parser(
        name,
        help=shows,
        description=f"{shows[0].upper()}{shows[1:]}.",
        epilog=f"example: {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path(f"{name}.png"),
        metavar="FILE",
        help=f"its suffix chooses the format (default: {name}.png)",
    )
    # The verb has it too; unset here, so as not to undo it there.
    parser.add_argument(
        "--json",
        action="store_true",
        default=argparse.SUPPRESS,
        help="print a summary a program can read",
    )
    return parser
