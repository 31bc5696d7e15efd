"""Sweeps by dask: a cluster of two processes on this machine, and what kills it.

Each runs in a process of its own: dask leaves threads and warnings behind that are
none of ours.
"""

import csv
import importlib.util
import os
import re
import signal
from collections import Counter
from contextlib import suppress
from ipaddress import ip_address
from pathlib import Path

import pytest

from fembridge.errors import MissingError, UsageError
from fembridge.host import executor
from fembridge.host.executor import dask_executor
from fembridge.sweeps.sweep import sweep as run_sweep

needs_dask = pytest.mark.skipif(
    importlib.util.find_spec("distributed") is None,
    reason="dask.distributed is not installed (the extra 'dask')",
)

CLUSTER = """
import sys, threading
from pathlib import Path

def main(study, folder):
    from distributed import LocalCluster
    from fembridge.sweeps.sweep import sweep as run_sweep
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0"
    ) as cluster:
        print("workers", *[w.pid for w in cluster.workers.values()], flush=True)
        sweep = run_sweep(
            Path(study), Path(folder), executor="dask",
            scheduler=cluster.scheduler_address, show_progress=True,
        )
        print("causes", [failure.cause for failure in sweep.failed], flush=True)

if __name__ == "__main__":
    main(*sys.argv[1:])
"""


def count(ledger, word):
    return Counter(entry[3] for entry in ledger() if entry[0] == word)


@needs_dask
@pytest.mark.slow
@pytest.mark.usefixtures("recorded_ccx")
def test_a_worker_killed_in_the_middle_loses_nothing_and_repeats_nothing(
    dermis_study, tmp_path, ledger, gate, begin, wait_until, is_alive
):
    (tmp_path / "cluster.py").write_text(CLUSTER)
    sweep = begin(tmp_path / "cluster.py", dermis_study(4), tmp_path / "out")
    wait_until(lambda: sum(count(ledger, "begin").values()) == 2)
    workers = {entry[2] for entry in ledger()}
    assert len(workers) == 2
    _, solver, worker, _ = ledger()[0]
    os.kill(worker, signal.SIGKILL)
    wait_until(lambda: not is_alive(solver))
    gate.touch()
    out, err = sweep.communicate(timeout=120)

    assert sweep.returncode == 0, err
    assert "causes []" in out
    assert sorted(count(ledger, "end").values()) == [1, 1, 1, 1]
    assert sum(count(ledger, "begin").values()) == 5
    with (tmp_path / "out/results.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["status"] for row in rows] == ["done"] * 12


@needs_dask
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:parameter set")
@pytest.mark.usefixtures("recorded_ccx")
def test_a_cluster_of_our_own_ends_with_the_sweep(
    dermis_study, tmp_path, ledger, gate, start_sweep, wait_until, is_alive
):
    words = ["-o", tmp_path / "out", "--executor", "dask", "--jobs", "2"]
    sweep = start_sweep(dermis_study(3), *words)
    wait_until(lambda: sum(count(ledger, "begin").values()) == 2)
    sweep.send_signal(signal.SIGINT)
    assert sweep.wait(60) == 130
    wait_until(lambda: not any(is_alive(pid) for e in ledger() for pid in e[1:3]))
    assert not count(ledger, "end")
    gate.touch()
    assert not run_sweep(dermis_study(3), tmp_path / "out").failed
    assert sorted(count(ledger, "end").values()) == [1, 1, 1]


def listening():
    """Addresses at which this process and what it started take connections."""
    ours, inodes, found = [os.getpid()], set(), []
    for pid in ours:
        for path in Path(f"/proc/{pid}/task").glob("*/children"):
            ours += map(int, path.read_text().split())
        for path in Path(f"/proc/{pid}/fd").iterdir():
            with suppress(FileNotFoundError):
                inodes.add(str(path.readlink()))
    for kind, size in (("tcp", 4), ("tcp6", 16)):
        for line in Path(f"/proc/net/{kind}").read_text().splitlines()[1:]:
            words = line.split()
            if words[3] == "0A" and f"socket:[{words[9]}]" in inodes:
                raw = bytes.fromhex(words[1].partition(":")[0])
                swapped = [raw[k : k + 4][::-1] for k in range(0, size, 4)]
                found.append(ip_address(b"".join(swapped)))
    return found


@needs_dask
@pytest.mark.slow
def test_a_cluster_of_our_own_listens_to_nobody_else():
    with dask_executor(None, 1) as pool:
        assert pool.submit(abs, -1).result() == 1
        found = listening()
    assert len(found) > 2
    assert all(each.is_loopback for each in found), found


@needs_dask
@pytest.mark.parametrize("address", ["localhost:8786", "http://x:1"])
def test_what_is_no_address_is_refused(address, dermis_study, tmp_path):
    with pytest.raises(UsageError, match=re.escape(repr(address))):
        run_sweep(dermis_study(1), tmp_path, executor="dask", scheduler=address)


@needs_dask
def test_tls_without_certificates_is_refused_in_one_line(dermis_study, tmp_path):
    with pytest.raises(UsageError, match=r"tls://127\.0\.0\.1:1"):
        run_sweep(dermis_study(1), tmp_path, executor="dask", scheduler="tls://127.0.0.1:1")


def test_without_dask_the_error_has_the_install_command(dermis_study, tmp_path, monkeypatch):
    def absent(name):
        raise ImportError(name)

    monkeypatch.setattr(executor, "import_module", absent)
    with pytest.raises(MissingError, match=r"pip install 'fembridge\[dask\]'"):
        run_sweep(dermis_study(1), tmp_path, executor="dask")
