"""`fembridge check` and `fb.check`: contents of a deck, problems and warnings."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import fembridge as fb
from decks.own_model.inspection import density_kg_m3, unit_findings
from decks.presets import read_finger
from decks.unit_system import LENGTH_UNITS, MM, UNIT_SYSTEMS
from fembridge.cli import main
from fembridge.errors import DeckError, FembridgeWarning
from fembridge.solver.check import TABLES, text_of

OWN_MODELS = Path(__file__).parent / "own_models"
FIXTURES = Path(__file__).parents[2] / "fixtures"
MARC = sorted((FIXTURES / "marc_samples").glob("*.dat"))
EXAMPLES = Path("/usr/share/doc/calculix-ccx-test/examples/test")  # Debian: calculix-ccx-test
DECK = """\
*HEADING
skin and tissue under a plate
*NODE, NSET=ALL
1, 0., 0.
2, 10., 0.
3, 0., 10.
4, 10., 10.
5, 0., 20.
6, 10., 20.
*ELEMENT, TYPE=CPE4, ELSET=LOWER
1, 1, 2, 4, 3
*ELEMENT, TYPE=CPE4, ELSET=UPPER
2, 3, 4, 6, 5
*NSET, NSET=TOP
5, 6
*MATERIAL, NAME=TISSUE
*ELASTIC
{young}, 0.3
*DENSITY
1.1E-9
*MATERIAL, NAME=SKIN
*HYPERELASTIC, NEO HOOKE
{c10}, 0.1
*SOLID SECTION, ELSET=LOWER, MATERIAL=TISSUE
*SOLID SECTION, ELSET=UPPER, MATERIAL=SKIN
*BOUNDARY
1, 1, 2
2, 2, 2
*STEP, NLGEOM
*STATIC
0.1, 1.
*BOUNDARY
TOP, 2, 2, -0.3
*DLOAD
LOWER, GRAV, {gravity}, 0., -1., 0.
*END STEP
*STEP
*FREQUENCY
5
*END STEP
"""


@pytest.fixture
def write(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def written(young=0.02, c10=0.1, gravity=9810.0, text=DECK):
        path = tmp_path / "mine.inp"
        path.write_text(text.format(young=young, c10=c10, gravity=gravity))
        return path

    return written


def topics(findings):
    return [finding.topic for finding in findings]


def test_the_tables_hold_what_the_deck_does(write):
    result = fb.check(write(), afferents={"SA": 5})
    assert result.passed
    assert result.parts[["part", "element", "elements", "material"]].to_numpy().tolist() == [
        ["LOWER", "CPE4", 1, "TISSUE"],
        ["UPPER", "CPE4", 1, "SKIN"],
    ]
    assert_allclose(result.materials["young_mpa"], [0.02, 6 * 0.1])  # E = 3 G, G = 2 C10
    assert_allclose(result.materials["density_kg_m3"].iloc[0], 1100.0)
    assert result.sets.set_index("set")["members"].to_dict() == {
        **{"ALL": 6, "TOP": 2, "LOWER": 1, "UPPER": 1}
    }
    assert result.steps[["procedure", "role"]].to_numpy().tolist() == [
        ["*STATIC", "waveform"],
        ["*FREQUENCY", "left out"],
    ]
    [motion] = result.motions.to_dict("records")
    assert (motion["target"], motion["direction"], motion["role"]) == ("TOP", "-y", "waveform")
    [load] = result.loads.to_dict("records")
    assert (load["label"], load["course"], load["line"]) == ("GRAV", "own ramp kept", 35)
    assert result.afferents["materials"].tolist() == ["SKIN"]
    assert result.cost["increments"] == 500
    assert topics(result.warnings) == ["waveform"]  # gravity acts in part


@pytest.mark.parametrize(
    ("young", "c10", "hint"),
    [(20.0, 100.0, "0.02 MPa if the 20 is in kPa"), (2e4, 1e5, "in Pa"), (1e-6, 1.0, "")],
)
def test_a_softest_material_that_no_tissue_is_triggers_a_warning(write, young, c10, hint):
    path = write(young, c10)
    warnings = [item for item in fb.check(path).warnings if item.topic == "units"]
    assert [item.line for item in warnings] == [16]
    assert hint in warnings[0].message
    with pytest.warns(FembridgeWarning) as caught:
        fb.rebase_deck(path, "sine_20_250", "runs")
    assert any("softest material, TISSUE" in str(item.message) for item in caught)
    assert not [item for item in fb.check(write()).warnings if item.topic == "units"]


@pytest.mark.parametrize(
    ("name", "density"),
    [("MM_TON_S_C", 1.1e-9), ("M_KG_S_C", 1100.0), ("M_TON_S_C", 1.1), ("IN_LB_S_F", 1.0293e-4)],
)
def test_a_density_is_that_of_skin_in_every_unit_system(name, density):
    assert_allclose(density_kg_m3(density, UNIT_SYSTEMS[name]), 1100.0, rtol=1e-4)


def test_gravity_density_and_size_in_other_units_trigger_warnings(write):
    row = {"material": "A", "young_mpa": 0.1, "density_kg_m3": 1.1e12, "elements": 3, "line": 7}
    assert len(unit_findings([row], (20.0, 5.0), MM)) == 1
    assert len(unit_findings([{**row, "elements": 0}], (0.02, 0.01), MM)) == 1
    assert len(unit_findings([], (20_000.0,), LENGTH_UNITS["m"])) == 1
    result = fb.check(write(gravity=9.81))
    assert [item.line for item in result.warnings if item.topic == "units"] == [35]


def test_a_density_names_the_unit_of_length_that_makes_it_one():
    row = {"material": "A", "young_mpa": 0.1, "density_kg_m3": 7.8e15, "elements": 3, "line": 7}
    [finding] = unit_findings([row], (), MM)
    assert "7800" in finding.message and "--length-unit m" in finding.message
    [finding] = unit_findings([{**row, "density_kg_m3": 1e20}], (), MM)
    assert "--length-unit" not in finding.message


def test_a_section_without_a_material_is_named(write):
    """*SHELL GENERAL SECTION of Abaqus states a stiffness, from which no stress follows."""
    section = "*SOLID SECTION, ELSET=UPPER, MATERIAL=SKIN\n"
    path = write(text=DECK.replace(section, "*SHELL GENERAL SECTION, ELSET=UPPER\n1., 2., 3.\n"))
    [problem] = [item for item in fb.check(path).problems if item.topic == "materials"]
    assert "*SHELL GENERAL SECTION" in problem.message


def test_what_a_waveform_refuses_is_a_problem(write):
    result = fb.check(write(), afferents={"SA": 3})
    assert topics(result.problems) == ["waveform"]
    assert "TISSUE and SKIN" in str(result.problems[0])
    assert result.cost == {}
    path = write(text=DECK.replace("*SOLID SECTION, ELSET=UPPER, MATERIAL=SKIN\n", ""))
    assert "materials" in topics(fb.check(path).problems)


def test_viscoelastic_and_path_dependent_contact_are_warned_of(write):
    pair = "*CONTACT PAIR, INTERACTION=I, TYPE=SURFACE TO SURFACE\nA, B"
    contact = f"*SURFACE INTERACTION, NAME=I\n{pair}\n*BOUNDARY"
    text = DECK.replace("*DENSITY", "*VISCOELASTIC, TIME=PRONY\n0.5, 0., 0.01\n*DENSITY")
    result = fb.check(write(text=text.replace("*BOUNDARY", contact, 1)))
    warnings = {(item.topic, item.line) for item in result.warnings}
    assert {("cards", 19), ("contact", 29)} <= warnings
    assert "19" in str(result.cards["line"].tolist())


def test_the_command_prints_a_page_and_the_same_as_json(write, capsys):
    path = write()
    assert main(["check", str(path), "--afferent", "SA=5"]) == 0
    page = capsys.readouterr().out.splitlines()
    assert page[0].startswith(f"{path} (CalculiX): 0 problems")
    assert {"parts:", "materials:", "steps:", "motions:", "loads:", "afferents:"} <= set(page)
    assert main(["check", str(path), "--afferent", "SA=3", "--json"]) == 1
    summary = json.loads(capsys.readouterr().out)
    assert set(TABLES) <= set(summary)
    severities = [(item["severity"], item["topic"]) for item in summary["findings"]]
    assert severities[0] == ("problem", "waveform")
    assert summary["findings"] == fb.check(path, afferents={"SA": 3}).to_dict()["findings"]
    assert not list(path.parent.glob("runs*"))


def test_a_result_shows_itself_in_five_lines_and_as_html(write):
    result = fb.check(write(20.0, 100.0))
    lines = repr(result).splitlines()
    assert lines[0].startswith("DeckCheck of ")
    assert len(lines) <= 5
    assert "<li>units: " in result._repr_html_()
    with pytest.raises(AttributeError):
        result.nothing  # noqa: B018 - the access is the test


@pytest.mark.parametrize("path", MARC, ids=lambda path: path.stem)
def test_a_deck_of_marc_is_checked(path):
    result = fb.check(path)
    assert result.steps["procedure"].tolist()
    assert result.parts["elements"].sum() > 0
    assert text_of(result)


def test_a_file_that_is_no_deck_is_refused(tmp_path):
    for name in ("no.inp", "mine.txt"):
        with pytest.raises(DeckError):
            fb.check(tmp_path / name)


@pytest.mark.parametrize("name", ["prepomax", "axisymmetric"])
def test_a_deck_of_another_program_is_checked(name):
    result = fb.check(OWN_MODELS / f"{name}.inp", move="2001,2" if name == "prepomax" else None)
    assert result.passed
    assert (result.units["length"], result.units["source"]) == (
        ("m", "the heading") if name == "prepomax" else ("mm", "assumed")
    )
    low_s, high_s = result.cost["seconds"]
    assert 0.3 < low_s < high_s < 60.0  # 3 s on one core, measured


CARDS = ("*TRANSFORM, NSET=TOP, TYPE=R", "*VISCOELASTIC, TIME=PRONY", "1, 2, 3", "*STEP", "*NODE")


@given(
    edits=st.lists(
        st.tuples(st.integers(0, 60), st.sampled_from(["", *CARDS])), min_size=1, max_size=4
    )
)
def test_a_deck_with_other_lines_is_checked_or_refused(tmp_path_factory, edits):
    lines = DECK.format(young=0.02, c10=0.1, gravity=9810.0).splitlines()
    for row, text in edits:
        lines[row % len(lines)] = text
    path = tmp_path_factory.mktemp("odd") / "mine.inp"
    path.write_text("\n".join(lines))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fembridge.solver.ccx.find_ccx", lambda: None)
        try:
            result = fb.check(path, afferents={"SA": 5})
        except DeckError:
            return
    assert text_of(result)
    assert json.dumps(result.to_dict())


@pytest.mark.solver
def test_a_deck_with_an_included_file_is_read_by_calculix_too(write):
    text = DECK.replace("*MATERIAL, NAME=SKIN", "*INCLUDE, INPUT=skin.inc\n*MATERIAL, NAME=OTHER")
    path = write(text=text)
    (path.parent / "skin.inc").write_text("*MATERIAL, NAME=SKIN\n*ELASTIC\n0.5, 0.4\n")
    result = fb.check(path)
    assert result.passed
    assert result.materials["material"].tolist() == ["TISSUE", "SKIN", "OTHER"]


@pytest.mark.solver
def test_an_error_of_calculix_is_a_problem_and_an_ignored_card_a_warning(write):
    path = write(text=DECK.replace("*DENSITY\n1.1E-9\n", "*DENSITIES\n1.1E-9\n"))
    result = fb.check(path)
    assert 19 in [item.line for item in result.warnings if item.topic == "cards"]
    result = fb.check(write(text=DECK.replace("\n1, 1, 2\n", "\nNOWHERE, 1, 2\n")))
    assert "solver" in topics(result.problems)


@pytest.mark.slow
@pytest.mark.skipif(not EXAMPLES.is_dir(), reason="calculix-ccx-test is not installed")
def test_every_deck_of_the_tests_of_calculix_is_checked(tmp_path, monkeypatch):
    """355 decks that nobody wrote for this program; none of them is about skin."""
    import gzip

    monkeypatch.setattr("fembridge.solver.ccx.find_ccx", lambda: None)
    checked = 0
    for source in sorted([*EXAMPLES.glob("*.inp"), *EXAMPLES.glob("*.inp.gz")]):
        data = source.read_bytes()
        path = tmp_path / source.name.removesuffix(".gz")
        path.write_bytes(gzip.decompress(data) if source.suffix == ".gz" else data)
        result = fb.check(path)
        assert text_of(result)
        assert "materials" not in topics(result.problems)
        checked += 1
    assert checked > 300


def test_a_finger_file_in_kpa_triggers_a_warning_before_anything_is_solved(tmp_path):
    path = tmp_path / "mine.toml"
    layers = {"stratum_corneum": 400, "epidermis": 400, "dermis": 80, "subcutaneous_tissue": 34}
    text = "".join(f"[materials.{name}]\nyoung_mpa = {value}\n" for name, value in layers.items())
    path.write_text(text)
    with pytest.warns(FembridgeWarning) as caught:
        read_finger(str(path))
    assert "in kPa" in str(caught[0].message)


def test_a_deck_without_a_step_has_a_problem_only_with_a_waveform(tmp_path, capsys):
    model = DECK.format(young=0.05, c10=0.3, gravity=9810.0).partition("*STEP")[0]
    (tmp_path / "model.inp").write_text(model)
    result = fb.check(tmp_path / "model.inp")
    assert result.passed and not result.changes and not result.cost
    assert result.steps.empty and len(result.parts) == 2
    (problem,) = fb.check(tmp_path / "model.inp", "sine_20_250").problems
    assert problem.topic == "waveform"
    assert main(["check", str(tmp_path / "model.inp")]) == 0
    assert main(["check", str(tmp_path / "model.inp"), "--stimulus", "sine_20_250"]) == 1
    for broken in ("*END STEP\n", "*INCLUDE, INPUT=absent.inp\n"):
        (tmp_path / "model.inp").write_text(model + broken)
        assert not fb.check(tmp_path / "model.inp").passed
    capsys.readouterr()
