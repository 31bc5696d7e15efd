"""Parts and instances: where they lie in closed form, and the flat deck that they stand for."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import fembridge as fb
from decks.assembly import Placement, flat_deck, has_parts, scopes_of
from decks.inp import read_inp
from decks.motion import Motion
from decks.own_model import Request
from decks.own_model.inp_deck import rebase_inp
from decks.solid_model import read_solid_model
from fembridge.errors import DeckError
from tests.fembridge.touching.mesh_models import block_deck

BLOCK = block_deck(across=2, down=2)
PART = BLOCK[BLOCK.index("*NODE") : BLOCK.index("*NSET, NSET=INNER")]
MATERIAL = BLOCK[BLOCK.index("*MATERIAL") : BLOCK.index("*SOLID")]
SECTION = "*Solid Section, elset=RUBBER, material=SOFT\n,\n"
LAID = " 1., 2., 3.\n 1., 2., 3., 2., 2., 3., 90.\n"
STEP = (
    "*Boundary\nSet-Bottom, ENCASTRE\n*Step, name=Press, nlgeom=YES\n*Static\n0.5, 1.\n"
    "*Boundary\nBlock-2.TOP, 3, 3, -0.1\n*Output, field, variable=PRESELECT\n*End Step\n"
)


def assembly(*, part=PART, placed=LAID, instances=2, more="", step=None):
    """Two blocks, as Abaqus/CAE writes them: the first is laid on its side."""
    second = "*Instance, name=Block-2, part=Block\n 20., 0., 0.\n*End Instance\n"
    both = "*Nset, nset=Set-Bottom, instance=Block-2\nBOTTOM, 27\n"
    return (
        f"*Heading\n two blocks\n*Part, name=Block\n{part}{SECTION}*End Part\n"
        "*Assembly, name=Assembly\n"
        f"*Instance, name=Block-1, part=Block\n{placed}*End Instance\n{second * (instances > 1)}"
        f"*Nset, nset=Set-Bottom, instance=Block-1\nBOTTOM\n{both * (instances > 1)}"
        "*Elset, elset=_Upper_S2, internal, instance=Block-1, generate\n5, 8, 1\n"
        f"*Surface, type=ELEMENT, name=Upper\n_Upper_S2, S2\n{more}*End Assembly\n"
        f"{MATERIAL}{(STEP if instances > 1 else '') if step is None else step}"
    )


def flat(text):
    deck = read_inp(text.encode(), abaqus=True)
    assert has_parts(deck)
    return flat_deck(deck)


def test_a_part_is_shifted_and_then_rotated_about_a_line():
    """90 degrees about the line along x through (1, 2, 3): y becomes z, z becomes -y."""
    placement = scopes_of(read_inp(assembly().encode(), abaqus=True))[1].placement
    moved = placement.moved(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]))
    assert_allclose(moved, [[1, 2, 3], [2, 2, 3], [1, 2, 4], [1, 1, 3]], atol=1e-12)
    about_diagonal = Placement(stop=(1.0, 1, 1), angle_deg=120.0)
    assert_allclose(about_diagonal.moved(np.array([[1.0, 2, 3]])), [[3, 1, 2]], atol=1e-12)


def test_numbers_that_meet_are_raised_and_others_stay():
    result = flat(assembly())
    model = read_solid_model(result.read())
    assert model.node.tolist() == [*range(1, 28), *range(101, 128)]
    assert [block.number.tolist() for block in model.elements] == [
        [*range(1, 9)],
        [*range(101, 109)],
    ]
    assert len(result.remarks) == 1 and "100" in result.remarks[0]
    alone = flat(assembly(instances=1))
    assert alone.remarks == () and "TOP" in read_solid_model(alone.read()).node_sets


def test_names_of_one_instance_alone_stay_and_others_are_qualified():
    result = flat(assembly())
    sets = read_solid_model(result.read()).node_sets
    assert sets["SET-BOTTOM"].tolist() == [*range(1, 10), *range(101, 110), 127]
    assert sets[result.name("Block-2.top")].tolist() == list(range(119, 128))
    assert result.name("Upper") == "Upper"
    assert flat(assembly(instances=1)).name("BLOCK-1.TOP") == "TOP"
    assert b"\nBLOCK-2_TOP, 3, 3, -0.1\n" in result.data


def test_the_flat_model_lies_where_the_instances_are():
    model = read_solid_model(flat(assembly()).read())
    original = read_solid_model(read_inp(BLOCK.encode()))
    x, y, z = original.position.T
    first = np.stack([x + 1, 2 - z, y + 3], -1)
    second = original.position + np.array([20.0, 0.0, 0.0])
    assert_allclose(model.position, np.concatenate([first, second]))
    skin = model.skin("Upper")
    assert_allclose(model.position[skin.rows][:, 1], 2.0, atol=1e-12)


def test_sections_come_after_the_materials_that_calculix_needs_before():
    text = flat(assembly()).data.decode()
    assert text.index("*MATERIAL") < text.index("*SOLID SECTION") < text.index("*Step")
    assert "INTERNAL" not in text.upper() and "INSTANCE=" not in text.upper()


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"part": PART + "*NGEN\n1, 3, 1\n"}, "*NGEN"),
        ({"part": PART.replace("*NODE,", "*NODE, SYSTEM=C,")}, "*NODE, SYSTEM=C"),
        ({"part": PART + "*ORIENTATION, NAME=O\n1., 0., 0., 0., 1., 0.\n"}, "*ORIENTATION"),
        ({"placed": " 0., 0., 0.\n 1., 1., 1., 1., 1., 1., 90.\n"}, "*Instance"),
        ({"more": "*Nset, nset=N, instance=Block-9\n1\n"}, "*Nset, nset=N,"),
    ],
)
def test_what_no_flat_deck_can_hold_is_refused_with_its_line(change, line):
    text = assembly(**change)
    number = text[: text.index(line)].count("\n") + 1
    with pytest.raises(DeckError, match=rf"^line {number}: "):
        flat(text)


def test_a_node_of_a_rotated_instance_is_found_where_it_lies():
    """For a waveform, too: node 14 is the middle of the block, half a millimetre below its top."""
    step = "*Step\n*Static\n0.5, 1.\n*Boundary\nSet-Bottom, 1, 3\nSet-Top, 2, 2, -0.1\n*End Step\n"
    top = "*Nset, nset=Set-Top, instance=Block-1\nTOP\n"
    text = assembly(instances=1, more=top, step=step)
    motion = Motion(0.5 * np.arange(3), np.array([0.0, 0.1, 0.0]), 0.5, 0)
    rebased = rebase_inp(text.encode(), motion, Request(afferents={"SA": 14}))
    assert_allclose(rebased.sites["SA"].position_mm, (1.0, 2.5, 3.0), atol=1e-12)


@pytest.mark.solver
def test_the_pad_of_an_instance_is_that_of_its_part(tmp_path):
    """The instance lies on its side; CalculiX solves the flat deck, also its word ENCASTRE."""
    (tmp_path / "assembly.inp").write_text(assembly())
    (tmp_path / "block.inp").write_text(BLOCK)
    solver, place = fb.Solver(threads=1), "RUBBER:0.6"
    pad = fb.make_pad(
        base_deck=tmp_path / "assembly.inp", target="calculix", skin="Block-1.TOP",
        afferents=f"Block-1.{place}", skin_map=fb.SkinMap(along=(1, 0, 0)), solver=solver,
    )  # fmt: skip
    expected = fb.make_pad(
        base_deck=tmp_path / "block.inp", skin="TOP", afferents=place,
        skin_map=fb.SkinMap(along=(1, 0, 0)), solver=solver,
    )  # fmt: skip
    assert np.array_equal(pad.node, expected.node)
    for ours, theirs in zip(pad.down_mm, expected.down_mm, strict=True):
        assert_allclose(ours, theirs, atol=2e-6 * np.abs(theirs).max())
    tensors = [one.stress.astype(float) * one.stress_scale_pa for one in (pad, expected)]
    assert_allclose(*tensors, atol=1e-3 * np.abs(tensors[1]).max())


def test_the_decks_for_abaqus_are_flat(tmp_path):
    (tmp_path / "assembly.inp").write_text(assembly())
    forces = fb.pad_decks(
        tmp_path / "assembly.inp", tmp_path / "pad", skin="Block-2.TOP",
        afferents={"SA": "Block-2.RUBBER:0.6"}, after_step=0,
    )  # fmt: skip
    # Step 1 moves the skin along z: forces act across and along it alone. Node 127 is held.
    assert forces.solver == "abaqus" and set(forces.decks[0][:, 1].tolist()) == {1, 2}
    assert forces.nodes.tolist() == list(range(119, 127))
    text = (tmp_path / "pad" / "forces_01.inp").read_text()
    assert not has_parts(read_inp(text.encode(), abaqus=True))
    assert "*BOUNDARY\nSet-Bottom, ENCASTRE\n" in text


def test_a_check_counts_the_members_of_sets_of_the_assembly(tmp_path):
    """Nodes 1 to 9 of both instances and 27 of the second; elements 5 to 8 of the first."""
    (tmp_path / "assembly.inp").write_text(assembly())
    result = fb.check(tmp_path / "assembly.inp")
    sets = result.sets.set_index(["set", "instance"])["members"]
    assert sets["SET-BOTTOM", ""] == 19 and sets["_UPPER_S2", ""] == 4
    assert sets["TOP", "Block-1"] == 9
