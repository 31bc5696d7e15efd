"""A random own deck with another waveform: three places change and nothing else does.

A deck is put together of pieces, each with what shall become of it: the same, or what
this file's own few lines of text make of the waveform.
"""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from decks.motion import Motion
from decks.own_model import Request
from decks.own_model.inp_deck import rebase_inp, solver_of
from fembridge.errors import DeckError

DT_S = 0.0005
NODES = b"1, 0., 0.\n7,1.5,-2.\n12, 3.25, -4.5, 0.\n"

# Data of cards that mean nothing here: any bytes but a line end, a star, an "=".
junk_line = st.binary(max_size=20).map(
    lambda raw: bytes(one for one in raw if one not in b"\r\n*=")
)
comment = junk_line.map(lambda raw: b"** " + raw)
outside_cards = st.sampled_from(
    [
        b"*EQUATION",
        b"*Material, name=SKIN",
        b"*surface, NAME=S, TYPE=NODE",
        b"*ELSET, ELSET=FEMBRIDGE",
        b" *Amplitude, name=OTHER",
        b"*NSET, NSET=AFFERENT_PC",
    ]
)
inside_cards = st.sampled_from(
    [
        b"*NODE PRINT, NSET=N",
        b"*contact file",
        b"*CLOAD",
        b"*Boundary",
        b"*CONTROLS, PARAMETERS=FIELD",
    ]
)


def noise(cards):
    """Cards with data, comments and blank lines, none of which is to change."""
    block = st.tuples(cards, st.lists(st.one_of(junk_line, comment), max_size=3))
    return st.lists(
        st.one_of(comment.map(lambda line: [line]), block.map(lambda b: [b[0], *b[1]])), max_size=3
    ).map(lambda groups: [line for group in groups for line in group])


requests = st.lists(
    st.sampled_from(
        [
            [b"*NODE FILE, NSET=N, FREQUENCY=3", b"U, RF"],
            [b"*El File", b"S,E", b"ME"],
            [b"*node output", b"u"],
            [b" *ELEMENT OUTPUT, DOUBLE", b"S"],
        ]
    ),
    max_size=3,
)


def kept(lines):
    return [(line, [line]) for line in lines]


@st.composite
def decks(draw):
    """Lines of a deck, each with the lines that it becomes; motion and request."""
    count = draw(st.integers(2, 130))
    depth_mm = (
        np.array(
            [0.0, *draw(st.lists(st.integers(-200_000, 200_000), min_size=count, max_size=count))]
        )
        * 1e-6
    )
    motion = Motion(np.arange(count + 1) * DT_S, depth_mm, DT_S, 0)
    factor = draw(st.sampled_from([1.0, 0.5, 2.0, 0.25]))
    wanted = draw(st.sampled_from([{}, {"SA": 7}, {"SA": 7, "RA": 12, "PC": 7}]))
    binary = draw(st.booleans())
    result = []

    def keep(*lines):
        result.extend(kept(lines))

    def change(old, new):
        result.append((old, new))

    keep(*draw(noise(outside_cards)))
    keep(draw(st.sampled_from([b"*NODE", b"\t*node , nset = N"])))
    keep(*NODES.splitlines())
    keep(*draw(noise(outside_cards)))
    keep(draw(st.sampled_from([b"*AMPLITUDE, NAME=Press", b"*amplitude,name=PRESS "])))
    keep(*draw(st.lists(comment, max_size=2)))
    times = [f"{time_s:.7f}" for time_s in motion.time_s]
    values = [f"{value / factor + 0.0:.9f}" for value in depth_mm]
    pairs = [f"{t}, {v}" for t, v in zip(times, values, strict=True)]
    table = [", ".join(pairs[k : k + 4]).encode() for k in range(0, len(pairs), 4)]
    change(b"0., 0., 1., 1.,", table)
    for line in draw(st.lists(st.sampled_from([b"2., 1.", b"", b"** more"]), max_size=3)):
        change(line, [] if line.startswith(b"2") else [line])
    keep(*draw(noise(outside_cards)))

    sets = []
    nodes = list(dict.fromkeys(wanted.values()))
    for name, node in wanted.items():
        sets += [f"*NSET, NSET=AFFERENT_{name}".encode(), f"{node},".encode()]
    if wanted:
        sets += [b"*NSET, NSET=FEMBRIDGE_OUTPUT"]
        sets += [", ".join(map(str, nodes)).encode() + b","]
    limit = draw(st.sampled_from([None, 3, 100000]))
    head = b"*Step, nlgeom"
    if limit is None:
        new = head if count <= 100 else head + b", INC=%d" % count
    else:
        new = head + (b", inc=%d" % limit if limit >= count else b", INC=%d" % count)
        head += b", inc=%d" % limit
    tail = draw(st.sampled_from([b"", b" \t"]))
    change(head + tail, [*sets, new + tail])
    keep(*draw(st.lists(comment, max_size=1)))
    keyword = draw(st.sampled_from([b"*STATIC", b"*static, solver=SPOOLES", b"*VISCO"]))
    direct = draw(st.sampled_from([b"", b", DIRECT"]))
    change(keyword + direct, [keyword + b", DIRECT"])
    keep(*draw(st.lists(comment, max_size=1)))
    increments = f"{DT_S:.7f}, {count * DT_S:.7f}".encode()
    change(draw(st.sampled_from([b" 0.1 , 1.", b"1e-3,2.,1.d-9,.1"])), [increments])
    keep(*draw(noise(inside_cards)))
    keep(b"*BOUNDARY, AMPLITUDE=press", b"PROBE, 2, 2, %r" % -factor)
    for request in draw(requests):
        for line in request:
            change(line, [])
        keep(*draw(st.lists(comment, max_size=1)))
        keep(*draw(noise(inside_cards)))
    kind, element, double = ("OUTPUT", "ELEMENT", ", DOUBLE") if binary else ("FILE", "EL", "")
    on = ", NSET=FEMBRIDGE_OUTPUT" if wanted else ""
    ours = [
        f"*NODE {kind}{on}, FREQUENCY=1{double}",
        "U",
        f"*{element} {kind}{on}, FREQUENCY=1{double}",
        "S",
    ]
    change(b"*End step", [*(line.encode() for line in ours), b"*End step"])
    keep(*draw(noise(outside_cards)))
    request = Request(afferents=wanted, results="binary" if binary else "text")
    return result, motion, request, draw(st.sampled_from([b"\n", b"\r\n"]))


def put_together(pieces, end):
    old = b"".join(line + end for line, _ in pieces)
    new = b"".join(line + end for _, lines in pieces for line in lines)
    return old, new


@settings(settings.get_profile("costly"))
@given(built=decks())
def test_only_waveform_increments_and_output_change_and_another_on_top_is_that_one_alone(built):
    pieces, motion, request, end = built
    deck, expected = put_together(pieces, end)
    assume(not (request.afferents and b"AFFERENT_PC" in deck))
    rebased = rebase_inp(deck, motion, request)
    assert rebased.deck == expected
    places = {"SA": (1.5, -2.0), "RA": (3.25, -4.5), "PC": (1.5, -2.0)}
    assert {name: site.position_mm for name, site in rebased.sites.items()} == {
        name: places[name] for name in request.afferents
    }
    if b"inc=3" not in deck:
        longer = Motion(np.arange(160) * DT_S, np.linspace(0, 0.1, 160), DT_S, 0)
        on_top = rebase_inp(rebased.deck, longer, request)
        assert on_top.deck == rebase_inp(deck, longer, request).deck


@settings(settings.get_profile("costly"))
@given(
    built=decks(),
    cut=st.tuples(st.floats(0, 1), st.floats(0, 1)),
    put=st.one_of(
        st.binary(max_size=4),
        st.sampled_from([b"\n*STEP\n", b"=", b",", b"\n*INCLUDE, INPUT=x\n", b'"']),
    ),
)
def test_a_damaged_deck_is_rebased_or_refused_and_nothing_else(built, cut, put):
    pieces, motion, request, end = built
    deck, _ = put_together(pieces, end)
    first, last = sorted(int(share * len(deck)) for share in cut)
    damaged = deck[:first] + put + deck[last if last - first < 40 else first :]
    try:
        rebased = rebase_inp(damaged, motion, request, resolver=lambda name: b"1, 2\n")
    except DeckError as error:
        assert str(error)
        return
    assert solver_of(rebased.deck) == solver_of(damaged)
