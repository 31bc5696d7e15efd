"""The deck's options against real decks: their order, their fields, their numbers."""

import numpy as np
import pytest

from decks.dialects import DIALECTS
from decks.marc.deck import marc_deck
from decks.marc.element_types import MARC_TYPES
from fembridge.errors import DeckError

PFL, NOUR = "pfl_example_model_0", "nour_plastic"


def test_the_deck_is_ascii_with_lf_and_no_line_wider_than_mentats(built):
    _, _, deck = built
    assert deck.text.isascii()
    assert deck.text.endswith("\n")
    assert not set("\r\t") & set(deck.text)
    assert max(map(len, deck.text.splitlines())) <= 180
    assert not [line for line in deck.text.splitlines() if line != line.rstrip()]


def test_the_same_model_gives_the_same_bytes(make_model):
    for probe in ("rigid", "meshed"):
        assert marc_deck(make_model(), probe=probe) == marc_deck(make_model(), probe=probe)


@pytest.mark.parametrize("name", [PFL, NOUR])
def test_options_stand_in_the_order_of_a_real_deck(built, sample, name):
    _, _, deck = built
    ours, theirs = (
        [keyword for k, keyword in enumerate(words) if keyword not in words[:k]]
        for words in (deck.keywords, sample(name).keywords)
    )
    common = set(ours) & set(theirs)
    assert {"connectivity", "isotropic" if name == NOUR else "contact", "post"} < common
    assert [word for word in ours if word in common] == [word for word in theirs if word in common]


def test_the_history_has_the_order_of_a_real_one(built, sample):
    def after_end_option(deck):
        words = deck.keywords[deck.keywords.index("end option") + 1 :]
        return [word for word in words if word not in ("auto step", "auto load")]

    _, _, deck = built
    ours = after_end_option(deck)
    assert ours[-2:] == ["time step", "continue"]
    ours.remove("time step")  # Mentat has it within its `auto step`
    assert ours == after_end_option(sample(PFL))


PARAMETERS = ("title", "extended", "alloc", "table", "processor", "all points")


@pytest.mark.parametrize("keyword", [*PARAMETERS, "large stra", "no echo", "version"])
def test_parameters_are_those_of_a_real_deck(built, sample, keyword):
    _, _, deck = built
    ours, theirs = deck.all(keyword)[0], sample(PFL).all(keyword)[0]
    assert ours.line == theirs.line
    assert ours.rows == theirs.rows


def widths(option, count):
    """Length of each line, without the name that some end in."""
    names = {"con intera": {0: 20}, "con table": {0: 30}, "contact": {4: 80}}
    cuts = names.get(option.keyword, {})
    rows = [row[: cuts.get(k)] for k, row in enumerate(option.rows[:count])]
    return [len(row) for row in rows]


# Lines of an option that do not depend on how much there is of something.
FIXED_LINES = {"contact": 11, "con intera": 23, "con table": 7, "contact table": 2}


@pytest.mark.parametrize("keyword", FIXED_LINES)
def test_contact_has_as_many_fields_a_line_as_a_real_deck(built, sample, keyword):
    _, _, deck = built
    ours, theirs = deck.all(keyword)[0], sample(PFL).all(keyword)[0]
    count = FIXED_LINES[keyword]
    assert len(widths(ours, count)) == count
    assert widths(ours, count) == widths(theirs, count)


def test_geometry_and_table_have_as_many_fields_as_in_a_real_deck(built, sample):
    _, _, deck = built
    real = sample(PFL)
    ours, theirs = deck.one("geometry"), real.one("geometry")
    assert ours.rows[:2] == theirs.rows[:2]  # plane strain
    assert ours.widths[3:] == theirs.widths[3:] == [140, 0]
    ours, theirs = deck.one("table", "waveform"), real.all("table")[1]
    assert ours.rows[0] == theirs.rows[0]
    assert ours.widths[1:3] == theirs.widths[1:3] == [160, 40]


def test_what_is_held_is_written_as_in_a_real_deck(built, sample):
    _, _, deck = built
    ours, theirs = deck.one("fixed disp").rows, sample(PFL).one("fixed disp").rows
    assert ours[1][:60] == theirs[1][:60]
    assert ours[2:6] == theirs[2:6]
    assert (ours[1][60:], ours[6]) == ("held", "held_nodes")
    assert (theirs[1][60:], theirs[6]) == ("apply1", "apply1_nodes")


def test_materials_have_the_fields_of_a_real_one(built, sample):
    _, _, deck = built
    theirs = sample(NOUR).one("isotropic")
    for ours in deck.all("isotropic"):
        assert ours.line == theirs.line
        assert ours.rows[0] == theirs.rows[0]
        assert ours.rows[1][10:90].split() == ["elastic", "10", "0", "0", "0"]
        assert ours.rows[1][50:90] == theirs.rows[1][50:90]
        assert ours.widths[2:] == theirs.widths[2:]
        assert ours.rows[3] == "         0" * 8
        assert ours.rows[4:] == theirs.rows[4:]


def test_what_no_one_chose_is_mentats(built, sample):
    _, _, deck = built
    real = sample(PFL)
    for ours, theirs in zip(deck.all("parameters"), real.all("parameters"), strict=True):
        assert ours.rows == theirs.rows
    assert deck.one("contact").rows[1:4] == real.one("contact").rows[1:4]
    ours, theirs = deck.one("con intera"), real.one("con intera")
    assert ours.line == theirs.line
    changed = [k for k in range(len(theirs.rows)) if ours.rows[k] != theirs.rows[k]]
    assert set(changed) <= {0, 2, 5}  # name, type of the second body, friction
    ours, theirs = deck.one("con table"), real.one("con table")
    assert ours.rows[2:] == theirs.rows[2:]
    assert deck.one("optimize").line == real.one("optimize").line
    assert deck.one("solver").rows == sample(NOUR).one("solver").rows


def test_sizes_count_a_pressure_node_an_element(built, columns):
    model, _, deck = built
    integers, _ = columns
    zero, elements, nodes, last = integers(deck.one("sizing").line[30:])
    assert (zero, last) == (0, 0)
    assert elements == len(deck.elements())
    pressures = elements if model.element in ("CPE4H", "CPE4RH") else 0
    assert nodes == len(deck.nodes()) + pressures
    highest = max(node for _, *nodes_ in deck.elements().values() for node in nodes_)
    assert highest == nodes


def test_the_real_deck_counts_its_nodes_in_the_same_way(sample, columns):
    integers, _ = columns
    deck = sample(PFL)
    _, elements, nodes, _ = integers(deck.one("sizing").line[30:])
    assert (elements, nodes - len(deck.nodes())) == (2461, 2461)


def test_the_papers_mesh_less_its_pressures_would_be_its_corners(make_model, columns):
    """36 346 nodes of 17 815 elements leave 18 531: as many more as here, of 18 000."""
    model = make_model()
    integers, _ = columns
    text = marc_deck(model)
    (line,) = [row for row in text.splitlines() if row.startswith("sizing")]
    _, elements, nodes, _ = integers(line[30:])
    assert nodes - elements == len(model.mesh.node_mm)


def test_each_type_of_element_is_declared_once(built):
    model, _, deck = built
    declared = [int(option.word) for option in deck.all("elements")]
    used = {kind for kind, *_ in deck.elements().values()}
    assert sorted(declared) == sorted(used)
    assert MARC_TYPES[model.element].number == declared[0]


def test_small_strain_is_asked_for_by_leaving_the_large_one_out(make_model, read_deck):
    deck = read_deck(marc_deck(make_model(large_strain=False)))
    assert "large stra" not in deck.keywords


def test_comments_tell_units_and_what_is_not_known(built):
    _, _, deck = built
    head = " ".join(line for line in deck.text.splitlines() if line.startswith("$"))
    words = head.replace("$....", "")
    assert "units: mm, N, s, MPa" in words
    assert "was not run in Marc" in words
    before_contact = " ".join(deck.all("contact")[0].comments).replace("$....", "")
    assert "segment-to-segment contact is not known" in before_contact
    assert "procedure beside it" in before_contact


# ---- Refusals


def test_an_element_that_no_marc_type_is_known_for_is_refused(make_model):
    model = make_model("CPE4R")
    with pytest.raises(DeckError, match=r"no Marc element for 'CPE4R'.*CPE4H \(80\)"):
        marc_deck(model)


def test_a_neo_hookean_skin_is_refused_with_the_reason(make_model):
    with pytest.raises(DeckError, match=r"stratum_corneum is neo-hookean.*certainty"):
        marc_deck(make_model(law="neo-hookean"))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"probe": "soft"}, "probe 'soft', expected rigid or meshed"),
        ({"post": "text"}, "post 'text', expected one of binary, formatted, both"),
    ],
)
def test_unknown_words_are_refused(make_model, options, words):
    with pytest.raises(DeckError, match=words):
        marc_deck(make_model(), **options)


def test_a_time_that_is_not_finite_is_refused(make_model):
    model = make_model()
    time_s = model.motion.time_s.copy()
    time_s[1] = np.nan
    object.__setattr__(model.motion, "time_s", time_s)
    with pytest.raises(DeckError, match="expected a finite one"):
        marc_deck(model)


def test_the_table_of_dialects_has_the_same_types():
    assert DIALECTS["marc"].elements == {
        name: str(kind.number) for name, kind in MARC_TYPES.items()
    }


def test_every_dialects_element_can_be_written(make_model):
    for name in DIALECTS["marc"].elements:
        model = make_model(name)
        assert f"elements            {MARC_TYPES[name].number:10d}" in marc_deck(model)
