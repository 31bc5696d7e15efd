"""The node nearest to a place: for users who know where, not which.

Places are coordinates of the undeformed mesh, as the file holds them: the deck's
length unit, mm in ours. Only nodes that have results can be taken.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError, UsageError
from fembridge.results.field_source import FieldSource, open_source
from fembridge.results.read_options import ReadOptions
from fembridge.typing import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class NearNode:
    """The node taken for a place: where it is, and how far away.

    `nearer` is the node of the mesh that is nearer and has no results, if there
    is one: the output was restricted to a set.
    """

    node: int
    place_mm: tuple[float, ...]
    at_mm: tuple[float, float, float]
    distance_mm: float
    nearer: int | None = None

    def __str__(self) -> str:
        place = ", ".join(f"{value:g}" for value in self.place_mm)
        at = ", ".join(f"{value:g}" for value in self.at_mm[: len(self.place_mm)])
        words = f"near {place}: node {self.node} at {at}, {self.distance_mm:.3g} mm away"
        if self.nearer is not None:
            words += f" (node {self.nearer} is nearer and has no results)"
        return words


def near_nodes(path: Path, places_mm: Sequence[Sequence[float]]) -> list[NearNode]:
    """Find the node nearest to each place that has a stress; of equals the lowest.

    A place is x, y or x, y, z. Without z the mesh has to lie in one plane of z.

    Raises
    ------
    UsageError
        A place is not two or three finite numbers, or lacks the z it needs.
    ResultError
        The file has no nodes, or no stress; a coordinate is no number.
    """
    for place in places_mm:
        if len(place) not in (2, 3) or not all(map(math.isfinite, place)):
            words = ", ".join(map(str, place))
            raise UsageError(f"place {words}: expected x,y or x,y,z")
    with open_source(path, ReadOptions(partial=True)) as source:
        return _search(source, places_mm)


def _search(source: FieldSource, places_mm: Sequence[Sequence[float]]) -> list[NearNode]:
    flat = any(len(place) == 2 for place in places_mm)
    best = [_Best() for _ in places_mm]
    every = [_Best() for _ in places_mm]
    lowest, highest = math.inf, -math.inf
    for nodes, at_mm, held in source.places():
        lowest = min(lowest, float(at_mm[:, 2].min()))
        highest = max(highest, float(at_mm[:, 2].max()))
        if flat and highest - lowest > 1e-9 * max(1.0, abs(lowest), abs(highest)):
            raise UsageError(
                f"{source.path}: nodes have z from {lowest:g} to {highest:g}: name a place as x,y,z"
            )
        for place, one, mesh in zip(places_mm, best, every, strict=True):
            with np.errstate(over="ignore"):  # a place out of reach is at infinity
                away = np.linalg.norm(at_mm[:, : len(place)] - np.array(place), axis=1)
            mesh.offer(nodes, at_mm, away)
            if held.any():
                one.offer(nodes[held], at_mm[held], away[held])
    if any(not math.isfinite(one.distance_mm) for one in best):
        raise ResultError("no node of the mesh has a place and results", source.path)
    return [
        NearNode(
            node=one.node,
            place_mm=tuple(map(float, place)),
            at_mm=one.at_mm,
            distance_mm=one.distance_mm,
            nearer=mesh.node if mesh.distance_mm < one.distance_mm else None,
        )
        for place, one, mesh in zip(places_mm, best, every, strict=True)
    ]


class _Best:
    """The nearest node so far."""

    def __init__(self) -> None:
        self.node, self.distance_mm = 0, math.inf
        self.at_mm = (math.nan, math.nan, math.nan)

    def offer(self, nodes: IntArray, at_mm: FloatArray, away_mm: FloatArray) -> None:
        """Take the nearest of `nodes` if it is nearer; of equals the lowest."""
        row = int(np.lexsort((nodes, away_mm))[0])
        offered = float(away_mm[row]), int(nodes[row])
        if self.node == 0 or offered < (self.distance_mm, self.node):
            self.distance_mm, self.node = offered
            x_mm, y_mm, z_mm = at_mm[row].tolist()
            self.at_mm = (x_mm, y_mm, z_mm)
