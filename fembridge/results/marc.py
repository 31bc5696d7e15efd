"""Stress and displacement at nodes, from a post file of Marc: ``.t16``, ``.t19``.

Marc stores stress at integration points. Here it is extrapolated to the node, element
by element, and averaged over the elements of one layer; von Mises stress is that of
the resulting tensor (as CalculiX's is), or with ``von_mises="scalar"`` the points' own
von Mises stress, extrapolated as a number, which is what Mentat plots. They differ.

Marc has no units. Lengths are taken as mm, times as s, and stress in
`ReadOptions.stress_unit`; what comes out is mm, ms and Pa.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.marc_format.content import PostIncrement, PostMesh
from fembridge.results.marc_format.post_file import PostFile
from fembridge.results.marc_nodes.clock import unrounded_ms
from fembridge.results.marc_nodes.history import Planner, history
from fembridge.results.marc_nodes.layer import Layers
from fembridge.results.marc_nodes.plan import Plan, plan_nodes, plan_sides
from fembridge.results.marc_nodes.quantity import equivalent_stress, stress_tensor
from fembridge.results.marc_nodes.whole import check_unchanged, check_whole
from fembridge.results.one_sided import OneSidedStress
from fembridge.results.read_options import ReadOptions, in_pa
from fembridge.results.stress import von_mises_pa
from fembridge.trace import MS_PER_S, StressTrace
from fembridge.typing import FloatArray, Table

DISPLACEMENT = "Displacement"
_DEFAULTS = ReadOptions()


def read(path: Path, nodes: Sequence[int], options: ReadOptions = _DEFAULTS) -> list[StressTrace]:
    """Read the von Mises stress at `nodes`, in that order.

    A trace begins with the first increment that has element values: increment 0, the
    state at rest, where the file has it.

    Raises
    ------
    ResultError
        As for `read_stress_tensor`; also times that are uneven.
    """
    with PostFile(path) as post:
        check_whole(post, options)
        if options.von_mises == "scalar":
            times_ms, stress_pa = _scalar_history(post, nodes, options)
        else:
            times_ms, tensor_pa = _tensor_history(post, _nodes(path, nodes, options), options)
            with np.errstate(over="ignore"):  # a trace refuses what is not finite
                stress_pa = von_mises_pa(tensor_pa)
        kept = options.kept(times_ms)
        times_ms, stress_pa = times_ms[kept], stress_pa[kept]
        times_ms = unrounded_ms(times_ms, post.kind, post.precision)
    return [
        StressTrace.on_grid(node, np.stack([times_ms, column], -1), path)
        for node, column in zip(nodes, stress_pa.T, strict=True)
    ]


def read_stress_tensor(
    path: Path, nodes: Sequence[int], options: ReadOptions = _DEFAULTS
) -> tuple[FloatArray, FloatArray]:
    """Stress at `nodes`: ``(T,)`` in ms and ``(T, node, 6)`` in Pa.

    The order of components is xx yy zz xy yz zx; which tensor it is, `options.tell`
    hears.

    Raises
    ------
    ResultError
        The file is absent, foreign or cut; it has no stress tensor; a node is not
        there, has no elements, lies between layers, or is another place after
        remeshing; a value is no finite number.
    """
    with PostFile(path) as post:
        check_whole(post, options)
        return _tensor_history(post, _nodes(path, nodes, options), options)


def read_one_sided(
    path: Path, node: int, options: ReadOptions = _DEFAULTS
) -> tuple[OneSidedStress, ...]:
    """Read the stress at `node`, for each layer there on its own.

    Raises
    ------
    ResultError
        As for `read_stress_tensor`, but for the layers.
    """
    told: list[tuple[Plan, PostMesh, Layers]] = []

    def planner(mesh: PostMesh, layers: Layers, stored: int) -> Plan:
        plan = plan_sides(mesh, layers, node, stored, options.method, path)
        told.append((plan, mesh, layers))
        return plan

    with PostFile(path) as post:
        check_whole(post, options)
        times_ms, tensor_pa = _tensor_history(post, planner, options)
    plan, mesh, layers = told[0]
    return tuple(
        OneSidedStress(
            node=node,
            material=side.layer,
            name=layers.names[side.layer],
            elements=tuple(mesh.element_ids[side.element_rows].tolist()),
            times_ms=times_ms,
            tensor_pa=tensor_pa[:, k],
        )
        for k, (side,) in enumerate(plan.sides)
    )


def read_displacement(
    path: Path, nodes: Sequence[int], options: ReadOptions = _DEFAULTS
) -> tuple[FloatArray, FloatArray]:
    """Displacement of `nodes`: ``(T,)`` in ms and ``(T, node, 3)`` in mm.

    Raises
    ------
    ResultError
        The file is absent, foreign or cut; it has no displacement; a node is not
        there; a value is no finite number.
    """
    with PostFile(path) as post:
        check_whole(post, options)
        times_ms, found = [], []
        for one in post.increments:
            if DISPLACEMENT not in {quantity.name for quantity in one.nodal}:
                continue
            rows = _rows_of(post.meshes[one.mesh], nodes, path)
            values = post.nodal_values(one.row, DISPLACEMENT, rows)
            _check_finite(values, nodes, one, DISPLACEMENT, path)
            times_ms.append(one.time_s * MS_PER_S)
            found.append(np.zeros((len(nodes), 3)))
            found[-1][:, : values.shape[1]] = values[:, :3]
        if not found:
            raise ResultError(f"no {DISPLACEMENT} in it", path)
        check_unchanged(post, options)
        return np.array(times_ms), np.array(found)


def describe(path: Path) -> Table:
    """Tell what the file holds: header, mesh, sets, quantities, what is wrong.

    Raises
    ------
    ResultError
        There is no file, it is empty, or no post file.
    """
    from fembridge.results.marc_nodes.listing import describe_post

    with PostFile(path) as post:
        return describe_post(post, path)


def _nodes(path: Path, nodes: Sequence[int], options: ReadOptions) -> Planner:
    wanted = [int(node) for node in nodes]
    return lambda mesh, layers, stored: plan_nodes(
        mesh,
        layers,
        wanted,
        stored,
        options.method,
        path,
        across_materials=options.across_materials,
    )


def _tensor_history(
    post: PostFile, planner: Planner, options: ReadOptions
) -> tuple[FloatArray, FloatArray]:
    tensor = stress_tensor(post.codes, post.path)
    options.note(f"stress: {tensor}, extrapolated to nodes: {options.method}")
    columns = list(tensor.columns)
    times_ms, values = history(post, planner, lambda at_points: at_points[:, :, columns], options)
    return times_ms, in_pa(values, options, post.path)


def _scalar_history(
    post: PostFile, nodes: Sequence[int], options: ReadOptions
) -> tuple[FloatArray, FloatArray]:
    """Von Mises stress of the points, extrapolated, ``(T, node)`` in Pa."""
    stored = equivalent_stress(post.codes)
    if stored is not None:
        column, words = stored.columns[0], str(stored)
        pick = lambda at_points: at_points[:, :, [column]]  # noqa: E731 - one of two
    else:
        tensor = stress_tensor(post.codes, post.path)
        columns, words = list(tensor.columns), f"von Mises of {tensor} at the points"
        pick = lambda at_points: von_mises_pa(at_points[:, :, columns])[:, :, None]  # noqa: E731
    options.note(f"stress: {words}, extrapolated to nodes: {options.method}")
    times_ms, values = history(post, _nodes(post.path, nodes, options), pick, options)
    below = np.argwhere(values[:, :, 0] < 0)
    if below.size:
        row, column = below[0]
        options.note(
            f"node {nodes[column]}: von Mises stress is below 0 at "
            f"{times_ms[row]:g} ms: linear extrapolation of a steep field does that"
        )
    return times_ms, in_pa(values[:, :, 0], options, post.path)


def _rows_of(mesh: PostMesh, nodes: Sequence[int], path: Path) -> np.ndarray:
    order = np.argsort(mesh.node_ids, kind="stable")
    wanted = np.asarray(nodes, dtype=np.int64)
    place = np.minimum(np.searchsorted(mesh.node_ids, wanted, sorter=order), max(order.size - 1, 0))
    rows = order[place] if order.size else place
    if not order.size or not np.array_equal(mesh.node_ids[rows], wanted):
        absent = next(node for node in wanted.tolist() if node not in mesh.node_ids)
        raise ResultError(f"no node {absent} in the mesh", path)
    return rows


def _check_finite(
    values: FloatArray, nodes: Sequence[int], one: PostIncrement, name: str, path: Path
) -> None:
    bad = np.argwhere(~np.isfinite(values))
    if bad.size:
        raise ResultError(
            f"node {nodes[bad[0][0]]} at {one.time_s * MS_PER_S:g} ms: {name} is not finite", path
        )
