"""Stress and whole fields at nodes, from a post file of Marc: ``.t16``, ``.t19``.

Marc stores stress at integration points. Here it is extrapolated to the node, element by
element, and averaged over the elements of one layer; von Mises stress is that of the
resulting tensor (as CalculiX's is), or with ``von_mises="scalar"`` the points' own von Mises
stress, extrapolated as a number, which is what Mentat plots. They differ.

Quantities go by Marc's names: those of the file at nodes (Displacement, Reaction Force),
those of the post codes at elements (Stress, Equivalent Von Mises Stress). A name is taken
case-blind, and as short as it is one quantity's alone; the whole name goes before longer
ones. Steps are Marc's sub-increments.

A tensor is requested by one code and stored as six consecutive ones, in the order 11 22 33
12 23 31, which is our xx yy zz xy yz zx: no column moves. Single components (codes 11 to
16) make the same tensor where all six are there.

Marc has no units. Lengths are taken as mm, times as s, and stress in
`ReadOptions.stress_unit`; what comes out is mm, ms and Pa.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fembridge.errors import ResultError, UsageError
from fembridge.results.byte_file import ByteFile
from fembridge.results.extrapolation import UNKNOWN_LAYERS, MeshPoints
from fembridge.results.fields import Block, Field, Scene, rows_of
from fembridge.results.history import (
    FREQUENCY,
    OF_STRESS,
    STRESS,
    TIME,
    VON_MISES,
    printed_digit_ms,
)
from fembridge.results.marc_post import PostCode, PostFile, PostIncrement
from fembridge.results.read_options import ReadOptions
from fembridge.results.source import FieldSource, field_of, names_in, not_finite
from fembridge.results.status import read_sts
from fembridge.results.stress import TENSOR, OneSidedStress, von_mises_pa
from fembridge.trace import MS_PER_S
from fembridge.typing import BoolArray, FloatArray, IntArray, Table

_TEXT_DIGITS = 6  # of a time in a .t19

PA, AS_IS = "Pa", ""
_TENSORS = {
    301: ("Total Strain", "E"), 311: ("Stress", "S"), 321: ("Plastic Strain", "P"),
    331: ("Creep Strain", "C"), 341: ("Cauchy Stress", "S"),
    401: ("Elastic Strain", "E"), 411: ("Stress in Global System", "S"),
    431: ("Plastic Strain in Global System", "P"),
    # Mentat wrote it for `*add_post_tensor log_strain`; a public reader calls it a
    # stress, and is wrong.
    681: ("Logarithmic Strain", "E"),
    1: ("Strain 1 to 6", "E"), 11: ("Stress 11 to 16", "S"),
    41: ("Cauchy Stress 41 to 46", "S"),
}  # fmt: skip
# The stress that traces are made of: the first of these that the file has. Cauchy stress,
# which CalculiX gives too, comes before "stress", which is that only where the job follows
# the deformation (updated Lagrange).
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


# --- What post codes amount to


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity at integration points: which `columns` of a point's values it is; or at nodes.

    `codes` are Marc's; `unit` holds for all components, "" where it is not known and the
    value is left as the file has it. `layer` is that of a shell, 0 elsewhere. At nodes there
    are no `columns`. With `mises` it is the von Mises stress of a tensor at the points.
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
        words = f"{self.name} ({codes})"
        return f"von Mises of {words} at the points" if self.mises else words


def element_quantities(codes: tuple[PostCode, ...]) -> tuple[Quantity, ...]:
    """What `codes` amount to, in the order of the file; no column twice."""
    column_of = {(code.code, code.layer): k for k, code in enumerate(codes)}
    layered = len({code.layer for code in codes}) > 1
    taken: set[int] = set()
    found = []
    for column, code in enumerate(codes):
        if column in taken or column_of[code.code, code.layer] != column:
            continue
        wanted = [(code.code + k, code.layer) for k in range(len(TENSOR))]
        if code.code in _TENSORS and all(key in column_of for key in wanted):
            name, letter = _TENSORS[code.code]
            columns = tuple(column_of[key] for key in wanted)
            components = tuple(f"{letter}{place.upper()}" for place in TENSOR)
            unit = PA if letter == "S" else AS_IS
        else:
            name = code.label.strip() or _SCALARS.get(code.code, f"Code {code.code}")
            columns, components = (column,), (_initials(name),)
            unit = PA if code.code in _PA_CODES else AS_IS
        taken.update(columns)
        name += f" layer {code.layer}" if layered else ""
        held = tuple(codes[k].code for k in columns)
        found.append(Quantity(name, components, held, unit, columns, code.layer))
    return tuple(found)


def _initials(name: str) -> str:
    words = name.split()
    if any(word.isdigit() for word in words):  # "Code 23": nothing to shorten
        return name.replace(" ", "_")
    return "".join(word[0] for word in words).upper() or "V"


@dataclass(slots=True)
class MarcBlock(Block):
    """A quantity in one increment."""

    one: PostIncrement
    quantity: Quantity

    @classmethod
    def of(cls, one: PostIncrement, quantity: Quantity, mises: bool = False) -> "MarcBlock":
        """That quantity of that increment; or as the von Mises stress of its points."""
        over = (FREQUENCY, one.frequency) if one.harmonic else (TIME, one.time_s)
        name, components = quantity.name, quantity.components
        if mises:
            name, components = VON_MISES, ("von_mises",)
        units = (quantity.unit,) * len(components)
        key = one.sub_increment, one.increment
        return cls(name, key, *over, components, units, one, quantity)

    def __str__(self) -> str:
        return f"{self.name} of increment {self.one.increment}"


Outputs = Sequence[dict[str, MarcBlock]]


class MarcSource(FieldSource[MarcBlock]):
    """An open post file.

    A point of its scene is a node as one layer has it: between layers stress jumps, as it does
    in the model.
    """

    def __init__(self, file: ByteFile, options: ReadOptions) -> None:
        super().__init__(file, options)
        self._post = PostFile(file)
        self._said: set[str] = set()

    @cached_property
    def _points(self) -> MeshPoints:
        return MeshPoints(self._post.mesh, self.path, self.options.method, self._post.points)

    @cached_property
    def _stored(self) -> tuple[Quantity, ...]:
        """The quantities at integration points."""
        return element_quantities(self._post.codes)

    def _stress_tensor(self) -> Quantity:
        """The stress tensor that traces are made of."""
        for code in STRESS_CODES:
            same = [one for one in self._stored if one.codes[0] == code and len(one.columns) == 6]
            if len(same) > 1:
                layers = ", ".join(str(one.layer) for one in same)
                words = f"code {code} is stored for layers {layers}: a shell has no one stress at a"
                raise ResultError(f"{words} node", self.path)
            if same:
                return same[0]
        words = ", ".join(map(str, self._stored)) or "no element values"
        if any(code.code in EQUIVALENT_CODES for code in self._post.codes):
            words += "; --von-mises scalar (von_mises='scalar') takes the one it holds"
        words = f"no stress tensor (post code 311 or 341) in it, it holds {words}"
        raise ResultError(words, self.path)

    def _mises_of_points(self) -> Quantity:
        """The von Mises stress that Marc stored at the points, else that of the tensor there."""
        for code in EQUIVALENT_CODES:
            same = [one for one in self._stored if one.codes == (code,)]
            if len(same) == 1:
                return same[0]
        return replace(self._stress_tensor(), mises=True)

    def describe(self) -> Table:
        """Header, mesh, sets, quantities, what is wrong; as of a ``.frd``."""
        post, mesh = self._post, self._post.mesh
        types, counts = np.unique(mesh.element_types, return_counts=True)
        header: Table = {"title": post.title, "post revision": post.revision}
        if post.kind == "t16":
            header["byte order"] = post.byte_order
        header |= {"precision": post.precision, "points stored an element": post.points}
        blocks: dict[str, list[MarcBlock]] = {}
        for output in self._listed():
            for name, one in output.items():
                blocks.setdefault(name, []).append(one)
        storage = "text" if post.kind == "t19" else post.precision
        return super().describe() | {
            "mesh_nodes": int(mesh.node_ids.size),
            "elements": int(counts.sum()),
            "materials": {},
            "header": header,
            "element_types": dict(zip(map(str, types.tolist()), counts.tolist(), strict=True)),
            "codes": [code.code for code in post.codes],
            "sets": [
                {"name": one.name, "kind": one.kind, "members": int(one.members.size)}
                for one in mesh.sets
            ],
            "increments": len(post.increments),
            "meshes": 1,
            "quantities": [
                self.quantity_table(name, held, mesh.node_ids, storage)
                | {"at": "integration points" if held[0].quantity.columns else "nodes"}
                for name, held in blocks.items()
            ],
            "remarks": post.remarks,
            "problem": post.problem,
        }

    def _listed(self) -> list[dict[str, MarcBlock]]:
        """Quantities of each increment by name, ``DX`` of Displacement; not complex ones."""
        outputs = []
        for one in self._post.increments:
            found = dict[str, MarcBlock]()
            for held in (each for each in one.nodal if not each.is_complex):
                numbered = tuple(str(k + 1) for k in range(held.components))
                axes, letters = _AXES.get(held.components, numbered), _initials(held.name)
                parts, unit = tuple(letters + a for a in axes), _NODAL_UNITS.get(held.code, AS_IS)
                quantity = Quantity(held.name, parts, (held.code,), unit)
                found[held.name] = MarcBlock.of(one, quantity)
            for quantity in self._stored if one.has_element_values else ():
                found.setdefault(quantity.name, MarcBlock.of(one, quantity))
            outputs.append(found)
        return outputs

    def outputs(self) -> list[dict[str, MarcBlock]]:
        """The quantities of each increment, and with `von_mises` "scalar" that of the points.

        What the file remarks is passed on. A file that is whole may be of a job that gave up:
        what the ``.sts`` beside says of it is passed on too. The increments that are there were
        converged.
        """
        post, options = self._post, self.options
        beside = self.path.with_suffix(".sts")
        status = None
        with suppress(ResultError):  # it is not what was asked for
            status = read_sts(beside).problem if beside.is_file() else None
        for words in (*post.remarks, f"{beside.name}: {status}" if status else ""):
            if words:
                options.note(words)
        if post.problem is not None:
            options.refuse(post.problem, self.path)
        found = self._listed()
        if options.von_mises == "scalar":
            for output, one in zip(found, post.increments, strict=True):
                if one.has_element_values:
                    output[VON_MISES] = MarcBlock.of(one, self._mises_of_points(), mises=True)
        return [output for output in found if output]

    def having(self, outputs: Outputs, names: Sequence[str]) -> list[dict[str, MarcBlock]]:
        """Outputs that have any of `names`, and these alone; what others lack is said."""
        for name in names:
            without = [str(next(iter(o.values())).one.increment) for o in outputs if name not in o]
            if without:
                shown = ", ".join(without[:5]) + (", ..." if len(without) > 5 else "")
                self._once(f"no {name} in increments {shown}")
        found = [{name: one for name, one in out.items() if name in names} for out in outputs]
        return [output for output in found if output]

    def history_name(self, available: Sequence[str], quantity: str | None) -> str:
        """The stress of traces, without one the displacement, else the first."""
        if VON_MISES in available and quantity in (None, VON_MISES):
            return VON_MISES
        name = ""
        if quantity in (None, STRESS, *OF_STRESS):
            try:
                name = self._stress_tensor().name
            except ResultError:
                if quantity is not None or self.options.von_mises is not None:
                    raise
            if name and name not in available and quantity is not None:
                raise ResultError(
                    "no element values in it: the deck's 'post' asks for no element code (311 is "
                    "the stress tensor)",
                    self.path,
                )
        if name in available:
            return name
        if not available:
            raise ResultError("no values in it", self.path)
        return self.field_name(available, quantity)

    def at_nodes(self, blocks: Sequence[MarcBlock], nodes: Sequence[int]) -> FloatArray:
        """Values of one quantity, ``(T, node, component)``; those of points inside one layer."""
        quantity, note = blocks[0].quantity, self.options.note
        if not quantity.columns:
            return np.array([self.whole(one).at(nodes) for one in blocks])
        points = self._around(nodes)
        between = [node for node in nodes if len(points.names_at(node)) > 1]
        if between and not self.options.across_materials:
            names = " and ".join(points.names_at(between[0]))
            raise ResultError(
                f"node {between[0]} lies between {names}: a mean over both belongs to neither; "
                "take a node inside one layer, each side with --one-sided, or the mean with "
                "--across-materials (across_materials=True)",
                self.path,
            )
        found = []
        for one in blocks:
            rows, values = points.one_a_node(self._carried(one, points))
            found.append(values[rows_of(np.array(nodes), points.mesh.node_ids[rows])])
        if blocks[0].name == VON_MISES and (below := np.argwhere(np.array(found) < 0)).size:
            row, column, _ = below[0]
            note(
                f"node {nodes[column]}: von Mises stress is below 0 at {blocks[row].at:g} ms: "
                "linear extrapolation of a steep field does that"
            )
        return np.array(found)

    def sides(self, node: int, set_name: str = "") -> tuple[OneSidedStress, ...]:
        """The stress at `node` for each layer there on its own."""
        if set_name:
            raise UsageError("--one-sided of a Marc post file takes no name: it has all elements")
        outputs = self.outputs()
        name = self.history_name(names_in(outputs), STRESS)
        blocks = [output[name] for output in self.having(outputs, (name,))]
        points = self._around([node])
        found = np.array([self._carried(one, points) for one in blocks])
        for one, values in zip(blocks, found, strict=True):
            if not np.isfinite(values).all():
                raise not_finite(one, points.nodes, values, self.path)
        times_ms = np.array([one.at for one in blocks])
        return tuple(
            OneSidedStress(node, layer, points.layers.names[layer], elements, times_ms, found[:, k])
            for k, (layer, elements) in enumerate(points.sides())
        )

    def _around(self, nodes: Sequence[int]) -> MeshPoints:
        """Points at `nodes`, each of which has some."""
        post = self._post
        points = MeshPoints(post.mesh, self.path, self.options.method, post.points, nodes)
        points.plan  # noqa: B018 - what cannot be carried is refused first
        for node in nodes:
            if not points.names_at(node):
                raise points.no_elements(node)
        for remark in points.remarks():
            self.options.note(remark)
        return points

    def _carried(self, block: MarcBlock, points: MeshPoints) -> FloatArray:
        """Element values at the points of a mesh, ``(P, component)``."""
        quantity = block.quantity
        if quantity.unit == PA:
            self._once(f"stress: {quantity}, extrapolated to nodes: {self.options.method}")
        if not points.layers.known:
            self._once(UNKNOWN_LAYERS)
        stored = self._post.element_values(block.one.row, points.element_rows)
        chosen = stored[:, :, quantity.columns]
        if quantity.mises:
            chosen = von_mises_pa(chosen)[:, :, None]
        return self._scaled(points.averaged(chosen), quantity)

    def _scaled(self, values: FloatArray, quantity: Quantity) -> FloatArray:
        with np.errstate(over="ignore"):  # a number that overflows is not finite
            scaled: FloatArray = values * self.options.scale(quantity.unit)
        return scaled

    def whole(self, block: MarcBlock, known: IntArray | None = None) -> Field:
        """`block` at all nodes; of element values at those that lie in one layer.

        With `across_materials` those between layers have the mean over all elements there.
        """
        points, ids = self._points, self._post.mesh.node_ids
        if not block.quantity.columns:
            left_out = points.pressure_nodes()
            rows = np.flatnonzero(~left_out)
            self._note_displaced(left_out)
            values = self._nodal(block)[rows]
        else:
            self._note_unknown()
            rows, values = points.one_a_node(self._carried(block, points))
            if not self.options.across_materials:
                between = np.isin(rows, points.rows[points.met > 1])
                if between.any():
                    self._once(
                        f"left out: {between.sum()} nodes lie between layers, where a mean belongs "
                        "to none; --across-materials takes it"
                    )
                rows, values = rows[~between], values[~between]
        return field_of(block, ids[rows], values, self.path)

    def _nodal(self, block: MarcBlock) -> FloatArray:
        return self._scaled(self._post.nodal_values(block.one.row, block.name), block.quantity)

    def last_digit_ms(self, times_ms: FloatArray) -> FloatArray:
        """A ``.t16`` has times in single precision, a ``.t19`` with six digits."""
        if self._post.kind == "t19":
            return printed_digit_ms(times_ms, _TEXT_DIGITS)
        if self._post.precision == "double":
            return np.zeros_like(times_ms)
        times_s = (np.abs(times_ms) / MS_PER_S).astype(np.float32)
        return np.spacing(times_s).astype(np.float64) * MS_PER_S

    def node_sets(self) -> dict[str, list[list[int]]]:
        """Its sets of nodes by name."""
        sets = self._post.mesh.sets
        return {one.name.strip(): [one.members.tolist()] for one in sets if one.kind == "node"}

    def places(self) -> tuple[IntArray, FloatArray, BoolArray]:
        """Nodes, coordinates ``(n, 3)`` in mm, and which have elements."""
        mesh, points = self._post.mesh, self._points
        if not mesh.node_ids.size:
            raise ResultError("no nodes in it, so no coordinates", self.path)
        keep = ~points.pressure_nodes()
        at_mm = mesh.coordinates_mm[keep] * self.options.length_mm
        return mesh.node_ids[keep], at_mm, points.bearing[keep]

    def scene(self, outputs: Outputs) -> tuple[Outputs, Scene]:
        """All `outputs`, and the mesh, a point a node and layer."""
        outputs = self.having(outputs, names_in(outputs))
        self._note_unknown()
        scene = self._points.scene()
        return outputs, replace(scene, points_mm=scene.points_mm * self.options.length_mm)

    def on_scene(self, block: MarcBlock, scene: Scene) -> tuple[Field, IntArray]:
        """The field of `block` at the points."""
        points = self._points
        if block.quantity.columns:
            values = self._carried(block, points)
        else:
            values = self._nodal(block)[points.rows]
        return field_of(block, points.nodes, values, self.path), np.arange(points.nodes.size)

    def _note_displaced(self, left_out: BoolArray) -> None:
        """Note nodes that no corner of an element is and that have coordinates nevertheless."""
        mesh = self._post.mesh
        odd = left_out & (mesh.coordinates_mm != 0.0).any(axis=1)
        if odd.any():
            node = mesh.node_ids[odd][0]
            self._once(f"left out: {odd.sum()} nodes at no corner of an element, {node} the first")

    def _note_unknown(self) -> None:
        if self._points.unknown_types:
            types = ", ".join(map(str, self._points.unknown_types))
            self._once(f"left out: elements of unknown type {types}")

    def _once(self, words: str) -> None:
        """Note what holds for every increment the first time."""
        if words not in self._said:
            self.options.note(words)
        self._said.add(words)
