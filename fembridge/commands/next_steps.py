"""The command that follows a verb: each verb prints it last, so that it can be pasted.

It is made from the arguments and the summary of the verb. A verb whose result is a page, a
picture or a text has none.
"""

import argparse
import shlex
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

Summary = Mapping[str, Any]


def next_commands(verb: str, args: argparse.Namespace, summary: Summary) -> list[str]:
    """Commands that continue from the result of `verb`; none after a failure.

    Parameters
    ----------
    verb
        Name of the verb.
    args
        Its arguments.
    summary
        Its summary; ``next`` has commands that the verb has made itself.
    """
    if not summary or summary.get("exit_code"):
        return []
    if "next" in summary:
        return list(summary["next"])
    make = _NEXT.get(verb)
    return make(args, summary) if make else []


def _command(*words: object) -> str:
    return shlex.join(["fembridge", *map(str, words)])


def _plot_folder(args: argparse.Namespace, summary: Summary) -> list[str]:
    return [_command("plot", summary["output"])]


def _after_touch(args: argparse.Namespace, summary: Summary) -> list[str]:
    return [_command("report", summary["output"]), _command("explore", summary["output"])]


def _after_stimuli(args: argparse.Namespace, summary: Summary) -> list[str]:
    if args.export:  # the lines are paths, for other programs
        return []
    ids = [str(row["id"]) for row in summary.get("stimuli", ()) if "id" in row]
    files = [str(file) for file in args.waveform or ()]
    if files:
        return [_command("simulate", "--waveform", files[0], "-o", "out")]
    name = ids[0] if args.ids and ids else "noise_25_250"
    return [_command("simulate", "--stimulus", name, "-o", "out")]


def _after_check(args: argparse.Namespace, summary: Summary) -> list[str]:
    """The map of the same deck, with the same options."""
    if summary.get("solver") != "calculix" or not getattr(args, "afferent", None):
        return []
    words = shlex.split(args.command_line)[2:]
    shared, skips = [], False
    for word in words:
        if skips:
            skips = False
        elif word in ("--stimulus", "--preindent-um", "--solver"):
            skips = True
        elif word != str(args.deck) and not word.startswith(("--stimulus=", "--preindent-um=")):
            shared.append(word)
    return [_command("map", "--base-deck", args.deck, *shared, "-o", "map")]


def _after_map(args: argparse.Namespace, summary: Summary) -> list[str]:
    if "map" not in summary:
        return []
    return [_command("simulate", "--stimulus", "all", "--response", summary["map"], "-o", "out")]


def _after_build_deck(args: argparse.Namespace, summary: Summary) -> list[str]:
    folders = [row["folder"] for row in summary["folders"]]
    if summary["solver"] != "calculix":
        return []
    if len(folders) == 1:
        return [_command("run", folders[0])]
    return [f"fembridge run {shlex.quote(str(Path(folders[0]).parent))}/*"]


def _after_run(args: argparse.Namespace, summary: Summary) -> list[str]:
    folders = [row["folder"] for row in summary.get("runs", ()) if row.get("folder")]
    if not folders:
        return []
    return [_command("ingest", folders[0], "-o", "traces.csv")]


def _after_ingest(args: argparse.Namespace, summary: Summary) -> list[str]:
    """Encode the traces; those of other models get a class, and an even step where they need it."""
    if summary.get("commands"):  # the listing of a file ends with its own
        return []
    output = summary.get("output")
    if output is None or summary.get("quantity") != "von-mises" or "traces" not in summary:
        return []
    words: list[object] = ["encode", output]
    if not all(trace.get("afferent") for trace in summary["traces"]):
        words += ["--afferent", "SA"]
    if summary["resample_ms"] is not None:
        words += ["--resample-ms", f"{summary['resample_ms']:g}"]
    return [_command(*words, "-o", "spikes")]


def _after_fit(args: argparse.Namespace, summary: Summary) -> list[str]:
    file = next((name for name in summary["files"] if str(name).endswith(".toml")), None)
    if file is None:
        return []
    parameters = Path(summary["output"]) / file
    words = ("--stimulus", "diharm", "--parameters", parameters, "-o", "predicted")
    return [_command("simulate", *words)]


def _after_threshold(args: argparse.Namespace, summary: Summary) -> list[str]:
    return [_command("validate", "-o", "validation")]


def _after_receptive_field(args: argparse.Namespace, summary: Summary) -> list[str]:
    return [_command("touch", "--shape", "sphere", "--press-n", "0.2", "-o", "touch")]


def _after_pad(args: argparse.Namespace, summary: Summary) -> list[str]:
    if "pad" not in summary:
        return []
    words = ("--pad", summary["pad"], "--shape", "sphere", "--press-um", "200", "-o", "touch")
    return [_command("touch", *words)]


def _after_doctor(args: argparse.Namespace, summary: Summary) -> list[str]:
    return [_command("simulate", "--stimulus", "noise_25_250", "-o", "out")]


_NEXT: Mapping[str, Callable[[argparse.Namespace, Summary], list[str]]] = {
    "simulate": _plot_folder,
    "encode": _plot_folder,
    "touch": _after_touch,
    "stimuli": _after_stimuli,
    "check": _after_check,
    "map": _after_map,
    "build-deck": _after_build_deck,
    "run": _after_run,
    "ingest": _after_ingest,
    "fit": _after_fit,
    "threshold": _after_threshold,
    "receptive-field": _after_receptive_field,
    "pad": _after_pad,
    "doctor": _after_doctor,
}
