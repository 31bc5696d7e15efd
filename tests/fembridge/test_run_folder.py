"""``run.toml`` and ``stimulus.csv``: there and back, and each way to be damaged."""

import math
import tomllib
from dataclasses import replace
from datetime import date

import pytest
import tomli_w

from fembridge.errors import ResultError
from fembridge.io.run_folder import AfferentNode, RunFolder, read_run_folder, read_waveform

PLACES = (
    AfferentNode("SA", 25, "epidermis", 0.0, -0.61, 0.61),
    AfferentNode("PC", 7, "subcutaneous", 0.1, -2.5, 2.5),
)


def whole_run(folder):
    return RunFolder(
        folder=folder,
        solver="calculix",
        increments=520,
        dt_ms=0.5,
        start_ms=10.0,
        afferents=PLACES,
        deck_sha256="ab" * 32,
        apex_node=3,
        inputs={"element": "CPE4", "stimulus": {"id": "sine_50_250", "seed": 3}},
    )


def test_an_own_deck_s_steps_before_the_stimulus_are_part_of_the_pre_indentation(tmp_path):
    inputs = {
        "base_deck": {"file": "mine.inp", "sha256": "0", "stands_um": 75.00000000000001},
        "stimulus": {"id": "sine_50_250", "window_ms": [0.0, 250.0], "preindent_um": 10.0},
    }
    assert replace(whole_run(tmp_path), inputs=inputs).origin().preindent_um == 85.0
    inputs["stimulus"].pop("preindent_um")
    assert replace(whole_run(tmp_path), inputs=inputs).origin().preindent_um == 75.0


@pytest.mark.parametrize("depth", ["75", [75.0], True])
def test_a_depth_that_is_no_number_gives_no_origin(tmp_path, depth):
    stimulus = {"id": "sine_50_250", "window_ms": [0.0, 250.0]}
    for inputs in (
        {"stimulus": stimulus, "base_deck": {"stands_um": depth}},
        {"stimulus": {**stimulus, "preindent_um": depth}, "base_deck": {"stands_um": 3.0}},
    ):
        with pytest.raises(ResultError) as caught:
            replace(whole_run(tmp_path), inputs=inputs).origin()
        assert caught.value.found == depth
        assert caught.value.expected == "a number"


def test_a_folder_without_one_is_no_run_folder(tmp_path):
    with pytest.raises(ResultError) as caught:
        read_run_folder(tmp_path)
    assert caught.value.path == tmp_path


@pytest.mark.parametrize("share", [0.05, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.99])
def test_a_file_cut_before_its_inputs_is_refused(tmp_path, share):
    """Also between two afferents, where it is TOML and lacks one of them."""
    whole_run(tmp_path).write()
    path = tmp_path / "run.toml"
    content = path.read_bytes()
    path.write_bytes(content[: int(share * content.index(b"[inputs]"))])
    with pytest.raises(ResultError):
        read_run_folder(tmp_path)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *((key, None) for key in ("format", "solver", "deck_sha256", "time", "inputs")),
        *((f"time.{key}", None) for key in ("increments", "dt_ms", "start_ms")),
        *((f"afferents.SA.{key}", None) for key in ("node", "layer", "x_mm", "y_mm")),
        ("afferents", None),
        ("format", 2),
        ("time.increments", 0),
        ("time.dt_ms", math.nan),
        ("time.dt_ms", 10**400),
        ("time.start_ms", -1.0),
        ("time.start_ms", 261.0),
        ("apex_node", -1),
        ("afferents.SA.node", 0),
        ("afferents.SA", 3),
        ("afferents.sa\x1b[31m", {"node": 3, "layer": "", "x_mm": 0.0, "y_mm": 0.0}),
        ("branches.x", 2),
        ("afferents.SA.node", 10**30),
        ("afferents.SA.x_mm", math.nan),
        ("time.before_ms", math.nan),
        ("inputs.probe.x_mm", math.nan),
        ("inputs.stimulus.preindent_um", -math.inf),
        ("inputs.finger.date", date(2026, 1, 1)),
        ("inputs.stimulus", 3),
        ("inputs.finger", "quick"),
    ],
)
def test_a_key_that_is_absent_or_holds_what_no_run_has_is_named(tmp_path, key, value):
    """None: the key is absent."""
    whole_run(tmp_path).write()
    table = tomllib.loads((tmp_path / "run.toml").read_text(encoding="utf-8"))
    *sections, last = key.split(".")
    section = table
    for name in sections:
        section = section.setdefault(name, {})
    section[last] = value
    if value is None:
        del section[last]
    (tmp_path / "run.toml").write_text(tomli_w.dumps(table))

    with pytest.raises(ResultError) as caught:
        read_run_folder(tmp_path)
    assert caught.value.path == tmp_path / "run.toml"
    assert caught.value.key == key


@pytest.mark.filterwarnings("ignore:.*1 of the 2 cells:fembridge.errors.FembridgeWarning")
@pytest.mark.parametrize(
    ("content", "line"),
    [
        ("", None),
        ("time,depth\n0,0\n1,1\n", 1),
        ("time_ms,displacement_um\n0.0,1.0\n", None),
        ("time_ms,displacement_um\n0,1\n0.5,two\n1,3\n", 3),
        ("time_ms,displacement_um\n0,1\n1,2,3\n", 3),
        ("time_ms,displacement_um\n0,1\n1\n", 3),
        ("time_ms,displacement_um\n0,1\n1,nan\n", 3),
    ],
)
def test_a_damaged_waveform_is_refused_with_its_line(tmp_path, content, line):
    (tmp_path / "stimulus.csv").write_text(content, encoding="utf-8")
    with pytest.raises(ResultError) as caught:
        read_waveform(tmp_path)
    assert (caught.value.path.name, caught.value.line) == ("stimulus.csv", line)
