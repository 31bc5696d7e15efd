"""The address of a run: the same content has one, another content another."""

import hashlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.store import canonical_text, digest

KEYS = st.text(min_size=1, max_size=5)
NUMBERS = st.one_of(st.integers(-(2**70), 2**70), st.floats(allow_nan=False, allow_infinity=False))
LEAVES = st.one_of(NUMBERS, st.text(max_size=5), st.booleans(), st.none())
TABLES = st.recursive(
    st.dictionaries(KEYS, LEAVES, max_size=4),
    lambda inner: st.dictionaries(KEYS, st.one_of(inner, st.lists(LEAVES)), max_size=4),
    max_leaves=12,
)


def reversed_table(content):
    if isinstance(content, dict):
        return {key: reversed_table(content[key]) for key in reversed(content)}
    return content


@given(TABLES)
def test_the_order_of_keys_makes_no_difference(table):
    assert digest(reversed_table(table)) == digest(table)


@given(TABLES, KEYS, NUMBERS, NUMBERS)
def test_any_other_number_makes_a_difference(table, key, one, other):
    same = one == other
    assert (digest({**table, key: one}) == digest({**table, key: other})) == same


@given(st.lists(NUMBERS, min_size=2, max_size=5))
def test_the_order_of_a_list_makes_a_difference(values):
    turned = values[::-1]
    assert (digest(turned) == digest(values)) == (turned == values)


def test_a_text_that_can_be_worked_out_by_hand():
    table = {"b": (1, -0.0, 0.5), "a": {"x": True, "w": None}}
    text = '{"a":{"w":null,"x":true},"b":[1.0,0.0,0.5]}'
    assert canonical_text(table) == text
    assert digest(table) == hashlib.sha256(text.encode()).hexdigest()


@pytest.mark.parametrize(("one", "other"), [("1", 1), (True, 1), (None, "null")])
def test_a_word_is_no_number_and_a_truth_is_neither(one, other):
    assert digest([one]) != digest([other])


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_a_number_that_is_not_finite_has_no_address(number):
    with pytest.raises(ValueError, match="Out of range float"):
        digest({"x": number})


def test_what_toml_has_no_word_for_has_no_address():
    with pytest.raises(TypeError, match="no canonical text"):
        digest({"x": object()})
