"""Print the completion of a shell: verbs, options and choices after the Tab key.

Load it in your shell's start file: in ~/.bashrc `source <(fembridge completion bash)`, in ~/.zshrc
the same with zsh after `autoload -Uz compinit; compinit`, in fish
`fembridge completion fish > ~/.config/fish/completions/fembridge.fish`.
"""

import argparse
from pathlib import Path
from typing import Any

EXAMPLE = "fembridge completion bash"

PRINTS_ITS_RESULT = True  # a text, which --quiet leaves

SHELLS = ("bash", "zsh", "fish", "tcsh")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    parser.add_argument("shell", choices=SHELLS, metavar="SHELL", help=", ".join(SHELLS))


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Print the completion; the summary has it."""
    import shtab

    parser = args.complete_parser()
    _name_values(parser)
    text = shtab.complete(parser, args.shell)
    print(text)
    return {"shell": args.shell, "completion": text}


def _name_values(parser: argparse.ArgumentParser) -> None:
    """Let options of paths complete files, and options of stimuli the sets of the catalogue."""
    import shtab

    from decks.stimuli import CATALOGUE, set_name

    sets = list(dict.fromkeys(["all", *(set_name(entry) for entry in CATALOGUE)]))
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for child in dict.fromkeys(action.choices.values()):
                _name_values(child)
        elif "--stimulus" in action.option_strings:
            action.choices = sets
        elif action.type is Path:
            action.complete = shtab.FILE  # type: ignore[attr-defined] # shtab's own
