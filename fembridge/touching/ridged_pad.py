"""The pad of a prism with contact on a finer grid, and fingerprint ridges on its skin.

Stress and the wide movements of the skin are those of the finite-element pad (`PrismPad`).
Contact is solved on nodes 0.06 to 0.125 mm apart, whose compliance has two parts
(`GridCompliance`)::

    C = K + W (C_pad - K_pad) W'

K is flat layered skin with the layers of the apex, in closed form, on the fine grid; K_pad the
same on the nodes of the pad; W interpolates from the nodes of the pad, cubically in both
directions. The difference is smooth: what elements of 0.25 mm cannot resolve is taken from the
closed form, the curve, the bone and the sides of the finger from the pad. Waves shorter than about
1 mm, in which a single loaded node of a mesh differs from an even pressure, are filtered from it.

Stress takes the forces spread on the nodes of the pad with the weights W: half a millimetre and
more below the skin a wave as long as a ridge has decayed to a thousandth.
"""

from dataclasses import dataclass, field, fields
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import UsageError
from fembridge.touching.compliance import Compliance, GridCompliance, interpolation_weights
from fembridge.touching.fingerprint import NONE, Fingerprint, resolve_fingerprint
from fembridge.touching.layered_skin import ElasticLayer, surface_kernel
from fembridge.touching.pad import Pad, SkinNodes
from fembridge.touching.prism_pad import LatticeNodes, PrismPad
from fembridge.typing import FloatArray, SingleArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

RIDGES = "loop"
"""Default fingerprint: the pattern of most fingers."""
# Waves that are kept of the difference: a half-band filter of seven nodes, 1 for long waves, a
# half at four nodes a wave, 0 at two.
_FILTER = np.array([-1, 0, 9, 16, 9, 0, -1]) / 32


@dataclass(frozen=True, eq=False, repr=False)
class RidgedPad(PrismPad):
    """A pad whose contact is solved on a finer grid with fingerprint ridges.

    `with_ridges` makes one of a `PrismPad`; the arrays of responses are those of `smooth_pad`.

    Parameters
    ----------
    smooth_pad
        Pad of the finite-element model.
    grid
        Grid of the nodes that may touch, with its compliance.
    fingerprint
        Ridges on the skin.
    """

    smooth_pad: PrismPad = field(kw_only=True)
    grid: "_Grid" = field(kw_only=True)
    fingerprint: Fingerprint = field(kw_only=True)

    @property
    def from_above(self) -> Pad:
        """The pad without ridges."""
        return self.smooth_pad

    @property
    def mechanics(self) -> dict[str, str]:
        """Name and digest of the finger, and sizes of the ridges."""
        return {**self.smooth_pad.mechanics, "ridges": self.fingerprint.sizes}

    @property
    def remedy_for_narrow(self) -> str:
        """Finer nodes, for a message."""
        return "a finer grid (--ridges loop:node_mm=0.0625)"

    @property
    def steps_per_node(self) -> float:
        """Contacts that are solved while a slide moves by one node, see `Pad`."""
        return 2

    @property
    def averaged_mm(self) -> float:
        """Nothing: ridges and nodes are resolved in time, see `PrismPad`."""
        return 0.0

    # ---- The skin

    def skin_height_mm(self, x_mm: FloatArray, z_mm: FloatArray) -> FloatArray:
        """The skin over its apex, <= 0, with its ridges; see `PrismPad`."""
        right = self.section.point_mm[: int(self.section.point_mm[:, 0].argmax()) + 1]
        outline = np.interp(np.abs(x_mm), right[:, 0], right[:, 1])
        arc_mm = np.sign(x_mm) * np.interp(
            np.abs(x_mm), right[:, 0], self.section.arc_mm[: len(right)]
        )
        height: FloatArray = outline - np.square(z_mm) / (2 * self.tip_radius_mm)
        return height - self.fingerprint.below_mm(arc_mm, z_mm)

    @cached_property
    def _node_height_mm(self) -> FloatArray:
        """Heights of all nodes ``(C, R)``, rows from the base to the tip."""
        z_mm = np.arange(-self.end_row, self.end_row + 1.0) * self.spacing_mm
        return self.skin_height_mm(self.x_mm[:, None], z_mm)

    def height_of_nodes_mm(self, nodes: LatticeNodes) -> FloatArray:
        """Heights of nodes in mm, ``(n,)``, see `PrismPad`."""
        return self._node_height_mm[nodes.column, nodes.row + self.end_row]

    # ---- Compliance

    def compliance_of(self, nodes: LatticeNodes, drag: tuple[float, float]) -> Compliance:
        """How far each of `nodes` goes into the skin under 1 N on each, see `PrismPad`."""
        dragged, drag_table_mm = None, None
        grid = self.grid
        if any(drag):
            sideways, _, axial = self.smooth_pad.lattice_compliance
            dragged = (
                drag[0] * sideways + drag[1] * axial,
                drag[0] * sideways - drag[1] * axial,
            )
            drag_table_mm = grid.drag_table_mm(drag)
        return GridCompliance(
            grid.kernel_mm,
            grid.rest_mm,
            grid.table_mm,
            grid.across,
            grid.parts,
            nodes.column,
            nodes.row,
            dragged,
            drag_table_mm,
        )

    # ---- Stress

    def columns_per_place(self, nodes: SkinNodes) -> int:
        """Numbers of `influence_pa` for each place and component, see `Pad`."""
        return self.smooth_pad.columns_per_place(nodes)

    def influence_pa(
        self,
        nodes: SkinNodes,
        layer: NDArray[np.str_],
        x_mm: FloatArray,
        z_mm: FloatArray,
        depth_mm: FloatArray,
        drag: tuple[float, float] = (0.0, 0.0),
    ) -> SingleArray:
        """Stress ``(6, place, node)`` in Pa under unit forces on nodes of the pad, see `Pad`."""
        return self.smooth_pad.influence_pa(nodes, layer, x_mm, z_mm, depth_mm, drag)

    def spread_on_pad(
        self, nodes: LatticeNodes, forces_n: FloatArray | SingleArray
    ) -> tuple[LatticeNodes, FloatArray | SingleArray]:
        """Nodes of the pad, and forces ``(S, node)`` on them that stand for those on `nodes`."""
        weights, on_pad = self.weights_on_pad(nodes)
        spread = np.ascontiguousarray((weights.T @ forces_n.T).T)
        return on_pad, spread

    def weights_on_pad(self, nodes: LatticeNodes) -> "tuple[csr_array, LatticeNodes]":
        """W of some nodes ``(n, node of the pad)``, and those nodes of the pad."""
        from scipy.sparse import csr_array

        pad, grid = self.smooth_pad, self.grid
        rows = 2 * pad.end_row + 1
        along = interpolation_weights(np.arange(2 * self.end_row + 1) / grid.parts, rows)
        across, along = grid.across[nodes.column], along[nodes.row + self.end_row]
        node, near = np.nonzero(across)
        at_row, near_row = np.nonzero(along)
        in_row = csr_array((along[at_row, near_row], (at_row, near_row)), shape=along.shape)
        # All pairs of a column and a row near each node.
        count = np.diff(in_row.indptr)[node]
        pair = np.repeat(np.arange(node.size), count)
        start = in_row.indptr[node[pair]]
        entry = start + np.arange(pair.size) - np.repeat(np.cumsum(count) - count, count)
        column, row = near[pair], in_row.indices[entry]
        weight = across[node[pair], column] * in_row.data[entry]
        number, used = np.unique(column * rows + row, return_inverse=True)
        weights = csr_array(
            (weight.astype(np.float32), (node[pair], used)), shape=(nodes.size, number.size)
        )
        return weights, LatticeNodes(pad, number // rows, number % rows - pad.end_row)


def with_ridges(pad: Pad, ridges: str | Fingerprint | None) -> Pad:
    """`pad` with fingerprint ridges; None: `RIDGES` where the pad is of a smooth finger.

    What a touch needs besides forces is computed once for a pad and a distance of nodes, and kept.

    Raises
    ------
    UsageError
        No such pattern, or ridges on a pad of a mesh, of the section alone or with own ridges.
    """
    if isinstance(pad, RidgedPad):
        if ridges is None:
            return pad
        pad = pad.smooth_pad
    if ridges is None:
        is_smooth = isinstance(pad, PrismPad) and not (pad.plane or pad.finger.ridges.height_mm)
        ridges = RIDGES if is_smooth else NONE
    fingerprint = resolve_fingerprint(ridges)
    if fingerprint is None:
        return pad
    if not isinstance(pad, PrismPad):
        raise UsageError("is for the pad of a finger, not of a mesh", argument="ridges")
    if pad.plane:
        raise UsageError("is for a whole fingertip, not for a plane pad", argument="ridges")
    if pad.finger.ridges.height_mm > 0:
        raise UsageError("is for smooth skin: this pad has ridges of its own", argument="ridges")
    return _ridged(pad, fingerprint)


@lru_cache(maxsize=8)
def _ridged(pad: PrismPad, fingerprint: Fingerprint) -> "RidgedPad":
    grid = _grid(pad, max(round(pad.spacing_mm / fingerprint.node_mm), 1))
    section = pad.section
    x_mm, y_mm = (np.interp(np.abs(grid.arc_mm), section.arc_mm, at) for at in section.point_mm.T)
    values = {item.name: getattr(pad, item.name) for item in fields(PrismPad)}
    values |= {
        "spacing_mm": pad.spacing_mm / grid.parts,
        "x_mm": np.sign(grid.arc_mm) * x_mm,
        "y_mm": y_mm,
    }
    return RidgedPad(**values, smooth_pad=pad, grid=grid, fingerprint=fingerprint)


@dataclass(frozen=True, eq=False)
class _Grid:
    """A grid with `parts` nodes for each of `pad`, and what its compliance is made of."""

    pad: PrismPad
    parts: int

    @cached_property
    def arc_mm(self) -> FloatArray:
        """Positions of the columns along the skin from the apex in mm, ``(C,)``."""
        columns = (self.pad.x_mm.size - 1) * self.parts + 1
        step_mm = self.pad.spacing_mm / self.parts
        return np.asarray((np.arange(columns) - columns // 2) * step_mm, dtype=np.float64)

    @cached_property
    def layers(self) -> tuple[ElasticLayer, ...]:
        """Layers at the apex, down to the bone."""
        finger = self.pad.finger
        skin, materials = finger.skin, finger.materials
        bone_mm = finger.bone.depth_mm - finger.bone.half_height_mm
        thickness_mm = {
            "stratum_corneum": skin.stratum_corneum_mm,
            "epidermis": skin.epidermis_mm,
            "dermis": skin.dermis_mm,
        }
        thickness_mm["subcutaneous_tissue"] = bone_mm - sum(thickness_mm.values())
        return tuple(
            ElasticLayer(depth_mm, materials[name].young_mpa, materials[name].poisson)
            for name, depth_mm in thickness_mm.items()
        )

    @cached_property
    def across(self) -> FloatArray:
        """W across the finger: ``(column of the grid, column of the pad)``."""
        return interpolation_weights(np.arange(self.arc_mm.size) / self.parts, self.pad.x_mm.size)

    @cached_property
    def kernel_mm(self) -> FloatArray:
        """K by the number of columns and rows between two nodes, ``(C, R)``, in mm/N."""
        rows = 2 * self.parts * self.pad.end_row + 1
        spacing_mm = self.pad.spacing_mm / self.parts
        return surface_kernel(self.layers, spacing_mm, (self.arc_mm.size, rows))

    @cached_property
    def rest_mm(self) -> FloatArray:
        """What the pad has besides K, filtered, by its nodes: ``(force, node, apart)`` in mm/N."""
        table = self.pad.lattice_compliance[1]
        columns, _, rows = table.shape
        flat = surface_kernel(self.layers, self.pad.spacing_mm, (columns, rows), band_limited=True)
        column = np.arange(columns)
        return _long_waves(table - flat[np.abs(column[:, None] - column)])

    @cached_property
    def table_mm(self) -> SingleArray:
        """C by columns of force and node and the rows between, ``(C, C, R)``, single precision."""
        column = np.arange(self.arc_mm.size)
        near = self.kernel_mm[np.abs(column[:, None] - column)]
        table: SingleArray = (near + self._on_grid(self.rest_mm, 1)).astype(np.float32)
        return table

    @cached_property
    def _drag_tables_mm(self) -> SingleArray:
        """Displacement under 1 N along x and along z, ``(2, force, node, rows apart)``."""
        sideways, _, axial = self.pad.lattice_compliance
        tables = [self._on_grid(sideways, 1), self._on_grid(axial, -1)]
        return np.stack(tables).astype(np.float32)

    def drag_table_mm(self, drag: tuple[float, float]) -> SingleArray:
        """Displacement by friction, of nodes ahead of a force and behind it, see `GridCompliance`.

        `drag` is the force along x and z that comes with 1 N into the skin.
        """
        sideways, axial = (
            np.float32(share) * table
            for share, table in zip(drag, self._drag_tables_mm, strict=True)
        )
        return np.stack([sideways + axial, sideways - axial])

    def _on_grid(self, table: FloatArray, flip: int) -> FloatArray:
        """A table ``(force, node, apart)`` of the pad's nodes, for those of the grid.

        Behind a force it is `flip` times that ahead.
        """
        fine = np.einsum("cf,fnj,dn->cdj", self.across, table, self.across, optimize=True)
        around = np.concatenate([flip * fine[..., 1:2], fine], axis=-1)
        rows = np.arange(2 * self.parts * self.pad.end_row + 1)
        along = interpolation_weights(1 + rows / self.parts, around.shape[-1])
        return np.asarray(around @ along.T)


_grid = lru_cache(maxsize=4)(_Grid)


def _long_waves(table: FloatArray) -> FloatArray:
    """A table ``(force, node, apart)``, filtered on both nodes across and along the finger."""
    columns, _, rows = table.shape
    reach = _FILTER.size // 2
    across = np.zeros((columns, columns))
    for column in range(columns):
        for offset, weight in zip(range(-reach, reach + 1), _FILTER, strict=True):
            near = abs(column + offset)  # at the sides the skin is taken to be a mirror image
            near = 2 * (columns - 1) - near if near >= columns else near
            across[column, near] += weight
    filtered = np.einsum("af,fnj,bn->abj", across, table, across, optimize=True)
    twice = np.convolve(_FILTER, _FILTER)
    reach = twice.size // 2
    around = np.concatenate(
        [filtered[..., reach:0:-1], filtered, filtered[..., -2 : -reach - 2 : -1]], axis=-1
    )
    return np.asarray(
        sum(weight * around[..., n : n + rows] for n, weight in enumerate(twice.tolist()))
    )
