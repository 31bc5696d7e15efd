"""A Mentat procedure that sets segment-to-segment contact and writes the deck again.

Which number of a deck asks for segment-to-segment contact is not known; the command
of Mentat that does is. So Mentat reads our deck, is told, and writes its own.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PurePath

from decks.dialects import REWRITTEN
from decks.marc.deck import JOB
from fembridge.errors import DeckError

# Kinds of post file in Mentat's words; no command was seen for the binary one alone,
# which is Mentat's own choice.
_POST_WORDS = {"binary": None, "formatted": "ascii", "both": "both"}

# A quote ends a name, a line end the command; the others are Mentat's own signs.
_FORBIDDEN = "\"'|#$@*"


@dataclass(frozen=True, slots=True)
class Command:
    """A command of Mentat, what it is for, and where public procedures have it."""

    text: str
    purpose: str
    source: str


def commands(deck_name: str, post: str, *, friction: bool = True) -> tuple[Command, ...]:
    """Give the commands for the deck `deck_name`, in their order.

    `post` is the kind of post file, see `decks.marc.post.KINDS`; without `friction`
    the deck has none, and Mentat is told nothing about it.
    """
    kind = _POST_WORDS[post]
    files = Command(
        f"*job_option post:{kind}",
        "Formatted post file (.t19)" + " and binary one (.t16)" * (kind == "both") + ".",
        "public scripts",
    )
    law = Command(
        "*job_option friction_model:coulomb_bilinear",
        "As the deck has it already. Older releases know it as\n"
        "*job_option frictype:coulomb_bilinear",
        "a public script, in a comment there; stabix for the older word",
    )
    return (
        Command(
            "*new_model yes",
            "An empty model; what is open and not saved is lost.",
            "PFLigthart/Marc_Mentat_Scripting (Mentat 2021)",
        ),
        Command(
            f'*import marc_read "{deck_name}"',
            "Read the deck.",
            "public scripts that write decks for Mentat 2021",
        ),
        Command(
            f"*edit_job {JOB}",
            "The job that Mentat makes of it is named by the deck's title.",
            "the same scripts, after an import; Nour-ept (Mentat 2020)",
        ),
        Command(
            "*job_option contact_method:segment_segment",
            "Segment-to-segment contact; node_segment is the other one.",
            "stabix, in a comment there (Mentat 2010 and later)",
        ),
        *([law] if friction else []),
        *([files] if kind else []),
        Command("*update_job", "Take the job's options over.", "Nour-ept (Mentat 2020)"),
        Command(
            f'*write_marc "{rewritten_name(deck_name)}" yes',
            "Write the deck that Marc is to run.",
            "PFLigthart/Marc_Mentat_Scripting (Mentat 2021)",
        ),
    )


def mentat_procedure(
    deck_name: str = "job.dat", *, post: str = "both", friction: bool = True
) -> str:
    """Give the text of a procedure file for the deck `deck_name` in the same folder.

    `post` and `friction` are what the deck was written with, see `commands`. Lines
    that start with ``|`` are comments. Each command stands in a public
    procedure, two of them in its comments; none was run here, since no Mentat was at
    hand.

    Raises
    ------
    DeckError
        A name that Mentat would not take for a file's, an unknown kind of post file.
    """
    if post not in _POST_WORDS:
        raise DeckError(f"post {post!r}, expected one of {', '.join(_POST_WORDS)}")
    said = commands(_checked(deck_name), post, friction=friction)
    return "\n".join(_lines(deck_name, said)) + "\n"


def rewritten_name(deck_name: str) -> str:
    """Name the deck that Mentat writes: ``job.dat`` gives ``job_s2s.dat``."""
    path = PurePath(deck_name)
    return path.with_name(f"{path.stem}{REWRITTEN}.dat").as_posix()


def _checked(deck_name: str) -> str:
    plain = deck_name.isascii() and deck_name.isprintable()
    if not (plain and PurePath(deck_name).stem.strip()) or any(
        sign in deck_name for sign in _FORBIDDEN
    ):
        raise DeckError(
            f"deck name {deck_name!r}: expected plain letters, without any of "
            f"{' '.join(_FORBIDDEN)}"
        )
    return deck_name


def _lines(deck_name: str, said: tuple[Command, ...]) -> Iterator[str]:
    yield f"| Segment-to-segment contact for {deck_name}, of fembridge."
    yield "| In the deck's folder: mentat -bg with this file, or in Mentat."
    yield "| Each command is one of public Mentat procedures; none was run here. Where"
    yield "| it stands in a comment there, this is said: look at Mentat's answer to it."
    for command in said:
        yield "|"
        for line in command.purpose.splitlines():
            yield f"| {line}"
        yield f"| Seen in: {command.source}."
        yield command.text
    yield "|"
    yield "| Compare the option contact of both decks: what differs is the flag."
