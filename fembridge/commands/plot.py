"""Draw a picture of a model, a response, or what came out of a run.

Each picture is made for a page of a journal and saved in the format that its
suffix names: .png, .pdf, .svg and others that Matplotlib knows.
"""

import argparse
import sys
from typing import TYPE_CHECKING, Any

from fembridge.commands.plot_options import (
    add_mesh,
    add_raster,
    add_response,
    add_sensitivity,
    add_stimulus,
    add_trace,
)

if TYPE_CHECKING:
    from fembridge.response.response_map import ResponseMap
    from fembridge.stimulus import Stimulus
    from fembridge.tables import SpikeTrain

EXAMPLE = "fembridge plot mesh --finger paper -o mesh.pdf"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands: a picture, then its own options."""
    pictures = parser.add_subparsers(
        dest="picture", metavar="PICTURE", required=True, title="pictures"
    )
    add_mesh(pictures)
    add_response(pictures)
    add_trace(pictures)
    add_raster(pictures)
    add_stimulus(pictures)
    add_sensitivity(pictures)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Draw; the summary holds what is in the picture and where it is."""
    from fembridge.plots.picture import check_suffix

    check_suffix(args.output)
    draw = {
        "mesh": _draw_mesh,
        "response": _draw_response,
        "trace": _draw_trace,
        "raster": _draw_raster,
        "stimulus": _draw_stimulus,
        "sensitivity": _draw_sensitivity,
    }[args.picture]
    told = draw(args)
    if not args.json:
        print(args.output)
    return {"picture": args.picture, "file": str(args.output), **told}


def _draw_mesh(args: argparse.Namespace) -> dict[str, Any]:
    from decks.finger_file import read_finger
    from decks.presets import mesh_of
    from fembridge.commands.options import probe_from
    from fembridge.plots.mesh import afferent_nodes, draw_mesh

    finger = read_finger(args.finger)
    mesh = mesh_of(finger)
    draw_mesh(finger, mesh, probe_from(args), args.output)
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
    from fembridge.plots.response import draw_response

    response = _response(args)
    draw_response(response, args.output)
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
    from fembridge.plots.trace import draw_traces
    from fembridge.tables import read_traces

    traces = read_traces(args.table)
    waveform = _one_stimulus(args.stimulus) if args.stimulus else None
    draw_traces(traces, args.output, waveform=waveform)
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
    from fembridge.plots.raster import draw_raster
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
    draw_raster(
        shown, args.output, stimuli=rows, afferents=classes, window_ms=window_ms, waveform=waveform
    )
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
    from fembridge.plots.waveform import draw_waveforms

    stimuli = _stimuli(args.ids, args.preindent_um, args.seed)
    draw_waveforms(stimuli, args.output)
    return {"stimuli": [stimulus.id for stimulus in stimuli]}


def _draw_sensitivity(args: argparse.Namespace) -> dict[str, Any]:
    from fembridge.commands.plot_sensitivity import draw_sensitivity

    return draw_sensitivity(args)


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
