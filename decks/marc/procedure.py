"""A Mentat procedure that sets segment-to-segment contact and writes the deck again.

Which number of a deck asks for segment-to-segment contact is not known; the command of
Mentat that does is. So Mentat reads our deck, sets it, and writes its own. Each command
is one of public procedures, two of them from their comments; none was run here, since no
Mentat was at hand.
"""

from decks.dialects import DIALECTS, REWRITTEN
from decks.dialects import JOB as FILES

# Mentat names the job that it makes of a deck by the deck's title.
JOB = "job1"
DECK = DIALECTS["marc"].deck
PROCEDURE = f"{FILES}.proc"

_READ = f"""\
| Segment-to-segment contact for {DECK}, of fembridge.
| In the deck's folder: mentat -bg with this file, or in Mentat.
| Each command is one of public Mentat procedures; none was run here. Where
| it stands in a comment there, this is said: look at Mentat's answer to it.
|
| An empty model; what is open and not saved is lost.
| Seen in: PFLigthart/Marc_Mentat_Scripting (Mentat 2021).
*new_model yes
|
| Read the deck.
| Seen in: public scripts that write decks for Mentat 2021.
*import marc_read "{DECK}"
|
| The job that Mentat makes of it is named by the deck's title.
| Seen in: the same scripts, after an import; Nour-ept (Mentat 2020).
*edit_job {JOB}
|
| Segment-to-segment contact; node_segment is the other one.
| Seen in: stabix, in a comment there (Mentat 2010 and later).
*job_option contact_method:segment_segment
"""
_FRICTION = """\
|
| As the deck has it already. Older releases know it as
| *job_option frictype:coulomb_bilinear
| Seen in: a public script, in a comment there; stabix for the older word.
*job_option friction_model:coulomb_bilinear
"""
# No command was seen for binary results alone, which is Mentat's own choice.
_RESULTS = {
    "binary": "",
    "text": """\
|
| Formatted post file (.t19).
| Seen in: public scripts.
*job_option post:ascii
""",
    "both": """\
|
| Formatted post file (.t19) and binary one (.t16).
| Seen in: public scripts.
*job_option post:both
""",
}
_WRITE = f"""\
|
| Take the job's options over.
| Seen in: Nour-ept (Mentat 2020).
*update_job
|
| Write the deck that Marc is to run.
| Seen in: PFLigthart/Marc_Mentat_Scripting (Mentat 2021).
*write_marc "{FILES}{REWRITTEN}.dat" yes
|
| Compare the option contact of both decks: what differs is the flag.
"""


def mentat_procedure(*, results: str = "both", friction: bool = True) -> str:
    """The procedure for a deck that was written with these `results` and this `friction`.

    Lines that start with ``|`` are comments.
    """
    return _READ + (_FRICTION if friction else "") + _RESULTS[results] + _WRITE
