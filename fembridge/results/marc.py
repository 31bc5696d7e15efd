"""Stress at nodes, from a post file of Marc: ``.t16``, ``.t19``.

Marc stores stress at integration points. Here it is extrapolated to the node, element by
element, and averaged over the elements of one layer; von Mises stress is that of the
resulting tensor (as CalculiX's is), or with ``von_mises="scalar"`` the points' own von Mises
stress, extrapolated as a number, which is what Mentat plots. They differ.

Marc has no units. Lengths are taken as mm, times as s, and stress in
`ReadOptions.stress_unit`; what comes out is mm, ms and Pa.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.marc_nodes import Plan, plan
from fembridge.results.marc_post import PostFile, PostIncrement, PostMesh
from fembridge.results.marc_quantity import (
    element_quantities,
    equivalent_stress,
    nodal_components,
    stress_tensor,
)
from fembridge.results.mentat import read_sts
from fembridge.results.one_sided import OneSidedStress
from fembridge.results.read_options import ReadOptions, in_pa
from fembridge.results.stress import von_mises_pa
from fembridge.trace import MS_PER_S, StressTrace
from fembridge.typing import FloatArray, Table

_DEFAULTS = ReadOptions()
_TEXT_DIGITS = 6  # of a time in a .t19

# Plans what to read of a mesh that stores so many points an element.
_Planner = Callable[[PostMesh, int], Plan]


def read(path: Path, nodes: Sequence[int], options: ReadOptions = _DEFAULTS) -> list[StressTrace]:
    """Read the von Mises stress at `nodes`, in that order.

    A trace begins with the first increment that has element values: increment 0, the state
    at rest, where the file has it.

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
            times_ms, tensor_pa, _ = _tensor_history(post, _planner(path, nodes, options), options)
            with np.errstate(over="ignore"):  # a trace refuses what is not finite
                stress_pa = von_mises_pa(tensor_pa)
        kept = options.kept(times_ms)
        times_ms, stress_pa = _unrounded_ms(times_ms[kept], post), stress_pa[kept]
    return [
        StressTrace.on_grid(node, np.stack([times_ms, column], -1), path)
        for node, column in zip(nodes, stress_pa.T, strict=True)
    ]


def read_stress_tensor(
    path: Path, nodes: Sequence[int], options: ReadOptions = _DEFAULTS
) -> tuple[FloatArray, FloatArray]:
    """Stress at `nodes`: ``(T,)`` in ms and ``(T, node, 6)`` in Pa, xx yy zz xy yz zx.

    Which tensor it is goes to `options.note`.

    Raises
    ------
    ResultError
        The file is absent, foreign or cut; it has no stress tensor; a node is not there, has
        no elements, lies between layers, or is another place after remeshing; a value is no
        finite number.
    """
    with PostFile(path) as post:
        check_whole(post, options)
        return _tensor_history(post, _planner(path, nodes, options), options)[:2]


def read_one_sided(
    path: Path, node: int, options: ReadOptions = _DEFAULTS
) -> tuple[OneSidedStress, ...]:
    """Read the stress at `node`, for each layer there on its own.

    Raises
    ------
    ResultError
        As for `read_stress_tensor`, but for the layers.
    """
    with PostFile(path) as post:
        check_whole(post, options)
        planner = _planner(path, [node], options, one_sided=True)
        times_ms, tensor_pa, planned = _tensor_history(post, planner, options)
    return tuple(
        OneSidedStress(node, side.layer, side.name, side.elements, times_ms, tensor_pa[:, k])
        for k, (side,) in enumerate(planned.sides)
    )


def check_whole(post: PostFile, options: ReadOptions) -> None:
    """Pass on what the file remarks; refuse one that is cut.

    A file that is whole may be of a job that gave up: what the ``.sts`` beside says of it is
    passed on too. The increments that are there were converged.

    Raises
    ------
    ResultError
        It is cut or damaged, and `options.partial` is not set.
    """
    for remark in post.remarks:
        options.note(remark)
    beside = post.path.with_suffix(".sts")
    if beside.is_file():
        try:
            problem = read_sts(beside).problem
        except ResultError:  # it is not what was asked for
            problem = None
        if problem is not None:
            options.note(f"{beside.name}: {problem}")
    if post.problem is not None:
        if not options.partial:
            words = f"{post.problem}; --partial (partial=True) takes what is whole"
            raise ResultError(words, post.path)
        options.note(post.problem)


def describe(path: Path) -> Table:
    """What the file holds: header, mesh, sets, quantities, what is wrong; as of a ``.frd``.

    Raises
    ------
    ResultError
        There is no file, it is empty, or no post file.
    """
    with PostFile(path) as post:
        mesh = post.mesh(0)
        types, counts = np.unique(mesh.element_types, return_counts=True)
        header: Table = {
            "title": post.title,
            "post revision": post.revision,
            "byte order": post.byte_order,
            "precision": post.precision,
            "points stored an element": post.points,
        }
        if post.kind == "t19":
            del header["byte order"]
        return {
            "format": f"marc-{post.kind}",
            "bytes": path.stat().st_size,
            "mesh_nodes": int(mesh.node_ids.size),
            "elements": int(counts.sum()),
            "materials": {},
            "header": header,
            "element_types": {
                str(int(number)): int(count) for number, count in zip(types, counts, strict=True)
            },
            "codes": [code.code for code in post.codes],
            "sets": [
                {"name": one.name, "kind": one.kind, "members": int(one.members.size)}
                for one in mesh.sets
            ],
            "increments": len(post.increments),
            "meshes": post.mesh_count,
            "quantities": _quantities(post, mesh),
            "remarks": post.remarks,
            "problem": post.problem,
        }


def _quantities(post: PostFile, mesh: PostMesh) -> list[Table]:
    found: dict[str, tuple[tuple[str, ...], str, list[PostIncrement]]] = {}
    stored = element_quantities(post.codes)
    for one in post.increments:
        for quantity in one.nodal:
            parts = nodal_components(quantity)
            found.setdefault(quantity.name, (parts, "nodes", []))[2].append(one)
        for held in stored if one.has_element_values else ():
            parts = held.components
            found.setdefault(held.name, (parts, "integration points", []))[2].append(one)
    ids = mesh.node_ids
    tables: list[Table] = []
    for name, (parts, where, increments) in found.items():
        timed = [one.time_s * MS_PER_S for one in increments if not one.harmonic]
        others = [one.frequency for one in increments if one.harmonic]
        tables.append(
            {
                "name": name,
                "components": list(parts),
                "increments": len(timed),
                "first_ms": timed[0] if timed else None,
                "last_ms": timed[-1] if timed else None,
                "modes": len(others),
                "axis": "frequency in cycles per time" if others else "total time",
                "first_value": others[0] if others else None,
                "last_value": others[-1] if others else None,
                "steps": sorted({one.sub_increment for one in increments}),
                "at": where,
                "nodes": int(ids.size),
                "lowest_node": int(ids.min()) if ids.size else None,
                "highest_node": int(ids.max()) if ids.size else None,
                "storage": "text" if post.kind == "t19" else post.precision,
            }
        )
    return tables


def _planner(
    path: Path, nodes: Sequence[int], options: ReadOptions, *, one_sided: bool = False
) -> _Planner:
    wanted = [int(node) for node in nodes]
    return lambda mesh, stored: plan(
        mesh,
        wanted,
        stored,
        options.method,
        path,
        across_materials=options.across_materials,
        one_sided=one_sided,
    )


def _tensor_history(
    post: PostFile, planner: _Planner, options: ReadOptions
) -> tuple[FloatArray, FloatArray, Plan]:
    tensor = stress_tensor(post.codes, post.path)
    options.note(f"stress: {tensor}, extrapolated to nodes: {options.method}")
    columns = list(tensor.columns)
    times_ms, values, planned = _history(post, planner, lambda at: at[:, :, columns], options)
    return times_ms, in_pa(values, options, post.path), planned


def _scalar_history(
    post: PostFile, nodes: Sequence[int], options: ReadOptions
) -> tuple[FloatArray, FloatArray]:
    """Von Mises stress of the points, extrapolated, ``(T, node)`` in Pa."""
    stored = equivalent_stress(post.codes)
    quantity = stored or stress_tensor(post.codes, post.path)
    columns = list(quantity.columns)

    def pick(at_points: FloatArray) -> FloatArray:
        chosen = at_points[:, :, columns]
        return chosen if stored else von_mises_pa(chosen)[:, :, None]

    words = str(stored) if stored else f"von Mises of {quantity} at the points"
    options.note(f"stress: {words}, extrapolated to nodes: {options.method}")
    times_ms, values, _ = _history(post, _planner(post.path, nodes, options), pick, options)
    below = np.argwhere(values[:, :, 0] < 0)
    if below.size:
        row, column = below[0]
        options.note(
            f"node {nodes[column]}: von Mises stress is below 0 at {times_ms[row]:g} ms: linear "
            "extrapolation of a steep field does that"
        )
    return times_ms, in_pa(values[:, :, 0], options, post.path)


def _history(
    post: PostFile,
    planner: _Planner,
    pick: Callable[[FloatArray], FloatArray],
    options: ReadOptions,
) -> tuple[FloatArray, FloatArray, Plan]:
    """Values at each increment that has any, ``(T,)`` in ms and ``(T, S, C)``; the first plan.

    `pick` makes ``(K, point, C)`` of the stored values ``(K, point, code)``.
    """
    plans: dict[int, Plan] = {}
    times_ms, found = [], []
    for one in _with_element_values(post, options):
        if one.mesh not in plans:
            plans[one.mesh] = _plan_of(post, one, planner, plans, options)
        planned = plans[one.mesh]
        values = planned.add_up(pick(post.element_values(one.row, planned.element_rows)))
        if np.isfinite(values).all():
            times_ms.append(one.time_s * MS_PER_S)
            found.append(values)
            continue
        node = planned.sides[int(np.argwhere(~np.isfinite(values))[0][0])][0].node
        words = f"node {node} at {one.time_s * MS_PER_S:g} ms: stress is not finite"
        if not options.partial:
            raise ResultError(words, post.path)
        options.note(f"dropped increment {one.increment}: {words}")
    if not found:
        raise ResultError("no increment with finite element values", post.path)
    if post.change is not None:
        if not options.partial:
            raise ResultError(f"{post.change}; read it again when the run has ended", post.path)
        options.note(post.change)
    return np.array(times_ms), np.array(found), next(iter(plans.values()))


def _plan_of(
    post: PostFile,
    one: PostIncrement,
    planner: _Planner,
    plans: dict[int, Plan],
    options: ReadOptions,
) -> Plan:
    if post.codes_of(one.row) != post.codes:
        raise ResultError(
            f"increment {one.increment} has other post codes than the first model", post.path
        )
    planned = planner(post.mesh(one.mesh), post.points_of(one.row))
    if not plans:
        for remark in planned.remarks:
            options.note(remark)
    elif not np.array_equal(planned.places, next(iter(plans.values())).places):
        raise ResultError(
            f"increment {one.increment} has a new mesh, in which what was asked for is another "
            "place: a trace over both would be of two places",
            post.path,
        )
    return planned


def _with_element_values(post: PostFile, options: ReadOptions) -> list[PostIncrement]:
    """Increments of a history; those left out are noted."""
    if not post.codes or not any(one.has_element_values for one in post.increments):
        raise ResultError(
            "no element values in it: the deck's 'post' asks for no element code (311 is the "
            "stress tensor)",
            post.path,
        )
    for left, what in (
        ([one for one in post.increments if not one.has_element_values], "without element values"),
        ([one for one in post.increments if one.harmonic], "of frequency, not of time"),
    ):
        if left:
            shown = ", ".join(str(one.increment) for one in left[:5])
            more = ", ..." if len(left) > 5 else ""
            options.note(f"left out: increments {what}, {shown}{more}")
    return [one for one in post.increments if one.has_element_values and not one.harmonic]


def _unrounded_ms(times_ms: FloatArray, post: PostFile) -> FloatArray:
    """Times ``(T,)`` without the rounding they are stored with, if they then are even.

    A ``.t16`` has times in single precision, a ``.t19`` with six digits: at 0.25 s an even
    step of 0.5 ms looks uneven in the latter.
    """
    times_s = np.abs(times_ms) / MS_PER_S
    if post.kind == "t19":
        tiny = np.maximum(times_s, np.finfo(np.float64).tiny)
        digit_s = 10.0 ** (np.floor(np.log10(tiny)) + 1 - _TEXT_DIGITS)
    elif post.precision == "single":
        digit_s = np.spacing(times_s.astype(np.float32)).astype(np.float64)
    else:
        return times_ms
    if times_ms.size < 2:
        return times_ms
    even: FloatArray = np.linspace(times_ms[0], times_ms[-1], times_ms.size)
    digit_ms = digit_s * MS_PER_S
    share = np.linspace(0.0, 1.0, times_ms.size)  # the ends are rounded too
    rounding_ms = digit_ms + (1 - share) * digit_ms[0] + share * digit_ms[-1]
    return even if (np.abs(even - times_ms) <= rounding_ms).all() else times_ms
