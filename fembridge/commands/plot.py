"""Draw a picture of a model, a response or the results of a run; of a folder all its pictures.

`fembridge plot out` draws every picture that the files in the folder out allow. Each picture is
made for a page of a journal and saved in the format that its suffix names: .png, .pdf, .svg and
others that Matplotlib knows.
"""

import argparse
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fembridge.commands.options import (
    NUMBERS,
    PROBE_USES,
    RepeatedOption,
    Several,
    add_from,
    add_probe_options,
    parse_window,
)
from fembridge.errors import FembridgeError, UsageError
from fembridge.host.terminal import log

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fembridge.io.spike_table import Rate, SpikeTrain
    from fembridge.simulation.folder import FolderStimuli
    from fembridge.stimulus import Stimulus

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
     "(default: those of the folder, else of the table)",
     {"action": RepeatedOption, "metavar": "ID"}),
    ("--afferent", "panels from left to right (default: those of the table)", _CLASSES),
)  # fmt: skip
_COUNTED: _Options = (
    ("--window-ms", "leave white only the time in which spikes were counted",
     {"type": parse_window, "metavar": "START:END"}),
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
        "the finger's layers and elements, its afferents, and the probe; of a round fingertip "
        "(fingertip, fingertip_macaque) two sections",
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
            ("table", "folder of a sweep with a design (docs/how_to/sweeps.md), its results.csv, "
             "or its --fingers", _FILE),
            ("--table", "write the numbers too: .csv has all, .md a table a class",
             {"dest": "effects", "type": Path, "metavar": "FILE"}),
            ("--fingers", "write a row a finger: parameters, and mean answers by set of stimuli",
             {"type": Path, "metavar": "FILE.csv"}),
        ),
    ),
}  # fmt: skip

_QUIET = ("--quiet", "print errors and warnings only")
ALL = "all"
_ALL_SHOWS = "every picture that the files of a folder allow; the word all may be left out"
# Records of results that draw themselves: class, and its pictures (none: its only one).
_RESULTS = {
    "touch.toml": ("fembridge.touching.touch_result:Touch", "fembridge.touching.touch_result"),
    "thresholds.toml": ("fembridge.fitting.thresholds:Thresholds", ""),
    "fitted.toml": ("fembridge.fitting.fit:Fit", ""),
    "receptive_field.toml": (
        "fembridge.touching.receptive_field:ReceptiveField",
        "fembridge.touching.receptive_field",
    ),
    "deflection.toml": ("fembridge.reporting.deflect:Deflections", ""),
}
# Pictures of tables, by the files of which one has to be there.
_OF_FILES = {
    "raster": ("spikes.csv",),
    "psth": ("spikes.csv",),
    "isi": ("spikes.csv",),
    "rates": ("rates.csv", "results.csv"),
    "trace": ("traces.npz", "traces.csv", "stress.npz"),
    "response": ("response.toml",),
    "mesh": ("finger.toml",),
    "sensitivity": ("results.csv",),
}


def spelled_out(arguments: Sequence[str]) -> list[str]:
    """Arguments with the picture ``all`` where a folder comes first: ``plot out``.

    A word that is no folder counts as one unless it resembles the name of a picture.
    """
    words = list(arguments)
    at = words.index("plot") + 1
    first = next((word for word in words[at:] if not word.startswith("-")), ALL)
    pictures = {ALL, *_PICTURES}
    if first in pictures:
        return words
    from fembridge.host.store import near_hint

    if Path(first).is_dir() or not near_hint(first, pictures):
        words.insert(at, ALL)
    return words


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands: a picture, then its own options."""
    pictures = parser.add_subparsers(
        dest="picture", metavar="PICTURE", required=True, title="pictures", prog=parser.prog
    )
    for name, (shows, example, options) in _PICTURES.items():
        picture = pictures.add_parser(
            name,
            help=shows,
            description=f"{shows[0].upper()}{shows[1:]}.",
            epilog=f"example: fembridge plot {example}",
            formatter_class=parser.formatter_class,
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
        for option, text in (("--json", "print a summary a program can read"), _QUIET):
            picture.add_argument(option, action="store_true", default=argparse.SUPPRESS, help=text)
        if name == "mesh":
            from fembridge.simulation.simulate import simulate

            add_from(picture, simulate, "finger")
            add_probe_options(picture)
        for option, help_text, settings in options:
            picture.add_argument(option, help=help_text, **settings)
    folder = pictures.add_parser(
        ALL,
        help=_ALL_SHOWS,
        description=f"{_ALL_SHOWS[0].upper()}{_ALL_SHOWS[1:]}.",
        epilog="example: fembridge plot out",
        formatter_class=parser.formatter_class,
        allow_abbrev=False,
    )
    folder.add_argument("folder", type=Path, metavar="DIR", help="folder of any verb")
    folder.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="folder of the pictures (default: DIR)"
    )
    folder.add_argument("--suffix", default=".png", metavar=".png", help="format (default: .png)")
    for option, text in (("--json", "print a summary a program can read"), _QUIET):
        folder.add_argument(option, action="store_true", default=argparse.SUPPRESS, help=text)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Draw; the summary holds what is in the picture and where it is."""
    from fembridge.plots.finger_mesh import MESH_DPI
    from fembridge.plots.style import DPI, check_suffix, save_figure

    if args.picture == ALL:
        return _all(args)
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


def _all(args: argparse.Namespace) -> dict[str, Any]:
    """Draw all that a folder allows; what cannot be drawn is logged with its reason."""
    from fembridge.errors import ResultError
    from fembridge.plots.style import check_suffix, save_figure
    from fembridge.simulation.folder import stimuli_in

    folder: Path = args.folder
    if not folder.is_dir():
        if folder.exists():
            problem = f"not a folder; `fembridge plot PICTURE {folder}` draws a file, with PICTURE"
        else:
            problem = "no such folder; a picture is named by"
        expected = "a folder, or the name of a picture"
        names = ", ".join(_PICTURES)
        raise UsageError(f"{problem} {names}", folder, found=str(folder), expected=expected)
    output: Path = args.output or folder
    check_suffix(output / f"picture{args.suffix}")
    files, reasons = [], {}
    for name, figure in _result_figures(folder):
        file = output / f"{name}{args.suffix}"
        save_figure(figure, file)
        files.append(file)
    if not files:
        parser = argparse.ArgumentParser()
        add_arguments(parser)
        for name, sources in _OF_FILES.items():
            source = next((folder / file for file in sources if (folder / file).is_file()), None)
            if source is None:
                continue
            file = output / f"{name}{args.suffix}"
            table = ["--finger", str(source)] if name == "mesh" else [str(folder)]
            if name == "trace" and len(stimuli := stimuli_in(folder).stimuli) > 1:
                table += ["--stimulus", stimuli[-1].id]
                log(f"trace: of {stimuli[-1].id}, the last of {len(stimuli)} stimuli")
            words = parser.parse_args([name, *table, "-o", str(file)])
            words.explicit = frozenset()
            try:
                run(words)
            except FembridgeError as error:
                reasons[name] = " ".join(str(error).split())
                continue
            files.append(file)
    else:
        print(*files, sep="\n")
    for name, reason in reasons.items():
        log(f"{name} is not drawn: {reason}")
    if not files:
        raise ResultError("has no file that a picture is made of", folder)
    return {"picture": ALL, "files": files, "not_drawn": reasons}


def _result_figures(folder: Path) -> Iterator[tuple[str, "Figure"]]:
    """Name and figure of each picture of the result that a record in `folder` names."""
    for record, (place, pictures_of) in _RESULTS.items():
        if not (folder / record).is_file():
            continue
        module, _, name = place.partition(":")
        result = getattr(import_module(module), name).read(folder)
        if not pictures_of:
            yield Path(record).stem, result.plot()
            return
        for kind in import_module(pictures_of).PICTURES:
            yield kind, result.plot(kind)
        return


def _mesh(args: argparse.Namespace) -> "Drawn":
    from decks.fingertip import is_fingertip
    from decks.presets import mesh_of, read_finger
    from fembridge.commands.options import probe_from
    from fembridge.plots.finger_mesh import afferent_nodes, mesh_figure

    if is_fingertip(args.finger):
        return _fingertip(args.finger)
    finger = read_finger(args.finger)
    mesh = mesh_of(finger)
    keys = ("node", "layer", "x_mm", "depth_mm")
    sites = afferent_nodes(finger, mesh)
    return mesh_figure(finger, mesh, probe_from(args)), {
        "finger": finger.name,
        "elements": len(mesh.quad),
        "nodes": len(mesh.node_mm),
        "afferents": {site.afferent: {key: getattr(site, key) for key in keys} for site in sites},
    }


def _fingertip(preset_or_path: str) -> "Drawn":
    from decks.fingertip import read_fingertip
    from decks.fingertip_mesh import mesh_fingertip
    from fembridge.plots.fingertip_sections import sections_figure

    tip = read_fingertip(preset_or_path)
    mesh = mesh_fingertip(tip)
    return sections_figure(tip, mesh), {
        "finger": tip.name,
        "elements": len(mesh.tet),
        "nodes": len(mesh.node_mm),
        "afferents": {name: len(rows) for name, rows in mesh.afferents.items()},
    }


def _response(args: argparse.Namespace) -> "Drawn":
    from decks.presets import read_finger
    from decks.probe import Probe
    from fembridge.plots.response import response_figure
    from fembridge.response.response_map import MAP_FILE, read_map, stored_response
    from fembridge.simulation.folder import find_file

    if args.file is None:
        response = stored_response(read_finger(args.finger or "quick"), Probe(), "CPE4")
    elif args.finger is None:
        made_by = "fembridge simulate leaves it where it solves a response map"
        response = read_map(find_file(args.file, (MAP_FILE,), made_by))
    else:
        raise UsageError(f"cannot be combined with the file {args.file}", argument="finger")
    return response_figure(response), {
        "afferents": response.class_names(),
        "depths": response.depth_um.size,
        "deepest_um": response.deepest_um,
        "closure_percent": response.closure_percent,
    }


def _trace(args: argparse.Namespace) -> "Drawn":
    from fembridge.plots.stress_history import trace_figure
    from fembridge.simulation.encoding import read_stress
    from fembridge.simulation.folder import stimuli_in

    traces, path = read_stress(args.table)
    recorded = stimuli_in(path.parent)
    stimuli_in_table = list(dict.fromkeys(trace.stimulus for trace in traces if trace.stimulus))
    if (
        stimuli_in_table
        and args.stimulus not in stimuli_in_table
        and (args.stimulus or len(stimuli_in_table) > 1)
    ):
        several = (
            f"{len(stimuli_in_table)} stimuli, {stimuli_in_table[0]} to {stimuli_in_table[-1]}"
        )
        problem = f"has {several if stimuli_in_table[1:] else stimuli_in_table[0]}"
        raise UsageError(f"{problem}; name one of them: --stimulus ID", path)
    name = args.stimulus
    if name is None and recorded.stimuli:
        [name, *others] = stimuli_in_table or [stimulus.id for stimulus in recorded.stimuli]
        name = None if others else name
    waveform = _waveform(args, name, recorded) if name else None
    _refuse_depth_of(waveform, args)
    selected = [
        trace
        for trace in traces
        if not stimuli_in_table or trace.stimulus == (args.stimulus or stimuli_in_table[0])
    ]
    return trace_figure(selected, waveform=waveform), {
        "stimulus": waveform.id if waveform else None,
        "preindent_um": waveform.preindent_um if waveform else None,
        "traces": [
            {
                "afferent": trace.afferent,
                "node": trace.node or None,
                "peak_pa": trace.stress_pa.max(),
            }
            for trace in selected
        ],
    }


def _spikes(args: argparse.Namespace) -> "Drawn":
    """Raster, PSTH or intervals of a table of spikes, with the stimuli that its folder knows."""
    from fembridge.plots import spike_figures
    from fembridge.simulation.folder import SPIKES_FILE, FolderStimuli, find_file, stimuli_in
    from fembridge.trace import AFFERENTS

    path = find_file(args.table, (SPIKES_FILE,), "simulate and encode leave it")
    trains = _trains(path)
    rows = stimuli_in_table = list(dict.fromkeys(train.stimulus for train in trains))
    recorded = stimuli_in(path.parent)
    if recorded.stimuli and all(map(recorded.stimulus, stimuli_in_table)):
        trains = recorded.with_silent(trains)
        rows = [stimulus.id for stimulus in recorded.stimuli]
    else:
        recorded = FolderStimuli(path)
    if args.stimulus:
        rows = _rows_named(args.stimulus, rows, is_complete=bool(recorded.stimuli))
    if not rows:
        raise UsageError("no spikes; --stimulus ID gives silent rows", path)
    silent = [name for name in rows if name not in stimuli_in_table]
    if unknown := [name for name in silent if not recorded.stimulus(name)]:
        log(f"{path}: no spike of {', '.join(unknown)}: silent, or not in it")
    selected = [train for train in trains if train.stimulus in rows]
    classes_present = {train.afferent for train in trains} or AFFERENTS
    classes = args.afferent or [name for name in AFFERENTS if name in classes_present]
    plot_options: dict[str, Any] = {"trains": selected, "stimuli": rows, "afferents": classes}
    count = sum(train.times_ms.size for train in selected if train.afferent in classes)
    summary = {"stimuli": rows, "silent": silent, "spikes": count}
    if args.picture != "raster":
        plot_options["bin_ms"] = summary["bin_ms"] = args.bin_ms
    if args.picture == "isi":
        intervals_ms = [
            spike_figures.intervals_ms(selected, row, afferent)
            for row in rows
            for afferent in classes
        ]
        summary["intervals"] = sum(intervals.size for intervals in intervals_ms)
        return spike_figures.isi_figure(**plot_options, longest_ms=args.longest_ms), summary
    stimuli = list(filter(None, map(recorded.stimulus, rows)))
    plot_options["waveform"] = None
    if len(rows) == 1 and (stimuli or args.stimulus):
        stimuli = [_waveform(args, rows[0], recorded)]
        [plot_options["waveform"]] = stimuli
    _refuse_depth_of(plot_options["waveform"], args)
    windows_ms = (
        {args.window_ms} if args.window_ms else {stimulus.window_ms for stimulus in stimuli}
    )
    plot_options["window_ms"] = windows_ms.pop() if len(windows_ms) == 1 else None
    draw = spike_figures.raster_figure if args.picture == "raster" else spike_figures.psth_figure
    return draw(**plot_options), summary


def _trains(path: Path) -> "list[SpikeTrain]":
    """Spikes of a table; of a touch also the silent units, which its table does not have."""
    from fembridge.io.spike_table import read_spikes
    from fembridge.touching.touch_result import RECORD_FILE, SPIKES_FILE, Touch

    if path.name == SPIKES_FILE and (path.parent / RECORD_FILE).is_file():
        return list(Touch.read(path.parent).trains())
    return read_spikes(path)


def _rows_named(texts: list[str], available: list[str], *, is_complete: bool) -> list[str]:
    """Ids that `texts` name; of a set only those `available`, where this list `is_complete`."""
    rows: list[str] = []
    for stimulus_id in ",".join(texts).split(","):
        named = (
            [stimulus_id]
            if stimulus_id in available
            else [stimulus.id for stimulus in _stimuli([stimulus_id])]
        )
        available_members = (
            [name for name in named if name in available] if is_complete and len(named) > 1 else []
        )
        rows += available_members or named
    return list(dict.fromkeys(rows))


def _waveform(args: argparse.Namespace, stimulus_id: str, recorded: "FolderStimuli") -> "Stimulus":
    """The stimulus as it is recorded, else as the catalogue and --preindent-um have it."""
    stimuli = (
        [stimulus]
        if (stimulus := recorded.stimulus(stimulus_id))
        else _stimuli([stimulus_id], args.preindent_um or 0.0)
    )
    if len(stimuli) > 1:
        problem = f"is {stimulus_id}, {len(stimuli)} stimuli, expected one"
        raise UsageError(problem, argument="stimulus", found=stimulus_id, expected="one stimulus")
    if stimulus := recorded.stimulus(stimuli[0].id):
        if args.preindent_um not in (None, stimulus.preindent_um):
            raise UsageError(
                f"is {args.preindent_um:g} um, expected {stimulus.preindent_um:g} um, which the "
                "run has; omit it",
                recorded.path,
                argument="preindent_um",
                found=args.preindent_um,
                expected=f"{stimulus.preindent_um:g}",
            )
        return stimulus
    if args.preindent_um is None:
        note = "the probe is drawn without pre-indentation: none is recorded beside the table"
        log(f"{args.table}: {note}; --preindent-um DEPTH sets it")
    return stimuli[0]


def _refuse_depth_of(waveform: "Stimulus | None", args: argparse.Namespace) -> None:
    """Refuse --preindent-um where no waveform is drawn."""
    if waveform is None and args.preindent_um is not None:
        raise UsageError(
            "is for a waveform that is drawn: --stimulus ID, a single one", argument="preindent_um"
        )


def _rates(args: argparse.Namespace) -> "Drawn":
    from fembridge.evidence import touchsim_rates
    from fembridge.io.observed_rates import read_observed
    from fembridge.plots.rate_comparison import placed, rates_figure
    from fembridge.simulation.folder import RATES_FILE, find_file
    from fembridge.sweeps.sweep import RESULTS_FILE

    made_by = "simulate, encode and sweep leave it"
    path = find_file(args.table, (RATES_FILE, RESULTS_FILE), made_by)
    rates = _rates_in(path)
    entries, unplaced = placed(rates)
    if unplaced and entries:
        note = f"without a frequency and an amplitude, left out: {', '.join(unplaced[:3])}"
        remainder = f" and {len(unplaced) - 3} more" if len(unplaced) > 3 else ""
        log(f"{path}: {note}{remainder}")
    observed = read_observed(args.observed, complete=False).rates() if args.observed else []
    touchsim = touchsim_rates() if args.touchsim else []
    figure = rates_figure(rates, observed=observed, touchsim=touchsim, afferents=args.afferent)
    comparisons = {"observed": observed, "touchsim": touchsim}
    return figure, {
        "stimuli": list(entries),
        "left_out": unplaced,
        **{
            name: sum(rate.stimulus in entries for rate in compared)
            for name, compared in comparisons.items()
        },
    }


def _rates_in(path: Path) -> "list[Rate]":
    """Rates of a table, or of the one finger of a sweep's table that did not fail."""
    from fembridge.io.spike_table import RATE_COLUMNS, read_rates
    from fembridge.io.text_table import read_table

    table = read_table(path, RATE_COLUMNS)
    if "status" not in table.header:
        expected = (*RATE_COLUMNS, *_OF_A_PAGE)
        table.check_columns(expected, ("unit",), lambda line: log(f"{path}: {line}"))
    else:
        table = table.where(table.column("status") == "done")
        keys = list(zip(table.column("stimulus"), table.column("afferent"), strict=True))
        if len(set(keys)) < len(keys):
            problem = "rates of several fingers, probes or methods, expected of one"
            raise UsageError(f"{problem}; plot sensitivity compares fingers", path)
    return read_rates(table)


def _stimulus(args: argparse.Namespace) -> "Drawn":
    from fembridge.plots.waveform_overview import waveform_figure

    stimuli = _stimuli(args.ids, args.preindent_um, args.seed)
    return waveform_figure(stimuli), {"stimuli": [stimulus.id for stimulus in stimuli]}


def _sensitivity(args: argparse.Namespace) -> "Drawn":
    """Draw, and write the tables; the summary holds every number of them."""
    from fembridge.host.store import write_text
    from fembridge.plots.sensitivity_charts import effects_figure, regressions_figure
    from fembridge.sensitivity import effects as sensitivity
    from fembridge.sensitivity.wording import effects_markdown, regressions_markdown
    from fembridge.simulation.folder import find_file
    from fembridge.sweeps.sweep import RESULTS_FILE

    if args.effects is not None and args.effects.suffix.lower() not in _TABLES:
        expected = f"a name in {' or '.join(_TABLES)}"
        raise UsageError(argument="effects", found=str(args.effects), expected=expected)
    path = find_file(args.table, (RESULTS_FILE,), "sweep leaves it when nothing is left to do")
    swept = sensitivity.read_swept(path)
    for cause in swept.causes:
        log(f"{path}: a finger is left out: {cause}")
    single = sensitivity.is_one_at_a_time(swept)
    if single:
        table = sensitivity.single_effects(swept)
        markdown, figure = effects_markdown(table), effects_figure(table)
    else:
        table = sensitivity.rank_regressions(swept)
        markdown = regressions_markdown(swept, table)
        figure = regressions_figure(table, len(swept.parameters))
    if args.effects is not None:
        is_csv = args.effects.suffix.lower() == ".csv"
        write_text(args.effects, sensitivity.csv_text(table) if is_csv else markdown)
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
    texts: list[str], preindent_um: float = 0.0, seed: int | None = None
) -> "list[Stimulus]":
    from fembridge.io.waveform import Waveform

    return Waveform(texts, seed=seed).stimuli(preindent_um)
