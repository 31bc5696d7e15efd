"""Contact in the deck: two bodies, the probe's curve, friction, who may touch."""

from collections import Counter

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from decks.analysis import Contact
from decks.marc.deck import marc_deck
from decks.marc.element_types import MARC_TYPES


def edges_of(elements, kinds):
    """Edges that one element alone has, as sets of corner nodes."""
    count = Counter()
    for kind, *members in elements.values():
        if kind in kinds:
            count.update(frozenset((members[k], members[(k + 1) % 4])) for k in range(4))
    return [edge for edge, owners in count.items() if owners == 1]


def test_the_real_deck_tells_as_many_boundary_nodes_as_its_outline_has(sample, columns):
    integers, _ = columns
    deck = sample("pfl_example_model_0")
    outline = frozenset().union(*edges_of(deck.elements(), {118}))
    assert integers(deck.one("contact").rows[0])[2] == len(outline) == 242


def test_boundary_nodes_are_those_of_the_outline_mid_sides_included(built, columns):
    model, _, deck = built
    integers, _ = columns
    finger = dict(list(deck.elements().items())[: len(model.mesh.quad)])
    kind = MARC_TYPES[model.element].number
    edges = edges_of(finger, {kind})
    count = len(frozenset().union(*edges))
    count += len(edges) if kind in (27, 54) else 0
    first = integers(deck.one("contact").rows[0])
    assert first[2] == count
    assert first[13] == (-1 if kind in (27, 54) else 0)


def bodies_of(deck):
    """Data lines of each contact body, by name."""
    rows = deck.one("contact").rows[4:]
    starts = [k for k, row in enumerate(rows) if row[80:].isidentifier() and len(row[:80]) == 80]
    ends = [*starts[1:], len(rows)]
    return {rows[start][80:]: rows[start:end] for start, end in zip(starts, ends, strict=True)}


def test_the_finger_is_the_first_body_and_deformable(built, columns):
    _, _, deck = built
    integers, reals = columns
    bodies = bodies_of(deck)
    assert list(bodies) == ["finger", "probe"]
    assert integers(deck.one("contact").rows[0])[0] == 2
    head, kind, *rest = bodies["finger"]
    assert integers(head[:80]) == [1, 0, 0, 0, 0, 0, 0, -1]
    assert integers(kind)[:4] == [1, 1, 0, 0]
    assert [len(row) for row in rest] == [140, 80, 160, 80, 40, 0]
    assert not any(reals(rest[2]) + integers(rest[3]))


def test_a_rigid_probe_is_moved_by_the_table_in_position_control(built, columns):
    _, probe, deck = built
    integers, reals = columns
    if probe == "meshed":
        head, kind, *rest = bodies_of(deck)["probe"]
        assert integers(head[:80]) == [2, 0, 0, 0, 0, 0, 0, -1]
        assert integers(kind)[:4] == [1, 1, 0, 0]
        assert rest[-1] == ""
        return
    head, kind, _, _, motion, tables, growth, *curves = bodies_of(deck)["probe"]
    assert integers(head[:80]) == [2, len(curves) // 9, 0, 0, 1, -1, 0, -1]
    assert integers(kind)[:4] == [2, 0, 0, 0]
    assert reals(motion) == [0.0, -1.0, 0, 0, 0, 0, 0, 0]
    assert integers(tables) == [0, 1, 0, 0, 0, 0, 0, 0]
    assert integers(growth) == [0, 0, 0, 0]
    assert integers(deck.all("table", "waveform")[0].rows[0])[0] == 1


def test_the_rigid_probe_is_the_lower_side_in_straight_pieces(make_model, read_deck, columns):
    model = make_model()
    integers, reals = columns
    curves = bodies_of(read_deck(marc_deck(model)))["probe"][7:]
    side = []
    for k in range(0, len(curves), 9):
        assert integers(curves[k]) == [9, 2, 2, 1]
        side.append([reals(curves[k + 1]), reals(curves[k + 2])])
        weights_and_knots = [reals(row) for row in curves[k + 3 : k + 9]]
        assert weights_and_knots == [[1.0], [1.0], [0.0], [0.0], [1.0], [1.0]]
    side = np.array(side)
    assert_array_equal(side[1:, 0], side[:-1, 1])  # each goes on where one ended
    assert_allclose(side[:, 0], model.lower_side_mm[:-1], rtol=1e-15)
    assert_allclose(side[-1, 1], model.lower_side_mm[-1], rtol=1e-15)


def test_the_probes_inside_is_on_the_left_of_its_curve_and_the_skin_on_the_right(built, columns):
    model, probe, deck = built
    _, reals = columns
    if probe == "meshed":
        return
    curves = bodies_of(deck)["probe"][7:]
    inside = model.probe_node_mm.mean(axis=0)
    skin = model.node_mm[model.contact_node - 1]
    for k in range(0, len(curves), 9):
        start, end = np.array([reals(curves[k + 1]), reals(curves[k + 2])])
        along = end - start

        def left(points, start=start, along=along):
            way = points - start
            return along[0] * way[..., 1] - along[1] * way[..., 0]

        assert left(inside) > 0
        under = skin[(skin[:, 0] >= start[0]) & (skin[:, 0] <= end[0])]
        assert (left(under) <= 1e-9).all()


@pytest.mark.parametrize("probe", ["rigid", "meshed"])
def test_friction_is_bilinear_coulombs_by_the_interaction(make_model, read_deck, columns, probe):
    integers, reals = columns
    for friction, first in ((0.4, [6, 1]), (0.0, [0, 0])):
        model = make_model(contact=Contact(friction=friction))
        deck = read_deck(marc_deck(model, probe=probe))
        assert integers(deck.one("contact").rows[0])[3:5] == first
        touch = deck.one("con intera").rows
        assert touch[0] == "         1         0touch"
        second = [1, 1, 0, 0] if probe == "meshed" else [2, 0, 0, 0]
        assert [integers(row) for row in touch[1:3]] == [[1, 1, 0, 0], second]
        assert reals(touch[5])[:4] == [0.0, 0.0, friction, 0.0]


def test_the_only_pair_is_finger_and_probe_by_that_interaction(built, columns):
    _, _, deck = built
    integers, _ = columns
    rows = deck.one("con table").rows
    assert rows[0] == "         1         1         0contact_pairs"
    assert integers(rows[1]) == [1, 2, 1, 0, 0]
    for option in deck.all("contact table"):
        assert [integers(row) for row in option.rows] == [[0, 4], [1]]
    assert len(deck.all("contact table")) == 2
