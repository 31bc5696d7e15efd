"""Time and memory of the pad of a mesh: the fingertip, with elements of several widths.

Each pad is made in a process of its own with one thread, so that its peak memory is that of one
pad (about four minutes and 0.5 GB of disk for the standard fingertip)::

    python -m benchmarks.pad_memory                 # pad_mm 1.2, 0.7 and 0.6
    python -m benchmarks.pad_memory --pad-mm 0.7 --whole-skin
    python -m benchmarks.pad_memory --factors       # the factors, beside METIS if there
"""

import argparse
import json
import multiprocessing
import resource
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import fembridge as fb
from decks.fingertip import HUMAN, Fingertip
from decks.inp import read_inp
from decks.perturbation import linear_state, stiffness_deck
from decks.solid_model import read_solid_model
from fembridge.touching.mesh_green import _LinearModel, _run


def main() -> None:
    """Print a row a pad, or a row a factorisation."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pad-mm", type=float, nargs="+", default=[1.2, 0.7, 0.6])
    parser.add_argument("--whole-skin", action="store_true", help="unit forces on all of SKIN")
    parser.add_argument("--factors", action="store_true", help="the factors alone")
    args = parser.parse_args()
    job = factors_row if args.factors else pad_row
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        for row in pool.imap(job, [(width, args.whole_skin) for width in args.pad_mm]):
            print(json.dumps(row), flush=True)


def tip_of(pad_mm: float) -> Fingertip:
    """The human fingertip with elements of another width on the pad."""
    resolution = replace(HUMAN.resolution, pad_mm=pad_mm, pad_radius_mm=max(4.0, pad_mm))
    return replace(HUMAN, name=f"tip_{pad_mm:g}", resolution=resolution)


def peak_gb() -> float:
    """Largest resident memory of this process."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (
        1e9 if sys.platform == "darwin" else 1e6
    )


def pad_row(job: tuple[float, bool]) -> dict[str, float]:
    """Size and cost of the pad of a fingertip."""
    pad_mm, whole_skin = job
    with tempfile.TemporaryDirectory() as folder:
        deck = Path(folder) / "tip.inp"
        fb.write_fingertip(deck, tip_of(pad_mm))
        afferents = {name: f"AFFERENTS_{name}" for name in HUMAN.afferents}
        skin_map = fb.SkinMap(
            outward=(0, 1, 0), along=(0, 0, 1), reach_mm=None if whole_skin else 8
        )
        begin_s, begin_cpu_s = time.monotonic(), time.process_time()
        pad = fb.make_pad(
            base_deck=deck,
            skin="SKIN",
            afferents=afferents,
            skin_map=skin_map,
            solver=fb.Solver(runs_folder=Path(folder) / "runs", threads=1),
        )
        wall_s, cpu_s = time.monotonic() - begin_s, time.process_time() - begin_cpu_s
        pad.write(Path(folder) / "pad.npz")
        return {
            "pad_mm": pad_mm,
            "unknowns": pad.origin["unknowns"],
            "nodes": len(pad.node),
            "forces": pad.origin["unit_forces"],
            "points": len(pad.point_mm),
            "wall_s": round(wall_s),
            "python_cpu_s": round(cpu_s),
            "peak_gb": round(peak_gb(), 2),
            "file_mb": round((Path(folder) / "pad.npz").stat().st_size / 1e6, 1),
            "difference": pad.origin["difference"],
        }


def factors_row(job: tuple[float, bool]) -> dict[str, float]:
    """Numbers, work and time of the factors of a fingertip."""
    pad_mm, _ = job
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tip.inp"
        fb.write_fingertip(path, tip_of(pad_mm))
        deck = read_inp(path.read_bytes())
        model, state = read_solid_model(deck), linear_state(deck, 0)
        run, _ = _run(Path(folder) / "stiffness", stiffness_deck(state), fb.Solver(threads=1))
        linear = _LinearModel(model, state, run)
        begin_s = time.process_time()
        factors = linear.factorise()
        cpu_s = time.process_time() - begin_s
        parts = [(part.columns.size, part.border.size) for part in factors._parts]
        numbers = sum(width * (width + 1) // 2 + width * border for width, border in parts)
        row = {
            "pad_mm": pad_mm,
            "unknowns": linear.size,
            "numbers_millions": round(numbers / 1e6, 1),
            "work_billions": round(factors.operations / 1e9),
            "python_cpu_s": round(cpu_s, 1),
            "stored_gb": round(factors.stored_bytes / 1e9, 2),
        }
        del factors
        return row | metis_row(linear)


def metis_row(linear: _LinearModel) -> dict[str, float]:
    """Numbers and work of the factors in the order of METIS, with three unknowns a node."""
    try:
        import pymetis
    except ImportError:
        return {}
    from scipy.sparse import csr_array

    nodes, node = np.unique(linear.node_row, return_inverse=True)
    entries = linear.matrix.tocoo()
    pairs = node[entries.coords[0]], node[entries.coords[1]]
    graph = csr_array((np.ones(entries.nnz, dtype=np.int8), pairs), shape=(nodes.size,) * 2)
    graph.sum_duplicates()
    graph.setdiag(0)
    graph.eliminate_zeros()
    lists = [part.tolist() for part in np.split(graph.indices, graph.indptr[1:-1])]
    order, rank = (np.array(numbers) for numbers in pymetis.nested_dissection(adjacency=lists))
    border: dict[int, np.ndarray] = {}
    children: list[list[int]] = [[] for _ in lists]
    numbers, work = 0, 0.0
    for place, index in enumerate(order):  # symbolic factorisation, column by column
        later = rank[np.array(lists[index], dtype=np.int64)]
        columns = np.unique(np.concatenate([later, *(border.pop(c) for c in children[place])]))
        border[place] = columns = columns[columns > place]
        if columns.size:
            children[columns[0]].append(place)
        numbers += 9 * columns.size + 6
        work += 3 * (3.0 * columns.size) ** 2
    return {
        "metis_numbers_millions": round(numbers / 1e6, 1),
        "metis_work_billions": round(work / 1e9),
    }


if __name__ == "__main__":
    main()
