"""Sweeps whose processes die: nothing is lost, nothing is solved twice."""

import csv
import os
import signal
from collections import Counter

import pytest

from fembridge.sweeps.study_file import read_study
from fembridge.sweeps.sweep import make_plan, solver_version
from fembridge.sweeps.sweep import sweep as run_sweep

pytestmark = [
    pytest.mark.usefixtures("recorded_ccx"),
    pytest.mark.filterwarnings("ignore:parameter set"),
]


def table_of(folder):
    with (folder / "results.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def solved(ledger):
    """How often each folder was solved to the end."""
    return Counter(where for word, _, _, where in ledger() if word == "end")


def begun(ledger):
    return [entry for entry in ledger() if entry[0] == "begin"]


def finished(sweep):
    code = sweep.wait(300)
    out, err = sweep.communicate()
    return code, out, err


@pytest.mark.slow
def test_after_kill_9_of_the_sweep_only_the_unfinished_is_done(
    dermis_study, tmp_path, ledger, gate, start_sweep, wait_until, is_alive, in_this_process
):
    path = dermis_study(3)
    gate.touch()
    wait_for = tmp_path / "out" / "runs"
    sweep = start_sweep(path, "-o", tmp_path / "out", "--jobs", "1")
    wait_until(lambda: len(list(wait_for.glob("*/item.toml"))) >= 1)
    gate.unlink()
    wait_until(
        lambda: len(begun(ledger)) - sum(solved(ledger).values()) >= 1 or len(begun(ledger)) == 3
    )
    sweep.send_signal(signal.SIGKILL)
    sweep.wait(60)
    working = {pid for entry in begun(ledger) for pid in entry[1:3]}
    wait_until(lambda: not any(map(is_alive, working)))
    whole = solved(ledger)
    assert not (tmp_path / "out/results.csv").exists()

    gate.touch()
    assert not run_sweep(path, tmp_path / "out", jobs=1).failed

    assert set(solved(ledger).values()) == {1}
    assert len(solved(ledger)) == 3
    assert whole.items() <= solved(ledger).items()
    assert {row["status"] for row in table_of(tmp_path / "out")} == {"done"}


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_sweep_that_is_asked_to_stop_takes_its_solvers_along(
    dermis_study, tmp_path, ledger, gate, start_sweep, wait_until, is_alive, number, code
):
    path = dermis_study(3)
    sweep = start_sweep(path, "-o", tmp_path / "out", "--jobs", "2")
    wait_until(lambda: len(begun(ledger)) == 2)
    os.kill(sweep.pid, number)

    found, _, shown = finished(sweep)
    assert found == code
    assert ("0 of 3 items are kept" in shown) == (number == signal.SIGINT)
    assert not any(is_alive(pid) for entry in ledger() for pid in entry[1:3])
    assert not solved(ledger)
    assert not (tmp_path / "out/results.csv").exists()

    gate.touch()
    assert not run_sweep(path, tmp_path / "out", jobs=1).failed
    assert sorted(solved(ledger).values()) == [1, 1, 1]


@pytest.mark.slow
def test_two_sweeps_on_one_folder_share_the_work(
    dermis_study, tmp_path, ledger, gate, start_sweep, wait_until
):
    path = dermis_study(4)
    sweeps = [start_sweep(path, "-o", tmp_path / "out") for _ in range(2)]
    wait_until(lambda: len(begun(ledger)) == 2)
    gate.touch()
    for sweep in sweeps:
        code, out, _ = finished(sweep)
        assert (code, out.startswith("4 of 4 items done")) == (0, True)
    assert sorted(solved(ledger).values()) == [1, 1, 1, 1]
    assert len(begun(ledger)) == 4


@pytest.mark.slow
def test_a_response_that_was_edited_by_hand_is_read_again_from_the_solver(
    dermis_study, tmp_path, ledger
):
    out = tmp_path / "out"
    run_sweep(dermis_study(2), out)
    table = (out / "results.csv").read_bytes()
    items = make_plan(read_study(dermis_study(2)), solver_version()).items.values()
    for item in items:
        (out / item.run_folder / "item.toml").unlink()
    stored = [out / item.response.run_folder for item in items]
    content = (stored[0] / "response.toml").read_text()
    (stored[0] / "response.toml").write_text(content.replace("1", "2"))
    (stored[1] / "response.toml").unlink()
    (stored[1] / "mesh.npz").write_bytes(b"cut")

    run_sweep(dermis_study(2), out)

    assert (out / "results.csv").read_bytes() == table
    assert (stored[0] / "response.toml").read_text() == content
    assert len(begun(ledger)) == 2  # what the solver wrote was whole
