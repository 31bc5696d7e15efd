"""Marc: an analysis as the text of an input deck.

Input version 15, as Mentat 2020 to 2023 write it. Each option is as in a real deck;
their composition was parsed back by a grammar of its own and never run, since no
Marc was at hand. The same analysis gives the same bytes, ASCII with LF line ends.
"""

from collections.abc import Iterator

from decks.analysis import Analysis
from decks.marc.contact import contact, contact_table
from decks.marc.history import history, parameters
from decks.marc.layout import Layout, lay_out
from decks.marc.lines import comment, integers, named, option
from decks.marc.mesh import mesh, sets
from decks.marc.motion import active, conditions, waveform
from decks.marc.post import post
from decks.marc.properties import geometry, materials

# Mentat names the job that it makes of a deck by the title, which real decks repeat
# as the name of the load case before the first increment.
JOB = "job1"

_VERSION = (15, 2, 0, 0)
_MEGABYTES = 25
_MULTIFRONTAL = 8
_NESTED_DISSECTION = 11
# Chosen by Mentat's "large strain": procedures by kind of material, among them
# updated Lagrange with additive decomposition.
_LARGE_STRAIN = (4, 213, 123, 130, 230, 123, 1, 0)
_RULE = "$..................."


def marc_deck(model: Analysis, *, probe: str = "rigid", post: str = "both") -> str:
    """Write `model` as a deck for Marc.

    Parameters
    ----------
    model
        What is computed, numbered.
    probe
        "rigid": a curve that a table moves; "meshed": elements of a second contact
        body whose nodes a table moves.
    post
        "binary" for ``job.t16``, "formatted" for ``job.t19``, or "both".

    Raises
    ------
    DeckError
        An element, a law, a probe or a kind of post file that it cannot write.
    """
    layout = lay_out(model, probe)
    blocks = (
        _parameters(layout),
        _model_definition(layout, post),
        [_RULE],
        history(layout),
        [_RULE],
    )
    return "\n".join(line for block in blocks for line in block) + "\n"


def _parameters(layout: Layout) -> Iterator[str]:
    yield named("title", JOB)
    yield from _heading(layout)
    yield named("extended")
    yield f"{'sizing':<30}" + integers([0, layout.elements, layout.nodes, 0])
    yield option("alloc", _MEGABYTES)
    for number in dict.fromkeys(part.element.number for part in layout.parts):
        yield option("elements", number)
    yield option("version", *_VERSION)
    yield option("table", 0, 0, 2, 1, 1, 0, 0, 1)
    yield option("processor", 1, 1, 1, 0)
    yield "$no list"
    if layout.model.large_strain:
        yield option("large stra", *_LARGE_STRAIN)
    yield named("all points")
    yield option("no echo", 1, 2, 3, 4)
    yield named("end")
    yield _RULE


def _heading(layout: Layout) -> Iterator[str]:
    analysis = layout.model
    yield from comment(f"fembridge: {analysis.title}")
    yield from comment("units: mm, N, s, MPa; plane strain, 1 mm thick")
    yield from comment(
        "x runs across the finger, y out of its pad; the ridge under the probe has "
        "its top at the origin"
    )
    for note in analysis.notes:
        yield from comment(note)
    yield from comment(
        "written option by option after decks of Marc Mentat 2020 to 2023; this deck "
        "was not run in Marc"
    )
    yield from comment("input file using extended precision")


def _model_definition(layout: Layout, post_kind: str) -> Iterator[str]:
    yield named("solver")
    yield integers([_MULTIFRONTAL, *[0] * 15])
    yield option("optimize", _NESTED_DISSECTION)
    yield from mesh(layout)
    yield from sets(layout)
    yield from materials(layout)
    yield from waveform(layout)
    yield from geometry(layout)
    yield from conditions(layout)
    yield from active(layout, JOB)
    yield from contact(layout)
    yield from contact_table()
    yield named("no print")
    yield from post(post_kind)
    yield from parameters(within_load_case=False)
    yield named("end option")
