"""Other loads of an own deck, stress at time 0, shells, relaxing materials, refusals."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from own_block import BLOCK, GRAVITY

import fembridge as fb
from decks.own_model import Request
from fembridge.errors import DeckError, FembridgeWarning, ResultError
from fembridge.io.run_folder import read_run_folder
from fembridge.solver.build import read_base_deck, rebased_deck
from fembridge.stimulus import Stimulus

SECOND = "*BOUNDARY\nSIDE, 1, 1, 0.02"
WARM = "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, 20."
WARMER = "*TEMPERATURE\nALL, 30."
STRESSED = "*INITIAL CONDITIONS, TYPE=STRESS\n" + "\n".join(
    f"{element}, {point}, 1.E-4, -2.E-4, 0., 5.E-5, 0., 0."
    for element in (1, 2)
    for point in range(1, 9)
)
SHELL = """\
*NODE, NSET=ALL
{nodes}
*ELEMENT, TYPE=S4, ELSET=SKIN
1, 1, 2, 5, 4
2, 2, 3, 6, 5
*NSET, NSET=TIP
3, 6
*MATERIAL, NAME=SOFT
*ELASTIC
10., 0.
*SHELL SECTION, ELSET=SKIN, MATERIAL=SOFT
0.2
*BOUNDARY
1, 1, 6
4, 1, 6
*STEP, NLGEOM
*STATIC
0.1, 1.
*BOUNDARY
TIP, 3, 3, -0.05
*NODE FILE, OUTPUT=2D
U
*END STEP
"""


def deck(tmp_path, model="", before="", loads="", text=BLOCK):
    path = tmp_path / "mine.inp"
    path.write_text(text.format(model=model, before=before, loads=loads))
    return path


def shell(tmp_path):
    nodes = [f"{k + 3 * j + 1}, {k}., {j}., 0." for j in range(2) for k in range(3)]
    path = tmp_path / "shell.inp"
    path.write_text(SHELL.format(nodes="\n".join(nodes)))
    return path


def still(duration_ms, dt_ms=1.0):
    """A waveform that does not move the probe."""
    samples = np.zeros(round(duration_ms / dt_ms) + 1)
    return Stimulus("still", samples, dt_ms, (0.0, duration_ms))


def rebased(path, stimulus=None, **request):
    stimulus = stimulus or still(4.0)
    return rebased_deck(read_base_deck(Path(path)), stimulus, Request(**request))


def solved(path, stimulus, folder, **options):
    [run] = fb.rebase_deck(path, stimulus, folder, **options)
    [outcome] = fb.run(run)
    assert outcome.accepted, outcome
    return run


# ---- Other loads of the waveform's step


@pytest.mark.parametrize(
    ("model", "loads", "option"),
    [
        ("", GRAVITY, "*DLOAD, AMPLITUDE=FEMBRIDGE_RAMP\n"),
        ("", SECOND, "*BOUNDARY, AMPLITUDE=FEMBRIDGE_RAMP\n"),
        (WARM, WARMER, "*TEMPERATURE, AMPLITUDE=FEMBRIDGE_RAMP\n"),
    ],
)
def test_a_load_without_an_amplitude_keeps_the_ramp_of_its_own_step(tmp_path, model, loads, option):
    result = rebased(deck(tmp_path, model, loads=loads), move="TOP,2")
    text = result.deck.decode()
    start = 2.0 / 3.0 if model else 0.0
    assert option in text
    assert f"*AMPLITUDE, NAME=FEMBRIDGE_RAMP\n0., {start:.9g}, 1, 1.\n" in text
    assert len(result.doubts) == 1  # the waveform sees a part of it alone
    path = tmp_path / "again.inp"
    path.write_bytes(result.deck)
    assert rebased(path).deck == result.deck


def test_a_load_that_an_earlier_step_has_brought_stays_as_it_is(tmp_path):
    before = f"*STEP, NLGEOM\n*STATIC\n0.5, 1.\n{GRAVITY}\n*BOUNDARY\nTOP, 2, 2, -0.01\n*END STEP"
    text = rebased(deck(tmp_path, before=before, loads=GRAVITY), move="TOP,2").deck.decode()
    assert "FEMBRIDGE_RAMP" not in text
    double = GRAVITY.replace("9.81E6", "19.62E6")
    text = rebased(deck(tmp_path, before=before, loads=double), move="TOP,2").deck.decode()
    assert "*AMPLITUDE, NAME=FEMBRIDGE_RAMP\n0., 0.5, 1, 1.\n" in text


@pytest.mark.parametrize(
    ("before", "start"),
    [("ALL, 1, 1, 0.01", 0.5), ("1, 1, 1, 0.01", 0.0), ("NEAR, 1, 1, 0.01", None)],
)
def test_the_start_of_a_ramp_is_what_earlier_steps_left_on_the_same_nodes(tmp_path, before, start):
    step = f"*STEP, NLGEOM\n*STATIC\n0.5, 1.\n*BOUNDARY\nTOP, 2, 2, -0.01\n{before}\n*END STEP"
    near = "*NSET, NSET=NEAR\n4, 5\n*NSET, NSET=SIDES\n3, 4"
    loads = "*BOUNDARY\nSIDES, 1, 1, 0.02"
    path = deck(tmp_path, near, before=step, loads=loads)
    if start is None:
        with pytest.raises(DeckError, match="NEAR"):
            rebased(path, move="TOP,2")
        return
    assert f"FEMBRIDGE_RAMP\n0., {start:g}, 1, 1.\n" in rebased(path, move="TOP,2").deck.decode()


def test_loads_of_one_block_that_start_at_different_values_are_split(tmp_path):
    loads = "*CLOAD\n3, 2, 1.E-3\n4, 2, 1.E-3"
    before = (
        "*STEP, NLGEOM\n*STATIC\n0.5, 1.\n*CLOAD\n3, 2, 5.E-4\n*BOUNDARY\nTOP, 2, 2, -0.01\n"
        "*END STEP"
    )
    text = rebased(deck(tmp_path, before=before, loads=loads), move="TOP,2").deck.decode()
    assert "*CLOAD, AMPLITUDE=FEMBRIDGE_RAMP\n3, 2, 1.E-3\n" in text
    assert "*CLOAD, AMPLITUDE=FEMBRIDGE_RAMP_2\n4, 2, 1.E-3\n" in text


def test_a_load_that_the_step_takes_back_is_refused(tmp_path):
    before = f"*STEP, NLGEOM\n*STATIC\n0.5, 1.\n{SECOND}\nTOP, 2, 2, -0.01\n*END STEP"
    path = deck(tmp_path, before=before, loads=SECOND.replace("0.02", "0."))
    with pytest.raises(DeckError, match="SIDE"):
        rebased(path, move="TOP,2")


@pytest.mark.solver
@pytest.mark.filterwarnings("ignore::fembridge.FembridgeWarning")
@pytest.mark.parametrize(
    ("model", "loads"), [("", GRAVITY), ("", SECOND), (WARM, WARMER)], ids=["dload", "move", "warm"]
)
def test_stress_at_a_time_is_that_of_the_own_deck_whatever_the_length_of_the_waveform(
    tmp_path, model, loads
):
    """The own deck, its probe held, at 20 ms of the second over which it ramps its loads."""
    path = deck(tmp_path, model, loads=loads)
    own = tmp_path / "own"
    own.mkdir()
    text = path.read_text().replace("0.05, 1.\n", "0.05, 1., 1.E-5, 0.02\n")
    text = text.replace("*STATIC\n", "*STATIC, DIRECT\n").replace(
        "0.05, 1., 1.E-5, 0.02", "0.02, 1."
    )
    output = "*NODE FILE\nU\n*EL FILE\nS\n*END STEP"
    (own / "job.inp").write_text(
        text.replace("2, 2, -0.01", "2, 2, 0.").replace("*END STEP", output)
    )
    fb_own = _run_ccx(own)
    history = fb.read_history(fb_own, [4])
    expected_pa = history.loc[np.isclose(history["time_ms"], 20.0), "von_mises_pa"].item()
    for duration_ms in (20.0, 100.0):
        run = solved(
            path,
            still(duration_ms),
            tmp_path / f"{duration_ms:g}",
            move="TOP,2",
            afferents={"SA": 4},
        )
        [trace] = fb.read(run)
        assert_allclose(trace.stress_pa[20], expected_pa, rtol=2e-4)
        assert trace.stress_pa[20] > 1.0


def _run_ccx(folder):
    import subprocess

    from fembridge.host.machine import find_ccx

    subprocess.run([find_ccx(), "-i", "job"], cwd=folder, check=True, capture_output=True)
    return folder / "job.frd"


# ---- Time 0


@pytest.mark.solver
def test_a_trace_begins_with_the_initial_stress_of_the_deck(tmp_path):
    """Von Mises of (1, -2, 0, 0.5) 1e-4 MPa; the free block relaxes in the first increment."""
    path = deck(tmp_path, STRESSED)
    run = solved(path, still(4.0), tmp_path / "runs", afferents={"SA": 4})
    assert read_run_folder(run.folder) == run
    assert not run.at_rest
    [trace] = fb.read(run)
    normal = (100.0 + 200.0) ** 2 + (-200.0 - 0.0) ** 2 + (0.0 - 100.0) ** 2
    assert_allclose(trace.stress_pa[0], np.sqrt(normal / 2 + 3 * 50.0**2), rtol=1e-12)
    assert trace.stress_pa[1] > 0
    with pytest.raises(ResultError, match="node 3"):
        fb.read(run, [3])


def test_initial_stress_that_varies_within_an_element_is_refused(tmp_path):
    path = deck(tmp_path, STRESSED.replace("2, 8, 1.E-4", "2, 8, 3.E-4"))
    with pytest.raises(DeckError, match="afferent SA"):
        rebased(path, afferents={"SA": 4})


@pytest.mark.parametrize(
    ("model", "loads", "line"),
    [
        (
            "*AMPLITUDE, NAME=ALWAYS\n0., 1., 1., 1.",
            GRAVITY.replace("\n", ", AMPLITUDE=ALWAYS\n", 1),
            44,
        ),
        ("*RESTART, READ", "", 32),
        ("*INITIAL CONDITIONS, TYPE=PLASTIC STRAIN\n1, 1, 0.1, 0., 0., 0., 0., 0.", "", 32),
    ],
)
def test_a_model_whose_state_at_time_0_is_not_known_is_refused(tmp_path, model, loads, line):
    with pytest.raises(DeckError) as caught:
        rebased(deck(tmp_path, model, loads=loads), move="TOP,2", afferents={"SA": 4})
    assert str(caught.value).startswith(f"line {line}: ")


# ---- Refusals before the solver runs


def test_a_displacement_that_a_later_step_moves_again_is_refused(tmp_path):
    later = "*END STEP\n*STEP\n*STATIC\n0.1, 1.\n*BOUNDARY\nTOP, 2, 2, -0.02"
    path = deck(tmp_path, "*AMPLITUDE, NAME=PRESS\n0., 0., 1., 1.", loads=later)
    path.write_text(
        path.read_text().replace(
            "*BOUNDARY\nTOP, 2, 2, -0.01", "*BOUNDARY, AMPLITUDE=PRESS\nTOP, 2, 2, -0.01"
        )
    )
    with pytest.raises(DeckError, match="several steps move TOP,2"):
        rebased(path)
    assert rebased(path, step="1").deck.count(b"*STEP") == 1


def test_a_node_between_materials_is_refused_and_nodes_inside_are_named(tmp_path):
    path = deck(tmp_path, "*SOLID SECTION, ELSET=LOWER, MATERIAL=HARD\n1.")
    with pytest.raises(DeckError, match=r"HARD and SOFT.*1 in HARD or 5 in SOFT"):
        rebased(path, afferents={"SA": 3})
    assert rebased(path, afferents={"SA": 5}).sites["SA"].position_mm == (0.0, 2.0)


def test_the_layer_of_a_shell_has_to_be_chosen(tmp_path):
    path = shell(tmp_path)
    with pytest.raises(DeckError, match="bottom, middle, top"):
        rebased(path, afferents={"SA": 2})
    top, bottom, middle = (
        rebased(path, afferents={"SA": 2}, shell_face=face) for face in ("top", "bottom", "middle")
    )
    assert [site.corner for site in (top.sites["SA"], bottom.sites["SA"])] == [5, 1]
    assert b"OUTPUT=3D" in top.deck
    assert b"NSET=FEMBRIDGE_OUTPUT, FREQUENCY=1, OUTPUT=2D" in middle.deck
    assert b"OUTPUT=2D" in rebased(path).deck  # the user's own choice
    solid = deck(tmp_path)
    with pytest.raises(DeckError, match="shell_face"):
        rebased(solid, afferents={"SA": 5}, shell_face="top")


def test_a_node_of_a_beam_is_refused(tmp_path):
    path = shell(tmp_path)
    path.write_text(
        path.read_text().replace("*NSET", "*ELEMENT, TYPE=B31, ELSET=ROD\n9, 3, 6\n*NSET", 1)
    )
    with pytest.raises(DeckError, match="B31"):
        rebased(path, afferents={"SA": 3}, shell_face="top")


@pytest.mark.solver
def test_the_faces_of_a_bent_shell_have_the_stress_of_bending_and_its_middle_has_none(tmp_path):
    """A clamped strip of 2 mm, 0.2 thick, bent by 0.05: s = 3 E h w x / (2 L^3) from its tip."""
    path = shell(tmp_path)
    depth_um = np.array([0.0, 25.0, 50.0])
    stress_pa = {}
    for face in ("top", "bottom", "middle"):
        run = solved(
            path,
            Stimulus("bend", depth_um, 1.0, (0.0, 2.0)),
            tmp_path / face,
            afferents={"SA": 2},
            shell_face=face,
        )
        [trace] = fb.read(run)
        stress_pa[face] = trace.stress_pa[-1]
    bending_pa = 1e6 * 3 * 10.0 * 0.2 * 0.05 * 1.0 / (2 * 2.0**3)
    assert_allclose([stress_pa["top"], stress_pa["bottom"]], bending_pa, rtol=0.1)
    assert stress_pa["middle"] < 0.1 * bending_pa


@pytest.mark.solver
def test_the_middle_of_a_shell_in_a_file_of_its_owner_is_named(tmp_path):
    own = tmp_path / "own"
    own.mkdir()
    text = shell(tmp_path).read_text().replace("*END STEP", "*EL FILE, OUTPUT=2D\nS\n*END STEP")
    (own / "job.inp").write_text(text)
    results = _run_ccx(own)
    with pytest.warns(FembridgeWarning, match="node 2 is of a shell"):
        fb.read_history(results, [2])
    (own / "job.inp").write_text(text.replace("OUTPUT=2D", "OUTPUT=3D"))
    fb.read_history(_run_ccx(own), [7])


@pytest.mark.parametrize(
    ("transform", "degree", "direction"),
    [
        ("R\n0., 0., 1., 1., 0., 0.", 1, "-z"),
        ("R\n0., 1., 0., -1., 0., 0.", 2, "+x"),
        ("R\n1., 1., 0., -1., 1., 0.", 1, "(-0.707, -0.707, 0)"),
        ("C\n0., 0., 0., 0., 0., 2.", 1, "-radius"),
        ("C\n0., 0., 0., 0., 0., 2.", 3, "-z"),
    ],
)
def test_the_direction_is_that_of_the_nodes_own_axes(tmp_path, transform, degree, direction):
    path = deck(tmp_path, f"*TRANSFORM, NSET=ALL, TYPE={transform}")
    path.write_text(path.read_text().replace("TOP, 2, 2, -0.01", f"TOP, {degree}, {degree}, -0.01"))
    remarks = rebased(path).remarks
    assert any(f"depth moves TOP along {direction}" in remark for remark in remarks)


# ---- A run without afferents


@pytest.mark.solver
def test_a_run_without_afferents_says_how_to_choose_nodes(tmp_path):
    run = solved(deck(tmp_path), still(2.0), tmp_path / "runs")
    for read in (fb.read, fb.encode):
        with pytest.raises(ResultError, match="--node"):
            read(run.folder)
    assert len(fb.read(run.folder, [4])) == 1


# ---- Relaxing materials

PRONY = "*VISCOELASTIC, TIME=PRONY\n0.3, 0., 0.002\n0.2, 0., 0.02"
RELAXING = """\
*NODE, NSET=ALL
1, 0., 0.
2, 1., 0.
3, 0., 1.
4, 1., 1.
*ELEMENT, TYPE=CPE4, ELSET=SKIN
1, 1, 2, 4, 3
*NSET, NSET=TOP
3, 4
*MATERIAL, NAME=SOFT
*ELASTIC{moduli}
{young}, {poisson}
{prony}
*SOLID SECTION, ELSET=SKIN, MATERIAL=SOFT
1.
*BOUNDARY
1, 1, 2
2, 1, 2
TOP, 1, 1
*STEP{step}
*STATIC
0.1, 1.
*BOUNDARY
TOP, 2, 2, -0.001
*END STEP
"""


def relaxing(
    tmp_path, moduli=", MODULI=INSTANTANEOUS", young=0.1, poisson=0.4, prony=PRONY, step=""
):
    path = tmp_path / "relaxing.inp"
    path.write_text(
        RELAXING.format(moduli=moduli, young=young, poisson=poisson, prony=prony, step=step)
    )
    return path


def lasting_moduli():
    """E and nu of half the shear modulus and the same bulk modulus as E = 0.1, nu = 0.4."""
    shear, bulk = 0.5 * 0.1 / 2.8, 0.1 / 0.6
    young = 9 * bulk * shear / (3 * bulk + shear)
    return {"young": repr(young), "poisson": repr(young / (2 * shear) - 1)}


@pytest.mark.solver
@pytest.mark.parametrize("moduli", ["instantaneous", "long term"])
def test_a_held_strain_relaxes_as_the_prony_series_says(tmp_path, moduli):
    """Strain goes up evenly in the first step and is held: G0 times a closed form."""
    at_once = moduli == "instantaneous"
    options = {} if at_once else {"moduli": "", **lasting_moduli()}
    path = relaxing(tmp_path, **options)
    dt_ms, depth_um = 0.5, 1.0
    stimulus = Stimulus("hold", np.array([0.0, *[depth_um] * 40]), dt_ms, (0.0, 20.0))
    run = solved(path, stimulus, tmp_path / "runs", afferents={"SA": 3})
    assert run.branches == {3: 3}
    [trace] = fb.read(run)
    since_ms = trace.times_ms[1:] - dt_ms
    share = 0.5 + sum(
        g * tau_ms / dt_ms * (1 - np.exp(-dt_ms / tau_ms)) * np.exp(-since_ms / tau_ms)
        for g, tau_ms in ((0.3, 2.0), (0.2, 20.0))
    )
    shear_pa, strain = 1e6 * 0.1 / 2.8, depth_um * 1e-3
    # The deviator of (0, e, 0) is e (-1/3, 2/3, -1/3): von Mises stress is 2 G e.
    assert_allclose(trace.stress_pa[1:], 2 * shear_pa * strain * share, rtol=2e-3)


def test_a_deck_with_branches_is_rebased_like_the_original(tmp_path):
    path = relaxing(tmp_path, step=", NLGEOM")
    result = rebased(path, afferents={"SA": 3})
    text = result.deck.decode()
    assert "*VISCOELASTIC" not in text
    assert "*VISCO, DIRECT, CETOL=1.0E6\n" in text
    assert text.count("TYPE=CPE4") == 3
    again = tmp_path / "again.inp"
    again.write_bytes(result.deck)
    second = rebased(again, afferents={"SA": 3})
    assert second.deck == result.deck
    assert second.sites == result.sites


@pytest.mark.parametrize(
    ("prony", "request_options"),
    [
        (PRONY.replace("0.3, 0.,", "0.3, 0.1,"), {}),
        (PRONY.replace("TIME=PRONY", "TIME=CREEP TEST DATA"), {}),
        (f"*PLASTIC\n1., 0.\n{PRONY}", {}),
        (PRONY.replace("0.002", "0.0002"), {}),
        (PRONY, {"increments": "automatic"}),
    ],
)
def test_a_material_that_calculix_cannot_relax_stays_elastic_with_a_warning(
    tmp_path, prony, request_options
):
    result = rebased(relaxing(tmp_path, prony=prony), **request_options)
    assert b"*VISCOELASTIC" in result.deck
    assert len(result.doubts) == 1
    assert "elastic" in result.doubts[0]
