"""Many touches on SLURM: ``python touches_slurm.py touches.toml /shared/set``.

dask-jobqueue (``pip install dask-jobqueue``) submits the workers, which come and go as the queue
lets them. This process writes the data set, so it needs the folder, and the workers need fembridge
and the files that the table names. ``--local`` tries the same on this machine, with two workers
as separate processes.
"""

import sys
from typing import Any

import fembridge as fb


def cluster_of(words: list[str]) -> Any:  # noqa: ANN401 - a cluster of dask
    """Workers by SLURM, one thread each; or on this machine."""
    if "--local" in words:
        from distributed import LocalCluster

        return LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0"
        )
    from dask_jobqueue import SLURMCluster

    cluster = SLURMCluster(
        queue="cpu",
        cores=16,  # of a job
        processes=16,  # one worker a core
        memory="32 GB",
        walltime="04:00:00",
        worker_extra_args=["--lifetime", "230m", "--lifetime-stagger", "5m"],
        job_script_prologue=["source /shared/venv/bin/activate"],
    )
    cluster.adapt(maximum_jobs=20)
    return cluster


def main(words: list[str]) -> int:
    """Compute the touches of a table; the number of touches that failed."""
    table, output = [word for word in words if word != "--local"]
    with cluster_of(words) as cluster:
        data = fb.touch_many(
            table,
            output,
            executor="dask",
            scheduler=cluster.scheduler_address,
            show_progress=True,
        )
    print(data)
    return len(data.failed)


if __name__ == "__main__":
    sys.exit(min(main(sys.argv[1:]), 1))
