"""The playground: its module is made of its sources, and its spikes are those of Python."""

import hashlib
import importlib.util
import json
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest

import fembridge as fb
from decks.synthesis import make_stimulus
from neural import parameter_set

FOLDER = Path(__file__).parents[2] / "docs/playground"
BUILD_AGAIN = "run python docs/playground/build.py (clang, lld), and commit what it writes"
READY = "window.fembridgePlayground && fembridgePlayground.all[0].first_ms !== undefined"
PLACE = "fembridgePlayground.all[0]"
NODE = """
const fs = require("fs"), [script, stimuli, output] = process.argv.slice(1);
globalThis.window = globalThis;
globalThis.document = { readyState: "complete", querySelectorAll: () => [] };
eval(fs.readFileSync(script, "utf8"));
fembridgePlayground.loading.then((encode) => {
  const spikes = JSON.parse(fs.readFileSync(stimuli, "utf8")).map((depths) =>
    encode(Float64Array.from(depths)).map((afferent) => afferent.cells));
  fs.writeFileSync(output, JSON.stringify(spikes));
});
"""


def module_of(name):
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def build():
    return module_of("build")


@pytest.fixture(scope="module")
def pages():
    return module_of("playground_page")


@pytest.fixture(scope="module")
def record():
    return tomllib.loads((FOLDER / "playground.toml").read_text(encoding="utf-8"))


@pytest.fixture
def open_playground(chromium, pages, tmp_path):
    (tmp_path / "playground.html").write_text(pages.page(), encoding="utf-8")

    def opened(*args, **options):
        page = chromium.open(tmp_path / "playground.html", *args, **options)
        page.wait(READY)
        return page

    return opened


def cells_of(simulation):
    """Spike times by stimulus, class and cell."""
    names, cells = list(parameter_set("fitted").parameters), {}
    for train in simulation.trains:
        key = train.stimulus, names.index(train.afferent)
        cells.setdefault(key, []).append(train.times_ms.tolist())
    return [
        [cells[stimulus.id, row] for row in range(len(names))] for stimulus in simulation.stimuli
    ]


def assert_same_spikes(found, expected):
    assert len(found) == len(expected)
    for stimulus, (of_page, of_python) in enumerate(zip(found, expected, strict=True)):
        for of_class, cells in zip(of_page, of_python, strict=True):
            assert len(of_class) == len(cells)
            for times, python_times in zip(of_class, cells, strict=True):
                assert len(times) == len(python_times), stimulus
                np.testing.assert_allclose(times, python_times, rtol=0, atol=1e-9)


def test_the_module_is_made_of_the_present_sources(build, record):
    module = (FOLDER / "playground.wasm").read_bytes()
    assert hashlib.sha256(module).hexdigest() == record["wasm_sha256"]
    assert record["sources_sha256"] == build.sources_sha256(), BUILD_AGAIN


@pytest.mark.skipif(not shutil.which("clang"), reason="no clang")
@pytest.mark.skipif(not shutil.which("wasm-ld"), reason="no wasm-ld")
def test_the_compiler_gives_the_bytes_of_the_module(build, record):
    if (version := build.compiler_version()) != record["clang"]:
        pytest.skip(f"clang {version}, the module was compiled by {record['clang']}")
    assert build.compiled() == (FOLDER / "playground.wasm").read_bytes(), BUILD_AGAIN


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("node"), reason="no node")
@pytest.mark.filterwarnings("ignore:parameter set fitted was fitted at:UserWarning")
def test_all_stimuli_of_the_catalogue_give_the_spikes_of_python(pages, tmp_path):
    simulation = fb.simulate("all", stored=True)
    own_um = np.abs(np.cumsum(np.random.default_rng(5).normal(0, 3, 601)))
    own = fb.simulate(fb.Waveform(own_um, dt_ms=0.5), stored=True)
    results = (simulation, own)
    depths = [list(s.displacement_um) for result in results for s in result.stimuli]
    (tmp_path / "script.js").write_text(pages.script(), encoding="utf-8")
    (tmp_path / "stimuli.json").write_text(json.dumps(depths))
    files = [tmp_path / name for name in ("script.js", "stimuli.json", "spikes.json")]
    subprocess.run(["node", "-e", NODE, *files], check=True)

    expected = [cells for result in results for cells in cells_of(result)]
    assert sum(len(times) for of in expected for cells in of for times in cells) > 20_000
    assert_same_spikes(json.loads(files[-1].read_text()), expected)


def test_the_page_is_small_and_loads_nothing(pages):
    page = pages.page()
    assert len(page.encode()) < 150_000
    assert not re.findall(r"(?:src|href)\s*=\s*[\"'](?!index\.html)[^\"'+]*[\"']", page)
    assert "//" not in re.sub(r"[\"'][A-Za-z0-9+/=]{200,}[\"']", "", page)


def test_the_first_picture_shows_the_spikes_of_python(open_playground):
    page = open_playground()
    found = page.run(f"{PLACE}.current.afferents.map((afferent) => afferent.cells)")
    simulation = fb.simulate("sine_40_100", stored=True)
    assert_same_spikes([found], cells_of(simulation))
    rates = page.run(f"{PLACE}.current.afferents.map((afferent) => afferent.rate_ips)")
    np.testing.assert_allclose(rates, simulation.rates["rate_ips"], rtol=1e-12)
    inked = "Array.from(document.querySelectorAll('canvas'), (canvas) => canvas.getContext('2d')"
    inked += ".getImageData(0, 0, canvas.width, canvas.height).data.some((part) => part))"
    assert page.run(inked) == [True, True]
    assert page.complaints() == []


@pytest.mark.parametrize(
    ("fragment", "stimulus"),
    [
        ("#kind=sine&frequency_hz=20&amplitude_um=250&preindent_um=75", "sine_20_250"),
        ("#kind=sine&frequency_hz=300&amplitude_um=2.5&preindent_um=75", "sine_300_2.5"),
        (
            "#kind=diharm&frequency1_hz=10&frequency2_hz=50&amplitude1_um=125&amplitude2_um=25"
            "&preindent_um=75",
            "diharm_10_50_125_25",
        ),
        ("#kind=ramp&depth_um=300&up_ms=100&hold_ms=200&preindent_um=75", "ramp_300_100_200_100"),
    ],
)
def test_a_stimulus_of_the_page_is_that_of_the_program(open_playground, fragment, stimulus):
    page = open_playground(fragment=fragment)
    depths = np.array(page.run(f"Array.from({PLACE}.current.depth_um)"))
    expected = make_stimulus(stimulus, 75.0, dt_ms=0.1)
    np.testing.assert_allclose(depths, expected.displacement_um, rtol=0, atol=1.1e-6)
    found = page.run(f"{PLACE}.current.afferents.map((afferent) => afferent.cells)")
    simulation = fb.simulate(stimulus, stored=True)
    assert_same_spikes([found], cells_of(simulation))
    rates = page.run(f"{PLACE}.current.afferents.map((afferent) => afferent.rate_ips)")
    np.testing.assert_allclose(rates, simulation.rates["rate_ips"], rtol=1e-12)
    assert stimulus in page.run("document.querySelector('.playground-foot code').textContent")
    assert page.complaints() == []


def centre_of(page, selector):
    box = page.run(f"document.querySelector('{selector}').getBoundingClientRect().toJSON()")
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def test_a_drag_changes_the_stimulus_and_the_picture(open_playground):
    page = open_playground()
    before = page.run(f"{PLACE}.state"), page.picture()
    x, y = centre_of(page, ".playground-wave")

    page.drag([(x, y), (x - 40, y - 20), (x - 110, y - 60)])
    page.wait(f"!{PLACE}.waits && !{PLACE}.stale")

    state = page.run(f"{PLACE}.state")
    assert state["amplitude_um"] == pytest.approx(2 * before[0]["amplitude_um"], rel=0.01)
    assert state["frequency_hz"] == pytest.approx(2 * before[0]["frequency_hz"], rel=0.01)
    assert page.picture() != before[1]
    assert page.complaints() == []


@pytest.mark.filterwarnings("ignore:parameter set fitted was fitted at:UserWarning")
def test_a_drawn_waveform_is_encoded_and_its_file_repeats_it(open_playground, tmp_path):
    page = open_playground()
    page.run("document.querySelector('input[value=own]').click()")
    page.wait(f"{PLACE}.current.duration_ms === 500")
    x, y = centre_of(page, ".playground-wave")
    before = page.run(f"{PLACE}.state.own_um")

    page.drag([(x - 200, y + 40), (x - 100, y - 30), (x + 50, y + 20), (x + 200, y)])
    page.wait(f"!{PLACE}.waits && !{PLACE}.stale")

    assert np.abs(np.subtract(page.run(f"{PLACE}.state.own_um"), before)).max() > 50
    assert_the_file_repeats(page, tmp_path)


@pytest.mark.filterwarnings("ignore:parameter set fitted was fitted at:UserWarning")
@pytest.mark.parametrize(
    "fragment",
    [
        "#kind=noise&rms_um=30&low_hz=20&high_hz=200&preindent_um=75&seed=3",
        "#kind=sine&amplitude_um=300&frequency_hz=30&preindent_um=150",  # deeper than the map
    ],
)
def test_what_no_id_names_is_saved_as_a_file(open_playground, tmp_path, fragment):
    page = open_playground(fragment=fragment)
    command = page.run("document.querySelector('.playground-foot code').textContent")
    assert command == "fembridge simulate --stimulus waveform.csv"
    assert_the_file_repeats(page, tmp_path)


def assert_the_file_repeats(page, tmp_path):
    saved = "URL.createObjectURL = (file) => { window.saved = file.text(); return '#'; };"
    page.run(saved + "document.querySelectorAll('.playground-foot button')[1].click()")
    (tmp_path / "waveform.csv").write_text(page.run("window.saved"))
    simulation = fb.simulate(tmp_path / "waveform.csv", stored=True)
    found = page.run(f"{PLACE}.current.afferents.map((afferent) => afferent.cells)")
    assert_same_spikes([found], cells_of(simulation))
    assert page.complaints() == []


def test_sliders_and_curve_answer_to_keys(open_playground):
    page = open_playground()
    page.run("document.querySelector('.playground-wave').focus()")
    page.key("ArrowUp")
    assert page.run(f"{PLACE}.state.amplitude_um") > 100
    page.run("document.querySelector('.playground-slider input').focus()")
    louder = page.run(f"{PLACE}.state.amplitude_um")
    for _ in range(30):
        page.key("ArrowLeft")
    assert page.run(f"{PLACE}.state.amplitude_um") < louder
    unlabelled = "Array.from(document.querySelectorAll('.fembridge-playground input'))"
    unlabelled += ".filter((input) => !input.labels.length).length"
    assert page.run(unlabelled) == 0


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_wider_than_a_phone(open_playground, scheme):
    page = open_playground((360, 800), **{"prefers-color-scheme": scheme})
    assert page.run("document.documentElement.scrollWidth") <= 360
    assert page.run("document.documentElement.dataset.theme") == scheme
    assert page.complaints() == []
