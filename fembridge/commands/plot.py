"""Draw a picture of a model, a response, or what came out of a run.

Each picture is made for a page of a journal and saved in the format that its
suffix names: .png, .pdf, .svg and others that Matplotlib knows.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fembridge.commands.options import (
    NUMBERS,
    PROBE_USES,
    Several,
    Words,
    add_from,
    add_probe_options,
    window,
)
from fembridge.errors import UsageError
from fembridge.terminal import log

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fembridge.simulation import FolderStimuli
    from fembridge.stimulus import Stimulus
    from fembridge.tables import Rate

    Drawn = tuple[Figure, dict[str, Any]]

EXAMPLE = "fembridge plot mesh --finger paper -o mesh.pdf"

USES = PROBE_USES

_TABLES = (".csv", ".md")
_PREINDENT: tuple[str, str, dict[str, Any]] = (
    "--preindent-um",
    "depth of the probe before time 0, where no simulation.toml or run.toml is beside the "
    "table that has it",
    {"type": NUMBERS["preindent_um"], "metavar": "DEPTH"},
)
_FILE: dict[str, Any] = {"type": Path, "metavar": "FILE|DIR"}
_CLASSES: dict[str, Any] = {"choices": ("SA", "RA", "PC"), "action": Several}
_Options = tuple[tuple[str, str, dict[str, Any]], ...]
_OF_SPIKES: _Options = (
    ("table", "table of spikes, or a folder of simulate or encode", _FILE),
    ("--stimulus", "rows from top to bottom, silent ones too; a single one is drawn above "
     "(default: those of the folder, else of the table)", {"action": Words, "metavar": "ID"}),
    ("--afferent", "panels from left to right (default: those of the table)", _CLASSES),
)  # fmt: skip
_COUNTED: _Options = (
    ("--window-ms", "leave white only the time in which spikes were counted",
     {"type": window, "metavar": "START:END"}),
    _PREINDENT,
)  # fmt: skip


def _bins(width_ms: float) -> _Options:
    """Option of the width of a bin."""
    how = {"type": NUMBERS["bin_ms"], "default": width_ms, "metavar": "MS"}
    return (("--bin-ms", f"width of a bin (default: {width_ms:g})", how),)


# Other columns of the rates that validate writes.
_OF_A_PAGE = ("source", "family", "set", "level_um")

# Each picture: what it shows, an example, and its own options: help, and how it is read.
_PICTURES: dict[str, tuple[str, str, _Options]] = {
    "mesh": (
        "the finger's layers and elements, its afferents, and the probe",
        "mesh --finger paper -o mesh.pdf",
        (),
    ),
    "response": (
        "stress at each afferent and the probe's force against its depth",
        "response --finger quick -o response.pdf",
        (
            ("file", "a response.toml, or a folder in which `fembridge simulate` left one",
             {"nargs": "?", **_FILE}),
            ("--finger", "the stored response of this finger (default, without FILE: quick)",
             {"metavar": "NAME"}),
        ),
    ),
    "trace": (
        "stress over time, a panel an afferent",
        "trace out --stimulus sine_20_250",
        (
            ("table", "table of traces, or a folder of simulate, or a run folder with results",
             _FILE),
            ("--stimulus", "which one of a folder; of a table: the waveform to draw above",
             {"metavar": "ID"}),
            _PREINDENT,
        ),
    ),
    "raster": (
        "spikes: a panel a class, a row a stimulus",
        "raster out --stimulus sine_20",
        (*_OF_SPIKES, *_COUNTED),
    ),
    "psth": (
        "rate over time in bins: a panel a class, a row a stimulus",
        "psth out --stimulus sine_20_250 --bin-ms 2",
        (*_OF_SPIKES, *_bins(5.0), *_COUNTED),
    ),
    "isi": (
        "inter-spike intervals: a panel a class, a row a stimulus",
        "isi out --stimulus noise_25_250 --longest-ms 60",
        (
            *_OF_SPIKES,
            *_bins(1.0),
            ("--longest-ms", "end of the axis (default: the longest interval)",
             {"type": NUMBERS["longest_ms"], "metavar": "MS"}),
        ),
    ),
    "rates": (
        "rate against amplitude: a row a class, a column a frequency",
        "rates out --observed observed.csv --touchsim",
        (
            ("table", "table of rates, or a folder of simulate, encode or a sweep of one finger",
             _FILE),
            ("--observed", "draw observed rates beside: a table stimulus,afferent,rate_ips",
             {"type": Path, "metavar": "RATES.csv"}),
            ("--touchsim", "draw TouchSim's rates beside (stored; probe without pre-indentation)",
             {"action": "store_true"}),
            ("--afferent", "rows from top to bottom (default: those of the table)", _CLASSES),
        ),
    ),
    "stimulus": (
        "the probe's depth over time, a panel a stimulus",
        "stimulus noise_25_250 sine_20_250 -o waveforms.svg",
        (
            ("ids", "sine_20_250, a set as sine_20, noise or all, a waveform's path; commas "
             "join several", {"nargs": "+", "metavar": "ID|FILE"}),
            ("--preindent-um", "depth of the probe before time 0 (default: 0)",
             {"type": NUMBERS["preindent_um"], "default": 0.0, "metavar": "DEPTH"}),
            ("--seed", "draw other noise than the catalogue's (>= 0)",
             {"type": NUMBERS["seed"]}),
        ),
    ),
    "sensitivity": (
        "which parameter of a sweep's fingers moves rates and stress how much",
        "sensitivity sweep --table effects.md",
        (
            ("table", "folder of a sweep with a design (docs/sweeps.md), its results.csv, or "
             "its --fingers", _FILE),
            ("--table", "write the numbers too: .csv has all, .md a table a class",
             {"dest": "effects", "type": Path, "metavar": "FILE"}),
            ("--fingers", "write a row a finger: parameters, and mean answers by set of stimuli",
             {"type": Path, "metavar": "FILE.csv"}),
        ),
    ),
}  # fmt: skip


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
            from fembridge.api import simulate

            add_from(picture, simulate, "finger")
            add_probe_options(picture)
        for option, words, how in options:
            picture.add_argument(option, help=words, **how)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Draw; the summary holds what is in the picture and where it is."""
    from fembridge.plots.mesh import MESH_DPI
    from fembridge.plots.style import DPI, check_suffix, save_figure

    check_suffix(args.output)
    figure, summary = {
        "mesh": _mesh,
        "response": _response,
        "trace": _trace,
        "rates": _rates,
        "stimulus": _stimulus,
        "sensitivity": _sensitivity,
    }.get(args.picture, _spikes)(args)
    save_figure(figure, args.output, MESH_DPI if args.picture == "mesh" else DPI)
    print(args.output)
    return {"picture": args.picture, "file": args.output, **summary}


def _mesh(args: argparse.Namespace) -> "Drawn":
    from decks.presets import mesh_of, read_finger
    from fembridge.commands.options import probe_from
    from fembridge.plots.mesh import afferent_nodes, mesh_figure

    finger = read_finger(args.finger)
    mesh = mesh_of(finger)
    keys = ("node", "layer", "x_mm", "depth_mm")
    places = afferent_nodes(finger, mesh)
    return mesh_figure(finger, mesh, probe_from(args)), {
        "finger": finger.name,
        "elements": len(mesh.quad),
        "nodes": len(mesh.node_mm),
        "afferents": {one.afferent: {key: getattr(one, key) for key in keys} for one in places},
    }


def _response(args: argparse.Namespace) -> "Drawn":
    from decks.presets import read_finger
    from decks.probe import Probe
    from fembridge.plots.response import response_figure
    from fembridge.response.response_map import MAP_FILE, read_map, stored_response
    from fembridge.simulation import find_file

    if args.file is None:
        response = stored_response(read_finger(args.finger or "quick"), Probe(), "CPE4")
    elif args.finger is None:
        made_by = "fembridge simulate leaves it where it solves a response map"
        response = read_map(find_file(args.file, (MAP_FILE,), made_by))
    else:
        raise UsageError(f"{args.file} and --finger {args.finger}: expected one")
    return response_figure(response), {
        "afferents": [place.afferent for place in response.places],
        "depths": response.depth_um.size,
        "deepest_um": response.deepest_um,
        "closure_percent": response.closure_percent,
    }


def _trace(args: argparse.Namespace) -> "Drawn":
    from fembridge.encoding import read_stress
    from fembridge.plots.trace import trace_figure
    from fembridge.simulation import stimuli_in

    traces, path = read_stress(args.table, log)
    written = stimuli_in(path.parent)
    there = list(dict.fromkeys(trace.stimulus for trace in traces if trace.stimulus))
    if there and args.stimulus not in there and (args.stimulus or len(there) > 1):
        several = f"{len(there)} stimuli, {there[0]} to {there[-1]}"
        found = f"has {several if there[1:] else there[0]}"
        raise UsageError(f"{path}: {found}; name one of them: --stimulus ID")
    name = args.stimulus
    if name is None and written.stimuli:
        [name, *others] = there or [stimulus.id for stimulus in written.stimuli]
        name = None if others else name
    waveform = _waveform(args, name, written) if name else None
    _refuse_depth_of(waveform, args)
    shown = [one for one in traces if not there or one.stimulus == (args.stimulus or there[0])]
    return trace_figure(shown, waveform=waveform), {
        "stimulus": waveform.id if waveform else None,
        "preindent_um": waveform.preindent_um if waveform else None,
        "traces": [
            {"afferent": one.afferent, "node": one.node or None, "peak_pa": one.stress_pa.max()}
            for one in shown
        ],
    }


def _spikes(args: argparse.Namespace) -> "Drawn":
    """Raster, PSTH or intervals of a table of spikes, with the stimuli that its folder knows."""
    from fembridge.plots import spikes
    from fembridge.simulation import SPIKES_FILE, FolderStimuli, find_file, stimuli_in
    from fembridge.tables import AFFERENTS, read_spikes

    path = find_file(args.table, (SPIKES_FILE,), "simulate and encode leave it")
    trains = read_spikes(path)
    rows = tabled = list(dict.fromkeys(train.stimulus for train in trains))
    written = stimuli_in(path.parent)
    if written.stimuli and all(map(written.of, tabled)):
        trains = written.with_silent(trains)
        rows = [stimulus.id for stimulus in written.stimuli]
    else:
        written = FolderStimuli(path)
    if args.stimulus:
        rows = _rows_named(args.stimulus, rows, whole=bool(written.stimuli))
    if not rows:
        raise UsageError(f"{path}: no spikes; --stimulus ID gives silent rows")
    silent = [name for name in rows if name not in tabled]
    if unknown := [name for name in silent if not written.of(name)]:
        log(f"{path}: no spike of {', '.join(unknown)}: silent, or not in it")
    shown = [train for train in trains if train.stimulus in rows]
    present = {train.afferent for train in trains} or AFFERENTS
    classes = args.afferent or [name for name in AFFERENTS if name in present]
    drawn: dict[str, Any] = {"trains": shown, "stimuli": rows, "afferents": classes}
    count = sum(train.times_ms.size for train in shown if train.afferent in classes)
    summary = {"stimuli": rows, "silent": silent, "spikes": count}
    if args.picture != "raster":
        drawn["bin_ms"] = summary["bin_ms"] = args.bin_ms
    if args.picture == "isi":
        found = [spikes.intervals_ms(shown, row, one) for row in rows for one in classes]
        summary["intervals"] = sum(each.size for each in found)
        return spikes.isi_figure(**drawn, longest_ms=args.longest_ms), summary
    stimuli = list(filter(None, map(written.of, rows)))
    drawn["waveform"] = None
    if len(rows) == 1 and (stimuli or args.stimulus):
        stimuli = [_waveform(args, rows[0], written)]
        [drawn["waveform"]] = stimuli
    _refuse_depth_of(drawn["waveform"], args)
    windows_ms = {args.window_ms} if args.window_ms else {one.window_ms for one in stimuli}
    drawn["window_ms"] = windows_ms.pop() if len(windows_ms) == 1 else None
    draw = spikes.raster_figure if args.picture == "raster" else spikes.psth_figure
    return draw(**drawn), summary


def _rows_named(words: list[str], there: list[str], *, whole: bool) -> list[str]:
    """Ids that `words` name; where `there` is the `whole` of it, of a set only those."""
    rows: list[str] = []
    for word in ",".join(words).split(","):
        named = [word] if word in there else [one.id for one in _stimuli([word])]
        of_set = [name for name in named if name in there] if whole and len(named) > 1 else []
        rows += of_set or named
    return list(dict.fromkeys(rows))


def _waveform(args: argparse.Namespace, word: str, written: "FolderStimuli") -> "Stimulus":
    """The stimulus as it is recorded, else as the catalogue and --preindent-um have it."""
    stimuli = [known] if (known := written.of(word)) else _stimuli([word], args.preindent_um or 0.0)
    if len(stimuli) > 1:
        raise UsageError(f"{word} names {len(stimuli)} stimuli, expected one")
    if known := written.of(stimuli[0].id):
        if args.preindent_um not in (None, known.preindent_um):
            found = f"{written.path} says {known.preindent_um:g} um"
            raise UsageError(f"--preindent-um {args.preindent_um:g}: {found}; leave the option out")
        return known
    if args.preindent_um is None:
        words = "the probe is drawn without pre-indentation: none is recorded beside the table"
        log(f"{args.table}: {words}; --preindent-um DEPTH sets it")
    return stimuli[0]


def _refuse_depth_of(waveform: "Stimulus | None", args: argparse.Namespace) -> None:
    """Refuse --preindent-um where no waveform is drawn."""
    if waveform is None and args.preindent_um is not None:
        raise UsageError(
            "--preindent-um is for a waveform that is drawn: --stimulus ID, a single one"
        )


def _rates(args: argparse.Namespace) -> "Drawn":
    from fembridge.evidence import touchsim_rates
    from fembridge.observed import read_observed
    from fembridge.plots.rates import placed, rates_figure
    from fembridge.simulation import RATES_FILE, find_file
    from fembridge.sweeps.sweep import RESULTS_FILE

    made_by = "simulate, encode and sweep leave it"
    path = find_file(args.table, (RATES_FILE, RESULTS_FILE), made_by)
    rates = _rates_in(path)
    entries, strange = placed(rates)
    if strange and entries:
        note = f"without a frequency and an amplitude, left out: {', '.join(strange[:3])}"
        more = f" and {len(strange) - 3} more" if len(strange) > 3 else ""
        log(f"{path}: {note}{more}")
    observed = read_observed(args.observed, complete=False).rates() if args.observed else []
    touchsim = touchsim_rates() if args.touchsim else []
    figure = rates_figure(rates, observed=observed, touchsim=touchsim, afferents=args.afferent)
    beside = {"observed": observed, "touchsim": touchsim}
    return figure, {
        "stimuli": list(entries),
        "left_out": strange,
        **{name: sum(one.stimulus in entries for one in each) for name, each in beside.items()},
    }


def _rates_in(path: Path) -> "list[Rate]":
    """Rates of a table, or of the one finger of a sweep's table that did not fail."""
    from fembridge.tables import RATE_COLUMNS, read_rates, read_table

    table = read_table(path, RATE_COLUMNS)
    if "status" not in table.header:
        expected = (*RATE_COLUMNS, *_OF_A_PAGE)
        table.check_columns(expected, ("unit",), lambda line: log(f"{path}: {line}"))
    else:
        table = table.where(table.column("status") == "done")
        whose = list(zip(table.column("stimulus"), table.column("afferent"), strict=True))
        if len(set(whose)) < len(whose):
            found = "rates of several fingers, probes or methods, expected of one"
            raise UsageError(f"{path}: {found}; plot sensitivity compares fingers")
    return read_rates(table)


def _stimulus(args: argparse.Namespace) -> "Drawn":
    from fembridge.plots.waveform import waveform_figure

    stimuli = _stimuli(args.ids, args.preindent_um, args.seed)
    return waveform_figure(stimuli), {"stimuli": [stimulus.id for stimulus in stimuli]}


def _sensitivity(args: argparse.Namespace) -> "Drawn":
    """Draw, and write the tables; the summary holds every number of them."""
    from fembridge import sensitivity
    from fembridge.plots.sensitivity import effects_figure, regressions_figure
    from fembridge.simulation import find_file
    from fembridge.store import write_text
    from fembridge.sweeps.sweep import RESULTS_FILE

    if args.effects is not None and args.effects.suffix.lower() not in _TABLES:
        raise UsageError(f"{args.effects}: expected {' or '.join(_TABLES)}")
    path = find_file(args.table, (RESULTS_FILE,), "sweep leaves it when nothing is left to do")
    swept = sensitivity.read_swept(path)
    for cause in swept.causes:
        log(f"{path}: a finger is left out: {cause}")
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
    from fembridge.stimulus_file import stimuli_of

    return stimuli_of(words, preindent_um, seed, log=log)
