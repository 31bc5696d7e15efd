"""Our deck by a plain reader, by our grammar and against real ones; the procedure; the page."""

import argparse
import re
import shlex
from collections import Counter
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from decks.dialects import DIALECTS, PROBES, DeckOptions
from decks.marc.contents import POSITION, read_marc_deck
from decks.marc.grammar import FileSection
from decks.marc.write import WAVEFORM, marc_deck, mentat_procedure
from fembridge.errors import DeckError

TYPES = {name: int(number) for name, number in DIALECTS["marc"].elements.items()}
PFL, NOUR = "pfl_example_model_0", "nour_plastic"


def test_the_deck_is_ascii_with_lf_and_no_line_wider_than_mentats(built):
    _, _, deck = built
    assert deck.text.isascii()
    assert deck.text.endswith("\n")
    assert not set("\r\t") & set(deck.text)
    assert max(map(len, deck.text.splitlines())) <= 180
    assert not [line for line in deck.text.splitlines() if line != line.rstrip()]


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


PARAMETERS = ("title", "extended", "alloc", "table", "processor", "all points")


def test_parameters_and_what_no_one_chose_are_those_of_a_real_deck(built, sample):
    _, _, deck = built
    real = sample(PFL)
    for keyword in (*PARAMETERS, "large stra", "no echo", "version"):
        ours, theirs = deck.all(keyword)[0], real.all(keyword)[0]
        assert (ours.line, ours.rows) == (theirs.line, theirs.rows)
    for ours, theirs in zip(deck.all("parameters"), real.all("parameters"), strict=True):
        assert ours.rows == theirs.rows
    assert deck.one("contact").rows[1:4] == real.one("contact").rows[1:4]
    ours, theirs = deck.one("con intera"), real.one("con intera")
    assert ours.line == theirs.line
    changed = [k for k in range(len(theirs.rows)) if ours.rows[k] != theirs.rows[k]]
    assert set(changed) <= {0, 2, 5}  # name, type of the second body, friction
    assert deck.one("con table").rows[2:] == real.one("con table").rows[2:]
    assert deck.one("optimize").line == real.one("optimize").line
    assert deck.one("solver").rows == sample(NOUR).one("solver").rows


# Lines of an option that do not depend on how much there is of something, and where a
# name ends one of them.
FIXED_LINES = {
    "contact": (11, {4: 80}),
    "con intera": (23, {0: 20}),
    "con table": (7, {0: 30}),
    "contact table": (2, {}),
}


def test_options_have_as_many_fields_a_line_as_in_a_real_deck(built, sample):
    def widths(option):
        count, names = FIXED_LINES[option.keyword]
        return [len(row[: names.get(k)]) for k, row in enumerate(option.rows[:count])]

    _, _, deck = built
    real = sample(PFL)
    for keyword, (count, _) in FIXED_LINES.items():
        ours, theirs = deck.all(keyword)[0], real.all(keyword)[0]
        assert len(widths(ours)) == count
        assert widths(ours) == widths(theirs)
    ours, theirs = deck.one("geometry"), real.one("geometry")
    assert ours.rows[:2] == theirs.rows[:2]  # plane strain
    assert ours.widths[3:] == theirs.widths[3:] == [140, 0]
    ours, theirs = deck.one("table", "waveform"), real.all("table")[1]
    assert ours.rows[0] == theirs.rows[0]
    assert ours.widths[1:3] == theirs.widths[1:3] == [160, 40]
    ours, theirs = deck.one("fixed disp").rows, real.one("fixed disp").rows
    assert ours[1][:60] == theirs[1][:60]
    assert ours[2:6] == theirs[2:6]
    assert (ours[1][60:], ours[6]) == ("held", "held_nodes")
    assert (theirs[1][60:], theirs[6]) == ("apply1", "apply1_nodes")
    theirs = sample(NOUR).one("isotropic")
    for ours in deck.all("isotropic"):
        assert (ours.line, ours.rows[0]) == (theirs.line, theirs.rows[0])
        assert ours.rows[1][10:90].split() == ["elastic", "10", "0", "0", "0"]
        assert ours.rows[1][50:90] == theirs.rows[1][50:90]
        assert ours.widths[2:] == theirs.widths[2:]
        assert ours.rows[3] == "         0" * 8
        assert ours.rows[4:] == theirs.rows[4:]


def test_a_neo_hookean_skin_is_refused(make_model):
    with pytest.raises(DeckError, match="stratum_corneum") as refused:
        marc_deck(make_model(law="neo-hookean"))
    error = refused.value
    assert (error.argument, error.found, error.expected) == ("law", "neo-hookean", "linear")


# ---- Contact


def edges_of(elements, kinds):
    """Edges that one element alone has, as sets of corner nodes."""
    count = Counter()
    for kind, *members in elements.values():
        if kind in kinds:
            count.update(frozenset((members[k], members[(k + 1) % 4])) for k in range(4))
    return [edge for edge, owners in count.items() if owners == 1]


def test_boundary_nodes_are_those_of_the_outline_mid_sides_included(built):
    model, _, deck = built
    finger = dict(list(deck.elements.items())[: len(model.mesh.quad)])
    kind = TYPES[model.element]
    edges = edges_of(finger, {kind})
    count = len(frozenset().union(*edges))
    count += len(edges) if kind in (27, 54) else 0
    first = deck.integers(deck.one("contact").rows[0])
    assert first[2] == count
    assert first[13] == (-1 if kind in (27, 54) else 0)


def bodies_of(deck):
    """Data lines of each contact body, by name."""
    rows = deck.one("contact").rows[4:]
    starts = [k for k, row in enumerate(rows) if row[80:].isidentifier() and len(row[:80]) == 80]
    ends = [*starts[1:], len(rows)]
    return {rows[start][80:]: rows[start:end] for start, end in zip(starts, ends, strict=True)}


def test_the_probes_inside_is_on_the_left_of_its_curve_and_the_skin_on_the_right(built):
    model, probe, deck = built
    if probe == "meshed":
        return
    curves = bodies_of(deck)["probe"][7:]
    inside = model.probe_mesh.node_mm.mean(axis=0)
    skin = model.node_mm[model.contact_node - 1]
    for k in range(0, len(curves), 9):
        start, end = np.array([deck.reals(curves[k + 1]), deck.reals(curves[k + 2])])
        along = end - start

        def left(points, start=start, along=along):
            way = points - start
            return along[0] * way[..., 1] - along[1] * way[..., 0]

        assert left(inside) > 0
        under = skin[(skin[:, 0] >= start[0]) & (skin[:, 0] <= end[0])]
        assert (left(under) <= 1e-9).all()


# Of public procedures and scripts; what may follow them is in the second column.
KNOWN = {
    "*new_model": r"yes",
    "*import": r'marc_read "[^"]+\.dat"',
    "*edit_job": r"\w+",
    "*job_option": r"(contact_method:segment_segment|"
    r"friction_model:coulomb_bilinear|post:(both|ascii))",
    "*update_job": r"",
    "*write_marc": r'"[^"]+\.dat" yes',
}


def spoken(text):
    """Lines that Mentat acts on."""
    return [line for line in text.splitlines() if not line.startswith("|")]


@pytest.mark.parametrize(
    ("results", "post"), [("binary", []), ("text", ["ascii"]), ("both", ["both"])]
)
def test_every_command_is_one_of_public_procedures_and_says_where_it_was_seen(
    results, post, make_model
):
    text = mentat_procedure(make_model(), DeckOptions(results))
    for line in spoken(text):
        word, _, rest = line.partition(" ")
        assert re.fullmatch(KNOWN[word], rest), line
    assert len(re.findall(r"^\| Seen in: .*\.\n\*", text, re.MULTILINE)) == len(spoken(text))
    assert re.findall(r"post:(\w+)", text) == post
    assert text.isascii()
    assert all(line.isprintable() and len(line) <= 88 for line in text.splitlines())


# ---- Read back by the grammar


def test_every_line_is_in_one_option_and_the_mesh_has_its_numbers(built):
    model, probe, ours = built
    deck = read_marc_deck(ours.text.encode("ascii"))
    lines = [line for option in deck.options for line in option.lines]
    assert [line.text for line in lines] == ours.text.splitlines()
    first = {}
    for option in deck.options:
        first.setdefault(option.keyword, option.section)
    assert first["sizing"] is first["end"] is FileSection.PARAMETER
    assert first["connectivity"] is first["post"] is FileSection.MODEL
    assert first["auto load"] is first["continue"] is FileSection.HISTORY
    assert (deck.remarks, deck.version) == ((), 15)
    finger, other = deck.bodies()
    motion = (other.control, *other.drives[1])
    assert (finger.name, finger.kind, other.name) == ("finger", 1, "probe")
    assert motion == ((POSITION, -1.0, 1) if probe == "rigid" else (0, 0.0, 0))
    parts = [*model.layers, *([model.probe] if probe == "meshed" else [])]
    place_mm, sets = deck.coordinates.position, deck.sets()
    node_mm = model.node_mm
    if probe == "meshed":
        node_mm = np.concatenate([node_mm, model.probe_mesh.node_mm])
    assert_allclose(place_mm[:, :2], node_mm, rtol=1e-15, atol=0)
    assert_array_equal(deck.coordinates.number, np.arange(1, len(node_mm) + 1))
    assert_array_equal(sets["held_nodes"].member, model.fixed)
    assert sets["skin_apex"].member.tolist() == [model.apex]
    for name, number in model.afferent.items():
        assert sets[f"afferent_{name.lower()}"].member.tolist() == [number]
    assert [each.name for each in deck.conditions()][1:] == ["probe_motion"] * (probe == "meshed")
    for block, material, part in zip(deck.elements, deck.materials(), parts, strict=True):
        corners = part.node.shape[1]
        assert_array_equal(block.node[:, :corners], part.node)
        if block.node.shape[1] > corners:  # a pressure node
            assert_array_equal(block.node[:, corners], len(node_mm) + part.number)
        assert_array_equal(block.number, part.number)
        assert block.material == material.number
        assert material.name == part.name
        assert material.values[:2] == (part.material.young_mpa, part.material.poisson)
    (table,) = deck.tables
    wanted = np.stack([model.motion.time_s, model.motion.depth_mm], axis=1)
    assert_allclose(table.points, wanted, rtol=1e-15)
    (case,) = deck.load_cases()
    moved = ("probe_motion",) * (probe == "meshed")
    assert (case.increments, case.active) == (3, ("held", *moved))


# ---- The page for Marc users asks for nothing that does not exist

DOCS = Path(__file__).parents[3] / "docs"
PAGE = (DOCS / "how_to" / "marc.md").read_text(encoding="utf-8")
COMMANDS = [
    line
    for block in re.findall(r"```sh\n(.*?)```", PAGE, flags=re.DOTALL)
    for line in block.splitlines()
] + [" ".join(words.split()) for words in re.findall(r"`(fembridge [a-z][^`]*)`", PAGE)]


@pytest.mark.parametrize("command", [c for c in COMMANDS if c.startswith("fembridge")])
def test_every_fembridge_command_is_understood(command):
    _, verb, *words = shlex.split(command.partition(" > ")[0])
    module = import_module(f"fembridge.commands.{verb.replace('-', '_')}")
    parser = argparse.ArgumentParser(exit_on_error=False)
    module.add_arguments(parser)
    parser.parse_args(words)


def test_what_the_page_says_of_the_deck_is_in_it(make_model):
    files = DIALECTS["marc"].write(make_model(), DeckOptions())
    assert set(files) == {"job.dat", "job.proc"}
    deck = files["job.dat"]
    for name in ("afferent_sa", "afferent_ra", "afferent_pc", "skin_apex", "held_nodes"):
        assert f"`{name}`" in PAGE
        assert re.search(rf"^define +node +set +{name}$", deck, flags=re.MULTILINE)
    assert f"`{WAVEFORM}`" in PAGE
    assert all(f"`{name}`" in PAGE or f" {name}`" in PAGE for name in PROBES)
    for number in DIALECTS["marc"].elements.values():
        assert f"{number}`" in PAGE
    for written in re.findall(r"`(job[_a-z0-9]*\.dat)`", PAGE):
        assert written in files or written in files["job.proc"]
