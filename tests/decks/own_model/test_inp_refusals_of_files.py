"""Nodes, sets, output and included files that are refused, and where they stand."""

import pytest

# ---- Nodes and sets


def test_a_node_that_is_not_there_is_refused(changed, refused):
    assert refused(afferents={"SA": 9}) == "no *NODE of the deck defines node 9"
    deck = changed("*ELEMENT", "*NGEN\n1, 9, 8\n*ELEMENT")
    assert refused(deck, afferents={"SA": 9}) == (
        "no *NODE of the deck defines node 9; *NGEN, line 8, is not followed"
    )


def test_a_node_that_is_there_twice_must_be_in_one_place(changed, rebase, refused):
    deck = changed("*ELEMENT", "*NODE\n3, 1., 1.\n*ELEMENT")
    assert rebase(deck, afferents={"SA": 3}).place_mm == {"SA": (1.0, 1.0)}
    deck = changed("*ELEMENT", "*NODE\n3, 1., 1.5\n*ELEMENT")
    assert refused(deck, afferents={"SA": 3}) == ("line 9: node 3 again, elsewhere than at line 6")


def test_a_node_in_another_system_of_coordinates_is_refused(changed, refused):
    deck = changed("*NODE, NSET=ALL", "*NODE, NSET=ALL, SYSTEM=C")
    assert refused(deck, afferents={"SA": 3}).startswith("line 3: *NODE, SYSTEM=C")


def test_a_coordinate_that_is_no_number_is_refused(changed, refused):
    deck = changed("3, 1., 1., 0.", "3, 1., one, 0.")
    assert refused(deck, afferents={"SA": 3}).startswith("line 6: 'one' where")


@pytest.mark.parametrize("name", ["S A", "", "SA,B", "ß", "SA\n*STEP"])
def test_an_afferent_whose_name_is_no_name_of_a_set_is_refused(name, refused):
    assert "its name becomes that of a set" in refused(afferents={name: 3})


def test_afferents_that_differ_in_case_alone_are_refused(refused):
    assert "two names of one set" in refused(afferents={"SA": 3, "sa": 4})


@pytest.mark.parametrize(
    "there",
    [
        "*NSET, NSET=AFFERENT_SA\n2,\n",
        "*NSET, NSET=afferent_sa\n3, 4\n",
        "*NSET, NSET=AFFERENT_SA\nALL\n",
        "*NODE, NSET=AFFERENT_SA\n9, 0., 0.\n",
        "*NSET, NSET=FEMBRIDGE_OUTPUT, GENERATE\n2, 4\n",
    ],
)
def test_a_set_of_that_name_that_holds_something_else_is_refused(there, changed, refused):
    deck = changed("*AMPLITUDE, NAME=OTHER", there + "*AMPLITUDE, NAME=OTHER")
    message = refused(deck, afferents={"SA": 3})
    assert message.startswith("line 12: set ")
    assert "holds something else" in message


# ---- The output request


def test_time_points_do_not_go_with_fixed_increments(changed, refused):
    deck = changed("*NODE FILE", "*CONTACT FILE, TIME POINTS=T\nCDIS\n*NODE FILE")
    assert refused(deck).startswith("line 21: *CONTACT FILE, TIME POINTS")


def test_expanded_results_from_a_step_before_are_refused_for_a_set_of_nodes(
    changed, rebase, refused
):
    first = "*STEP\n*STATIC\n*NODE FILE, OUTPUT=3D\nU\n*END STEP\n"
    deck = changed("*STEP", first + first.replace(", OUTPUT=3D", "") + "*STEP")
    assert refused(deck, afferents={"SA": 3}).startswith("line 16: *NODE FILE, OUTPUT=")
    rebase(deck)
    rebase(changed("*STEP", first + "*STEP"), afferents={"SA": 3})


# ---- Included files


FILES = {
    "mesh.inp": b"9, 3., 4.\n*NSET, NSET=INNER\n9\n",
    "wave.inp": b"*AMPLITUDE, NAME=WAVE\n0., 0.\n",
    "table.txt": b"2., 0.\n",
    "boundary.inp": b"*BOUNDARY, AMPLITUDE=PRESS\n4, 2, 2, -2.\n",
    "request.inp": b"*EL FILE\nS\n",
    "end.inp": b"*END STEP\n",
    "static.inp": b"*STATIC\n0.1, 1.\n",
    "self.inp": b"*INCLUDE, INPUT=self.inp\n",
}


def include(name):
    return f"*INCLUDE, INPUT={name}\n"


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("*ELEMENT", "*INCLUDE\n*ELEMENT", "line 8: *INCLUDE without INPUT="),
        ("*ELEMENT", include("self.inp") + "*ELEMENT", "self.inp, line 1: *INCLUDE of"),
        ("*STEP", include("wave.inp") + "*STEP", "wave.inp, line 1: *AMPLITUDE, NAME=W"),
        (
            "*AMPLITUDE, NAME=OTHER",
            include("table.txt") + "*AMPLITUDE, NAME=OTHER",
            "table.txt, line 1: data of *AMPLITUDE, line 10, in an included file",
        ),
        (
            "*NODE FILE",
            include("boundary.inp") + "*NODE FILE",
            "boundary.inp, line 2: magnitude -2, but -1 at line 20",
        ),
        (
            "*NODE FILE",
            include("request.inp") + "*NODE FILE",
            "request.inp, line 1: *EL FILE of step 1 (push), line 14 is in an included",
        ),
        (
            "*NODE FILE\nU\n*END STEP\n",
            include("end.inp"),
            "end.inp, line 1: *END STEP of step 1 (push), line 14 is in an included",
        ),
        (
            "*STATIC\n0.1, 1.\n",
            include("static.inp"),
            "static.inp, line 1: *STATIC of the waveform's step is in an included",
        ),
    ],
)
def test_what_would_have_to_change_in_an_included_file_is_refused(old, new, told, changed, refused):
    amplitude = "WAVE" if "wave" in new else "PRESS"
    message = refused(changed(old, new), resolver=FILES.get, amplitude=amplitude)
    assert message.startswith(told)


def test_what_may_stand_in_a_file_that_was_not_read_is_said(changed, rebase, refused):
    deck = changed("*ELEMENT", include("mesh.inp") + "*ELEMENT")
    assert refused(deck, afferents={"SA": 9}) == (
        "no *NODE of the deck defines node 9; not read: mesh.inp (line 8)"
    )
    assert rebase(deck).remarks[-1] == (
        "line 8: mesh.inp was not read, and what it holds is not known"
    )
