"""Sweeps: the table against the pipeline, what is kept, words, counts and exit codes."""

import csv
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from decks.presets import PRESETS
from decks.stimuli import resolve
from decks.synthesis import make_stimulus
from fembridge.errors import UsageError
from fembridge.response.response_map import FOLDER, read_map
from fembridge.simulation.simulate import simulate
from fembridge.stimulus import Stimulus
from fembridge.sweeps import Study, Variant
from fembridge.sweeps import sweep as module
from fembridge.sweeps.study_file import study_from, study_from_frame
from fembridge.sweeps.sweep import (
    RESULTS_FILE,
    STUDY_FILE,
    Sweep,
    make_plan,
    read_answers,
    run_task,
    solver_version,
)
from fembridge.sweeps.sweep import sweep as run_sweep
from neural import parameter_set
from neural.rates import spikes_inside

# Sets on other fingers than that of their fit are in tests/fembridge/test_mechanics.py.
pytestmark = pytest.mark.filterwarnings("ignore:parameter set")

QUICK = Variant("quick", PRESETS["quick"])


def study(words, **changes):
    return Study(resolve(words), changes.pop("variants", (QUICK,)), stored=True, **changes)


def rows_of(sweep):
    with (sweep.folder / RESULTS_FILE).open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_table_holds_what_the_pipeline_gives(here, tmp_path):
    chosen = parameter_set("fitted")
    made = study("noise_25_250,sine_20_250", preindents_um=(0.0, 75.0))
    sweep = run_sweep(made, tmp_path / "out")

    rows = {
        (float(row["preindent_um"]), row["stimulus"], row["afferent"]): row
        for row in rows_of(sweep)
    }
    assert len(sweep.results) == len(rows) == 2 * 6 * 3
    for depth_um in (0.0, 75.0):
        expected = simulate(
            [make_stimulus(entry) for entry in made.stimuli],
            stored=True,
            parameters=replace(chosen, preindent_um=depth_um),
        )
        windows = {each.id: each.window_ms for each in expected.stimuli}
        for rate in expected.mean_rates:
            row = rows[depth_um, rate.stimulus, rate.afferent]
            assert float(row["rate_ips"]) == rate.rate_ips
            inside = [
                spikes_inside(train.times_ms, windows[train.stimulus])
                for train in expected.trains
                if (train.stimulus, train.afferent) == (rate.stimulus, rate.afferent)
            ]
            assert int(row["spikes"]) == sum(inside)
            assert (row["status"], row["cause"]) == ("done", "")
        for stimulus, traces in zip(expected.stimuli, expected.traces, strict=True):
            for trace in traces:
                row = rows[depth_um, stimulus.id, trace.afferent]
                assert float(row["peak_stress_pa"]) == trace.stress_pa.max()


def test_deep_stimuli_take_the_deep_response_that_is_stored(here, tmp_path):
    sweep = run_sweep(study("sine_20_250", preindents_um=(300.0,)), tmp_path)
    assert not sweep.failed
    assert sweep.results["peak_stress_pa"].min() > 0


def harmed(content):
    """What may become of a file: cut, edited, nonsense, or gone."""
    return content[: len(content) // 2], content.replace(b"2", b"3", 1), b"\xff\x00", None


def test_a_file_of_an_item_that_was_harmed_makes_it_unfinished(here, tmp_path):
    made = study("sine_20_250")
    sweep = run_sweep(made, tmp_path)
    table = (sweep.folder / RESULTS_FILE).read_bytes()
    [item] = make_plan(made, "stored").items.values()
    for name in ("answers.csv", "spikes.csv", "item.toml"):
        path = tmp_path / item.run_folder / name
        content = path.read_bytes()
        for change in harmed(content):
            path.unlink() if change is None else path.write_bytes(change)
            assert not item.is_finished(tmp_path), (name, change)
            path.write_bytes(content)
            assert item.is_finished(tmp_path)
        path.write_bytes(b"")

        again = run_sweep(made, tmp_path)

        assert again.finished_before == 0
        assert (again.folder / RESULTS_FILE).read_bytes() == table
        assert item.is_finished(tmp_path)


def test_one_that_fails_is_listed_and_stops_nobody(here, tmp_path):
    table = {
        "stimuli": ["noise_25_250", "sine_20_250"],
        "fingers": ["quick", {"grid": {"skin": {"epidermis_mm": [0.5]}}}, "paper"],
        "stored": True,
    }
    sweep = run_sweep(study_from(table, tmp_path), tmp_path)

    [failed] = sweep.failed
    assert "no response is stored for this finger" in failed.cause
    rows = rows_of(sweep)
    assert [row["status"] for row in rows] == ["done"] * 18 + ["failed"] * 18 + ["done"] * 18
    bad = rows[18:36]
    assert {row["cause"] for row in bad} == {failed.cause}
    assert {row["rate_ips"] + row["spikes"] + row["peak_stress_pa"] for row in bad} == {""}
    assert {(row["finger"], row["skin.epidermis_mm"]) for row in rows} == {
        ("quick", "0.4"),
        ("quick", "0.5"),
        ("paper", "0.4"),
    }


def test_a_bug_of_ours_in_one_item_is_its_cause_and_stops_nobody(here, tmp_path, monkeypatch):
    real = module.encode_all

    def buggy(stimuli, traces, *words):
        if traces[0][0].node == of_quick:
            raise ZeroDivisionError("by\nnothing")
        return real(stimuli, traces, *words)

    monkeypatch.setattr(module, "encode_all", buggy)
    of_quick = read_map(FOLDER / "quick.toml").places[0].node
    made = study("sine_20_250", variants=(QUICK, Variant("paper", PRESETS["paper"])))
    sweep = run_sweep(made, tmp_path)

    [failed] = sweep.failed
    assert failed.cause.endswith("ZeroDivisionError: by nothing")
    trace = tmp_path / failed.run / "failed.txt"
    assert "in buggy" in trace.read_text()
    monkeypatch.undo()
    monkeypatch.setattr(module, "LocalExecutor", here)
    assert not run_sweep(made, tmp_path).failed
    assert not trace.exists()


def test_an_old_table_does_not_outlive_the_start_of_a_sweep(here, tmp_path, monkeypatch):
    made = study("sine_20_250")
    sweep = run_sweep(made, tmp_path)
    [item] = make_plan(made, "stored").items.values()
    (tmp_path / item.run_folder / "item.toml").unlink()

    def stopped(*words):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "_run_tasks", stopped)
    with pytest.raises(KeyboardInterrupt):
        run_sweep(made, tmp_path)
    assert not (sweep.folder / RESULTS_FILE).exists()


def test_a_frame_is_the_study_with_a_row_a_point(here, tmp_path):
    frame = pd.DataFrame({"stimulus": ["sine_20_250", "sine_50_250"], "preindent_um": [75.0, 75.0]})
    table = {"stimuli": frame["stimulus"].tolist(), "preindent_um": [75.0]}
    rows = []
    for made in (study_from_frame(frame), study_from(table, tmp_path)):
        rows.append(make_plan(replace(made, stored=True), "stored").rows)
    pd.testing.assert_frame_equal(*rows)


def test_fingers_of_a_frame_have_their_changes():
    frame = pd.DataFrame(
        {
            "stimulus": ["sine_20_250", "sine_50_250"] * 2,
            "skin.epidermis_mm": [0.35, 0.35, 0.45, 0.45],
            "probe_diameter_mm": 0.5,
        }
    )
    made = study_from_frame(frame)
    assert [variant.changes for variant in made.variants] == [
        {"skin.epidermis_mm": 0.35},
        {"skin.epidermis_mm": 0.45},
    ]
    assert [probe.diameter_mm for probe in made.probes] == [0.5]
    assert made.points == 4


@pytest.mark.parametrize(
    "frame",
    [
        pd.DataFrame({"stimulus": ["sine_20_250"], "speed": [3]}),
        pd.DataFrame({"preindent_um": [75.0]}),
        pd.DataFrame({"stimulus": ["sine_20_250", "sine_50_250"], "preindent_um": [0.0, 75.0]}),
    ],
)
def test_a_frame_that_is_no_study_is_refused(frame):
    with pytest.raises(UsageError) as caught:
        study_from_frame(frame)
    assert caught.value.argument == "study"


def test_a_sweep_comes_back_from_its_folder(here, tmp_path):
    table = {"stimuli": ["sine_20_250"], "fingers": ["quick", "paper"], "stored": True}
    made = run_sweep(table, tmp_path / "out")
    made.write(tmp_path / "copy")
    for folder in ("out", "copy"):
        read = Sweep.read(tmp_path / folder)
        pd.testing.assert_frame_equal(read.results, made.results)
        assert (read.failed, read.items) == ((), 2)
        assert read.provenance == made.provenance
    with pytest.raises(UsageError) as caught:
        made.plot("raster")
    assert (caught.value.argument, caught.value.found) == ("kind", "raster")


def test_the_command_counts_and_ends_with_0(here, command, study_file, tmp_path, capsys):
    path = study_file('stimuli = ["sine_20_250"]\nstored = true\n')
    assert command(path, "-o", tmp_path / "out") == 0
    streams = capsys.readouterr()
    assert streams.out == f"1 of 1 items done; results.csv (3 rows): {tmp_path}/out\n"
    assert streams.err.startswith("1/1 quick, map: ")
    assert command(path, "-o", tmp_path / "out", "--json") == 0
    streams = capsys.readouterr()
    summary = json.loads(streams.out)
    assert (summary["done"], summary["finished_before"], summary["failed"]) == (1, 1, [])


def test_without_a_solver_the_whole_sweep_is_refused_at_once(
    here, command, study_file, tmp_path, capsys
):
    path = study_file('stimuli = ["sine_20_250"]\n')
    assert command(path, "-o", tmp_path / "out") == 1
    [line] = capsys.readouterr().err.splitlines()
    assert "no ccx on the PATH" in line
    assert "stored = true" in line
    assert list((tmp_path / "out").iterdir()) == []


def short(entry, preindent_um=0.0, seed=None):
    """A quarter of a slow wave: few increments."""
    wave_um = 60.0 * np.sin(np.linspace(0, np.pi / 2, 9))
    return Stimulus(entry.id, wave_um, 0.5, (0.0, 4.0), origin={"family": "short"})


@pytest.mark.slow
@pytest.mark.solver
def test_calculix_gives_what_is_stored_and_a_transient_what_the_map_gives(tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    variants = (Variant("quick", PRESETS["quick"]),)
    study = Study(resolve("noise_25_250_20,sine_20_250"), variants)
    stored = Study(study.stimuli, variants, stored=True)

    solved = run_sweep(study, tmp_path / "out")
    known = run_sweep(stored, tmp_path / "out")

    assert not solved.failed
    assert not known.failed
    [one] = make_plan(study, solver_version()).items.values()
    [other] = make_plan(stored, "stored").items.values()
    answers = read_answers(tmp_path / "out" / one.run_folder)
    expected = read_answers(tmp_path / "out" / other.run_folder)
    assert answers.rate_ips.to_dict() == expected.rate_ips.to_dict()
    np.testing.assert_allclose(answers.peak_stress_pa, expected.peak_stress_pa, rtol=1e-3)

    monkeypatch.setattr(module, "make_stimulus", short)
    both = Study(
        resolve("sine_20_250"),
        variants,
        methods=("map", "transient"),
        parameters=parameter_set("published"),
    )
    plan = make_plan(both, solver_version())
    assert {item.response.key for item in plan.items.values()} == {one.response.key}
    assert (tmp_path / "out" / STUDY_FILE).exists()
    peaks = []
    for item in plan.items.values():
        assert run_task(item, tmp_path / "out", threads=1).cause == ""
        assert run_task(item, tmp_path / "out").before
        peaks.append(read_answers(tmp_path / "out" / item.run_folder).peak_stress_pa)
    np.testing.assert_allclose(peaks[1], peaks[0], rtol=5e-3)
