"""Many touches in one data set: the same bytes whoever computes them, whatever goes wrong."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas
import pytest

import fembridge as fb
from fembridge.cli import outputs_of
from fembridge.errors import FembridgeWarning, OutputError, ResultError, UsageError
from fembridge.sweeps import dataset, touch_work, touches
from fembridge.sweeps.touch_study import SETTINGS
from fembridge.sweeps.touches import Plan, read_touches, touch_many, touches_status, verify_touches
from fembridge.touching.influence import drop_influence

pytest.importorskip("pyarrow")

SHORT = {"ridges": "none", "population": "one_each", "hold_ms": 100, "ramp_ms": 20}


def rows_of(count=6, depths_um=(200, 300), **settings):
    """Touches at few depths, each with its own noise."""
    return [
        {
            **SHORT,
            "press_um": depths_um[number % len(depths_um)],
            "noise_mv": 0.1,
            "trials": 2,
            "seed": number,
            "label": "ab"[number % 2],
            **settings,
        }
        for number in range(count)
    ]


def bytes_of(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(Path(folder).rglob("*"))
        if path.is_file()
    }


def test_a_row_is_what_the_same_touch_alone_is():
    row = {**SHORT, "press_um": 300, "population": "grid:step_mm=2", "x_mm": 0.5, "angle_deg": 10}
    row |= {"shape": "bar:width_mm=2", "noise_mv": 0.1, "trials": 3, "seed": 7}
    data = touch_many([{"press_um": 100, **SHORT}, row], jobs=1)
    alone = fb.touch(
        "bar:width_mm=2",
        fb.Trajectory.press(300, ramp_ms=20, hold_ms=100),
        population="grid:step_mm=2",
        ridges="none",
        at_mm=(0.5, 0),
        angle_deg=10,
        noise_mv=0.1,
        trials=3,
        seed=7,
    )
    spikes = data.spikes[data.spikes["touch"] == 1].reset_index(drop=True)
    assert len(spikes) > 100
    columns = ["afferent", "unit", "trial", "spike_time_ms"]
    pandas.testing.assert_frame_equal(spikes[columns], alone.spikes[columns], check_dtype=False)
    rates = data.rates[data.rates["touch"] == 1].reset_index(drop=True)
    pandas.testing.assert_frame_equal(
        rates[["afferent", "unit", "rate_ips"]], alone.rates[["afferent", "unit", "rate_ips"]]
    )
    units = data.units_of(1)
    pandas.testing.assert_frame_equal(
        units.drop(columns="afferent"), alone.population.to_frame().drop(columns="afferent")
    )
    forces = data.forces[data.forces["touch"] == 1]
    assert forces["time_ms"].tolist() == list(np.arange(0, 161, 10.0))
    np.testing.assert_array_equal(forces["force"], alone.force_n[::20])


def test_touches_that_agree_in_pad_shape_and_motion_share_one_contact(monkeypatch):
    solved = []

    def solve(*arguments):
        solved.append(arguments)
        return touch_work_solve(*arguments)

    touch_work_solve = touch_work.solve_contact
    monkeypatch.setattr(touch_work, "solve_contact", solve)
    rows = [
        {**SHORT, "press_um": 200, **other}
        for other in (
            *({"population": name} for name in ("one_each", "line:step_mm=5")),
            *({"parameters": name} for name in ("published", "fitted")),
            *({"trials": 3, "noise_mv": 0.2, "seed": seed} for seed in (1, 2)),
        )
    ]
    with pytest.warns(FembridgeWarning, match="touches: "):
        data = touch_many([*rows, {**SHORT, "press_um": 300}], jobs=1)
    assert len(solved) == 2
    assert not data.failed
    assert data.touches["contact_key"].nunique() == 2


def test_the_number_of_workers_changes_no_byte(tmp_path):
    rows = rows_of(8)
    for jobs in (1, 2):
        touch_many(rows, tmp_path / str(jobs), jobs=jobs)
    files = bytes_of(tmp_path / "1")
    assert files == bytes_of(tmp_path / "2")
    assert set(files) == {
        "dataset.toml",
        "rows.parquet",
        *(f"{name}/part-00000.parquet" for name in dataset.TABLES),
    }
    data = fb.read(tmp_path / "1")
    data.write(tmp_path / "copy")
    assert bytes_of(tmp_path / "copy") == files


@pytest.mark.slow
def test_a_touch_does_not_depend_on_the_touches_before_it():
    """Not in a bit of its stress, although sums of float32 depend on what is beside them."""
    from fembridge.touching import touch as module

    press = {"shape": "braille:text=q", "press_n": 0.02, "ramp_ms": 5, "hold_ms": 5}
    rows = [{**press, "x_mm": 0.3 * number, "z_mm": 0.1 * number} for number in range(5)]
    stresses = []

    def encode(stress, *arguments, **options):
        stresses.append(stress.stress_pa(np.arange(0, 260, 4)))
        return plain_encode(stress, *arguments, **options)

    plain_encode = module.encode_units
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "encode_units", encode)
        for order in (range(5), reversed(range(5))):
            drop_influence()  # as in a new process
            for number in order:
                batch = touch_work.Batch({number: rows[number]}, Path(), 0)
                assert not touch_work.run_batch(batch)[0].cause
    for first, second in zip(stresses[:5], reversed(stresses[5:]), strict=True):
        np.testing.assert_array_equal(first, second)


def test_groups_fill_parts_whole_unless_they_are_larger_than_a_part():
    rows = [
        {"press_um": depth, "seed": seed}
        for depth, count in ((100, 50), (200, 10), (300, 10), (400, 150))
        for seed in range(count)
    ]
    plan = Plan(read_touches(rows))
    sizes = [[len(group) for group in part] for part in plan.parts]
    assert sizes == [[50, 10], [10], [64], [64], [22]]
    touches_of = [touch for part in plan.parts for group in part for touch in group]
    assert sorted(touches_of) == list(range(220))


@pytest.mark.slow
def test_other_programs_read_the_folder_as_it_is(tmp_path):
    duckdb, polars = pytest.importorskip("duckdb"), pytest.importorskip("polars")
    data = touch_many(rows_of(4), tmp_path / "set", jobs=1)
    spikes = len(data.spikes)
    assert spikes > 0
    assert len(pandas.read_parquet(tmp_path / "set/spikes")) == spikes
    assert polars.read_parquet(tmp_path / "set/spikes/*.parquet").height == spikes
    [(count, labels)] = duckdb.sql(
        f"select count(*), count(distinct label) from '{tmp_path}/set/spikes/*.parquet' "
        f"join '{tmp_path}/set/touches/*.parquet' using (touch)"
    ).fetchall()
    assert (count, labels) == (spikes, data.touches["label"].nunique())


def test_counts_are_those_of_a_plain_loop():
    data = touch_many(rows_of(4, population="line:step_mm=4"), jobs=1)
    counts, bin_ms = data.counts(bin_ms=7), 7.0
    assert counts.shape == (4, 2, 9, int(np.ceil(160 / bin_ms)))
    units = data.units_of(0)["unit"].tolist()
    plain = np.zeros_like(counts)
    for spike in data.spikes.itertuples():
        number = int(np.ceil(round(spike.spike_time_ms / bin_ms, 9))) - 1
        plain[spike.touch, spike.trial - 1, units.index(spike.unit), number] += 1
    np.testing.assert_array_equal(counts, plain)
    assert counts.sum() == len(data.spikes) > 0

    examples = data.examples(7, target="label")
    assert len(examples) == 8
    assert [target for _, target in examples] == ["a", "a", "b", "b", "a", "a", "b", "b"]
    np.testing.assert_array_equal(examples[5][0], counts[2, 1])
    assert examples[5][0].dtype == np.float32
    with pytest.raises(IndexError):
        examples[8]


def test_touches_of_different_units_have_no_common_counts():
    data = touch_many([*rows_of(1), *rows_of(1, population="line:step_mm=4")], jobs=1)
    with pytest.raises(UsageError) as refused:
        data.counts(10)
    assert refused.value.argument == "touches"


def test_a_row_that_cannot_be_fails_with_its_cause_and_the_others_are_done(tmp_path):
    rows = [*rows_of(3), {**SHORT, "press_um": 100, "x_mm": 500}]
    data = touch_many(rows, tmp_path / "set", jobs=1)
    assert list(data.failed) == [3]
    assert "beside the pad" in data.failed[3]
    assert data.touches["status"].tolist() == ["done"] * 3 + ["failed"]
    assert sorted(data.rates["touch"].unique()) == [0, 1, 2]
    assert "1 failed" in repr(data)


def test_warnings_of_a_row_are_kept_in_its_row_and_issued_once():
    rows = rows_of(3, depths_um=(1500,), hold_ms=10)
    with pytest.warns(FembridgeWarning) as issued:
        data = touch_many(rows, jobs=1)
    [warning] = issued
    assert str(warning.message).startswith("3 of 3 touches: ")
    [text] = {text for texts in data.touches["warnings"] for text in texts}
    assert str(warning.message).endswith(text)


@pytest.fixture
def deadly(tmp_path, monkeypatch):
    """Workers that die by SIGKILL at the touch of seed 3, so many times; the deaths so far."""

    def prepare(times):
        module = tmp_path / "modules"
        module.mkdir()
        (module / "deadly.py").write_text(
            "import os, signal\n"
            "from pathlib import Path\n"
            "from fembridge.sweeps.touch_work import run_batch as compute\n"
            f"LEDGER, TIMES = Path({str(tmp_path / 'deaths')!r}), {times}\n"
            "def run_batch(batch):\n"
            "    deaths = LEDGER.read_text() if LEDGER.exists() else ''\n"
            "    if any(row['seed'] == 3 for row in batch.rows.values()) and len(deaths) < TIMES:\n"
            "        LEDGER.write_text(deaths + 'x')\n"
            "        os.kill(os.getpid(), signal.SIGKILL)\n"
            "    return compute(batch)\n"
        )
        monkeypatch.syspath_prepend(str(module))
        monkeypatch.setenv("PYTHONPATH", str(module))
        import deadly

        monkeypatch.setattr(touches, "run_batch", deadly.run_batch)
        return lambda: len((tmp_path / "deaths").read_text())

    yield prepare
    sys.modules.pop("deadly", None)


@pytest.mark.slow
def test_a_worker_that_dies_once_changes_no_byte(tmp_path, deadly):
    rows = rows_of(6)
    touch_many(rows, tmp_path / "plain", jobs=1)
    deaths = deadly(times=1)
    assert not touch_many(rows, tmp_path / "set", jobs=2).failed
    assert deaths() == 1
    assert bytes_of(tmp_path / "set") == bytes_of(tmp_path / "plain")


@pytest.mark.slow
def test_a_row_that_kills_its_worker_fails_at_the_third_time_and_alone(
    tmp_path, deadly, monkeypatch
):
    rows = rows_of(6)
    touch_many(rows, tmp_path / "plain", jobs=1)
    with monkeypatch.context():
        deaths = deadly(times=100)
        data = touch_many(rows, tmp_path / "set", jobs=2)
        assert deaths() == 3
        assert list(data.failed) == [3]
        assert data.touches["status"].value_counts().to_dict() == {"done": 5, "failed": 1}
    monkeypatch.setattr(touches, "run_batch", touch_work.run_batch)
    ran = []
    monkeypatch.setattr(touch_work, "_outcome", recorder(ran, touch_work._outcome))
    assert not touch_many(rows, tmp_path / "set", jobs=1).failed
    assert ran == [3]
    assert bytes_of(tmp_path / "set") == bytes_of(tmp_path / "plain")


def recorder(ran, compute):
    """`compute`, which appends the number of each touch to `ran`."""

    def run(touch, *arguments):
        ran.append(touch)
        return compute(touch, *arguments)

    return run


@pytest.mark.slow
def test_a_disk_that_is_full_costs_its_part_only_and_the_next_run_finishes(tmp_path, monkeypatch):
    rows = rows_of(70, depths_um=tuple(range(100, 170, 10)), noise_mv=0.0, trials=1)
    touch_many(rows, tmp_path / "plain", jobs=1)
    attempts = []
    write = dataset.LocalStore.write

    def refuse(store, name, content):
        if name == "spikes/part-00000.parquet":
            attempts.append(name)
            raise OutputError("cannot write: No space left on device", store.folder / name)
        write(store, name, content)

    monkeypatch.setattr(dataset, "_PAUSE_S", 0.0)
    with monkeypatch.context() as patch:
        patch.setattr(dataset.LocalStore, "write", refuse)
        data = touch_many(rows, tmp_path / "set", jobs=1)
    assert len(attempts) == 3
    assert len(data.failed) == 60
    assert all("No space left" in cause for cause in data.failed.values())
    assert data.parts == [1]
    assert not touch_many(rows, tmp_path / "set", jobs=1).failed
    assert bytes_of(tmp_path / "set") == bytes_of(tmp_path / "plain")


@pytest.mark.slow
def test_after_kill_9_the_same_command_does_only_what_is_missing(tmp_path, wait_until, monkeypatch):
    rows = rows_of(192, depths_um=tuple(range(100, 196, 8)), noise_mv=0.0, trials=1)
    pandas.DataFrame(rows).to_csv(tmp_path / "touches.csv", index=False)
    words = ["sweep", str(tmp_path / "touches.csv"), "-o", str(tmp_path / "set"), "--jobs", "2"]
    process = subprocess.Popen([sys.executable, "-m", "fembridge.cli", *words])
    first = tmp_path / "set/touches/part-00000.parquet"
    wait_until(lambda: first.exists() or process.poll() is not None)
    state = touches_status(tmp_path / "set")
    process.send_signal(signal.SIGKILL)
    process.wait(60)
    assert (state.rows, state.parts) == (192, 3)
    assert state.done >= 64
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "set").rglob("part-00000*")}

    data = touch_many(tmp_path / "touches.csv", tmp_path / "set", jobs=1)
    assert not data.failed
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    touch_many(tmp_path / "touches.csv", tmp_path / "plain", jobs=1)
    assert bytes_of(tmp_path / "set") == bytes_of(tmp_path / "plain")


CLUSTER = """
import os, signal, sys, threading, time
from pathlib import Path

def kill_a_worker(cluster, first):
    while not first.exists():
        time.sleep(0.05)
    [worker, *_] = cluster.workers.values()
    os.kill(worker.pid, signal.SIGKILL)
    print("killed", flush=True)

def main(table, folder):
    from distributed import LocalCluster
    import fembridge as fb
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0"
    ) as cluster:
        first = Path(folder, "touches/part-00000.parquet")
        threading.Thread(target=kill_a_worker, args=(cluster, first), daemon=True).start()
        data = fb.touch_many(
            table, folder, executor="dask", scheduler=cluster.scheduler_address
        )
        print("failed", len(data.failed), flush=True)

if __name__ == "__main__":
    main(*sys.argv[1:])
"""


@pytest.mark.slow
def test_workers_of_dask_write_the_same_bytes_even_if_one_is_killed(tmp_path):
    pytest.importorskip("distributed")
    rows = rows_of(130, depths_um=tuple(range(100, 230, 10)), noise_mv=0.0, trials=1)
    pandas.DataFrame(rows).to_csv(tmp_path / "touches.csv", index=False)
    (tmp_path / "cluster.py").write_text(CLUSTER)
    words = [str(tmp_path / "cluster.py"), str(tmp_path / "touches.csv"), str(tmp_path / "set")]
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["killed", "failed 0"]
    touch_many(tmp_path / "touches.csv", tmp_path / "plain", jobs=1)
    assert bytes_of(tmp_path / "set") == bytes_of(tmp_path / "plain")


@pytest.mark.slow
def test_the_script_for_slurm_runs_on_workers_of_this_machine(tmp_path):
    pytest.importorskip("distributed")
    pandas.DataFrame(rows_of(4)).to_csv(tmp_path / "touches.csv", index=False)
    script = Path(fb.__file__).parents[1] / "docs/how_to/touches_slurm.py"
    words = [str(script), str(tmp_path / "touches.csv"), str(tmp_path / "set"), "--local"]
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("Touches: 4 of 4 done")


def test_an_address_of_fsspec_is_a_folder_like_any_other(tmp_path, monkeypatch):
    fsspec = pytest.importorskip("fsspec")
    system = fsspec.filesystem("memory")
    rows, address = rows_of(3), "memory://touches/set"
    touch_many(rows, tmp_path / "set", jobs=1)
    put = type(system).pipe_file

    def cut(self, path, value, **options):
        if "/spikes/" in path:
            raise ConnectionError("connection reset")
        return put(self, path, value, **options)

    monkeypatch.setattr(dataset, "_PAUSE_S", 0.0)
    try:
        with monkeypatch.context() as patch:
            patch.setattr(type(system), "pipe_file", cut)
            assert len(touch_many(rows, address, jobs=1).failed) == 3
        data = touch_many(rows, address, jobs=1)
        assert not data.failed
        assert fb.read(address).spikes.equals(fb.read(str(tmp_path / "set")).spikes)
        for name, content in bytes_of(tmp_path / "set").items():
            assert system.cat_file(f"/touches/set/{name}") == content
    finally:
        system.rm("/touches", recursive=True)


def test_verify_finds_a_changed_file_and_a_changed_pad(tmp_path, file):
    units = file("units.csv", "unit,afferent,x_mm,z_mm\nu,SA,0,0\n")
    rows = rows_of(3, population=str(units))
    data = touch_many(rows, tmp_path / "set", jobs=1)
    check = verify_touches(tmp_path / "set", 100)
    assert (check.checked, check.different, check.damaged) == ((0, 1, 2), {}, ())
    units.write_text("unit,afferent,x_mm,z_mm\nu,SA,1,0\n")
    check = verify_touches(tmp_path / "set", 1, seed=1)
    assert len(check.checked) == 1
    assert check.different == {check.checked[0]: "another population"}
    path = tmp_path / "set/forces/part-00000.parquet"
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    assert verify_touches(tmp_path / "set", 1).damaged == ("forces/part-00000.parquet",)
    assert json.loads(data.touches["settings"][2])["seed"] == 2


def test_a_part_with_a_file_that_was_deleted_is_named_and_computed_again(tmp_path):
    rows = rows_of(3)
    touch_many(rows, tmp_path / "set", jobs=1)
    files = bytes_of(tmp_path / "set")
    (tmp_path / "set/forces/part-00000.parquet").unlink()
    assert dataset.damaged_files(dataset.store_of(tmp_path / "set")) == [
        "forces/part-00000.parquet"
    ]
    assert fb.read(tmp_path / "set").parts == []
    touch_many(rows, tmp_path / "set", jobs=1)
    assert bytes_of(tmp_path / "set") == files


def test_a_study_of_touches_is_none_of_fingers():
    with pytest.raises(UsageError) as refused:
        fb.sweep({"touches": {"press_um": 100}})
    assert refused.value.key == "touches"


def test_a_folder_of_another_table_is_refused_unless_nothing_of_it_is_done(tmp_path):
    touch_many(rows_of(1, x_mm=500), tmp_path / "set", jobs=1)
    touch_many(rows_of(1), tmp_path / "set", jobs=1)
    before = bytes_of(tmp_path / "set")
    for other in (rows_of(2)[1:], rows_of(1, label="c")):
        with pytest.raises(OutputError) as refused:
            touch_many(other, tmp_path / "set", jobs=1)
        assert refused.value.path == tmp_path / "set"
    with pytest.raises(OutputError):
        touch_many(rows_of(1), tmp_path / "set", jobs=1, forces_step_ms=5)
    assert bytes_of(tmp_path / "set") == before


@pytest.mark.slow
@pytest.mark.parametrize("failing", [pytest.param(False, marks=pytest.mark.slow), True])
def test_a_longer_table_computes_only_its_further_rows_and_keeps_the_files_of_the_others(
    tmp_path, monkeypatch, failing
):
    """Further rows may be anywhere in the table; rows keep the numbers they have."""
    first = rows_of(3)
    if failing:
        first[1] |= {"x_mm": 500}
    further = rows_of(5, depths_um=(250,), seed=9)
    further[4] |= {"press_um": 350}
    touch_many(first, tmp_path / "set", jobs=1)
    before = bytes_of(tmp_path / "set")
    run = []
    batch = touches.run_batch
    monkeypatch.setattr(touches, "run_batch", lambda work: run.extend(work.rows) or batch(work))
    table = [*further[:2], *first, *further[2:]]
    data = touch_many(table, tmp_path / "set", jobs=1)
    assert sorted(run) == [1, 3, 4, 5, 6, 7] if failing else [3, 4, 5, 6, 7]
    after = bytes_of(tmp_path / "set")
    kept = [name for name in before if "part" in name]
    assert all(after[name] == before[name] for name in kept) or failing
    assert data.touches["press_um"].tolist() == [200, 300, 200, 250, 250, 250, 250, 350]
    order = touch_many([*first, *further], jobs=1)
    pandas.testing.assert_frame_equal(data.spikes, order.spikes)
    assert data.about["extents"] == [3]
    run.clear()
    assert touch_many(table, tmp_path / "set", jobs=1).failed.keys() == data.failed.keys()
    assert sorted(run) == [1] if failing else not run
    assert not verify_touches(tmp_path / "set", percent=100).damaged
    with pytest.raises(OutputError):
        touch_many(first, tmp_path / "set", jobs=1)


def test_a_study_with_more_draws_and_values_extends_its_data_set(tmp_path):
    def study(count, depths_um):
        draw = {"count": count, "seed": 3, "x_mm": {"uniform": [-1, 1]}}
        return {"touches": {**SHORT, "product": {"press_um": depths_um}, "draw": draw}}

    touch_many(study(2, [200, 300]), tmp_path / "set", jobs=1)
    touch_many(study(3, [200, 300]), tmp_path / "set", jobs=1)
    data = touch_many(study(3, [200, 300, 250]), tmp_path / "set", jobs=1)
    assert data.about["extents"] == [4, 6]
    whole = touch_many(study(3, [200, 300, 250]), jobs=1).touches
    columns = ["press_um", "x_mm", "spikes", "key"]
    assert sorted(data.touches["key"]) == sorted(whole["key"])
    joined = data.touches[columns].merge(whole[columns], on="key")
    assert joined["spikes_x"].tolist() == joined["spikes_y"].tolist()


def test_a_process_that_was_killed_before_it_described_a_longer_table_changes_nothing(
    tmp_path, monkeypatch
):
    rows = rows_of(3)
    touch_many(rows[:2], tmp_path / "set", jobs=1)
    about = (tmp_path / "set/dataset.toml").read_bytes()
    touch_many(rows, tmp_path / "set", jobs=1)
    other = rows_of(4)[:2] + rows_of(1, depths_um=(150,))
    for name in ("touches", "spikes", "units", "forces"):
        (tmp_path / "set" / name / "part-00001.parquet").unlink()
    (tmp_path / "set/dataset.toml").write_bytes(about)
    assert touch_many(rows[:2], tmp_path / "set", jobs=1).about["rows"] == 2
    assert touch_many(other, tmp_path / "set", jobs=1).touches["press_um"].tolist() == [
        *(200, 300),
        150,
    ]


def test_a_data_set_is_resumed_without_its_table_unless_it_has_python_objects(tmp_path):
    rows = rows_of(2) + rows_of(1, x_mm=500)
    data = touch_many(rows, tmp_path / "set", jobs=1, forces_step_ms=5)
    files = bytes_of(tmp_path / "set")
    (tmp_path / "set/touches/part-00000.parquet").unlink()
    again = touch_many(tmp_path / "set", jobs=1)
    assert bytes_of(tmp_path / "set") == files
    assert again.failed == data.failed
    with pytest.raises(UsageError) as refused:
        touch_many(tmp_path / "set", tmp_path / "other")
    assert refused.value.argument == "output"
    rows[0] |= {"population": fb.Population.one_each()}
    touch_many(rows, tmp_path / "objects", jobs=1)
    with pytest.raises(UsageError) as refused:
        touch_many(tmp_path / "objects")
    assert refused.value.path == tmp_path / "objects"


@pytest.mark.parametrize(
    ("labels", "kind"),
    [({"label_a": 1.5}, "float64"), ({"label_a": "b"}, None), ({"label_c": 1}, "int64")],
)
def test_further_rows_have_the_columns_of_the_data_set(tmp_path, labels, kind):
    first = rows_of(1, label_a=1)
    touch_many(first, tmp_path / "set", jobs=1)
    with pytest.raises(UsageError) as refused:
        touch_many([*first, *rows_of(1, seed=5, **labels)], tmp_path / "set", jobs=1)
    assert refused.value.argument == next(iter(labels))
    assert kind is None or refused.value.found == kind
    table = [*rows_of(1, seed=5, label_b="x"), *rows_of(1, seed=6)]
    with pytest.raises(UsageError):
        touch_many([*first, *table], tmp_path / "set", jobs=1)
    assert touch_many(first, tmp_path / "set", jobs=1).about["rows"] == 1


@pytest.mark.parametrize(
    ("settings", "argument"),
    [
        ({"shape": "barr"}, "shape"),
        ({"shape": "letters.png"}, "shape"),
        ({"population": "nobody"}, "population"),
        ({"population": "one_each", "population_seed": 1}, "population_seed"),
        ({"parameters": "guessed"}, "parameters"),
        ({"pad": "paw"}, "pad"),
        ({"pad": "paw.npz"}, "pad"),
        ({"finger": "mine.toml"}, "finger"),
    ],
)
def test_unknown_names_and_absent_files_are_refused_before_anything_is_written(
    tmp_path, settings, argument
):
    with pytest.raises(UsageError) as refused:
        touch_many([*rows_of(1), {"press_um": 100, **settings}], tmp_path / "set")
    assert refused.value.argument == argument
    assert not (tmp_path / "set").exists()


def test_objects_of_python_are_rows_too(tmp_path):
    heights_mm = np.zeros((20, 20))
    heights_mm[8:12] = 1.0
    shape = fb.Shape.from_heights(heights_mm, 0.5)
    press = fb.Trajectory.press(200, ramp_ms=20, hold_ms=50)
    units = fb.Population.one_each()
    row = {"shape": shape, "trajectory": press, "population": units, "ridges": "none"}
    data = touch_many([row, {**row, "x_mm": 1.0}], tmp_path / "set", jobs=1)
    alone = fb.touch(shape, press, population=units, ridges="none", at_mm=(1.0, 0.0))
    times_ms = data.spikes.loc[data.spikes["touch"] == 1, "spike_time_ms"]
    assert times_ms.tolist() == alone.spikes["spike_time_ms"].tolist()
    assert "Trajectory" in data.touches["trajectory"][0]
    assert verify_touches(tmp_path / "set", 100).skipped == 2
    assert touch_many([row, {**row, "x_mm": 1.0}], tmp_path / "set", jobs=1).spikes.equals(
        data.spikes
    )


def test_stimuli_of_a_response_map_are_rows_beside_touches_of_a_pad(tmp_path):
    from fembridge.response.response_map import write_map

    write_map(tmp_path / "map.toml", fb.PadProbe(pad="reference", ridges="none").response)
    row = {"map": str(tmp_path / "map.toml"), "stimulus": "sine_50_100", "parameters": "published"}
    data = touch_many([row, *rows_of(1)], jobs=1)
    alone = fb.simulate("sine_50_100", response=tmp_path / "map.toml", parameters="published")
    spikes = data.spikes[data.spikes["touch"] == 0]
    assert spikes["spike_time_ms"].tolist() == alone.spikes["spike_time_ms"].tolist()
    assert data.units_of(0)["afferent"].tolist() == ["SA", "RA", "PC"]
    rates = data.rates[data.rates["touch"] == 0]
    assert rates["rate_ips"].tolist() == pytest.approx(alone.rates["rate_ips"].tolist())


def test_more_than_ten_minutes_are_confirmed_or_not_begun(tmp_path, monkeypatch):
    monkeypatch.setattr(touches, "LONG_S", 1e-6)
    rows = rows_of(12)
    with pytest.raises(UsageError) as refused:
        touch_many(rows, tmp_path / "set", jobs=1, yes=False)
    assert refused.value.found > 1e-6
    assert not (tmp_path / "set/touches").exists()
    assert not touch_many(rows, tmp_path / "set", jobs=1).failed


def test_touches_of_other_depths_forces_and_shapes_are_tried_by_themselves():
    def kinds(*rows):
        return len({touches._kind(row) for row in rows})

    assert kinds({"press_um": 100}, {"press_um": 300, "x_mm": 1.0, "seed": 3}) == 1
    assert kinds({"press_um": 300}, {"press_um": 310}, {"press_um": 700}) == 3
    assert kinds({"press_n": 0.0}, {"press_n": 0.0002}, {"press_n": 0.3}, {"press_n": 0.45}) == 2
    assert kinds({"press_um": 100, "shape": "edge"}, {"press_um": 100, "shape": "plate"}) == 2


def test_pictures_are_drawn_against_any_column():
    data = touch_many(rows_of(4), jobs=1)
    for kind in (None, "press_um", "label"):
        figure = data.plot(kind)
        assert [panel.get_title() for panel in figure.axes] == ["SA", "RA", "PC"]
        assert figure.axes[0].get_xlabel() == (kind or "touch")
    with pytest.raises(UsageError) as refused:
        data.plot("letter")
    assert (refused.value.argument, refused.value.found) == ("kind", "letter")


@pytest.mark.parametrize("table", dataset.TABLES)
def test_the_page_of_outputs_has_the_columns(table):
    _, columns = outputs_of("sweep")[f"{table}/part-NUMBER.parquet"]
    named = [name for name, _, _ in columns]
    if table == "touches":
        named = [name for name in named if not name.startswith("<")]
        settings = {*SETTINGS, "trajectory"}
        assert named == [name for name in dataset.schema_of(table).names if name not in settings]
    else:
        assert named == dataset.schema_of(table).names


def test_a_folder_without_a_data_set_is_refused(tmp_path):
    for read in (fb.Touches.read, touches_status, verify_touches):
        with pytest.raises(ResultError) as refused:
            read(tmp_path)
        assert refused.value.path == tmp_path / "dataset.toml"


def test_the_command_writes_reports_and_verifies(tmp_path, command, capsys, file):
    path = file(
        "study.toml",
        '[touches]\npopulation = "one_each"\nridges = "none"\nhold_ms = 50\n'
        "[touches.product]\npress_um = [100, 200]\n",
    )
    folder = tmp_path / "set"
    assert command(path, "-o", folder, "--jobs", "1", "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["rows"], summary["done"], summary["failed"]) == (2, 2, [])
    assert command("status", folder, "--json") == 0
    state = json.loads(capsys.readouterr().out)
    assert (state["done"], state["parts_done"], state["is_running"]) == (2, 1, False)
    assert command("verify", folder, "--percent", "100", "--jobs", "1", "--json") == 0
    assert json.loads(capsys.readouterr().out)["checked"] == [0, 1]
    (folder / "touches/part-00000.parquet").unlink()
    assert command("status", folder) == 0
    assert f"resume {folder}" in capsys.readouterr().out
    assert command("resume", folder, "--jobs", "1", "--json") == 0
    assert json.loads(capsys.readouterr().out) == summary
    spikes = folder / "spikes/part-00000.parquet"
    os.truncate(spikes, spikes.stat().st_size - 1)
    assert command("verify", folder, "--percent", "1") == 1
