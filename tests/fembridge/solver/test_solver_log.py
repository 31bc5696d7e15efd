"""Messages of CalculiX 2.20, as it prints them."""

import pytest

from fembridge.solver.verdict import find_card, read_solver_log

HEAD = """
************************************************************

CalculiX Version 2.20, Copyright(C) 1998-2022 Guido Dhondt
"""


@pytest.fixture
def read(tmp_path):
    def read_text(text):
        path = tmp_path / "solver.log"
        path.write_text(HEAD + text)
        return read_solver_log(path)

    return read_text


@pytest.mark.parametrize(
    "warning",
    [
        "in modaldynamics: parameter not recognized:\n          FOO=3",
        "reading *NODE PRINT: node set NOPE does not exist",
        "reading *STATIC: unknown solver;\n           the default solver is used",
        "reading *NODE/EL/CONTACT FILE: label not applicable\n          or unknown; ",
        "in calinput: PEEQ-output requested\n         yet no (visco)plastic analysis",
    ],
)
def test_a_warning_that_leaves_something_out_is_seen(read, warning):
    assert len(read(f" *WARNING {warning}\n\n").dropped) == 1


def test_a_thousand_warnings_do_not_hide_the_error_after_them(read):
    many = "".join(f" *WARNING: parameter not recognized: P{n}\n" for n in range(1000))
    assert [e.text for e in read(many + " *ERROR in here: no\n").errors] == ["in here: no"]


def test_a_message_ends_at_the_blank_line_and_a_summary_counts_only_when_it_is_alone(read):
    log = read(" *ERROR: seems to diverge; try \n automatic incrementation\n\n something else\n")
    assert [str(error) for error in log.errors] == [
        "seems to diverge; try automatic incrementation"
    ]
    summary = " *ERROR in calinput: at least one fatal\n    error message\n\n"
    assert len(read(summary).errors) == 1
    assert [str(e) for e in read(" *ERROR in x: y\n\n" + summary).errors] == ["in x: y"]


def test_a_card_that_stands_twice_has_no_line(tmp_path):
    deck = tmp_path / "job.inp"
    deck.write_text("*EL FILE\nS\n*EL PRINT\nS\n")
    assert find_card(deck, "S") is None
    assert find_card(deck, "NOPE,1,1") is None
