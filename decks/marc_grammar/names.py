"""Lines that are names, though they start with a letter as keywords do.

Mentat writes names of sets, geometries and conditions from column 1. Most are no
keyword; of one that is (a condition called ``control``), its place decides.
"""

import re
from collections.abc import Sequence, Set

from decks.marc_grammar.keywords import CONDITIONS, KNOWN, name_of
from decks.marc_grammar.layout import Layout, cut, integer, only_integers
from decks.marc_grammar.line import Line

_CONTINUED = re.compile(r"(?:^|[\s,\d])c(?:ontinue)?\s*\Z", re.IGNORECASE)
_NODAL = re.compile(r"nodal\b", re.IGNORECASE)
_FORMULA = 3
_MEMBERSHIP_IN_MESH = 2
_BEFORE_SET = 4  # lines of a condition before its set, at least
_CAD_BODY = 6  # numbers before the names of a body


def continues(text: str) -> bool:
    """Whether a list goes on, on the next line: this one ends in ``c``."""
    return _CONTINUED.search(text) is not None


def is_name(
    keyword: str,
    data: Sequence[Line],
    line: Line,
    layout: Layout,
    *,
    known: bool,
    conditions: Set[str],
) -> bool:
    """Whether `line`, which starts with a letter, is data of the option before it.

    `data` are that option's lines so far, without comments; `known` tells that its
    keyword is one of Marc's; `conditions` are names of the conditions before.
    """
    if data and continues(data[-1].text):
        return True
    if keyword == "loadcase" and line.text.strip().rstrip(", ") in conditions:
        return _announced(data, layout)
    rule = _RULES.get(keyword)
    if rule is None and keyword in CONDITIONS:
        rule = _condition
    if rule is not None and rule(data, line, layout):
        return True
    if name_of(line.text) is not None:
        return False
    return not known or keyword not in KNOWN


def condition_name(text: str, layout: Layout) -> str:
    """Give the name behind the six numbers that start a condition, or nothing."""
    name = cut(text, layout, "iiiiiit")[6]
    return name if name[:1].isalpha() else ""


def _condition(data: Sequence[Line], _line: Line, layout: Layout) -> bool:
    """Tell a set's name: it stands after the kind of list of a named condition."""
    if not data or only_integers(data[-1].text, layout) != 1:
        return False
    for row, before in enumerate(reversed(data[:-1]), start=2):
        if before.lettered:
            return False
        if condition_name(before.text, layout):
            return row >= _BEFORE_SET
    return False


def _displacement(data: Sequence[Line], line: Line, layout: Layout) -> bool:
    """Tell a set's name where degrees of freedom stand before it too."""
    before = data[-_BEFORE_SET - 1 : -_BEFORE_SET]
    if not any(condition_name(each.text, layout) for each in before):
        return False
    return _condition(data, line, layout)


def _announced(data: Sequence[Line], layout: Layout) -> bool:
    """Whether a load case has more conditions to come, as its first line counts."""
    if not data or only_integers(data[0].text, layout) != 1:
        return False
    return len(data) <= integer(cut(data[0].text, layout, "i")[0])


def _geometry(data: Sequence[Line], _line: Line, layout: Layout) -> bool:
    """Tell a geometry's name: it stands after numbers, since input version 12 or so."""
    if len(data) < 2 or only_integers(data[-1].text, layout) < 2:
        return False
    style = cut(data[0].text, layout, "iii")[2]
    return style == str(_MEMBERSHIP_IN_MESH)


def _cad_bodies(data: Sequence[Line], _line: Line, layout: Layout) -> bool:
    """Tell the two names after a body's numbers: its own and its file's."""
    if len(data) < 2:
        return False
    if only_integers(data[-1].text, layout) == _CAD_BODY:
        return True
    return data[-1].lettered and not data[-2].lettered


def _define(data: Sequence[Line], _line: Line, _layout: Layout) -> bool:
    """Tell the first line of a list: every set has one, if only an empty line."""
    return not data


def _table(data: Sequence[Line], _line: Line, layout: Layout) -> bool:
    """Tell a formula: the value of a table can be one."""
    if len(data) < 2 or any(line.lettered for line in data):
        return False
    return cut(data[0].text, layout, "iiiii")[4] == str(_FORMULA)


def _post(_data: Sequence[Line], line: Line, _layout: Layout) -> bool:
    """Tell ``nodal``, which stands before the code of a nodal quantity."""
    return _NODAL.match(line.text) is not None and name_of(line.text) is None


_RULES = {
    "cad bodies": _cad_bodies,
    "define": _define,
    "fixed disp": _displacement,
    "geometry": _geometry,
    "post": _post,
    "table": _table,
}
