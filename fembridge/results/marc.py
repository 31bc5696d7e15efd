"""Stress and fields at nodes from a post file of Marc: ``.t16``, ``.t19``.

Marc stores stress at integration points. Here it is extrapolated to the node, element by
element, and averaged over the elements of one layer. Von Mises stress is that of the resulting
tensor (as in CalculiX), or with ``von_mises="scalar"`` the extrapolated von Mises stress of the
points, which Mentat plots. The two differ.

Quantities have Marc's names: names in the file at nodes (Displacement, Reaction Force), names of
the post codes at elements (Stress, Equivalent Von Mises Stress). Case does not matter, and a
unique beginning suffices; an exact name precedes longer ones. Steps are Marc's sub-increments.

A tensor is requested by one code and stored as six consecutive codes, in the order 11 22 33 12 23
31, which is xx yy zz xy yz zx. Single components (codes 11 to 16) are the same tensor if all six
are stored.

Marc has no units. Lengths are taken as mm, times as s, and stress in `ReadOptions.stress_unit`;
results are in mm, ms and Pa.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fembridge.errors import ResultError, UsageError
from fembridge.results.byte_file import ByteFile
from fembridge.results.extrapolation import UNKNOWN_LAYERS, MeshPoints
from fembridge.results.fields import Field, FieldBlock, Scene, rows_of
from fembridge.results.history import (
    FREQUENCY,
    STRESS,
    STRESS_FUNCTIONS,
    TIME,
    VON_MISES,
    printed_digit_ms,
)
from fembridge.results.marc_post import PostCode, PostFile, PostIncrement
from fembridge.results.read_options import ReadOptions
from fembridge.results.source import FieldSource, make_field, not_finite_error, quantity_names
from fembridge.results.status import read_sts
from fembridge.results.von_mises import TENSOR, OneSidedStress, von_mises_pa
from fembridge.trace import MS_PER_S
from fembridge.typing import BoolArray, FloatArray, IntArray, Table

_TEXT_DIGITS = 6  # of a time in a .t19

PA, AS_IS = "Pa", ""
_TENSORS = {
    301: ("Total Strain", "E"), 311: ("Stress", "S"), 321: ("Plastic Strain", "P"),
    331: ("Creep Strain", "C"), 341: ("Cauchy Stress", "S"),
    401: ("Elastic Strain", "E"), 411: ("Stress in Global System", "S"),
    431: ("Plastic Strain in Global System", "P"),
    # Mentat writes it for `*add_post_tensor log_strain`; a public reader wrongly calls it a
    # stress.
    681: ("Logarithmic Strain", "E"),
    1: ("Strain 1 to 6", "E"), 11: ("Stress 11 to 16", "S"),
    41: ("Cauchy Stress 41 to 46", "S"),
}  # fmt: skip
# Stress of traces: the first of these codes in the file. Cauchy stress, which CalculiX writes
# too, precedes "stress", which equals it only in updated Lagrange jobs.
STRESS_CODES = (341, 311, 41, 11, 411)
EQUIVALENT_CODES = (47, 17)
_SCALARS = {
    7: "Equivalent Plastic Strain", 9: "Temperature",
    17: "Equivalent Von Mises Stress", 18: "Mean Normal Stress",
    47: "Equivalent Cauchy Stress", 48: "Strain Energy Density",
    58: "Elastic Strain Energy Density", 127: "Equivalent Elastic Strain",
}  # fmt: skip
_PA_CODES = frozenset(
    {*range(11, 19), *range(41, 49), 58, *(base + k for base in STRESS_CODES for k in range(6))}
)
# By nodal post code.
_NODAL_UNITS = {
    1: "mm", 3: "N", 5: "N", 28: "mm/s", 30: "mm/s2",
    34: PA, 35: "N", 36: PA, 37: "N",
}  # fmt: skip
_AXES = {1: ("",), 2: ("X", "Y"), 3: ("X", "Y", "Z")}


# --- Quantities of post codes


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity at integration points, in `columns` of a point's values, or at nodes.

    `codes` are Marc's. `unit` is that of all components, "" if it is unknown and values are as in
    the file. `layer` is the layer of a shell, else 0. A quantity at nodes has no `columns`.
    `mises` marks the von Mises stress of a tensor at the points.
    """

    name: str
    components: tuple[str, ...]
    codes: tuple[int, ...]
    unit: str
    columns: tuple[int, ...] = ()
    layer: int = 0
    mises: bool = False

    def __str__(self) -> str:
        first, last = self.codes[0], self.codes[-1]
        codes = f"code {first}" if first == last else f"codes {first} to {last}"
        text = f"{self.name} ({codes})"
        return f"von Mises of {text} at the points" if self.mises else text


def element_quantities(codes: tuple[PostCode, ...]) -> tuple[Quantity, ...]:
    """Quantities of post codes, in the order of the file; each column is used once."""
    column_of = {(code.code, code.layer): k for k, code in enumerate(codes)}
    layered = len({code.layer for code in codes}) > 1
    used_columns: set[int] = set()
    quantities = []
    for column, code in enumerate(codes):
        if column in used_columns or column_of[code.code, code.layer] != column:
            continue
        keys = [(code.code + k, code.layer) for k in range(len(TENSOR))]
        if code.code in _TENSORS and all(key in column_of for key in keys):
            name, letter = _TENSORS[code.code]
            columns = tuple(column_of[key] for key in keys)
            components = tuple(f"{letter}{component.upper()}" for component in TENSOR)
            unit = PA if letter == "S" else AS_IS
        else:
            name = code.label.strip() or _SCALARS.get(code.code, f"Code {code.code}")
            columns, components = (column,), (_initials(name),)
            unit = PA if code.code in _PA_CODES else AS_IS
        used_columns.update(columns)
        name += f" layer {code.layer}" if layered else ""
        post_codes = tuple(codes[k].code for k in columns)
        quantities.append(Quantity(name, components, post_codes, unit, columns, code.layer))
    return tuple(quantities)


def _initials(name: str) -> str:
    parts = name.split()
    if any(part.isdigit() for part in parts):  # "Code 23": nothing to shorten
        return name.replace(" ", "_")
    return "".join(part[0] for part in parts).upper() or "V"


@dataclass(slots=True)
class MarcBlock(FieldBlock):
    """A quantity in one increment."""

    increment: PostIncrement
    quantity: Quantity

    @classmethod
    def from_increment(
        cls, increment: PostIncrement, quantity: Quantity, mises: bool = False
    ) -> "MarcBlock":
        """Block of a quantity in an increment; with `mises` the von Mises stress of its points."""
        position = (
            (FREQUENCY, increment.frequency) if increment.harmonic else (TIME, increment.time_s)
        )
        name, components = quantity.name, quantity.components
        if mises:
            name, components = VON_MISES, ("von_mises",)
        units = (quantity.unit,) * len(components)
        key = increment.sub_increment, increment.increment
        return cls(name, key, *position, components, units, increment, quantity)

    def __str__(self) -> str:
        return f"{self.name} of increment {self.increment.increment}"


Outputs = Sequence[dict[str, MarcBlock]]


class MarcSource(FieldSource[MarcBlock]):
    """An open post file.

    Its scene has a point for each node and layer, so that stress jumps between layers as in the
    model.
    """

    def __init__(self, file: ByteFile, options: ReadOptions) -> None:
        super().__init__(file, options)
        self._post = PostFile(file)
        self._noted: set[str] = set()

    @cached_property
    def _points(self) -> MeshPoints:
        return MeshPoints(self._post.mesh, self.path, self.options.method, self._post.points)

    @cached_property
    def _stored(self) -> tuple[Quantity, ...]:
        """Quantities at integration points."""
        return element_quantities(self._post.codes)

    def _stress_tensor(self) -> Quantity:
        """Stress tensor of the traces."""
        for code in STRESS_CODES:
            matches = [
                quantity
                for quantity in self._stored
                if quantity.codes[0] == code and len(quantity.columns) == 6
            ]
            if len(matches) > 1:
                layers = ", ".join(str(quantity.layer) for quantity in matches)
                message = (
                    f"code {code} is stored for layers {layers}: a shell has no one stress at a"
                )
                raise ResultError(f"{message} node", self.path)
            if matches:
                return matches[0]
        message = ", ".join(map(str, self._stored)) or "no element values"
        if any(code.code in EQUIVALENT_CODES for code in self._post.codes):
            message += "; --von-mises scalar (von_mises='scalar') reads the stored scalar"
        message = f"no stress tensor (post code 311 or 341); the file has {message}"
        raise ResultError(message, self.path)

    def _mises_of_points(self) -> Quantity:
        """Von Mises stress that Marc stored at the points, else that of the tensor there."""
        for code in EQUIVALENT_CODES:
            matches = [quantity for quantity in self._stored if quantity.codes == (code,)]
            if len(matches) == 1:
                return matches[0]
        return replace(self._stress_tensor(), mises=True)

    def describe(self) -> Table:
        """Header, mesh, sets, quantities and defects, as of a ``.frd``."""
        post, mesh = self._post, self._post.mesh
        types, counts = np.unique(mesh.element_types, return_counts=True)
        header: Table = {"title": post.title, "post revision": post.revision}
        if post.kind == "t16":
            header["byte order"] = post.byte_order
        header |= {"precision": post.precision, "points stored an element": post.points}
        blocks: dict[str, list[MarcBlock]] = {}
        for output in self._quantities_by_increment():
            for name, block in output.items():
                blocks.setdefault(name, []).append(block)
        storage = "text" if post.kind == "t19" else post.precision
        return super().describe() | {
            "mesh_nodes": int(mesh.node_ids.size),
            "elements": int(counts.sum()),
            "materials": {},
            "header": header,
            "element_types": dict(zip(map(str, types.tolist()), counts.tolist(), strict=True)),
            "codes": [code.code for code in post.codes],
            "sets": [
                {
                    "name": post_set.name,
                    "kind": post_set.kind,
                    "members": int(post_set.members.size),
                }
                for post_set in mesh.sets
            ],
            "increments": len(post.increments),
            "meshes": 1,
            "quantities": [
                self.quantity_table(name, blocks_of_name, mesh.node_ids, storage)
                | {"at": "integration points" if blocks_of_name[0].quantity.columns else "nodes"}
                for name, blocks_of_name in blocks.items()
            ],
            "remarks": post.remarks,
            "problem": post.problem,
        }

    def _quantities_by_increment(self) -> list[dict[str, MarcBlock]]:
        """Quantities of each increment by name, without complex ones."""
        outputs = []
        for increment in self._post.increments:
            output = dict[str, MarcBlock]()
            for nodal in (candidate for candidate in increment.nodal if not candidate.is_complex):
                numbered = tuple(str(k + 1) for k in range(nodal.components))
                axes, letters = _AXES.get(nodal.components, numbered), _initials(nodal.name)
                components, unit = (
                    tuple(letters + a for a in axes),
                    _NODAL_UNITS.get(nodal.code, AS_IS),
                )
                quantity = Quantity(nodal.name, components, (nodal.code,), unit)
                output[nodal.name] = MarcBlock.from_increment(increment, quantity)
            for quantity in self._stored if increment.has_element_values else ():
                output.setdefault(quantity.name, MarcBlock.from_increment(increment, quantity))
            outputs.append(output)
        return outputs

    def outputs(self) -> list[dict[str, MarcBlock]]:
        """Quantities of each increment; with `von_mises` "scalar" also that of the points.

        Remarks about the file are noted. A complete file may be from a job that failed: the
        problem in its ``.sts`` is noted, too. All increments in the file have converged.
        """
        post, options = self._post, self.options
        sts_path = self.path.with_suffix(".sts")
        status = None
        with suppress(ResultError):  # the .sts is optional
            status = read_sts(sts_path).problem if sts_path.is_file() else None
        for remark in (*post.remarks, f"{sts_path.name}: {status}" if status else ""):
            if remark:
                options.note(remark)
        if post.problem is not None:
            options.refuse(post.problem, self.path)
        outputs = self._quantities_by_increment()
        if options.von_mises == "scalar":
            for output, increment in zip(outputs, post.increments, strict=True):
                if increment.has_element_values:
                    output[VON_MISES] = MarcBlock.from_increment(
                        increment, self._mises_of_points(), mises=True
                    )
        return [output for output in outputs if output]

    def select_outputs(self, outputs: Outputs, names: Sequence[str]) -> list[dict[str, MarcBlock]]:
        """Outputs that have any of `names`, reduced to these; others are noted."""
        for name in names:
            without = [
                str(next(iter(output.values())).increment.increment)
                for output in outputs
                if name not in output
            ]
            if without:
                shown = ", ".join(without[:5]) + (", ..." if len(without) > 5 else "")
                self._note_once(f"no {name} in increments {shown}")
        selected = [
            {name: block for name, block in output.items() if name in names} for output in outputs
        ]
        return [output for output in selected if output]

    def choose_name(self, available: Sequence[str], quantity: str | None) -> str:
        """Stress of the traces; without it the displacement, else the first quantity."""
        if VON_MISES in available and quantity in (None, VON_MISES):
            return VON_MISES
        name = ""
        if quantity in (None, STRESS, *STRESS_FUNCTIONS):
            try:
                name = self._stress_tensor().name
            except ResultError:
                if quantity is not None or self.options.von_mises is not None:
                    raise
            if name and name not in available and quantity is not None:
                raise ResultError(
                    "no element values: the deck's 'post' requests no element code (311 is the "
                    "stress tensor)",
                    self.path,
                )
        if name in available:
            return name
        if not available:
            raise ResultError("no values", self.path)
        return self.match_name(available, quantity)

    def node_values(self, blocks: Sequence[MarcBlock], nodes: Sequence[int]) -> FloatArray:
        """Values of one quantity, ``(T, node, component)``; element values inside one layer."""
        quantity, note = blocks[0].quantity, self.options.note
        if not quantity.columns:
            return np.array([self.read_field(block).values_at(nodes) for block in blocks])
        points = self._points_at(nodes)
        shared = [node for node in nodes if len(points.layer_names(node)) > 1]
        if shared and not self.options.across_materials:
            names = " and ".join(points.layer_names(shared[0]))
            raise ResultError(
                f"node {shared[0]} is between {names}, where a mean belongs to neither: take a "
                "node inside one layer, each side with --one-sided, or the mean with "
                "--across-materials (across_materials=True)",
                self.path,
            )
        node_values = []
        for block in blocks:
            rows, values = points.node_means(self._extrapolated(block, points))
            node_values.append(values[rows_of(np.array(nodes), points.mesh.node_ids[rows])])
        if (
            blocks[0].name == VON_MISES
            and (negative := np.argwhere(np.array(node_values) < 0)).size
        ):
            row, column, _ = negative[0]
            note(
                f"node {nodes[column]}: negative von Mises stress at {blocks[row].axis_value:g} "
                "ms, from the linear extrapolation of a steep field"
            )
        return np.array(node_values)

    def sides(self, node: int, set_name: str = "") -> tuple[OneSidedStress, ...]:
        """Stress at `node` in each layer."""
        if set_name:
            raise UsageError(
                f"is {set_name!r}, expected no name: a Marc post file has all elements",
                argument="one_sided",
            )
        outputs = self.outputs()
        name = self.choose_name(quantity_names(outputs), STRESS)
        blocks = [output[name] for output in self.select_outputs(outputs, (name,))]
        points = self._points_at([node])
        stress_pa = np.array([self._extrapolated(block, points) for block in blocks])
        for block, values in zip(blocks, stress_pa, strict=True):
            if not np.isfinite(values).all():
                raise not_finite_error(block, points.nodes, values, self.path)
        times_ms = np.array([block.axis_value for block in blocks])
        return tuple(
            OneSidedStress(
                node, layer, points.layers.names[layer], elements, times_ms, stress_pa[:, k]
            )
            for k, (layer, elements) in enumerate(points.sides())
        )

    def _points_at(self, nodes: Sequence[int]) -> MeshPoints:
        """Mesh points at `nodes`; a node without any raises a `ResultError`."""
        post = self._post
        points = MeshPoints(post.mesh, self.path, self.options.method, post.points, nodes)
        points.plan  # noqa: B018 - raises if an element type cannot be extrapolated
        for node in nodes:
            if not points.layer_names(node):
                raise points.no_elements_error(node)
        for remark in points.remarks():
            self.options.note(remark)
        return points

    def _extrapolated(self, block: MarcBlock, points: MeshPoints) -> FloatArray:
        """Element values extrapolated to the points of a mesh, ``(P, component)``."""
        quantity = block.quantity
        if quantity.unit == PA:
            self._note_once(f"stress: {quantity}, extrapolated to nodes: {self.options.method}")
        if not points.layers.is_known:
            self._note_once(UNKNOWN_LAYERS)
        stored = self._post.element_values(block.increment.row, points.element_rows)
        point_values = stored[:, :, quantity.columns]
        if quantity.mises:
            point_values = von_mises_pa(point_values)[:, :, None]
        return self._scaled(points.average(point_values), quantity)

    def _scaled(self, values: FloatArray, quantity: Quantity) -> FloatArray:
        with np.errstate(over="ignore"):  # an overflow is infinite
            scaled: FloatArray = values * self.options.scale(quantity.unit)
        return scaled

    def read_field(self, block: MarcBlock, known_nodes: IntArray | None = None) -> Field:
        """`block` at all nodes; element values only at nodes inside one layer.

        With `across_materials` a node between layers has the mean over all its elements.
        """
        points, ids = self._points, self._post.mesh.node_ids
        if not block.quantity.columns:
            left_out = points.pressure_nodes()
            rows = np.flatnonzero(~left_out)
            self._note_displaced(left_out)
            values = self._nodal(block)[rows]
        else:
            self._note_unknown()
            rows, values = points.node_means(self._extrapolated(block, points))
            if not self.options.across_materials:
                is_shared = np.isin(rows, points.rows[points.material_count > 1])
                if is_shared.any():
                    self._note_once(
                        f"left out: {is_shared.sum()} nodes on layer boundaries; "
                        "--across-materials (across_materials=True) takes the mean of the layers"
                    )
                rows, values = rows[~is_shared], values[~is_shared]
        return make_field(block, ids[rows], values, self.path)

    def _nodal(self, block: MarcBlock) -> FloatArray:
        return self._scaled(
            self._post.nodal_values(block.increment.row, block.name), block.quantity
        )

    def last_digit_ms(self, times_ms: FloatArray) -> FloatArray:
        """Last digit of times: single precision in a ``.t16``, six digits in a ``.t19``."""
        if self._post.kind == "t19":
            return printed_digit_ms(times_ms, _TEXT_DIGITS)
        if self._post.precision == "double":
            return np.zeros_like(times_ms)
        times_s = (np.abs(times_ms) / MS_PER_S).astype(np.float32)
        return np.spacing(times_s).astype(np.float64) * MS_PER_S

    def node_sets(self) -> dict[str, list[list[int]]]:
        """Node sets by name."""
        sets = self._post.mesh.sets
        return {
            post_set.name.strip(): [post_set.members.tolist()]
            for post_set in sets
            if post_set.kind == "node"
        }

    def node_positions(self) -> tuple[IntArray, FloatArray, BoolArray]:
        """Nodes ``(n,)``, coordinates ``(n, 3)`` in mm, whether each has elements ``(n,)``."""
        mesh, points = self._post.mesh, self._points
        if not mesh.node_ids.size:
            raise ResultError("no nodes, so no coordinates", self.path)
        is_kept = ~points.pressure_nodes()
        coordinates_mm = mesh.coordinates_mm[is_kept] * self.options.length_mm
        return mesh.node_ids[is_kept], coordinates_mm, points.has_values[is_kept]

    def scene(self, outputs: Outputs) -> tuple[Outputs, Scene]:
        """All `outputs`, and the mesh with a point for each node and layer."""
        outputs = self.select_outputs(outputs, quantity_names(outputs))
        self._note_unknown()
        scene = self._points.scene()
        return outputs, replace(scene, points_mm=scene.points_mm * self.options.length_mm)

    def field_on_scene(self, block: MarcBlock, scene: Scene) -> tuple[Field, IntArray]:
        """Field of `block` at the points."""
        points = self._points
        if block.quantity.columns:
            values = self._extrapolated(block, points)
        else:
            values = self._nodal(block)[points.rows]
        return make_field(block, points.nodes, values, self.path), np.arange(points.nodes.size)

    def _note_displaced(self, left_out: BoolArray) -> None:
        """Note nodes with coordinates that are not at a corner of an element."""
        mesh = self._post.mesh
        is_displaced = left_out & (mesh.coordinates_mm != 0.0).any(axis=1)
        if is_displaced.any():
            node = mesh.node_ids[is_displaced][0]
            self._note_once(
                f"left out: {is_displaced.sum()} nodes at no corner of an element, {node} the first"
            )

    def _note_unknown(self) -> None:
        if self._points.unknown_types:
            types = ", ".join(map(str, self._points.unknown_types))
            self._note_once(f"left out: elements of unknown type {types}")

    def _note_once(self, message: str) -> None:
        """Note a remark about all increments once."""
        if message not in self._noted:
            self.options.note(message)
        self._noted.add(message)
