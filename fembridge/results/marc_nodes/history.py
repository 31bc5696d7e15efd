"""Values at chosen nodes over the increments of a post file.

The elements at the nodes are found once for each mesh; an increment then costs a few
seeks. Increments that hold nothing of use are left out, and that is told.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.marc_format.content import PostIncrement, PostMesh
from fembridge.results.marc_format.post_file import PostFile
from fembridge.results.marc_nodes.layer import UNTOLD, Layers, layers_of
from fembridge.results.marc_nodes.plan import Plan
from fembridge.results.marc_nodes.whole import check_unchanged
from fembridge.results.read_options import ReadOptions
from fembridge.trace import MS_PER_S
from fembridge.typing import FloatArray

# Plans what to read of a mesh that stores so many points an element.
Planner = Callable[[PostMesh, Layers, int], Plan]


def history(
    post: PostFile, planner: Planner, pick: Callable[[FloatArray], FloatArray], options: ReadOptions
) -> tuple[FloatArray, FloatArray]:
    """Values at each increment that has any: ``(T,)`` in ms and ``(T, S, C)``.

    Parameters
    ----------
    planner
        Gives the `Plan` of ``S`` shares in a mesh.
    pick
        Makes ``(K, point, C)`` of the stored values ``(K, point, code)``.

    Raises
    ------
    ResultError
        No increment has element values; what was asked for is another place after
        remeshing; a value is no finite number; the file changes while it is read.
    """
    plans: dict[int, Plan] = {}
    times_ms, found = [], []
    for one in _with_element_values(post, options):
        if one.mesh not in plans:
            plan = _plan(post, one, planner, options, told=bool(plans))
            _check_same(plan, plans, one, post.path)
            plans[one.mesh] = plan
        plan = plans[one.mesh]
        values = plan.add_up(pick(post.element_values(one.row, plan.element_rows)))
        if np.isfinite(values).all():
            times_ms.append(one.time_s * MS_PER_S)
            found.append(values)
            continue
        node = plan.nodes[int(np.argwhere(~np.isfinite(values))[0][0])]
        words = f"node {node} at {one.time_s * MS_PER_S:g} ms: stress is not finite"
        if not options.partial:
            raise ResultError(words, post.path)
        options.note(f"dropped increment {one.increment}: {words}")
    if not found:
        raise ResultError("no increment with finite element values", post.path)
    check_unchanged(post, options)
    return np.array(times_ms), np.array(found)


def _plan(
    post: PostFile, one: PostIncrement, planner: Planner, options: ReadOptions, *, told: bool
) -> Plan:
    if post.codes_of(one.row) != post.codes:
        raise ResultError(
            f"increment {one.increment} has other post codes than the first model", post.path
        )
    mesh = post.meshes[one.mesh]
    layers = layers_of(mesh, post.path)
    plan = planner(mesh, layers, post.points_of(one.row))
    if not told:
        for words in (*plan.remarks, *(() if layers.told else (UNTOLD,))):
            options.note(words)
    return plan


def _with_element_values(post: PostFile, options: ReadOptions) -> list[PostIncrement]:
    """Increments that count; the others are told of."""
    if not post.codes or not any(one.has_element_values for one in post.increments):
        raise ResultError(
            "no element values in it: the deck's 'post' asks for no element code "
            "(311 is the stress tensor)",
            post.path,
        )
    empty = [one for one in post.increments if not one.has_element_values]
    _tell_left(empty, "without element values", options)
    modes = [one for one in post.increments if one.harmonic]
    _tell_left(modes, "of frequency, not of time", options)
    return [one for one in post.increments if one.has_element_values and not one.harmonic]


def _tell_left(left: list[PostIncrement], what: str, options: ReadOptions) -> None:
    if left:
        shown = ", ".join(str(one.increment) for one in left[:5])
        more = ", ..." if len(left) > 5 else ""
        options.note(f"left out: increments {what}, {shown}{more}")


def _check_same(plan: Plan, plans: dict[int, Plan], one: PostIncrement, path: Path) -> None:
    """Hold the elements of a new mesh against those of the first."""
    if plans and not plan.same_as(next(iter(plans.values()))):
        raise ResultError(
            f"increment {one.increment} has a new mesh, in which what was asked for "
            "is another place: a trace over both would be of two places",
            path,
        )
