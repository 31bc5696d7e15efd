"""From a finger's section to a mesh of quadrilaterals, by gmsh through pygmsh.

The right half is meshed and mirrored, so that the mesh is symmetric to the last bit. The
skin's layers are patches with four sides (transfinite), so that the columns under the
probe stand upright and the same columns cross all three layers; the subcutaneous tissue
and the bone are filled freely. No physical groups are used (pygmsh mixes up the cells of
lines and surfaces once there are both): each surface is asked for its elements.

gmsh's own files of options are not read, its handler of Ctrl-C is not put in place, and
signals that its libraries set to the system's default are put back: the mesh depends on
the finger alone, and the caller keeps its signals.
"""

import ctypes
import math
import signal
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from decks.finger import LAYERS, AfferentSite, Finger
from decks.mesh import DIGITS, MIN_SCALED_JACOBIAN, Mesh, scaled_jacobian
from decks.section import Section, section_of
from fembridge.errors import FingerError, MissingError

# More would take a solver more than a day, and gmsh more than minutes.
MAX_ELEMENTS = 200_000

# Where the free quads come out too skewed, other widths far from the probe often
# help; these are tried in turn.
_STRETCHES = (1.0, 0.95, 1.05, 0.9, 1.1, 0.85, 1.15, 0.8, 1.2, 0.75, 1.3, 0.7)
# gmsh's number for a quadrilateral of four nodes.
_QUAD = 3
Surface = tuple[int, int]
"""gmsh's number of a surface, and the layer it belongs to (index of `LAYERS`)."""

# A boundary is a spline through this many points a column, at least.
_SAMPLES_A_COLUMN = 16
_MIN_SAMPLES = 64
_BONE_SAMPLES = 200
# The afferent's point on the axis stays this far from dermis and bone.
_CLEARANCE_MM = 0.03
# Growth of neighbouring columns beyond the ridges.
_GROWTH = 1.12
# Tolerance for nodes on x = 0.
_ON_AXIS_MM = 1e-7
# A node that moves less than this share of its shortest edge folds nothing.
_SINGLE_NODE_SHARE = 0.45
# A longer shift fades out over this many times its length.
_REACH_FACTOR = 6.0
SYSTEM_PACKAGES = "libglu1-mesa libgl1 libxcursor1 libxft2 libxinerama1 libgomp1"

_OPTIONS = {
    "General.Verbosity": 1,
    "General.NumThreads": 1,
    "Mesh.RecombineAll": 1,
    "Mesh.Smoothing": 10,
    "Mesh.RecombinationAlgorithm": 2,
    "Mesh.MeshSizeExtendFromBoundary": 1,
    "Mesh.MeshSizeFromPoints": 0,
}


def mesh_finger(finger: Finger) -> Mesh:
    """Mesh `finger`; the same finger and gmsh version give the same mesh.

    Raises
    ------
    MissingError
        gmsh or one of the system's libraries that it opens is not installed.
    FingerError
        The resolution asks for too many elements, gmsh cannot mesh this finger,
        or the mesh fails `Mesh`'s checks.
    """
    section = section_of(finger)
    count = _expected_elements(section)
    if count > MAX_ELEMENTS:
        raise FingerError(
            f"makes about {count:.0f} elements, expected at most {MAX_ELEMENTS}: use wider columns "
            "or fewer rows",
            argument="resolution",
            found=round(count),
            expected=f"at most {MAX_ELEMENTS} elements",
        )
    problem = ""
    for stretch in _STRETCHES:
        try:
            return _mesh(section, stretch)
        except FingerError as error:
            problem = problem or str(error)
    raise FingerError(f"{problem}; another resolution.far_mm may help")


def _mesh(section: Section, stretch: float) -> Mesh:
    with gmsh_session(_OPTIONS) as (geometry, gmsh):
        surfaces = _draw(geometry, section, section.finger.resolution.far_mm * stretch)
        geometry.generate_mesh(dim=2, algorithm=8)
        gmsh.model.mesh.optimize("UntangleMeshGeometry", niter=10)
        half = _collect(gmsh, surfaces)
    return mirrored(snapped(half, section.finger.afferents.values())).checked()


def _expected_elements(section: Section) -> float:
    """About how many elements the whole section will have."""
    outline, resolution = section.finger.outline, section.finger.resolution
    depth_mm = section.finger.skin.dermis_depth_mm
    half_axes_mm = outline.half_width_mm - depth_mm, outline.half_height_mm - depth_mm
    columns = sum(patch.count for _, _, patch in columns_of(section, resolution.far_mm))
    inside = math.pi * math.prod(half_axes_mm) / resolution.far_mm**2
    return 2.0 * columns * sum(_rows(section.finger)) + inside


def _rows(finger: Finger) -> tuple[int, int, int]:
    """Rows of elements across corneum, epidermis and dermis."""
    resolution = finger.resolution
    return resolution.stratum_corneum_rows, resolution.epidermis_rows, resolution.dermis_rows


def _collect(gmsh: Any, surfaces: Sequence[Surface]) -> Mesh:  # noqa: ANN401 - untyped
    """The mesh that gmsh made of the right half, with counter-clockwise elements."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    row_of = np.full(int(max(tags)) + 1, -1, dtype=np.int64)
    row_of[tags.astype(np.int64)] = np.arange(len(tags))
    quads, layers = [], []
    for surface, layer in surfaces:
        kinds, _, nodes = gmsh.model.mesh.getElements(2, surface)
        if list(kinds) != [_QUAD]:
            raise FingerError(f"gmsh left triangles in {LAYERS[layer]}: choose another resolution")
        quads.append(row_of[nodes[0].astype(np.int64)].reshape(-1, 4))
        layers.append(np.full(len(quads[-1]), layer, dtype=np.int64))
    used, compact = np.unique(np.concatenate(quads), return_inverse=True)
    node_mm = np.asarray(coordinates, dtype=np.float64).reshape(-1, 3)[used, :2]
    half = Mesh(np.round(node_mm, DIGITS) + 0.0, compact.reshape(-1, 4), np.concatenate(layers))
    clockwise = half.area_mm2() < 0
    return replace(half, quad=np.where(clockwise[:, None], half.quad[:, ::-1], half.quad))


# ---- The drawing


def _draw(geometry: Any, section: Section, far_mm: float) -> list[Surface]:  # noqa: ANN401 - untyped
    """Draw `section` into pygmsh's `geometry`, its columns growing to `far_mm`."""
    finger = section.finger
    surfaces: list[Surface] = []

    def point(point_mm: Iterable[float]) -> Any:  # noqa: ANN401 - untyped
        return geometry.add_point([*point_mm, 0.0])

    def divided(curve: Any, division: Division) -> Any:  # noqa: ANN401 - untyped
        geometry.set_transfinite_curve(curve, division.count + 1, "Progression", division.growth)
        return curve

    # Boundaries of the layers, from the skin inwards: curves, and the points between them.
    boundaries = []
    for depth in (section.surface, section.corneum, section.epidermis, section.dermis):
        knots: list[Any] = []
        curves: list[Any] = []
        for start_mm, end_mm, division in columns_of(section, far_mm):
            samples = max(_SAMPLES_A_COLUMN * division.count, _MIN_SAMPLES)
            first, *inner, last = section.curve(depth, np.linspace(start_mm, end_mm, samples + 1))
            knots += [point(first)] if not knots else []
            knots.append(point(last))
            spline = geometry.add_spline([knots[-2], *map(point, inner), knots[-1]])
            curves.append(divided(spline, division))
        boundaries.append((curves, knots))
    # Patches of each layer between two boundaries; the outermost ends in the nail.
    for band, rows in enumerate(_rows(finger)):
        (above, top), (below, bottom) = boundaries[band : band + 2]
        upright = [
            divided(geometry.add_line(*ends), Division(rows))
            for ends in zip(top, bottom, strict=True)
        ]
        for k in range(len(above)):
            loop = geometry.add_curve_loop([above[k], upright[k + 1], -below[k], -upright[k]])
            surface = geometry.add_plane_surface(loop)
            corners = [top[k], top[k + 1], bottom[k + 1], bottom[k]]
            geometry.set_transfinite_surface(surface, "Left", corners)
            name = "nail" if band == 0 and k == len(above) - 1 else LAYERS[band]
            surfaces.append((surface._id, LAYERS.index(name)))
    # Subcutaneous tissue and bone, below the lower side of the dermis.
    dermis, knots = boundaries[-1]
    points = section.bone(np.linspace(0.0, np.pi, _BONE_SAMPLES + 1))
    bone_knots = [point(point_mm) for point_mm in points]
    length_mm = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    bone = divided(geometry.add_spline(bone_knots), even(length_mm, far_mm))
    middle = geometry.add_line(bone_knots[-1], bone_knots[0])
    divided(middle, even(2 * finger.bone.half_height_mm, far_mm))
    bottom_line = geometry.add_line(bone_knots[-1], knots[-1])
    # The line from dermis to bone has a node where an afferent sits.
    fine_mm = finger.skin.dermis_mm / finger.resolution.dermis_rows
    start, start_mm, axis = knots[0], finger.skin.dermis_depth_mm, []
    bone_mm = finger.bone.depth_mm - finger.bone.half_height_mm
    sites_mm = {
        site.depth_mm
        for site in finger.afferents.values()
        if (site.layer, site.x_mm) == ("subcutaneous_tissue", 0)
        and start_mm + _CLEARANCE_MM < site.depth_mm < bone_mm - _CLEARANCE_MM
    }
    for stop_mm in sorted(sites_mm):
        end = point((0.0, -stop_mm))
        division = graded(stop_mm - start_mm, fine_mm, fine_mm)
        axis.append(divided(geometry.add_line(start, end), division))
        start, start_mm = end, stop_mm
    last_line = geometry.add_line(start, bone_knots[0])
    axis.append(divided(last_line, graded(-points[0, 1] - start_mm, fine_mm, far_mm)))
    below_mm = points[-1, 1] - float(knots[-1].x[1])
    divided(bottom_line, graded(below_mm, far_mm, far_mm))
    around = [*dermis, -bottom_line, -bone, *(-line for line in reversed(axis))]
    tissue = geometry.add_plane_surface(geometry.add_curve_loop(around))
    inside = geometry.add_plane_surface(geometry.add_curve_loop([bone, middle]))
    geometry.set_recombined_surfaces([tissue, inside])
    surfaces.append((tissue._id, LAYERS.index("subcutaneous_tissue")))
    surfaces.append((inside._id, LAYERS.index("bone")))
    geometry.set_mesh_size_callback(lambda dim, tag, x, y, z, lc: min(lc, far_mm))
    return surfaces


# ---- How an edge is divided: even steps, or steps that grow from one width to another.
# Counts are even throughout: an area whose sides have even counts can be filled with
# quadrilaterals alone.


@dataclass(frozen=True, slots=True)
class Division:
    """`count` steps, each `growth` times as long as the one before."""

    count: int
    growth: float = 1.0


def columns_of(section: Section, far_mm: float) -> list[tuple[float, float, Division]]:
    """Patches of half the outline, contact, ridges, growth, side, nail: from, to, columns."""
    resolution = section.finger.resolution
    ridged_mm = section.finger.ridges.half_width_mm
    nail_mm, fine_mm = section.nail_arc_mm, resolution.ridge_mm
    grown_mm = min(
        ridged_mm + max(far_mm * _GROWTH - fine_mm, 0.3) / (_GROWTH - 1),
        0.5 * (ridged_mm + nail_mm),
    )
    patches, start_mm = [], 0.0
    for end_mm, first_mm, last_mm in (
        (min(resolution.contact_half_width_mm, ridged_mm), *2 * (resolution.contact_mm,)),
        (ridged_mm, fine_mm, fine_mm),
        (grown_mm, fine_mm, far_mm),
        (nail_mm, far_mm, far_mm),
        (section.end_arc_mm, far_mm, far_mm),
    ):
        if end_mm - start_mm >= 1e-9:
            patches.append((start_mm, end_mm, graded(end_mm - start_mm, first_mm, last_mm)))
            start_mm = end_mm
    return patches


def graded(length_mm: float, start_mm: float, stop_mm: float) -> Division:
    """Divide into steps from about `start_mm` to about `stop_mm` long."""
    if abs(stop_mm - start_mm) < 1e-9 or length_mm <= 2 * max(start_mm, stop_mm):
        return even(length_mm, min(start_mm, stop_mm))
    ratio = (length_mm - start_mm) / (length_mm - stop_mm)
    count = _even(math.log(stop_mm / start_mm) / math.log(ratio) + 1)
    return Division(count, (stop_mm / start_mm) ** (1 / max(count - 1, 1)))


def even(length_mm: float, step_mm: float) -> Division:
    """Divide into equal steps of about `step_mm`."""
    return Division(_even(length_mm / step_mm))


def _even(number: float) -> int:
    return 2 * max(1, round(number / 2))


# ---- The right half, before it is mirrored


def snapped(half: Mesh, sites: Iterable[AfferentSite]) -> Mesh:
    """Move the nearest inner node of each site's layer onto the site.

    So an afferent sits at the same point whatever the resolution. A node
    with a short way goes alone; with a longer one it takes the nodes of its
    layer around it along, the less the further they are. On the axis nodes
    stay on the axis, and the layer's boundaries stay where they are. Where
    the elements would not bear it nothing moves.
    """
    used_rows: list[int] = []
    for site in sites:
        if (moved := _with_node_at(half, site, used_rows)) is not None:
            half, row = moved
            used_rows.append(row)
    return half


def _with_node_at(half: Mesh, site: AfferentSite, used_rows: list[int]) -> tuple[Mesh, int] | None:
    """`half` with a node moved onto the site, not one of `used_rows`, and its row; else None."""
    in_layer = half.in_layer(site.layer)
    inner = np.setdiff1d(half.quad[in_layer], half.quad[~in_layer])
    target_mm = np.array([abs(site.x_mm), -site.depth_mm])
    target_mm[0] *= target_mm[0] >= _ON_AXIS_MM
    occupied = (half.node_mm[used_rows] == target_mm).all(axis=1)
    inner = np.setdiff1d(inner, used_rows)
    on_axis = np.abs(half.node_mm[inner, 0]) < _ON_AXIS_MM
    candidates = inner[on_axis == (target_mm[0] < _ON_AXIS_MM)]
    if occupied.any() or not candidates.size:
        return None
    row = int(candidates[np.linalg.norm(half.node_mm[candidates] - target_mm, axis=1).argmin()])
    shift_mm = target_mm - half.node_mm[row]
    reach_mm = max(_REACH_FACTOR * float(np.linalg.norm(shift_mm)), _ON_AXIS_MM)
    distance_mm = np.linalg.norm(half.node_mm[inner] - half.node_mm[row], axis=1)
    share = np.clip(1 - distance_mm / reach_mm, 0.0, None)
    single, neighbourhood = half.node_mm.copy(), half.node_mm.copy()
    neighbourhood[inner] = np.round(neighbourhood[inner] + share[:, None] * shift_mm, DIGITS)
    neighbourhood[inner[on_axis], 0] = half.node_mm[inner[on_axis], 0]
    edges, _, _ = half.edges()
    start, end = half.node_mm[edges[(edges == row).any(axis=1)]].swapaxes(0, 1)
    shortest_mm = np.linalg.norm(start - end, axis=1).min()
    near = np.linalg.norm(shift_mm) <= _SINGLE_NODE_SHARE * shortest_mm
    for node_mm in (single, neighbourhood) if near else (neighbourhood,):
        node_mm[row] = target_mm
        if scaled_jacobian(node_mm, half.quad).min() >= MIN_SCALED_JACOBIAN:
            return Mesh(node_mm, half.quad, half.layer), row
    return None


def mirrored(half: Mesh) -> Mesh:
    """Join with the mirror image; number nodes from the pad inwards."""
    node_mm = half.node_mm.copy()
    on_axis = np.abs(node_mm[:, 0]) < _ON_AXIS_MM
    node_mm[on_axis, 0] = 0.0
    count = len(node_mm)
    image = np.where(on_axis, np.arange(count), count + np.cumsum(~on_axis) - 1)
    nodes = np.concatenate([node_mm, node_mm[~on_axis] * [-1.0, 1.0]])
    quads = np.concatenate([half.quad, image[half.quad][:, ::-1]])
    layers = np.concatenate([half.layer, half.layer])
    order = np.lexsort((nodes[:, 0], -nodes[:, 1]))
    new_row = np.empty_like(order)
    new_row[order] = np.arange(len(order))
    quads = new_row[quads]
    first = quads.argmin(axis=1)
    quads = np.take_along_axis(quads, (first[:, None] + np.arange(4)) % 4, axis=1)
    sort = np.lexsort((quads[:, 0], layers))
    return Mesh(nodes[order], quads[sort], layers[sort])


# ---- gmsh


def mesher_problem() -> str:
    """Why no finger can be meshed here, with the command that installs what is missing; or ""."""
    try:
        _gmsh_modules()
    except MissingError as error:
        return str(error)
    return ""


def _gmsh_modules() -> tuple[Any, Any]:
    """The modules gmsh and pygmsh; raises MissingError if one of them cannot be imported."""
    try:
        import gmsh
        import pygmsh
    except OSError as error:
        raise MissingError(
            f"gmsh cannot load a system library ({error}); apt-get install -y {SYSTEM_PACKAGES}"
        ) from error
    except ImportError as error:
        raise MissingError(f"{error}; pip install pygmsh") from error
    return gmsh, pygmsh


@contextmanager
def gmsh_session(options: Mapping[str, int]) -> Iterator[tuple[Any, Any]]:
    """Pygmsh's geometry and the gmsh module under `options`; gmsh is closed at the end.

    Raises
    ------
    MissingError
        gmsh or one of the system's libraries that it opens is not installed.
    FingerError
        gmsh is in use by the caller, or cannot mesh.
    """
    gmsh, pygmsh = _gmsh_modules()
    if gmsh.isInitialized():
        raise FingerError("gmsh is already at work here: call gmsh.finalize() first")
    with _signals_kept():
        gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        for option, value in options.items():
            gmsh.option.setNumber(option, value)
        gmsh.model.add("finger")
        yield pygmsh.geo.Geometry(), gmsh
    except FingerError:
        raise
    except Exception as error:
        if type(error) is not Exception:  # gmsh raises the bare class, bugs do not
            raise
        raise FingerError(f"gmsh cannot mesh this finger: {error}") from error
    finally:
        gmsh.model.mesh.removeSizeCallback()
        gmsh.finalize()


@contextmanager
def _signals_kept() -> Iterator[None]:
    """Handlers of all signals, put back as the system has them.

    What gmsh loads sets eleven to the default, unseen by Python: SIGPIPE, so that a write to a
    worker that died would end us without a word; SIGTERM and SIGHUP, so that we would not unwind.
    """
    sigaction = ctypes.CDLL(None).sigaction
    actions = {number: ctypes.create_string_buffer(256) for number in signal.valid_signals()}
    for number, action in actions.items():
        sigaction(number, None, action)
    try:
        yield
    finally:
        for number, action in actions.items():
            sigaction(number, action, None)
