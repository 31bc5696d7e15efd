"""gmsh, through pygmsh: from a finger's section to a mesh of quadrilaterals.

The skin's layers are patches with four sides (transfinite), so that the columns
under the probe stand upright and the same columns cross all three layers; the
subcutaneous tissue and the bone are filled freely. The right half is meshed and
mirrored, so that the mesh is symmetric to the last bit. No physical groups are
used (pygmsh mixes up the cells of lines and surfaces once there are both): each
surface is asked for its elements.
"""

import math
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from decks.finger import LAYERS, AfferentSite, Finger, Resolution
from decks.mesh import Mesh
from decks.section import Section, section_of
from fembridge.errors import FingerError, MissingError
from fembridge.typing import FloatArray, IntArray

SYSTEM_PACKAGES = "libglu1-mesa libgl1 libxcursor1 libxft2 libxinerama1 libgomp1"

# Growth of neighbouring columns beyond the ridges.
_GROWTH = 1.12
# Where the free quads come out too skewed, other widths far from the probe often
# help; these are tried in turn.
_STRETCHES = (1.0, 0.95, 1.05, 0.9, 1.1, 0.85)
# Coordinates are stored to a picometre: below what arithmetic differs by
# between processors, above what matters.
_DIGITS = 9


def mesh_finger(finger: Finger) -> Mesh:
    """Mesh `finger`; the same finger and gmsh version give the same mesh.

    Raises
    ------
    MissingError
        gmsh or one of the system's libraries that it opens is not installed.
    FingerError
        gmsh cannot mesh this finger, or the mesh fails `Mesh`'s checks.
    """
    section = section_of(finger)
    for attempt, stretch in enumerate(_STRETCHES, start=1):
        try:
            return _mesh(section, stretch)
        except FingerError:
            if attempt == len(_STRETCHES):
                raise
    raise AssertionError("unreachable")


def _mesh(section: Section, stretch: float) -> Mesh:
    with _geometry() as (geometry, gmsh):
        surfaces = _draw(geometry, section, stretch)
        try:
            geometry.generate_mesh(dim=2, algorithm=8)
            gmsh.model.mesh.optimize("UntangleMeshGeometry", niter=10)
        except Exception as error:  # gmsh raises the bare class
            raise FingerError(f"gmsh cannot mesh this finger: {error}") from error
        node_mm, quad, layer = _collect(gmsh, surfaces)
    for site in section.finger.afferents.values():
        _snap(node_mm, quad, layer, site)
    return _mirrored(node_mm, quad, layer)


@contextmanager
def _geometry() -> Iterator[tuple[Any, Any]]:
    try:
        import gmsh
        import pygmsh
    except OSError as error:
        raise MissingError(
            f"gmsh cannot load a system library ({error}); "
            f"apt-get install -y {SYSTEM_PACKAGES}"
        ) from error
    except ImportError as error:
        raise MissingError(f"{error}; pip install pygmsh") from error
    in_main = threading.current_thread() is threading.main_thread()
    handler = signal.getsignal(signal.SIGINT) if in_main else None
    with pygmsh.geo.Geometry() as geometry:
        if in_main:
            signal.signal(signal.SIGINT, handler)  # gmsh takes Ctrl-C for itself
        for option, value in (
            ("General.Verbosity", 1),
            ("General.NumThreads", 1),
            ("Mesh.RecombineAll", 1),
            ("Mesh.Smoothing", 10),
            ("Mesh.RecombinationAlgorithm", 2),
            ("Mesh.MeshSizeExtendFromBoundary", 1),
            ("Mesh.MeshSizeFromPoints", 0),
        ):
            gmsh.option.setNumber(option, value)
        yield geometry, gmsh


def _draw(
    geometry: Any,  # noqa: ANN401 - untyped library
    section: Section,
    stretch: float,
) -> list[tuple[int, int]]:
    """Build the half section; give (surface tag, layer index) pairs."""
    resolution = section.finger.resolution
    far_mm = resolution.far_mm * stretch
    breaks, counts, growths = _columns(section, far_mm)
    rows = (
        resolution.stratum_corneum_rows,
        resolution.epidermis_rows,
        resolution.dermis_rows,
    )
    boundaries = (section.surface, section.corneum, section.epidermis, section.dermis)
    lines: list[list[Any]] = []
    ends: list[list[Any]] = []
    for boundary in boundaries:
        knots, curves = [], []
        for k, (start, end) in enumerate(zip(breaks, breaks[1:], strict=False)):
            samples = max(16 * counts[k], 64)
            arc_mm = np.linspace(start, end, samples + 1)
            points = section.curve(boundary, arc_mm)
            if not knots:
                knots.append(geometry.add_point([*points[0], 0.0]))
            knots.append(geometry.add_point([*points[-1], 0.0]))
            inner = [geometry.add_point([*point, 0.0]) for point in points[1:-1]]
            curves.append(geometry.add_spline([knots[-2], *inner, knots[-1]]))
            geometry.set_transfinite_curve(
                curves[-1], counts[k] + 1, "Progression", growths[k]
            )
        lines.append(curves)
        ends.append(knots)
    surfaces = []
    uprights: list[list[Any]] = []
    for band, count in enumerate(rows):
        upright = [
            geometry.add_line(ends[band][k], ends[band + 1][k])
            for k in range(len(breaks))
        ]
        for line in upright:
            geometry.set_transfinite_curve(line, count + 1, "Progression", 1.0)
        uprights.append(upright)
        for k in range(len(counts)):
            loop = geometry.add_curve_loop(
                [lines[band][k], upright[k + 1], -lines[band + 1][k], -upright[k]]
            )
            surface = geometry.add_plane_surface(loop)
            corners = [ends[band][k], ends[band][k + 1]]
            corners += [ends[band + 1][k + 1], ends[band + 1][k]]
            geometry.set_transfinite_surface(surface, "Left", corners)
            on_back = band == 0 and k == len(counts) - 1
            name = "nail" if on_back else LAYERS[band]
            surfaces.append((surface._id, LAYERS.index(name)))
    surfaces += _draw_inside(geometry, section, lines[-1], ends[-1], far_mm)
    geometry.set_mesh_size_callback(
        lambda dim, tag, x, y, z, lc: min(lc, far_mm)
    )
    return surfaces


def _draw_inside(
    geometry: Any,  # noqa: ANN401 - untyped library
    section: Section,
    dermis: list[Any],
    knots: list[Any],
    far_mm: float,
) -> list[tuple[int, int]]:
    """Subcutaneous tissue and bone, below the lower side of the dermis."""
    points = section.bone(np.linspace(0.0, np.pi, 201))
    bone_knots = [geometry.add_point([*point, 0.0]) for point in points]
    bone = geometry.add_spline(bone_knots)
    way_mm = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    geometry.set_transfinite_curve(bone, _even(way_mm / far_mm) + 1, "Progression", 1.0)
    middle = geometry.add_line(bone_knots[-1], bone_knots[0])
    height_mm = 2 * section.finger.bone.half_height_mm
    geometry.set_transfinite_curve(
        middle, _even(height_mm / far_mm) + 1, "Progression", 1.0
    )
    top, bottom = [], geometry.add_line(bone_knots[-1], knots[-1])
    stops = _sites_on_axis(section)
    here, here_mm = knots[0], section.finger.skin.dermis_depth_mm
    fine_mm = _dermis_row_mm(section)
    for stop_mm in [*stops, -points[0, 1]]:
        last = stop_mm == -points[0, 1]
        there = bone_knots[0] if last else geometry.add_point([0.0, -stop_mm, 0.0])
        top.append(geometry.add_line(here, there))
        coarse_mm = far_mm if last else fine_mm
        _divide(geometry, top[-1], stop_mm - here_mm, fine_mm, coarse_mm)
        here, here_mm = there, stop_mm
    _divide(geometry, bottom, points[-1, 1] - float(knots[-1].x[1]), far_mm, far_mm)
    tissue = geometry.add_plane_surface(
        geometry.add_curve_loop([*dermis, -bottom, -bone, *(-line for line in reversed(top))])
    )
    inside = geometry.add_plane_surface(geometry.add_curve_loop([bone, middle]))
    geometry.set_recombined_surfaces([tissue, inside])
    return [
        (tissue._id, LAYERS.index("subcutaneous_tissue")),
        (inside._id, LAYERS.index("bone")),
    ]


def _columns(
    section: Section, far_mm: float
) -> tuple[list[float], list[int], list[float]]:
    """Patches along the outline: where they end, how many columns, their growth."""
    resolution = section.finger.resolution
    contact_mm = min(
        resolution.contact_half_width_mm, section.finger.ridges.half_width_mm
    )
    ridged_mm = section.finger.ridges.half_width_mm
    nail_mm, end_mm = section.nail_arc_mm, section.end_arc_mm
    fine_mm = resolution.ridge_mm
    grown_mm = min(
        ridged_mm + max(far_mm * _GROWTH - fine_mm, 0.3) / (_GROWTH - 1),
        0.5 * (ridged_mm + nail_mm),
    )
    breaks, counts, growths = [0.0], [], []
    for end, start_mm, stop_mm in (
        (contact_mm, resolution.contact_mm, resolution.contact_mm),
        (ridged_mm, fine_mm, fine_mm),
        (grown_mm, fine_mm, far_mm),
        (nail_mm, far_mm, far_mm),
        (end_mm, far_mm, far_mm),
    ):
        length_mm = end - breaks[-1]
        if length_mm < 1e-9:
            continue
        count, growth = _graded(length_mm, start_mm, stop_mm)
        breaks.append(end)
        counts.append(count)
        growths.append(growth)
    return breaks, counts, growths


def _graded(length_mm: float, start_mm: float, stop_mm: float) -> tuple[int, float]:
    """Even number of steps from `start_mm` to `stop_mm` long, and their ratio."""
    if abs(stop_mm - start_mm) < 1e-9 or length_mm <= 2 * max(start_mm, stop_mm):
        return _even(length_mm / min(start_mm, stop_mm)), 1.0
    ratio = (length_mm - start_mm) / (length_mm - stop_mm)
    count = _even(math.log(stop_mm / start_mm) / math.log(ratio) + 1)
    return count, (stop_mm / start_mm) ** (1 / max(count - 1, 1))


def _even(number: float) -> int:
    return 2 * max(1, round(number / 2))


def _divide(
    geometry: Any,  # noqa: ANN401 - untyped library
    line: Any,  # noqa: ANN401
    length_mm: float,
    start_mm: float,
    stop_mm: float,
) -> None:
    count, growth = _graded(length_mm, start_mm, stop_mm)
    geometry.set_transfinite_curve(line, count + 1, "Progression", growth)


def _sites_on_axis(section: Section) -> list[float]:
    """Depths at which the line from dermis to bone gets a node: afferents there."""
    finger = section.finger
    bone_mm = finger.bone.depth_mm - finger.bone.half_height_mm
    return sorted(
        {
            site.depth_mm
            for site in finger.afferents.values()
            if site.layer == "subcutaneous_tissue"
            and site.x_mm == 0
            and finger.skin.dermis_depth_mm + 0.1 < site.depth_mm < bone_mm - 0.1
        }
    )


def _dermis_row_mm(section: Section) -> float:
    resolution: Resolution = section.finger.resolution
    return section.finger.skin.dermis_mm / resolution.dermis_rows


def _collect(
    gmsh: Any,  # noqa: ANN401 - untyped library
    surfaces: list[tuple[int, int]],
) -> tuple[FloatArray, IntArray, IntArray]:
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    row_of = np.full(int(max(tags)) + 1, -1, dtype=np.int64)
    row_of[tags.astype(np.int64)] = np.arange(len(tags))
    quads, layers = [], []
    for surface, layer in surfaces:
        kinds, _, nodes = gmsh.model.mesh.getElements(2, surface)
        if list(kinds) != [3]:
            raise FingerError(
                f"gmsh left triangles in {LAYERS[layer]}: choose another resolution"
            )
        quads.append(row_of[nodes[0].astype(np.int64)].reshape(-1, 4))
        layers.append(np.full(len(quads[-1]), layer, dtype=np.int64))
    quad = np.concatenate(quads)
    used, compact = np.unique(quad, return_inverse=True)
    node_mm = np.asarray(coordinates, dtype=np.float64).reshape(-1, 3)[used, :2]
    return (
        np.round(node_mm, _DIGITS) + 0.0,
        compact.reshape(-1, 4),
        np.concatenate(layers),
    )


def _snap(
    node_mm: FloatArray, quad: IntArray, layer: IntArray, site: AfferentSite
) -> None:
    """Move the nearest inner node of the site's layer onto the site.

    So an afferent sits at the same point whatever the resolution. Nothing moves
    further than 0.45 of the shortest edge there; `Mesh` checks the shapes.
    """
    mine = layer == LAYERS.index(site.layer)
    inner = np.setdiff1d(quad[mine], quad[~mine])
    wanted = np.array([abs(site.x_mm), -site.depth_mm])
    if not inner.size:
        return
    row = int(inner[np.linalg.norm(node_mm[inner] - wanted, axis=1).argmin()])
    if (node_mm[row, 0] < 1e-7) != (wanted[0] < 1e-7):
        return
    around = quad[(quad == row).any(axis=1)]
    edges = np.stack([around, np.roll(around, -1, axis=1)], -1).reshape(-1, 2)
    edges = edges[(edges == row).any(axis=1)]
    lengths_mm = np.linalg.norm(node_mm[edges[:, 0]] - node_mm[edges[:, 1]], axis=1)
    if np.linalg.norm(node_mm[row] - wanted) <= 0.45 * lengths_mm.min():
        node_mm[row] = wanted


def _mirrored(node_mm: FloatArray, quad: IntArray, layer: IntArray) -> Mesh:
    """Join a right half with its mirror image; number nodes from the pad inwards."""
    node_mm = node_mm.copy()
    corner = node_mm[quad]
    ahead, across = corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1]
    clockwise = ahead[:, 0] * across[:, 1] - ahead[:, 1] * across[:, 0] < 0
    quad = np.where(clockwise[:, None], quad[:, ::-1], quad)
    on_axis = np.abs(node_mm[:, 0]) < 1e-7
    node_mm[on_axis, 0] = 0.0
    image = np.where(
        on_axis, np.arange(len(node_mm)), len(node_mm) + np.cumsum(~on_axis) - 1
    )
    nodes = np.concatenate([node_mm, node_mm[~on_axis] * [-1.0, 1.0]])
    quads = np.concatenate([quad, image[quad][:, ::-1]])
    layers = np.concatenate([layer, layer])
    order = np.lexsort((nodes[:, 0], -nodes[:, 1]))
    new_row = np.empty_like(order)
    new_row[order] = np.arange(len(order))
    quads = new_row[quads]
    first = quads.argmin(axis=1)
    quads = np.take_along_axis(quads, (first[:, None] + np.arange(4)) % 4, axis=1)
    sort = np.lexsort((quads[:, 0], layers))
    return Mesh(nodes[order], quads[sort], layers[sort])
