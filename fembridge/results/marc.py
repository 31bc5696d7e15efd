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

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError, UsageError
from fembridge.results.fields import Field, Frame, Key, arrays_of, derived_of, history_of
from fembridge.results.history import (
    FREQUENCY,
    NAMES,
    OF_STRESS,
    STRESS,
    TIME,
    VON_MISES,
    History,
    name_in,
    one_axis,
)
from fembridge.results.marc_nodes import UNKNOWN_LAYERS, MeshPoints, Plan, plan
from fembridge.results.marc_post import PostCode, PostFile, PostIncrement, PostMesh
from fembridge.results.mentat import read_sts
from fembridge.results.one_sided import OneSidedStress
from fembridge.results.read_options import NotFiniteError, ReadOptions, in_pa
from fembridge.results.stress import DERIVED, TENSOR, von_mises_pa
from fembridge.trace import MS_PER_S, StressTrace
from fembridge.typing import BoolArray, FloatArray, IntArray, Table

_DEFAULTS = ReadOptions()
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
    are no `columns`.
    """

    name: str
    components: tuple[str, ...]
    codes: tuple[int, ...]
    unit: str
    columns: tuple[int, ...] = ()
    layer: int = 0

    @property
    def is_tensor(self) -> bool:
        """Whether it has the six components of a symmetric tensor."""
        return len(self.components) == len(TENSOR)

    def __str__(self) -> str:
        first, last = self.codes[0], self.codes[-1]
        codes = f"code {first}" if first == last else f"codes {first} to {last}"
        return f"{self.name} ({codes})"


def element_quantities(codes: Sequence[PostCode]) -> tuple[Quantity, ...]:
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


def stress_tensor(codes: Sequence[PostCode], path: Path) -> Quantity:
    """The stress tensor that traces are made of.

    Raises
    ------
    ResultError
        There is none, or one for each of several layers of a shell.
    """
    found = element_quantities(codes)
    for code in STRESS_CODES:
        same = [one for one in found if one.codes[0] == code and one.is_tensor]
        if len(same) > 1:
            layers = ", ".join(str(one.layer) for one in same)
            words = f"code {code} is stored for layers {layers}: a shell has no one stress at a"
            raise ResultError(f"{words} node", path)
        if same:
            return same[0]
    words = ", ".join(map(str, found)) or "no element values"
    if any(code.code in EQUIVALENT_CODES for code in codes):
        words += "; --von-mises scalar (von_mises='scalar') takes the one it holds"
    raise ResultError(f"no stress tensor (post code 311 or 341) in it, it holds {words}", path)


def equivalent_stress(codes: Sequence[PostCode]) -> Quantity | None:
    """The von Mises stress that Marc stored at the points; None without one."""
    for code in EQUIVALENT_CODES:
        same = [one for one in element_quantities(codes) if one.codes == (code,)]
        if len(same) == 1:
            return same[0]
    return None


def quantities_of(one: PostIncrement, codes: Sequence[PostCode]) -> dict[str, Quantity]:
    """Quantities of an increment by name, ``DX``, ``DY`` of Displacement; not complex ones."""
    found = {}
    for held in one.nodal:
        if not held.is_complex:
            numbered = tuple(str(k + 1) for k in range(held.components))
            parts = (_initials(held.name) + a for a in _AXES.get(held.components, numbered))
            unit = _NODAL_UNITS.get(held.code, AS_IS)
            found[held.name] = Quantity(held.name, tuple(parts), (held.code,), unit)
    for quantity in element_quantities(codes) if one.has_element_values else ():
        found.setdefault(quantity.name, quantity)
    return found


def _initials(name: str) -> str:
    words = name.split()
    if any(word.isdigit() for word in words):  # "Code 23": nothing to shorten
        return name.replace(" ", "_")
    return "".join(word[0] for word in words).upper() or "V"


# --- Traces


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
            times_ms, tensor_pa, _ = _tensor_history(post, nodes, options)
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
        no elements or lies between layers; a value is no finite number.
    """
    with PostFile(path) as post:
        check_whole(post, options)
        return _tensor_history(post, nodes, options)[:2]


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
        times_ms, tensor_pa, planned = _tensor_history(post, [node], options, one_sided=True)
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
        mesh = post.mesh
        types, counts = np.unique(mesh.element_types, return_counts=True)
        header: Table = {"title": post.title, "post revision": post.revision}
        if post.kind == "t16":
            header["byte order"] = post.byte_order
        header |= {"precision": post.precision, "points stored an element": post.points}
        return {
            "format": f"marc-{post.kind}",
            "bytes": path.stat().st_size,
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
            "quantities": _quantities(post, mesh),
            "remarks": post.remarks,
            "problem": post.problem,
        }


def _quantities(post: PostFile, mesh: PostMesh) -> list[Table]:
    found: dict[str, tuple[Quantity, list[PostIncrement]]] = {}
    for one in post.increments:
        for name, quantity in quantities_of(one, post.codes).items():
            found.setdefault(name, (quantity, []))[1].append(one)
    ids = mesh.node_ids
    tables: list[Table] = []
    for name, (quantity, increments) in found.items():
        timed = [one.time_s * MS_PER_S for one in increments if not one.harmonic]
        others = [one.frequency for one in increments if one.harmonic]
        tables.append(
            {
                "name": name,
                "components": list(quantity.components),
                "increments": len(timed),
                "first_ms": timed[0] if timed else None,
                "last_ms": timed[-1] if timed else None,
                "modes": len(others),
                "axis": "frequency in cycles per time" if others else "total time",
                "first_value": others[0] if others else None,
                "last_value": others[-1] if others else None,
                "steps": sorted({one.sub_increment for one in increments}),
                "at": "integration points" if quantity.columns else "nodes",
                "nodes": int(ids.size),
                "lowest_node": int(ids.min()) if ids.size else None,
                "highest_node": int(ids.max()) if ids.size else None,
                "storage": "text" if post.kind == "t19" else post.precision,
            }
        )
    return tables


def _tensor_history(
    post: PostFile, nodes: Sequence[int], options: ReadOptions, *, one_sided: bool = False
) -> tuple[FloatArray, FloatArray, Plan]:
    tensor = stress_tensor(post.codes, post.path)
    options.note(f"stress: {tensor}, extrapolated to nodes: {options.method}")
    columns = list(tensor.columns)
    return _history(post, nodes, lambda at: at[:, :, columns], options, one_sided=one_sided)


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
    times_ms, values, _ = _history(post, nodes, pick, options)
    below = np.argwhere(values[:, :, 0] < 0)
    if below.size:
        row, column = below[0]
        options.note(
            f"node {nodes[column]}: von Mises stress is below 0 at {times_ms[row]:g} ms: linear "
            "extrapolation of a steep field does that"
        )
    return times_ms, values[:, :, 0]


def _history(
    post: PostFile,
    nodes: Sequence[int],
    pick: Callable[[FloatArray], FloatArray],
    options: ReadOptions,
    *,
    one_sided: bool = False,
) -> tuple[FloatArray, FloatArray, Plan]:
    """Values at each increment that has any, ``(T,)`` in ms and ``(T, S, C)`` in Pa; the plan.

    `pick` makes ``(K, point, C)`` of the stored values ``(K, point, code)``.
    """
    increments = _with_element_values(post, options)
    wanted = [int(node) for node in nodes]
    planned = plan(post.mesh, wanted, post.points, options, post.path, one_sided=one_sided)
    for remark in planned.remarks:
        options.note(remark)
    times_ms, found = [], []
    for one in increments:
        values = planned.add_up(pick(post.element_values(one.row, planned.element_rows)))
        bad = np.argwhere(~np.isfinite(values))
        if not bad.size:
            times_ms.append(one.time_s * MS_PER_S)
            found.append(values)
            continue
        node = planned.sides[int(bad[0][0])][0].node
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
    return np.array(times_ms), in_pa(np.array(found), options, post.path), planned


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
            options.note(f"left out: increments {what}, {_some(left)}")
    return [one for one in post.increments if one.has_element_values and not one.harmonic]


def _some(increments: Sequence[PostIncrement]) -> str:
    """Numbers of the first few `increments`."""
    shown = ", ".join(str(one.increment) for one in increments[:5])
    return f"{shown}, ..." if len(increments) > 5 else shown


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


# --- Whole fields


class MarcSource:
    """An open post file, see `fembridge.results.fields.FieldSource`."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self.path, self._options = path, options
        self._post = PostFile(path)
        self._checked = False
        self._said: set[str] = set()

    def __enter__(self) -> "MarcSource":
        return self

    def __exit__(self, *error: object) -> None:
        self._post.__exit__(*error)

    @cached_property
    def _points(self) -> MeshPoints:
        return MeshPoints(self._post.mesh, self.path)

    def keys(self, quantity: str) -> list[Key]:
        """Sub-increment and increment of each output of `quantity`."""
        self._check_whole()
        name = self._name(quantity)
        held = [name in self._quantities(one) for one in self._post.increments]
        self._note_without(name, self._post.increments, held)
        return [_key(one) for one, has in zip(self._post.increments, held, strict=True) if has]

    def field(self, quantity: str, key: Key) -> Field:
        """Read `quantity` at one of its `keys`.

        Of element values: nodes that lie in one layer, or with `across_materials` all, those
        between layers with the mean over all elements there.
        """
        name = self._name(quantity)
        one = next(
            each
            for each in reversed(self._post.increments)
            if _key(each) == key and name in self._quantities(each)
        )
        found = self._quantities(one)[name]
        if not found.columns:
            rows = np.flatnonzero(~self._points.pressure_nodes())
            nodes, values = self._post.mesh.node_ids[rows], self._values(one, found)[rows]
        else:
            self._note_mesh()
            nodes, values = self._one_value_a_node(self._values(one, found))
        self._check_finite(found, one, nodes, values)
        return _field(found, one, nodes, values)

    def fields(self, quantity: str) -> Iterator[Field]:
        """`quantity` at each of its outputs; what is absent is refused at once."""
        return self._fields(quantity, self.keys(quantity))

    def _fields(self, quantity: str, keys: Sequence[Key]) -> Iterator[Field]:
        for key in keys:
            try:
                yield self.field(quantity, key)
            except NotFiniteError as error:
                if not self._options.partial:
                    raise
                self._options.note(f"dropped increment {key[1]}: {error.problem}")

    def history(
        self, nodes: Sequence[int] | None, quantity: str | None, modes: bool, last: bool = False
    ) -> History:
        """Each increment of a quantity at `nodes`, see `fields.FieldSource`."""
        self._check_whole()
        options, stress = self._options, quantity in (None, STRESS, *OF_STRESS)
        held = list(
            dict.fromkeys(name for one in self._post.increments for name in self._quantities(one))
        )
        if quantity is None and options.von_mises is None:
            try:
                stress_tensor(self._post.codes, self.path)
            except ResultError:
                stress = False
        if stress and nodes is not None and not modes:
            if options.von_mises == "scalar" and quantity in (None, VON_MISES):
                times_ms, scalar = _scalar_history(self._post, nodes, options)
                values = scalar[:, :, None]
            else:
                times_ms, values, _ = _tensor_history(self._post, nodes, options)
            wanted = tuple(int(node) for node in nodes)
            return History.of_stress(wanted, _unrounded_ms(times_ms, self._post), values)
        name = next((one for one in NAMES["displacement"] if one in held), (*held, "")[0])
        if quantity is not None or not held:
            name = name_in(held, quantity or STRESS, self.path)
        if stress:
            name = stress_tensor(self._post.codes, self.path).name
        increments = [one for one in self._post.increments if name in self._quantities(one)]
        axes = [FREQUENCY if one.harmonic else TIME for one in increments]
        axis = one_axis(name, axes, modes, options)
        keys = [_key(one) for one, of in zip(increments, axes, strict=True) if of == axis]
        fields = [self.field(name, key) for key in (keys[-1:] if last else keys)]
        return history_of(fields, nodes)

    def places(self) -> Iterator[tuple[IntArray, FloatArray, BoolArray]]:
        """Yield nodes, coordinates ``(n, 3)`` in mm, and which have elements."""
        mesh, points = self._post.mesh, self._points
        if not mesh.node_ids.size:
            raise ResultError("no nodes in it, so no coordinates", self.path)
        keep = ~points.pressure_nodes()
        at_mm = mesh.coordinates_mm[keep] * self._options.length_mm
        yield mesh.node_ids[keep], at_mm, points.bearing[keep]

    def frames(
        self, quantities: Sequence[str] | None, derived: Sequence[str], modes: bool = False
    ) -> Iterator[Frame]:
        """Check the request now; yield the increments when they are asked for.

        A point of the scene is a node as one layer has it: between layers stress jumps, as it
        does in the model.
        """
        self._check_whole()
        names = None if quantities is None else [self._name(one) for one in quantities]
        axes = [FREQUENCY if one.harmonic else TIME for one in self._post.increments]
        axis = one_axis(", ".join(names or ["any quantity"]), axes, modes, self._options)
        increments = [
            one for one, of in zip(self._post.increments, axes, strict=True) if of == axis
        ]
        every = [self._quantities(one) for one in increments]
        for name in names or dict.fromkeys(name for held in every for name in held):
            self._note_without(name, increments, [name in held for held in every])
        return self._frames(increments, names, derived)

    def _frames(
        self,
        increments: Sequence[PostIncrement],
        names: Sequence[str] | None,
        derived: Sequence[str],
    ) -> Iterator[Frame]:
        points, scene = self._points, None
        for one in increments:
            held = self._quantities(one)
            found = {name: held[name] for name in held if names is None or name in names}
            if not found:
                self._options.note(f"left out: increment {one.increment}, it has none")
                continue
            if scene is None:
                scene = points.scene()
                scene = replace(scene, points_mm=scene.points_mm * self._options.length_mm)
                self._note_mesh()
            values, tensors = {}, {}
            for name, quantity in found.items():
                there = self._values(one, quantity)
                there = there if quantity.columns else there[points.rows]
                try:
                    self._check_finite(quantity, one, points.nodes, there)
                except NotFiniteError as error:  # of this quantity, not of the others
                    self._options.note(f"left out: {error.problem}")
                    continue
                values[name] = there
                if quantity.columns and quantity.is_tensor:
                    tensors[quantity.codes[0]] = quantity
            if not values:
                continue
            arrays: dict[str, FloatArray] = {}
            for name in values:
                arrays |= arrays_of(_field(found[name], one, points.nodes, values[name]))
            best = next((tensors[code] for code in STRESS_CODES if code in tensors), None)
            if best is not None:
                field = _field(best, one, points.nodes, values[best.name])
                with np.errstate(over="ignore", invalid="ignore"):
                    for name in derived:
                        if DERIVED[name][0] == ("STRESS",):
                            arrays[f"{name}_pa"] = derived_of(name, {"STRESS": field})
            at = one.frequency if one.harmonic else one.time_s * MS_PER_S
            yield Frame(at, scene, arrays, not one.harmonic)

    def _values(self, one: PostIncrement, quantity: Quantity) -> FloatArray:
        """A quantity at all nodes, or of element values at all points of the mesh."""
        if not quantity.columns:
            values = self._post.nodal_values(one.row, quantity.name)
        else:
            every = np.arange(self._post.mesh.element_ids.size)
            stored = self._post.element_values(one.row, every)[:, :, quantity.columns]
            values = self._points.averaged(stored, self._options.method)
        if not np.isfinite(values).all():
            return values
        if quantity.unit == PA:
            return in_pa(values, self._options, self.path)
        return values * self._options.scale(quantity.unit)

    def _check_finite(
        self, quantity: Quantity, one: PostIncrement, nodes: IntArray, values: FloatArray
    ) -> None:
        if not np.isfinite(values).all():
            row, column = np.argwhere(~np.isfinite(values))[0].tolist()
            raise NotFiniteError(
                f"{quantity.name} of increment {one.increment}, node {nodes[row]}: "
                f"{quantity.components[column]} is {values[row, column]}",
                self.path,
            )

    def _note_without(
        self, name: str, increments: Sequence[PostIncrement], held: Sequence[bool]
    ) -> None:
        """Say which increments have no `name`, where some have and some have not."""
        without = [one for one, has in zip(increments, held, strict=True) if not has]
        if without:
            self._options.note(f"no {name} in increments {_some(without)}")

    def _one_value_a_node(self, at_points: FloatArray) -> tuple[IntArray, FloatArray]:
        points, node_ids = self._points, self._post.mesh.node_ids
        between = points.met > 1
        if between.any() and not self._options.across_materials:
            count = np.unique(points.rows[between]).size
            self._once(
                f"left out: {count} nodes lie between layers, where a mean belongs to none; "
                "--across-materials takes it"
            )
            rows = points.rows[~between]
            order = np.argsort(rows, kind="stable")
            return node_ids[rows[order]], at_points[~between][order]
        share = points.elements_at()
        rows, place = np.unique(points.rows, return_inverse=True)
        total = np.zeros((rows.size, at_points.shape[1]))
        np.add.at(total, place, at_points * share[:, None])
        elements = np.bincount(place, share, rows.size)
        return node_ids[rows], total / elements[:, None]

    def _quantities(self, one: PostIncrement) -> dict[str, Quantity]:
        return quantities_of(one, self._post.codes)

    def _name(self, word: str) -> str:
        """Name of the quantity that `word` stands for."""
        names = list(
            dict.fromkeys(name for one in self._post.increments for name in self._quantities(one))
        )
        plain = word.casefold()
        same = [name for name in names if name.casefold() == plain]
        close = same or [name for name in names if name.casefold().startswith(plain)]
        if len(close) == 1:
            return close[0]
        if close:
            raise UsageError(f"{word!r} may be {' or '.join(close)}")
        raise ResultError(f"no {word} in it, it holds {', '.join(names) or 'nothing'}", self.path)

    def _check_whole(self) -> None:
        if not self._checked:
            check_whole(self._post, self._options)
        self._checked = True

    def _note_mesh(self) -> None:
        if self._points.unknown_types:
            types = ", ".join(map(str, self._points.unknown_types))
            self._once(f"left out: elements of unknown type {types}")
        if not self._points.layers.known:
            self._once(UNKNOWN_LAYERS)

    def _once(self, words: str) -> None:
        """Note what holds for every increment the first time."""
        if words not in self._said:
            self._options.note(words)
        self._said.add(words)


def _field(quantity: Quantity, one: PostIncrement, nodes: IntArray, values: FloatArray) -> Field:
    units = (quantity.unit,) * len(quantity.components)
    time_ms = one.time_s * MS_PER_S
    over = (FREQUENCY, one.frequency) if one.harmonic else (TIME, time_ms / MS_PER_S)
    return Field(
        quantity.name, *_key(one), time_ms, quantity.components, units, nodes, values, *over
    )


def _key(one: PostIncrement) -> Key:
    return one.sub_increment, one.increment
