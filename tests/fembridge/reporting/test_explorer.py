"""The page of `fembridge explore`: its numbers are those of the result, and a browser shows it."""

import base64
import html
import json
import re
import shutil
import zlib
from pathlib import Path

import numpy as np
import pytest

import fembridge as fb
from fembridge.cli import main
from fembridge.errors import UsageError
from fembridge.reporting import explorer as module
from fembridge.reporting.explorer import FRAMES, frame_pressure_kpa

ROOT = Path(__file__).parents[3]
PAGE = Path(module.__file__).parent / "explorer_page"
READY = "window.fembridgeExplorer"
BYTE_KPA = 0.5 / 255


@pytest.fixture(scope="module")
def touch():
    units = fb.Population.grid(step_mm=2.0)
    return fb.touch("punch:diameter_mm=2", press_um=400, population=units, ridges="none")


@pytest.fixture(scope="module")
def simulation():
    return fb.simulate(["sine_20_250", "diharm_10_50_125"], stored=True)


def data_of(page):
    """Values and arrays of the text of a page."""
    [text] = re.findall(r"const DATA = (.*);\n", page)
    data = json.loads(text)
    arrays = {
        name: np.frombuffer(
            zlib.decompress(base64.b64decode(packed["zlib"])), packed["type"]
        ).reshape(packed["shape"])
        for name, packed in data["arrays"].items()
    }
    return data, arrays


def test_the_page_of_a_touch_has_its_spikes_and_samples(touch):
    data, arrays = data_of(fb.explore(touch).to_html())
    spikes = touch.spikes.sort_values("spike_time_ms", kind="stable")
    assert len(spikes) > 20
    assert arrays["spike_ms"].tolist() == spikes["spike_time_ms"].tolist()
    assert [data["units"][unit] for unit in arrays["spike_unit"]] == spikes["unit"].tolist()
    classes = [data["classes"][row] for row in arrays["unit_class"]]
    assert classes == list(touch.population.afferent)
    np.testing.assert_allclose(arrays["rate_ips"], touch.rate_ips, rtol=1e-6)
    np.testing.assert_allclose(arrays["depth_um"], touch.depth_um, rtol=1e-6)
    np.testing.assert_allclose(arrays["force_n"], touch.force_n, rtol=1e-6)
    np.testing.assert_array_equal(arrays["time_ms"], touch.trajectory.times_ms)
    np.testing.assert_allclose(arrays["unit_mm"][:, 0], touch.population.x_mm, rtol=1e-6)
    assert data["force_unit"] == "N"


def test_the_pressure_of_a_frame_carries_the_force(touch):
    """The pressure on all cells times their area is the force of the shape at that time."""
    data, arrays = data_of(fb.explore(touch).to_html())
    frames = np.searchsorted(touch.trajectory.times_ms, arrays["frame_ms"])
    assert frames.size == FRAMES
    pressure_kpa = frame_pressure_kpa(touch, frames)
    carried_n = (pressure_kpa * 1e-3 * touch.contact.nodes.area_mm2).sum(1)
    np.testing.assert_allclose(carried_n, touch.force_n[frames], atol=0.03 * touch.force_n.max())
    shown = arrays["pressure"] / 255 * data["most_kpa"]
    cells = touch.contact.nodes.cells()
    expected = np.nan_to_num([np.ravel(cells.values(row)) for row in pressure_kpa])
    expected = expected[:, expected.any(axis=0)]
    assert shown.max() > 10
    np.testing.assert_allclose(shown, expected, rtol=0, atol=1.01 * BYTE_KPA * data["most_kpa"])


def test_the_stress_on_the_skin_is_that_of_the_touch(touch):
    data, arrays = data_of(fb.explore(touch).to_html())
    hardest = int(touch.force_n[: arrays["time_ms"].size].argmax())
    frame = int(np.abs(arrays["frame_ms"] - arrays["time_ms"][hardest]).argmin())
    vertex = int(np.hypot(arrays["surface_mm"][:, 0], arrays["surface_mm"][:, 2]).argmin())
    state = np.array([touch.contact.hardest])
    place = arrays["surface_mm"][vertex]
    [[[stress_pa]]] = touch.skin_stress_pa(state, place[:1], place[2:])
    shown_kpa = arrays["stress"][frame, vertex] / 255 * data["most_stress_kpa"]
    assert shown_kpa == pytest.approx(stress_pa / 1000, rel=0.02)


def test_the_page_of_a_simulation_has_its_spikes_and_stress(simulation):
    data, arrays = data_of(fb.explore(simulation).to_html())
    names = [afferent["name"] for afferent in data["afferents"]]
    for row, stimulus in enumerate(simulation.stimuli):
        spikes = simulation.spikes.query("stimulus == @stimulus.id")
        expected = sorted(
            zip(spikes["spike_time_ms"], spikes["afferent"], spikes["cell"], strict=True)
        )
        found = zip(
            arrays[f"spike_ms_{row}"].tolist(),
            [names[k] for k in arrays[f"spike_afferent_{row}"]],
            (arrays[f"spike_cell_{row}"] + 1).tolist(),
            strict=True,
        )
        assert sorted(found) == expected
        for column, trace in enumerate(simulation.traces[row]):
            stress = arrays[f"stress_pa_{row}"][column]
            np.testing.assert_allclose(stress, trace.stress_pa, rtol=1e-6)
        depth = arrays[f"depth_um_{row}"]
        np.testing.assert_allclose(depth, stimulus.displacement_um, rtol=1e-6, atol=1e-6)
    rates = [rate for entry in data["stimuli"] for rate in entry["rates_ips"]]
    assert rates == simulation.rates["rate_ips"].tolist()


def test_the_command_writes_the_page_of_the_function(simulation, tmp_path, capsys):
    simulation.write(tmp_path / "out")
    assert main(["explore", str(tmp_path / "out"), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["kind"] == "simulation"
    page = (tmp_path / "out/explore.html").read_bytes()
    assert page == fb.explore(tmp_path / "out").to_html().encode()
    assert main(["explore", str(tmp_path / "out"), "-o", str(tmp_path / "page.html")]) == 0
    assert (tmp_path / "page.html").read_bytes() == page


def test_the_page_of_a_written_touch_is_that_of_the_touch(touch, tmp_path):
    touch.write(tmp_path / "touched")
    assert fb.explore(touch).to_html() == fb.explore(touch).to_html()
    data, arrays = data_of(fb.explore(tmp_path / "touched").to_html())
    in_memory, same = data_of(fb.explore(touch).to_html())
    assert data["units"] == in_memory["units"]
    for name in ("spike_ms", "spike_unit", "pressure"):
        np.testing.assert_array_equal(arrays[name], same[name])


def test_a_solved_run_has_a_page(tmp_path):
    shutil.copytree(ROOT / "fixtures/transient_sine", tmp_path / "run")
    with pytest.warns(fb.FembridgeWarning, match="75 um"):
        explorer = fb.explore(tmp_path / "run")
    assert [item["class"] for item in explorer.values["afferents"]] == ["SA", "RA", "PC"]
    assert explorer.values["section"] is not None
    assert explorer.arrays["spike_ms_0"].size > 20


@pytest.mark.filterwarnings("ignore:parameter set fitted was fitted on:UserWarning")
def test_a_map_of_a_pad_has_no_section():
    result = fb.simulate("sine_20_100", response=fb.PadProbe())
    explorer = fb.explore(result)
    assert explorer.values["section"] is None
    assert explorer.arrays["spike_ms_0"].size == len(result.spikes)


@pytest.mark.filterwarnings("ignore:parameter set fitted_pad was fitted on finger:UserWarning")
@pytest.mark.parametrize("pad", ["plane", "fingertip"])
def test_every_kind_of_pad_has_a_page(pad):
    touch = fb.touch("punch:diameter_mm=2", press_um=200, pad=pad, population="one_each")
    explorer = fb.explore(touch)
    assert explorer.arrays["pressure"].any()
    assert explorer.arrays["stress"].any()
    assert np.abs(explorer.arrays["surface_mm"][:, 0]).max() > 3


def test_what_is_no_result_is_refused(simulation, tmp_path):
    for wrong in (tmp_path, tmp_path / "absent", 3):
        with pytest.raises(UsageError):
            fb.explore(wrong)
    with pytest.raises(UsageError):
        fb.explore(simulation).write()


def test_a_notebook_shows_the_page(simulation):
    explorer = fb.explore(simulation)
    [page] = re.findall('srcdoc="([^"]*)"', explorer._repr_html_())
    assert html.unescape(page) == explorer.to_html()


def test_a_title_that_looks_like_markup_is_text(simulation, tmp_path):
    result = fb.simulate(
        fb.Stimulus("</script><b>", simulation.stimuli[0].displacement_um, 0.1, (0, 250), 75.0),
        stored=True,
    )
    page = fb.explore(result).to_html()
    assert "</script><b>" not in page
    assert data_of(page)[0]["stimuli"][0]["id"] == "</script><b>"


def test_the_bundle_is_of_the_version_that_is_named():
    version = json.loads((PAGE / "three/package.json").read_text())["devDependencies"]["three"]
    bundle = (PAGE / "three/three.min.js").read_text(encoding="utf-8")
    assert f'"{version.split(".")[1]}"' in bundle
    assert len(bundle) < 700_000
    names = set(re.findall(r"\bthree\.([A-Z]\w+)", (PAGE / "explorer.js").read_text("utf-8")))
    exported = (PAGE / "three/scene.mjs").read_text("utf-8")
    assert names == set(re.findall(r"\b[A-Z]\w+", exported.split("*/")[-1].split("\n", 1)[1]))
    assert "MIT License" in (PAGE / "three/LICENSE.txt").read_text("utf-8")


# ---- In a browser


def opened(chromium, explorer, tmp_path, **options):
    path = explorer.write(tmp_path / "explore.html")
    page = chromium.open(path, **options)
    page.wait(READY)
    return page


def inked(page, selector):
    """Whether a canvas has a picture."""
    return page.run(
        f"(() => {{ const canvas = document.querySelector('{selector}');"
        "const copy = document.createElement('canvas');"
        "[copy.width, copy.height] = [canvas.width, canvas.height];"
        "const pen = copy.getContext('2d'); pen.drawImage(canvas, 0, 0);"
        "return pen.getImageData(0, 0, copy.width, copy.height).data.some(Boolean); })()"
    )


def test_a_touch_is_played_in_three_dimensions(chromium, touch, tmp_path):
    page = opened(chromium, fb.explore(touch), tmp_path)
    if not page.run("fembridgeExplorer.isInSpace()"):
        pytest.skip("no WebGL in this Chromium")
    page.run("new Promise((done) => setTimeout(done, 100))")
    assert inked(page, ".stage canvas:not([hidden]):not(.overlay)")
    assert inked(page, ".plots")
    before = page.run("fembridgeExplorer.state.time"), page.picture()
    page.run("fembridgeExplorer.moveTo(0); document.querySelector('.play').click()")
    page.wait("fembridgeExplorer.state.time > 5")
    page.run("document.querySelector('.play').click()")
    assert page.picture() != before[1]
    page.run("document.querySelector('.views button[value=above]').click()")
    page.run("new Promise((done) => setTimeout(done, 100))")
    assert not page.run("fembridgeExplorer.isInSpace()")
    assert page.complaints() == []


def test_without_webgl_the_skin_is_shown_from_above(chromium, touch, tmp_path):
    text = fb.explore(touch).to_html()
    without = "<script>HTMLCanvasElement.prototype.getContext = ((get) => function (kind, ...more) "
    without += "{ return kind === '2d' ? get.call(this, kind, ...more) : null; })"
    without += "(HTMLCanvasElement.prototype.getContext);</script></head>"
    (tmp_path / "page.html").write_text(text.replace("</head>", without, 1), encoding="utf-8")
    page = chromium.open(tmp_path / "page.html")
    page.wait(READY)
    page.run("new Promise((done) => setTimeout(done, 100))")
    assert "no WebGL" in page.run("document.querySelector('.message').textContent")
    assert inked(page, ".stage canvas:not([hidden])")


def test_scrubbing_and_pointing_tell_what_is_there(chromium, touch, tmp_path):
    page = opened(chromium, fb.explore(touch), tmp_path, size=(1300, 900))
    box = page.run("document.querySelector('.plots').getBoundingClientRect().toJSON()")
    page.drag([(box["x"] + 100, box["y"] + 50), (box["x"] + box["width"] - 12, box["y"] + 50)])
    assert page.run("fembridgeExplorer.state.time") == pytest.approx(touch.trajectory.times_ms[-1])
    units = page.run("fembridgeExplorer.state.model.bands[2].units")
    y = page.run("fembridgeExplorer.state.model.bands[2].first")
    page.mouse("mouseMoved", box["x"] + 200, box["y"] + y + 1)
    tip = page.run("document.querySelector('.tip').textContent")
    name = touch.population.unit[units[0]]
    assert tip.startswith(f"{name} (SA): {touch.rate_ips[units[0]]:.3g}")
    assert page.complaints() == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_simulation_is_shown_on_a_phone(chromium, simulation, tmp_path, scheme):
    page = opened(
        chromium,
        fb.explore(simulation),
        tmp_path,
        size=(360, 800),
        **{"prefers-color-scheme": scheme},
    )
    page.run("new Promise((done) => setTimeout(done, 100))")
    assert inked(page, ".stage canvas")
    assert inked(page, ".plots")
    assert page.run("document.documentElement.scrollWidth") <= 360
    choose = "const choice = document.querySelector('select[aria-label=Stimulus]');"
    page.run(f"{choose} choice.value = '1'; choice.dispatchEvent(new Event('change'))")
    assert page.run("fembridgeExplorer.state.model.entry.id") == "diharm_10_50_125"
    assert page.complaints() == []
