"""The benchmark of the result readers: its files, its checks, its table."""

import importlib
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
SAMPLES = ROOT / "fixtures" / "frd_samples"
SOURCE = SAMPLES / "cpe4_bin_f64.frd"
TWINS = {"ascii": "cpe4_ascii", "float32": "cpe4_bin_f32", "float64": "cpe4_bin_f64"}


@pytest.fixture(autouse=True)
def _from_the_root(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))


@pytest.fixture
def files():
    return importlib.import_module("benchmarks.result_files")


@pytest.fixture
def jobs():
    return importlib.import_module("benchmarks.reading_jobs")


@pytest.fixture
def process():
    pytest.importorskip("resource")
    return importlib.import_module("benchmarks.reading_process")


@pytest.fixture
def recorded():
    return importlib.import_module("benchmarks.recorded_run")


@pytest.fixture
def run(recorded):
    return recorded.read_run(SOURCE)


@pytest.mark.parametrize("storage", TWINS)
def test_a_file_that_is_made_has_the_bytes_that_ccx_wrote(files, run, storage, tmp_path):
    files.write_run(run, tmp_path / "job.frd", storage, len(run.times_s))

    made = (tmp_path / "job.frd").read_bytes()
    assert made == (SAMPLES / f"{TWINS[storage]}.frd").read_bytes()


def test_times_from_one_second_on_stand_as_ccx_writes_them(files, run, tmp_path):
    headers = re.findall(rb"  100CL.*\n", (SAMPLES / "cpe4_time_ge_1.frd").read_bytes())
    blocks = len(headers) // len(run.times_s)
    times_s = tuple(float(header[12:24]) for header in headers[::blocks])

    late = replace(run, times_s=times_s)
    files.write_run(late, tmp_path / "job.frd", "ascii", len(times_s))

    assert max(times_s) >= 1.0
    made = (tmp_path / "job.frd").read_bytes()
    assert re.findall(rb"  100CL.*\n", made) == headers


def test_no_two_increments_have_the_same_stress(files, run):
    increments = 3 * len(run.times_s)
    seen, times_s = set(), []
    for time_s, quantities in files.history(run, increments):
        [stress] = [each for each in quantities if each.name == "STRESS"]
        seen.add(stress.values.tobytes())
        times_s.append(time_s)

    assert len(seen) == increments
    np.testing.assert_allclose(np.diff(times_s), times_s[0], rtol=1e-9)


def test_the_size_asked_for_is_reached(files, run, tmp_path):
    files.make_files(run, "a sample", tmp_path, 1.0)

    size = (tmp_path / "ascii.frd").stat().st_size
    assert 1.0e6 <= size <= 1.2e6


def test_files_that_are_there_are_taken_and_others_made_anew(files, run, tmp_path):
    files.make_files(run, "a sample", tmp_path, 0.1)
    small = (tmp_path / "ascii.frd").stat()
    files.make_files(run, "a sample", tmp_path, 0.1)
    assert (tmp_path / "ascii.frd").stat().st_mtime_ns == small.st_mtime_ns

    turned = replace(run, increments=run.increments[1:] + run.increments[:1])
    files.make_files(turned, "a sample", tmp_path, 0.1)
    other = (tmp_path / "ascii.frd").stat()
    assert other.st_mtime_ns != small.st_mtime_ns

    files.make_files(turned, "a sample", tmp_path, 0.3)
    assert (tmp_path / "ascii.frd").stat().st_size > 2 * small.st_size


def test_chosen_nodes_lie_inside_one_material(run):
    chosen = run.inner_nodes(5)

    assert len(set(chosen)) == 5
    for node in chosen:
        materials = {each.material for each in run.elements if node in each.nodes}
        assert len(materials) == 1


def test_results_at_few_nodes_are_dealt_out_over_the_mesh(recorded):
    run = recorded.read_run(recorded.FIXTURE / "job.frd")

    for quantity in run.increments[-1]:
        assert len(quantity.values) == run.nodes.size
    [stress] = [each.values for each in run.increments[-1] if each.name == "STRESS"]
    assert len(np.unique(stress[:, 0])) > 0.9 * run.nodes.size


def test_the_deck_that_is_solved_asks_for_every_node_of_few_increments(recorded):
    recorded_deck = (recorded.FIXTURE / "job.inp").read_text(encoding="ascii")
    deck = recorded._deck_with_all_output()

    changed = [
        (old, new)
        for old, new in zip(recorded_deck.splitlines(), deck.splitlines(), strict=True)
        if old != new
    ]
    assert [new for _, new in changed] == [
        "0.0005000, 0.0040000",
        "*NODE OUTPUT, DOUBLE",
        "*ELEMENT OUTPUT, DOUBLE",
    ]


def test_a_result_that_is_not_float64_is_refused(recorded):
    with pytest.raises(ValueError, match="expected 3"):
        recorded.read_run(SAMPLES / "cpe4_bin_f32.frd")


def test_a_wrong_number_of_a_reader_is_named(files, process, run, tmp_path):
    files.make_files(run, "a sample", tmp_path, 0.1)
    held = json.loads((tmp_path / files.ABOUT).read_text(encoding="utf-8"))
    right = np.array(held["stress_mpa"][-1])
    last = len(held["stress_mpa"]) - 1
    process.check([(last, right), (last, process.von_mises(right))], held)

    wrong = right.copy()
    wrong[3, 2] += 0.01 * np.abs(right[3]).max()
    with pytest.raises(ValueError, match=f"node {held['nodes'][3]}, increment"):
        process.check([(last, wrong)], held)


@pytest.mark.slow
def test_one_command_measures_and_writes_the_table_into_the_page(jobs, process, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "before\n<!-- benchmark -->\nold\n<!-- /benchmark -->\nafter\n", encoding="utf-8"
    )
    words = ["--megabytes", "1", "--rounds", "1", "--alone", "--source", str(SOURCE)]
    words += ["--update-docs", str(page)]
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.result_readers", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == 0, done.stderr
    text = page.read_text(encoding="utf-8")
    assert text.startswith("before\n<!-- benchmark -->\n1 MB in ASCII, ")
    assert text.endswith("\n<!-- /benchmark -->\nafter\n")
    assert done.stdout.strip() in text
    assert "old" not in text
    ours = [job for job in jobs.JOBS.values() if job.package is None]
    for job in ours[1:]:  # the first is what memory is counted from
        assert f"| {job.reader} | {job.does} | {job.file} |" in text
    assert "`read()` of the file into memory" in text
    assert re.search(r"pyvista-frd-reader / ours \| not measured", text)


def test_a_page_without_marks_gets_them_at_its_end(tmp_path):
    readers = importlib.import_module("benchmarks.result_readers")
    page = tmp_path / "page.md"
    page.write_text("# Results\n\nwords\n", encoding="utf-8")

    readers.update_page(page, "first")
    readers.update_page(page, "second\n")

    assert page.read_text(encoding="utf-8") == (
        "# Results\n\nwords\n\n<!-- benchmark -->\nsecond\n<!-- /benchmark -->\n"
    )
