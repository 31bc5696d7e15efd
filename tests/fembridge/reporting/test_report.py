"""Reports of folders: what is told apart, what is checked, and a page that needs nothing else."""

import re
import shutil
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import fembridge as fb
from decks.own_model.deck_mesh import read_deck_mesh
from decks.presets import QUICK, finger_from, mesh_of
from fembridge.cli import main
from fembridge.errors import DeckError, FembridgeWarning, UsageError
from fembridge.plots.deck_mesh import deck_mesh_figure
from fembridge.reporting.folder_page import Check, Report, Section
from fembridge.response.response_map import FOLDER, read_map, write_map
from fembridge.touching.pad_file import STORED

# Sets on other mechanics than those of their fit are in tests/fembridge/test_mechanics.py.
pytestmark = pytest.mark.filterwarnings("ignore:parameter set")

ROOT = Path(fb.__file__).parents[1]
RUN = ROOT / "fixtures/response_quick"
PREPOMAX = ROOT / "tests/fembridge/own_models/prepomax.inp"
# Attributes by which a page loads something.
LOADING = {"src", "href", "xlink:href", "data", "srcset", "action", "poster"}


class Page(HTMLParser):
    """Tags, ids and loading attributes of a page."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.ids, self.loads = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        for name, value in attributes:
            if name == "id":
                self.ids.append(value)
            if name in LOADING:
                self.loads.append(value)


def run_folder(tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(RUN, folder)
    return folder


def verdicts(report):
    return dict(zip(report.checks["check"], report.checks["verdict"], strict=True))


def titles(report):
    return [section.title for section in report.sections]


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """A folder of each kind that costs little."""
    home = tmp_path_factory.mktemp("folders")
    fb.simulate("sine_20_250", stored=True).write(home / "simulation")
    relaxing = {"dermis": {"prony": "skin-wang-2015"}}
    with pytest.warns(FembridgeWarning, match="fitted"):
        touched = fb.touch(
            press_um=200,
            population="one_each",
            finger=finger_from({"materials": relaxing}, "relaxing"),
        )
    touched.write(home / "touch")
    shutil.copytree(RUN, home / "run")
    write_map(home / "response.toml", read_map(FOLDER / "quick.toml"))
    return home


@pytest.fixture(scope="module")
def reported(folders):
    """Report and page of a folder, drawn once."""

    @cache
    def reported(name):
        report = fb.report(folders / name)
        return report, report.to_html()

    return reported


KINDS = {
    "run": ("run", {"Model", "Finger", "What drives it", "Stress", "Spikes", "Commands"}),
    "simulation": (
        "simulation",
        {"Model", "Finger", "What drives it", "Stress", "Spikes", "Commands"},
    ),
    "touch": ("touch", {"Model", "Finger", "What drives it", "Relaxation", "Skin", "Spikes"}),
    "response.toml": ("map", {"Model", "Closure", "Commands"}),
    ".": ("map", {"Model", "Closure", "Commands"}),
}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] * (name in ("touch", "response.toml", ".")))
        for name in KINDS
    ],
)
def test_each_kind_of_folder_has_its_page(name, reported):
    kind, expected = KINDS[name]
    report, text = reported(name)
    assert (report.kind, report.passed) == (kind, True)
    assert expected <= set(titles(report))
    page = Page(text)
    assert not {"script", "link", "iframe", "object", "embed"} & set(page.tags)
    assert all(value.startswith(("#", "data:image/png;base64,")) for value in page.loads)
    assert "@import" not in text
    assert not re.search(r"url\((?!#)", text)
    assert len(page.ids) == len(set(page.ids))
    assert {f"#{section.anchor}" for section in report.sections} <= set(page.loads)
    assert page.tags.count("svg") == len(report.pictures)


def test_a_pad_has_a_page():
    report = fb.report(STORED / "plane.npz")
    assert (report.kind, report.pictures) == ("pad", ())
    with pytest.raises(UsageError) as refused:
        report.plot()
    assert refused.value.argument == "kind"


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("run", marks=pytest.mark.slow),
        "simulation",
        "touch",
        pytest.param("response.toml", marks=pytest.mark.slow),
    ],
)
def test_every_picture_is_drawn_by_its_name(name, folders):
    report = fb.report(folders / name)
    for kind in report.pictures:
        assert isinstance(report.plot(kind), Figure)
    with pytest.raises(UsageError) as refused:
        report.plot("no such picture")
    assert (refused.value.argument, refused.value.found) == ("kind", "no such picture")


def test_numbers_of_a_simulation_stand_on_its_page(folders, reported):
    _, text = reported("simulation")
    for rate_ips in fb.Simulation.read(folders / "simulation").rates["rate_ips"]:
        assert f"<td>{rate_ips:.6g}</td>" in text
    assert "fembridge simulate --stimulus sine_20_250 --finger quick" in text


def test_the_page_of_a_relaxing_touch_names_the_published_set(reported):
    _, text = reported("touch")
    assert "skin-wang-2015: 0.72 at 190 ms" in text


@pytest.mark.parametrize("path", ["nowhere", "."])
def test_what_is_no_folder_of_ours_is_refused(path, tmp_path):
    with pytest.raises(UsageError) as refused:
        fb.report(tmp_path / path)
    assert (refused.value.argument, refused.value.path) == ("folder", tmp_path / path)


# ---- Checks


def test_a_run_without_results_has_a_page_that_says_so(tmp_path):
    folder = run_folder(tmp_path)
    (folder / "job.frd").unlink()
    report = fb.report(folder)
    assert verdicts(report) == {"deck": "ok", "results": "doubt"}
    assert "Stress" not in titles(report)


def test_a_changed_deck_is_a_doubt(tmp_path):
    folder = run_folder(tmp_path)
    deck = folder / "job.inp"
    deck.write_bytes(deck.read_bytes() + b"** a remark\n")
    assert verdicts(fb.report(folder))["deck"] == "doubt"


def test_a_missing_deck_fails_and_so_does_the_command(tmp_path, capsys):
    folder = run_folder(tmp_path)
    (folder / "job.inp").unlink()
    report = fb.report(folder)
    assert (verdicts(report)["deck"], report.passed) == ("failed", False)
    assert main(["report", str(folder), "-o", str(tmp_path / "page.html")]) == 1
    assert (tmp_path / "page.html").is_file()
    assert "failed deck" in capsys.readouterr().out


def test_cut_results_fail(tmp_path):
    folder = run_folder(tmp_path)
    results = folder / "job.frd"
    results.write_bytes(results.read_bytes()[:30_000])
    assert verdicts(fb.report(folder))["stress"] == "failed"


def test_a_map_that_does_not_close_fails(tmp_path):
    response = read_map(FOLDER / "quick.toml")
    for closure, verdict in ((0.4, "ok"), (0.6, "failed"), (float("nan"), "doubt")):
        write_map(tmp_path / "response.toml", replace(response, closure_percent=closure))
        assert verdicts(fb.report(tmp_path))["closure"] == verdict


def test_a_refused_map_has_the_page_of_its_run(tmp_path):
    shutil.copytree(run_folder(tmp_path), tmp_path / "map" / "run")
    report = fb.report(tmp_path / "map")
    assert (report.kind, verdicts(report)["map"]) == ("run", "doubt")
    (tmp_path / "map" / "no_map.txt").write_text("stress depends on the path\n")
    report = fb.report(tmp_path / "map")
    assert (verdicts(report)["map"], verdicts(report)["deck"]) == ("failed", "ok")
    assert "depends on the path" in str(report.checks)


def test_the_command_writes_into_the_folder(folders, reported, capsys):
    assert main(["report", str(folders / "touch")]) == 0
    page = folders / "touch" / "report.html"
    assert page.read_text(encoding="utf-8") == reported("touch")[1]
    assert str(page) in capsys.readouterr().out


def test_texts_of_others_are_escaped(tmp_path):
    section = Section("A & B", "<b>", {"x_mm": "<i>"}, items=("<u>",), commands=("a < b",))
    checks = (Check("<s>", None, "<p>"),)
    text = Report(tmp_path, "run", "<h1>", "<em>", (section,), checks).to_html()
    for tag in ("b", "i", "u", "s", "em"):
        assert f"<{tag}>" not in text
        assert f"&lt;{tag}&gt;" in text
    assert "x (mm)" in text


# ---- Meshes of any deck


def test_a_mesh_of_our_deck_has_its_elements():
    mesh = read_deck_mesh(RUN / "job.inp")
    quads = mesh_of(QUICK)
    counts = {name.lower(): (mesh.material == n).sum() for n, name in enumerate(mesh.materials)}
    assert mesh.flat
    for layer in ("epidermis", "dermis", "bone"):
        assert counts[layer] == quads.in_layer(layer).sum()


def test_faces_of_solids_are_those_that_one_element_has():
    """The 26 hexahedra of a deck as PrePoMax writes it, beside a plain count."""
    mesh = read_deck_mesh(PREPOMAX)
    text = PREPOMAX.read_text()
    rows = text.partition("Type=C3D8")[2].partition("\n")[2].split("*")[0].split("\n")
    elements = [[int(word) for word in row.split(",")][1:] for row in rows if row.strip()]
    times = {}
    for nodes in elements:
        for face in (
            (0, 1, 2, 3),
            (4, 5, 6, 7),
            (0, 1, 5, 4),
            (1, 2, 6, 5),
            (2, 3, 7, 6),
            (3, 0, 4, 7),
        ):
            key = frozenset(nodes[corner] for corner in face)
            times[key] = times.get(key, 0) + 1
    assert len(mesh.face) == sum(1 for count in times.values() if count == 1)
    assert (mesh.flat, mesh.materials) == (False, ("SOFT",))
    assert isinstance(deck_mesh_figure(mesh, {"SA": (1e-3, 1e-3, 0.0)}, "m"), Figure)


def test_the_mesh_of_a_marc_deck_is_drawn():
    mesh = read_deck_mesh(ROOT / "fixtures/marc_samples/nour_linear.dat")
    assert (mesh.flat, mesh.materials, len(mesh.face)) == (True, ("steel",), 8)
    assert isinstance(deck_mesh_figure(mesh, {"SA": (0.0, 0.0)}), Figure)


def test_a_deck_without_elements_is_refused(tmp_path):
    path = tmp_path / "empty.inp"
    path.write_text("*NODE\n1, 0., 0.\n")
    with pytest.raises(DeckError) as refused:
        read_deck_mesh(path)
    assert refused.value.path == path


# ---- Own models


def own_run(tmp_path):
    deck = tmp_path / "mine.inp"
    deck.write_text(PREPOMAX.read_text())
    depth_um = 10 * (1 - np.cos(np.arange(41) * np.pi / 20))
    wave = fb.Stimulus("wave", depth_um, 0.5, (0.0, 20.0))
    options = {"move": "2001,2", "increments": "automatic", "afferents": {"RA": 25}}
    [run] = fb.rebase_deck(deck, wave, tmp_path / "runs", **options)
    return run.folder


@pytest.mark.slow
@pytest.mark.solver
def test_an_own_model_has_a_page_from_mesh_to_spikes(tmp_path):
    folder = own_run(tmp_path)
    before = fb.report(folder)
    assert verdicts(before)["results"] == "doubt"
    [outcome] = fb.run([folder])
    assert outcome.failure is None
    report = fb.report(folder)
    assert {"Mesh", "What drives it", "Run", "Stress", "Spikes"} <= set(titles(report))
    assert (verdicts(report)["run"], verdicts(report)["stress"]) == ("ok", "ok")
    text = report.to_html()
    assert "--base-deck mine.inp" in text
    assert "--move 2001,2" in text
    assert "--increments automatic" in text
    assert "--afferent RA=25" in text
    assert "2001,2 gets an amplitude" in text


@pytest.mark.slow
@pytest.mark.solver
def test_a_map_of_an_own_deck_has_its_mesh_and_the_command_that_made_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.inp").write_text(PREPOMAX.read_text())
    command = "fembridge map --base-deck mine.inp --move 2001,2 --afferent RA=25,18"
    command += " --depth-um 100 --retract-um 100 --steps 30 -o mapped"
    assert main(command.split()[1:]) == 0
    report = fb.report("mapped")
    assert (report.kind, report.passed) == ("map", True)
    assert {"Mesh", "What drives it", "Closure"} <= set(titles(report))
    assert verdicts(report)["closure"] == "ok"
    assert command in report.to_html()


def test_the_stress_of_all_stimuli_is_checked(tmp_path):
    fb.simulate(["sine_20_250", "sine_50_250"], stored=True).write(tmp_path)
    checks = fb.report(tmp_path).checks.set_index("check")
    assert checks.loc["stress"].tolist() == ["ok", "6 traces, none of them 0"]
