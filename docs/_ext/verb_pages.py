"""A page for each verb of the command line, from its parser and from ``outputs.md``.

The pages are written into ``reference/commands`` before Sphinx reads its sources; the folder is
not part of the repository.
"""

import argparse
import re
from pathlib import Path

from sphinx.application import Sphinx

from fembridge import cli

FOLDER = Path("reference/commands")

TOPICS = {
    "Stimulus": "--stimulus --waveform --preindent-um --seed --slide-mm-per-s --dt-ms "
    "--full-scale-um --window-ms --newton-per-um --mpa-per-um --frequencies-hz --frequency-hz "
    "--depth-um --retract-um --steps --background-um --columns --gain-pa --resample-ms",
    "Finger and probe": "--finger --probe-shape --probe-diameter-mm --probe-fillet-mm --probe-x-mm "
    "--response --pad --ridges --plane --spacing-mm --reach-mm --plate-mm --step-mm --depth-mm",
    "Your deck": "--base-deck --amplitude --move --step --length-unit --increments --shell-face "
    "--results --runs",
    "Afferents": "--afferent --afferents --unit --units --endings-mm --sa-von-mises --parameters "
    "--drive --cells --calibration --derivative --criterion --times-threshold",
    "Recorded data": "--observed --recorded --thresholds --timing --spikes --spike-distance "
    "--impulses --distance --family --held-out --allow-missing",
    "Search": "--evaluations --population --rule --seeds --name",
    "Solver": "--solver --method --stored --element --whole-section --inertia --law --threads "
    "--jobs --time-limit --stall-limit --iteration-limit --no-cache --executor --scheduler --yes "
    "--force",
    "Output": "--output --export --animate --no-plot --no-raster --json --help-outputs --quiet",
}
"""Sections of the options that a verb declares outside its own groups, in the order of the page."""
MANY = 10
"""Up to this number of options a verb needs no sections."""


def verb_page(verb: str) -> str:
    """The page of `verb` in MyST: usage, options by group, example and written files."""
    parser, command = cli._parser([verb])
    verbs = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    verb_parser = verbs.choices[verb]
    summary, _, details = (command.__doc__ or "").partition("\n\n")
    pieces = [
        f"# fembridge {verb}\n\n{_text(summary)}",
        f"```sh\n{command.EXAMPLE}\n```",
        _details(details),
        f"## Options\n\n```text\n{verb_parser.format_usage().removeprefix('usage: ').strip()}\n```",
    ]
    formatter = verb_parser._get_formatter()
    for title, actions in _sections(verb_parser).items():
        rows = [
            f"`{formatter._format_action_invocation(action)}`\n"
            f": {_text(formatter._expand_help(action)) if action.help else '–'}"
            for action in actions
        ]
        joined = "\n\n".join(rows)
        pieces.append(f"### {title}\n\n::::{{container}} options\n{joined}\n::::")
    if outputs := _outputs(verb):
        pieces.append(f"## Files\n\n{outputs}")
    return "\n\n".join(filter(None, pieces)) + "\n"


def _sections(parser: argparse.ArgumentParser) -> dict[str, list[argparse.Action]]:
    """The options of a verb by section: its own groups, and the others by `TOPICS`."""
    arguments, options, *groups = (
        (str(group.title), _shown(group)) for group in parser._action_groups
    )
    sections = {"Arguments": arguments[1]}
    output: list[argparse.Action] = []
    if len(options[1]) <= MANY and not groups:
        sections["Options"] = options[1]
    else:
        topic_of = {name: topic for topic, names in TOPICS.items() for name in names.split()}
        if any("--evaluations" in action.option_strings for action in options[1]):
            topic_of["--seed"] = "Search"
        by_topic: dict[str, list[argparse.Action]] = {topic: [] for topic in (*TOPICS, "Other")}
        for action in options[1]:
            names = (topic_of[name] for name in action.option_strings if name in topic_of)
            by_topic[next(names, "Other")].append(action)
        output = by_topic.pop("Output")
        sections |= by_topic
    for title, actions in groups:
        sections[title[0].upper() + title[1:]] = actions
    sections["Output"] = output
    return {title: actions for title, actions in sections.items() if actions}


def _shown(group: argparse._ArgumentGroup) -> list[argparse.Action]:
    """The options of a group that its help page has."""
    return [
        action
        for action in group._group_actions
        if action.help != argparse.SUPPRESS and action.dest != "help"
    ]


def _text(text: str) -> str:
    """Plain `text` of a help page as MyST: no markup but ``code``, options and our pages."""
    pieces = re.split(r"(``?[^`]+``?|(?<![\w-])--?[a-z][\w-]*|docs/[\w/]+\.md)", text.strip())
    return "".join(
        f"[{piece.rpartition('/')[2]}](../../{piece.removeprefix('docs/')})"
        if piece.startswith("docs/")
        else f"`{piece.strip('`')}`"
        if piece.startswith(("`", "-"))
        else re.sub(r"([*_<>\[\]$#])", r"\\\1", piece)
        for piece in pieces
    )


def _details(text: str) -> str:
    """The description of a verb as MyST; its indented lines are a list, terms before two blanks."""
    lines: list[str] = []
    for line in text.strip().splitlines():
        item = re.fullmatch(r"  (\S.*?)(?:  +(\S.*))?", line)
        if item and item[2]:
            lines.append(f"- `{item[1]}`: {_text(item[2])}")
        elif item:
            lines.append(f"- {_text(item[1])}")
        elif line.startswith("   ") and lines and lines[-1].startswith("-"):
            lines[-1] += " " + _text(line)
        else:
            if lines and lines[-1].startswith("-"):
                lines.append("")
            lines.append(_text(line))
    return re.sub(r"(?m)^(?!- )(.+)\n- ", r"\1\n\n- ", "\n".join(lines))


def _outputs(verb: str) -> str:
    """The written files of `verb`, each with the columns of its table."""
    blocks = []
    for file, (description, columns) in cli.outputs_of(verb).items():
        block = f"`{file}`\n: {description}"
        if columns:
            rows = [f"| `{name}` | {unit} | {meaning} |" for name, unit, meaning in columns]
            table = "\n".join(["| column | unit | meaning |", "|---|---|---|", *rows])
            block += "\n\n" + "\n".join(f"  {row}" for row in table.splitlines())
        blocks.append(block)
    return "\n\n".join(blocks)


def index_page() -> str:
    """The list of all verbs in their groups, with a table of contents."""
    pieces = [
        "# Commands\n\nEach command has `--help` with an example and `--help-outputs` with the "
        "files that it writes; `--json` prints results and errors for programs. The exit code is "
        "0 (done), 1 (an error, in one line) or 2 (usage error)."
    ]
    for title, verbs in cli._GROUPS.items():
        rows = [f"| [`{verb}`]({verb}.md) | {_text(line)} |" for verb, line in verbs.items()]
        table = "\n".join(["| command | purpose |", "|---|---|", *rows])
        pieces.append(f"## {title.capitalize()}\n\n{table}")
    pieces.append("```{toctree}\n:hidden:\n\n" + "\n".join(cli.VERBS) + "\n```")
    return "\n\n".join(pieces) + "\n"


def write_pages(app: Sphinx) -> None:
    """Write a page for each verb, where it differs from the present one."""
    folder = Path(app.srcdir) / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    pages = {verb: verb_page(verb) for verb in cli.VERBS} | {"index": index_page()}
    for old in folder.glob("*.md"):
        if old.stem not in pages:
            old.unlink()
    for name, text in pages.items():
        page = folder / f"{name}.md"
        if not page.is_file() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before Sphinx looks for its sources."""
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True}
