"""A pad: what unit forces on the skin of a model do to its skin and to its afferents.

`Pad` and `SkinNodes` are the interface that contact, stress and populations use. There are two
kinds: `fembridge.touching.prism_pad.PrismPad`, a section that is swept along the finger, and
`fembridge.touching.mesh_pad.MeshPad`, any mesh.

Positions on the skin are those of a map: x across and z along the finger, seen from above.
Components of stress are those in its directions: x, y out of the skin, z.
"""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import UsageError
from fembridge.touching.compliance import Compliance
from fembridge.touching.shape import Shape
from fembridge.typing import BoolArray, FloatArray, IntArray, SingleArray

COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "zx")


class Site(Protocol):
    """Where the afferents of a class are."""

    @property
    def layer(self) -> str:
        """Layer in which they lie."""

    @property
    def x_mm(self) -> float:
        """Position of the median unit across the finger in mm."""

    @property
    def depth_mm(self) -> float:
        """Depth below the skin in mm."""


@dataclass(frozen=True, slots=True)
class SkinMargin:
    """Positions on or beside the skin: `rows` ``(P,)`` are the ones that have a `problem`."""

    rows: BoolArray
    problem: Callable[[int], str]


@dataclass(frozen=True, slots=True, eq=False)
class SkinCells:
    """Cells of the skin for a picture of pressure.

    Parameters
    ----------
    x_mm, z_mm
        Positions of the corners in mm, ``(N,)`` each; without `triangles`, edges of columns and
        rows of a lattice.
    triangles
        Corners of each triangle, ``(F, 3)``; None: a lattice.
    values
        Function of values at the nodes ``(n,)`` that returns those of the cells, ``(F,)`` or
        ``(row, column)``: NaN where nothing touches.
    """

    x_mm: FloatArray
    z_mm: FloatArray
    triangles: IntArray | None
    values: Callable[[FloatArray], FloatArray]


class SkinNodes(ABC):
    """Nodes of the skin of a pad that may touch, or some of them."""

    pad: "Pad"
    """Pad of the nodes."""

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of nodes."""

    @property
    @abstractmethod
    def x_mm(self) -> FloatArray:
        """Positions across the finger in mm, ``(n,)``."""

    @property
    @abstractmethod
    def z_mm(self) -> FloatArray:
        """Positions along the finger in mm, ``(n,)``."""

    @property
    def seen_mm(self) -> tuple[FloatArray, FloatArray]:
        """Positions in the plane of the shape that touches in mm, two ``(n,)``."""
        return self.x_mm, self.z_mm

    @property
    @abstractmethod
    def height_mm(self) -> FloatArray:
        """Heights towards the shape that touches in mm, ``(n,)``."""

    @property
    @abstractmethod
    def area_mm2(self) -> FloatArray:
        """Skin that each node stands for in mm², ``(n,)``."""

    @abstractmethod
    def subset(self, rows: BoolArray | IntArray) -> "SkinNodes":
        """Nodes of a mask ``(n,)`` or of numbers from 0."""

    @abstractmethod
    def compliance(self, drag: tuple[float, float] = (0.0, 0.0)) -> Compliance:
        """Displacement of each towards the skin under forces of the shape.

        Parameters
        ----------
        drag
            Force along x and z that comes with 1 N into the skin.
        """

    def spread_on_pad(
        self, forces_n: FloatArray | SingleArray
    ) -> tuple["SkinNodes", FloatArray | SingleArray]:
        """Nodes whose stress the pad knows, and forces ``(S, node)`` on them that stand for others.

        Parameters
        ----------
        forces_n
            Forces on these nodes in N, ``(S, n)``.
        """
        return self, forces_n

    def own_influence_pa(
        self, layer: NDArray[np.str_], x_mm: FloatArray, z_mm: FloatArray, depth_mm: FloatArray
    ) -> SingleArray | None:
        """Stress ``(6, place, node)`` in Pa that only these nodes know; None: the pad knows it.

        Parameters
        ----------
        layer
            Layer of each place, ``(P,)``.
        x_mm, z_mm, depth_mm
            Position of each place on the skin, and depth below it, in mm, ``(P,)``.
        """
        return None

    @abstractmethod
    def cells(self) -> SkinCells:
        """Cells of the skin around these nodes, for a picture."""

    @abstractmethod
    def to_arrays(self) -> dict[str, IntArray]:
        """Numbers of the nodes by name, for a file; `Pad.nodes_from` takes them."""

    def gaps_mm(self, shape: Shape) -> FloatArray:
        """Way of `shape` to each node in mm before it moves, ``(n,)``; the least touches first."""
        gap: FloatArray = shape.height_mm(*self.seen_mm) - self.height_mm
        return gap


class Pad(ABC):
    """Responses of the skin of a model to unit forces on it, for `touch`.

    `make_pad` computes one, of a finger or of any mesh; `read` and `write` are its file.

    Examples
    --------
    >>> import fembridge as fb
    >>> result = fb.touch("sphere", press_um=100, population="one_each", pad="reference")
    >>> bool(result.force_n.max() > 0.01)
    True
    """

    spacing_mm: float
    """Distance of two nodes that may touch in mm."""
    origin: Mapping[str, Any]
    """How the pad was computed."""
    source: str
    """Name or path of its file; empty without a file."""
    sha256: str
    """Checksum of its file; empty without a file."""

    uniform_along: ClassVar[bool] = False
    """Whether a response depends on the distance along z alone."""

    @property
    def steps_per_node(self) -> float:
        """Contacts that are solved while a slide moves by one node, at least."""
        return 8

    @property
    def averaged_mm(self) -> float:
        """Way of a slide over which forces are averaged in mm: that from node to node."""
        return self.spacing_mm

    @property
    def plane(self) -> bool:
        """Whether shapes are endless along z and forces are by mm."""
        return False

    @classmethod
    def read(cls, path: "str | os.PathLike[str]") -> "Pad":
        """The pad of a file that `write` or ``fembridge pad`` wrote.

        Parameters
        ----------
        path
            File in ``.npz``.

        Raises
        ------
        ResponseError
            An absent, altered or cut file, or numbers that no pad has.
        """
        from fembridge.touching.pad_file import read_pad

        return read_pad(Path(path))

    @abstractmethod
    def write(self, path: "str | os.PathLike[str]") -> None:
        """Write the pad with its checksum.

        Parameters
        ----------
        path
            File in ``.npz``.

        Raises
        ------
        OutputError
            The file cannot be written.
        """

    def seen_from(self, tilt_deg: tuple[float, float], at_mm: tuple[float, float]) -> "Pad":
        """The pad for a shape from another direction; its middle aims at a point of the skin.

        Parameters
        ----------
        tilt_deg
            Directions from which the shape comes, in deg from above: positive from the right, and
            from the tip.
        at_mm
            Position on the map in mm at which the middle of the shape aims.

        Raises
        ------
        UsageError
            The pad is a prism, whose forces come from above.
        """
        del at_mm
        raise UsageError(
            "is for a pad of your own model: forces on a prism come from above",
            argument="tilt_deg",
            found=tilt_deg,
        )

    @property
    def pose(self) -> dict[str, list[float]]:
        """`tilt_deg` and `at_mm` of `seen_from` for a record; empty from above."""
        return {}

    @property
    def from_above(self) -> "Pad":
        """The pad for shapes from above."""
        return self

    # ---- The skin

    @property
    @abstractmethod
    def skin_text(self) -> str:
        """Number and distance of the nodes that may touch, for a message."""

    @property
    def remedy_for_narrow(self) -> str:
        """A pad for narrower shapes, for a message."""
        return "a pad with a finer spacing (fembridge pad --spacing-mm)"

    @property
    @abstractmethod
    def reach_mm(self) -> float:
        """How far from the middle, across the finger, skin may be touched."""

    @property
    @abstractmethod
    def half_length_mm(self) -> float:
        """How far from the middle, along the finger, skin may be touched."""

    @property
    @abstractmethod
    def limits(self) -> str:
        """The ends of the skin that may be touched, for a message."""

    @abstractmethod
    def skin_nodes(self) -> SkinNodes:
        """All nodes that a shape may touch."""

    @abstractmethod
    def nodes_from(self, arrays: Mapping[str, IntArray]) -> SkinNodes:
        """Nodes of the numbers of `SkinNodes.to_arrays`.

        Parameters
        ----------
        arrays
            Numbers by name, ``(n,)`` each.

        Raises
        ------
        KeyError
            An array is missing.
        ValueError
            A number that is no node of the pad.
        """

    @abstractmethod
    def end_nodes(self, nodes: SkinNodes) -> Mapping[str, BoolArray]:
        """Those of `nodes` at each end of the skin that may be touched, ``(n,)``, by its name.

        Parameters
        ----------
        nodes
            Nodes of the pad.
        """

    @abstractmethod
    def first_touch_mm(self, shape: Shape) -> float:
        """How far a shape is over the skin where it touches first, also between nodes, in mm.

        Parameters
        ----------
        shape
            Shape at its position.

        Raises
        ------
        UsageError
            The shape is nowhere over the part of the pad that may be touched.
        """

    outline_ends: ClassVar[bool] = True
    """Whether the finger ends where its outline does; the outline of a prism goes on."""

    @abstractmethod
    def outline(self) -> FloatArray:
        """Outline of the finger on the map: x, z of both ends of each piece, ``(L, 4)`` in mm."""

    # ---- Afferents

    @property
    @abstractmethod
    def afferents(self) -> Mapping[str, Any]:
        """Sites of the afferents by class; their type is `Site`."""

    @property
    @abstractmethod
    def mechanics(self) -> dict[str, str]:
        """Name and digest of the model, which a parameter set is compared with."""

    @property
    @abstractmethod
    def model_table(self) -> dict[str, Any]:
        """The model in TOML types, for the record of a response."""

    @abstractmethod
    def extent_mm(self) -> tuple[FloatArray, FloatArray, float, float]:
        """Skin for a population: arcs across, their x ``(A,)``, half the width and length."""

    @abstractmethod
    def margins(self, x_mm: FloatArray, z_mm: FloatArray) -> Iterator[SkinMargin]:
        """Positions at which the pad has no skin or no stress, and why.

        Parameters
        ----------
        x_mm, z_mm
            Positions across and along the finger in mm, ``(P,)``.
        """

    def far_margin(self, x_mm: FloatArray, z_mm: FloatArray) -> SkinMargin | None:
        """Positions that a force in the middle of the pad does not reach, and why.

        Parameters
        ----------
        x_mm, z_mm
            Positions across and along the finger in mm, ``(P,)``.
        """
        return None

    @abstractmethod
    def clipped(self, x_mm: FloatArray, z_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The nearest positions with skin and stress, ``(P,)`` each.

        Parameters
        ----------
        x_mm, z_mm
            Positions across and along the finger in mm, ``(P,)``.
        """

    @abstractmethod
    def depth_range_mm(
        self, layer: str, x_mm: FloatArray, z_mm: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Least and largest depth in mm with stress in a layer, ``(P,)`` each.

        Parameters
        ----------
        layer
            Layer of the model.
        x_mm, z_mm
            Positions across and along the finger in mm, ``(P,)``.

        Raises
        ------
        UsageError
            The pad holds no stress in this layer.
        """

    @abstractmethod
    def normal_at(self, x_mm: FloatArray, z_mm: FloatArray) -> FloatArray:
        """Outward normal of the skin, ``(P, 3)``.

        Parameters
        ----------
        x_mm, z_mm
            Positions across and along the finger in mm, ``(P,)``.
        """

    @abstractmethod
    def columns_per_place(self, nodes: SkinNodes) -> int:
        """Numbers of `influence_pa` for each place and component, also those on the way.

        Parameters
        ----------
        nodes
            Nodes with a force.
        """

    @abstractmethod
    def influence_pa(
        self,
        nodes: SkinNodes,
        layer: NDArray[np.str_],
        x_mm: FloatArray,
        z_mm: FloatArray,
        depth_mm: FloatArray,
        drag: tuple[float, float] = (0.0, 0.0),
    ) -> SingleArray:
        """Stress ``(6, place, node)`` in Pa under 1 N of the shape on each of `nodes`.

        Parameters
        ----------
        nodes
            Nodes with a force.
        layer
            Layer of each place, ``(P,)``.
        x_mm, z_mm, depth_mm
            Position of each place on the skin, and depth below it, in mm, ``(P,)``.
        drag
            Force along x and z that comes with 1 N into the skin. Default: ``(0, 0)``.

        Raises
        ------
        UsageError
            A place in a layer or at a depth of which the pad holds no stress.
        """
