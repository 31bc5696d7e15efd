"""Stress at a node as each layer has it: the two sides of a layer boundary."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fembridge.results.stress import TENSOR, von_mises_pa
from fembridge.tables import write_table
from fembridge.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class OneSidedStress:
    """Stress at `node` in one material: `tensor_pa` ``(T, 6)`` in Pa.

    At `times_ms` ``(T,)``, in the order xx yy zz xy yz zx; it is the mean over the
    `elements` of that material at the node.
    """

    node: int
    material: int
    name: str
    elements: tuple[int, ...]
    times_ms: FloatArray
    tensor_pa: FloatArray

    @property
    def von_mises_pa(self) -> FloatArray:
        """Von Mises stress on this side, ``(T,)`` in Pa."""
        return von_mises_pa(self.tensor_pa)


def write_sides(path: Path, sides: Iterable[OneSidedStress]) -> None:
    """Write a long CSV, one row a time and side; floats come back exactly."""
    stresses = ["von_mises_pa", *(f"{name}_pa" for name in TENSOR)]
    rows = (
        (time_ms, side.node, side.name, *stress_pa)
        for side in sides
        for time_ms, stress_pa in zip(
            side.times_ms.tolist(),
            np.column_stack([side.von_mises_pa, side.tensor_pa]).tolist(),
            strict=True,
        )
    )
    write_table(path, ("time_ms", "node", "material", *stresses), rows)
