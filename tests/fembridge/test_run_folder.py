"""``run.toml`` and ``stimulus.csv``: there and back, and each way to be damaged."""

import hashlib
import math

import numpy as np
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from fembridge.errors import ResultError
from fembridge.exports import write_csv
from fembridge.run_folder import AfferentNode, RunFolder, read_run_folder, read_waveform
from fembridge.stimulus import Stimulus
from fembridge.store import sha256_of

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


@pytest.fixture
def table(tmp_path):
    """Give the table that ``run.toml`` of a whole run holds."""
    import tomllib

    whole_run(tmp_path).write()
    return tomllib.loads((tmp_path / "run.toml").read_text(encoding="utf-8"))


def test_a_run_folder_comes_back_as_it_was_written(tmp_path):
    run = whole_run(tmp_path)

    run.write()

    assert read_run_folder(tmp_path) == run
    assert run.node_of() == {"SA": 25, "PC": 7}
    assert run.end_ms == 260.0
    assert run.deck == tmp_path / "job.inp"
    assert run.results == tmp_path / "job.frd"


def test_the_same_run_gives_the_same_bytes(tmp_path):
    for name in ("first", "second"):
        whole_run(tmp_path / name).write()
    first, second = (tmp_path / name / "run.toml" for name in ("first", "second"))
    assert first.read_bytes() == second.read_bytes()


def test_a_folder_without_one_is_no_run_folder(tmp_path):
    with pytest.raises(ResultError, match=r"no run\.toml: not a run") as caught:
        read_run_folder(tmp_path)
    assert caught.value.path == tmp_path


def test_a_file_is_no_run_folder(tmp_path):
    (tmp_path / "job.frd").write_text("1C")
    with pytest.raises(ResultError, match=r"job\.frd: no run.toml: not a run folder"):
        read_run_folder(tmp_path / "job.frd")


def test_a_folder_in_its_place_is_told(tmp_path):
    (tmp_path / "run.toml").mkdir()
    with pytest.raises(ResultError, match="cannot be read: Is a directory"):
        read_run_folder(tmp_path)


@pytest.mark.parametrize(
    "content", [b"solver = ", b"\xff\xfe\x00", b"a = " + b"[" * 100_000, b"format = 1\nformat = 1"]
)
def test_what_is_not_toml_is_refused(tmp_path, content):
    (tmp_path / "run.toml").write_bytes(content)
    with pytest.raises(ResultError, match=r"run\.toml: not readable as TOML: "):
        read_run_folder(tmp_path)


@pytest.mark.parametrize("share", [0.05, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.99])
def test_a_file_cut_before_its_inputs_is_refused(tmp_path, share):
    """Also between two afferents, where it is TOML and lacks one of them."""
    whole_run(tmp_path).write()
    path = tmp_path / "run.toml"
    content = path.read_bytes()
    path.write_bytes(content[: int(share * content.index(b"[inputs]"))])

    with pytest.raises(ResultError):
        read_run_folder(tmp_path)


@pytest.mark.parametrize("value", [None, 0, 2, "1"])
def test_another_format_is_refused_with_the_next_step(tmp_path, table, value):
    del table["format"]
    if value is not None:
        table["format"] = value
    (tmp_path / "run.toml").write_text(tomli_w.dumps(table))

    with pytest.raises(ResultError, match="expected 1; build the deck again") as caught:
        read_run_folder(tmp_path)
    assert f"format {value!r}" in str(caught.value)


@pytest.mark.parametrize(
    "key",
    [
        "solver",
        "deck_sha256",
        "time",
        "time.increments",
        "time.dt_ms",
        "time.start_ms",
        "inputs",
        "afferents",
        "afferents.SA.node",
        "afferents.SA.layer",
        "afferents.PC.x_mm",
        "afferents.PC.y_mm",
        "afferents.PC.depth_mm",
    ],
)
def test_a_missing_key_is_named(tmp_path, table, key):
    *sections, last = key.split(".")
    section = table
    for name in sections:
        section = section[name]
    del section[last]
    (tmp_path / "run.toml").write_text(tomli_w.dumps(table))

    with pytest.raises(ResultError, match=f"not a run.toml of fembridge: no '{last}'"):
        read_run_folder(tmp_path)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("time.increments", 0, "increments is 0, expected 1 or more"),
        ("time.increments", 30.5, "increments is 30.5, expected 1 or more"),
        ("time.increments", True, "increments is True"),
        ("time.increments", "30", "increments is '30'"),
        ("time.dt_ms", 0.0, "dt_ms is 0.0, expected more than 0"),
        ("time.dt_ms", math.nan, "dt_ms is nan"),
        ("time.dt_ms", math.inf, "dt_ms is inf"),
        ("time.dt_ms", "soon", "could not convert string to float: 'soon'"),
        ("time.dt_ms", 10**400, "too large"),
        ("time.start_ms", -1.0, "start_ms is -1, expected from 0 to the end of"),
        ("time.start_ms", 261.0, "start_ms is 261, expected from 0 to the end of"),
        ("time.start_ms", math.nan, "start_ms is nan"),
        ("apex_node", -1, "apex_node is -1, expected 0 or more"),
        ("afferents.SA.node", 0, "SA: node is 0, expected 1 or more"),
        ("afferents.SA.node", 2.0, "SA: node is 2.0"),
        ("afferents.SA.depth_mm", math.nan, "SA: its place is not finite"),
        ("afferents.SA", 3, "not a run.toml of fembridge"),
        ("afferents", [], "not a run.toml of fembridge"),
        ("time", 5, "not a run.toml of fembridge"),
        ("inputs", 5, "not a run.toml of fembridge"),
    ],
)
def test_a_value_that_no_run_has_is_refused(tmp_path, table, key, value, message):
    *sections, last = key.split(".")
    section = table
    for name in sections:
        section = section[name]
    section[last] = value
    (tmp_path / "run.toml").write_text(tomli_w.dumps(table))

    with pytest.raises(ResultError, match=message) as caught:
        read_run_folder(tmp_path)
    assert caught.value.path == tmp_path / "run.toml"


def test_the_waveform_comes_back_to_the_last_bit(tmp_path):
    depth_um = np.random.default_rng(5).standard_normal(501)
    stimulus = Stimulus("mine", depth_um, 0.5, (5.0, 250.0))

    write_csv(stimulus, tmp_path / "stimulus.csv")
    times_ms, read_um = read_waveform(tmp_path)

    np.testing.assert_array_equal(times_ms, stimulus.times_ms)
    np.testing.assert_array_equal(read_um, depth_um)


@pytest.mark.parametrize(
    ("content", "where"),
    [
        ("", "stimulus.csv:1: expected time_ms,displacement_um"),
        ("time,depth\n0,0\n1,1\n", "stimulus.csv:1: expected time_ms,displacement_um"),
        ("time_ms,displacement_um\n", "stimulus.csv: 0 samples"),
        ("time_ms,displacement_um\n0.0,1.0\n", "stimulus.csv: 1 samples"),
        ("time_ms,displacement_um\n0,1\n0.5,two\n1,3\n", r"csv:3: .*'two'"),
        ("time_ms,displacement_um\n0,1\n\n1,3\n", "csv:3: not a sample"),
        ("time_ms,displacement_um\n0,1\n1,2,3\n", "csv:3: not a sample"),
        ("time_ms,displacement_um\n0,1\n1\n", "csv:3: not a sample"),
        ("time_ms,displacement_um\n0,1\n1,nan\n", "csv:3: not a sample: not finite"),
        ("time_ms,displacement_um\n0,1\n1,\0\n", "csv:3: not a sample"),
        (f"time_ms,displacement_um\n0,{'1' * 200_000}\n", "csv:2: not a sample"),
    ],
)
def test_a_damaged_waveform_is_refused_with_its_line(tmp_path, content, where):
    (tmp_path / "stimulus.csv").write_text(content, encoding="utf-8")
    with pytest.raises(ResultError, match=where):
        read_waveform(tmp_path)


def test_a_waveform_that_is_no_text_or_not_there_is_refused(tmp_path):
    with pytest.raises(ResultError, match=r"stimulus\.csv: cannot be read: No such"):
        read_waveform(tmp_path)
    (tmp_path / "stimulus.csv").write_bytes(b"time_ms,displacement_um\n0,\xff\n")
    with pytest.raises(ResultError, match="not a sample"):
        read_waveform(tmp_path)


@given(content=st.binary(max_size=2000))
def test_a_digest_is_that_of_the_bytes(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("digest") / "file"
    path.write_bytes(content)
    assert sha256_of(path) == hashlib.sha256(content).hexdigest()
