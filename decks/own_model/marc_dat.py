"""An own Marc deck with the waveform in it; all else is kept to the byte.

Changed are: the points of one table; the increments of the load case it drives; the
output request. The depth is put into the table so that what the table is multiplied
by becomes the probe's depth in the deck's unit of length; time is taken to be in s,
and to run on over load cases. Not run in Marc: the deck's grammar was learned from
decks that Mentat wrote.
"""

from collections.abc import Mapping

from decks.marc_grammar.deck import MarcDeck
from decks.marc_grammar.reader import Resolver, read_marc_deck
from decks.marc_grammar.table import Table
from decks.motion import Motion
from decks.own_model.marc_drive import driving_table, one_factor
from decks.own_model.marc_edits import Edits, reals_line, set_integer
from decks.own_model.marc_output import set_output
from decks.own_model.marc_steps import ChosenCase, acting_drives, choose_case, set_increments
from decks.own_model.request import Rebased, Request
from fembridge.errors import DeckError

_POINTS = 1  # field, from 0, of a table's second line


def rebase_marc(
    data: bytes, motion: Motion, request: Request, resolver: Resolver | None = None
) -> Rebased:
    """Put `motion` into a Marc deck.

    Parameters
    ----------
    data
        The deck.
    motion
        The probe's way into the skin.
    request
        Which table and load case, which nodes, and the deck's unit of length.
    resolver
        Gives the bytes of an included file by its name, None where it has none.

    Raises
    ------
    DeckError
        What is asked for is missing from the deck or could be several things; the
        message names the lines.
    """
    deck = read_marc_deck(data, resolver=resolver)
    table, drives = driving_table(deck, request.amplitude)
    chosen = choose_case(deck, request.step, drives)
    drives = acting_drives(chosen, drives)
    factor = one_factor(table, drives)
    edits = Edits(data)
    remarks = [*deck.remarks, f"{table.line.place}: table {table.name!r} is the waveform"]
    remarks += [f"{use.line.place}: it drives {use.what}, factor {use.value:g}" for use in drives]
    if factor != 1.0:
        remarks.append(f"{drives[0].line.place}: the table holds depth divided by {factor:g}")
    remarks += _set_points(edits, table, motion, chosen, request.length_mm * factor)
    remarks += set_increments(edits, deck, chosen, motion)
    remarks += set_output(edits, deck, chosen.case.number, request.results)
    return Rebased(
        edits.changed(),
        tuple(remarks),
        _places(deck, request.afferents, request.length_mm),
        tuple(dict.fromkeys(each.name for each in deck.includes)),
        chosen.start_s,
    )


def _set_points(
    edits: Edits, table: Table, motion: Motion, chosen: ChosenCase, unit_mm: float
) -> list[str]:
    """Put time and depth into the table, from when the load case starts."""
    times_s = (motion.time_s + chosen.start_s).tolist()
    points = list(zip(times_s, (motion.depth_mm / unit_mm).tolist(), strict=True))
    told = []
    if chosen.start_s > 0:
        points.insert(0, (0.0, points[0][1]))
        told.append(
            f"{table.line.place}: the waveform starts at {chosen.start_s:g} s, when "
            f"{chosen.told} does"
        )
    if chosen.after:
        after = chosen.after[0]
        told.append(
            f"{after.line.place}: load case {after.number} follows: behind its last "
            "point the table goes on as its second line says"
        )
    layout = table.option.layout
    like = table.rows[-1].text
    set_integer(edits, table.rows[1], layout, _POINTS, len(points))
    edits.replace(table.rows[2], *(reals_line(each, layout, like) for each in points))
    for line in table.rows[3:]:
        edits.replace(line)
    return told


def _places(
    deck: MarcDeck, afferents: Mapping[str, int], length_mm: float
) -> dict[str, tuple[float, float]]:
    """Where the afferents' nodes are, in mm.

    Raises
    ------
    DeckError
        The deck has no such node.
    """
    places = {}
    for name, node in afferents.items():
        place = deck.coordinates.of(node)
        if place is None or len(place) < 2:
            raise _no_node(deck, name, node)
        places[name] = (float(place[0]) * length_mm, float(place[1]) * length_mm)
    return places


def _no_node(deck: MarcDeck, name: str, node: int) -> DeckError:
    problem = f"afferent {name}: node {node} has no coordinates"
    unread = [each.name for each in deck.includes if not each.followed]
    if unread:
        problem += f"; included and not read: {', '.join(unread)}"
    line = deck.coordinates.line
    return DeckError(problem) if line is None else line.refuse(problem)
