"""A finger's half section drawn for gmsh: curves, their divisions, surfaces.

The skin's layers are patches with four sides (transfinite), so that the columns
under the probe stand upright and the same columns cross all three layers; the
subcutaneous tissue and the bone are filled freely.
"""

from itertools import pairwise
from typing import Any

import numpy as np

from decks.finger import LAYERS
from decks.meshing.columns import Columns, Division, columns_of, even, graded
from decks.section import Section

Surface = tuple[int, int]
"""gmsh's number of a surface, and the layer it belongs to (index of `LAYERS`)."""

# A boundary is a spline through this many points a column, at least.
_SAMPLES_A_COLUMN = 16
_LEAST_SAMPLES = 64
_BONE_SAMPLES = 200
# The afferent's point on the axis stays this far from dermis and bone.
_CLEAR_MM = 0.03


class SectionDrawing:
    """Draws `section` into pygmsh's `geometry`; columns grow to `far_mm`."""

    def __init__(
        self,
        geometry: Any,  # noqa: ANN401 - untyped library
        section: Section,
        far_mm: float,
    ) -> None:
        self._geometry, self._section, self._far_mm = geometry, section, far_mm

    def draw(self) -> list[Surface]:
        """Draw everything; give the surfaces with their layers."""
        columns = columns_of(self._section, self._far_mm)
        section = self._section
        depths = (section.surface, section.corneum, section.epidermis, section.dermis)
        boundaries = [self._boundary(columns, depth) for depth in depths]
        resolution = section.finger.resolution
        rows = (resolution.stratum_corneum_rows, resolution.epidermis_rows, resolution.dermis_rows)
        surfaces: list[Surface] = []
        for band, count in enumerate(rows):
            surfaces += self._band(band, count, boundaries[band], boundaries[band + 1])
        surfaces += self._inside(*boundaries[-1])
        far_mm = self._far_mm
        self._geometry.set_mesh_size_callback(lambda dim, tag, x, y, z, lc: min(lc, far_mm))
        return surfaces

    def _boundary(
        self,
        columns: Columns,
        depth: Any,  # noqa: ANN401
    ) -> tuple[list[Any], list[Any]]:
        """Draw one boundary of the layers: its curves, and the points between them."""
        geometry = self._geometry
        knots: list[Any] = []
        curves: list[Any] = []
        patches = zip(pairwise(columns.break_mm), columns.division, strict=True)
        for (start_mm, end_mm), division in patches:
            samples = max(_SAMPLES_A_COLUMN * division.count, _LEAST_SAMPLES)
            arc_mm = np.linspace(start_mm, end_mm, samples + 1)
            points = self._section.curve(depth, arc_mm)
            if not knots:
                knots.append(self._point(points[0]))
            knots.append(self._point(points[-1]))
            inner = [self._point(point) for point in points[1:-1]]
            curves.append(geometry.add_spline([knots[-2], *inner, knots[-1]]))
            self._divide(curves[-1], division)
        return curves, knots

    def _band(
        self,
        band: int,
        rows: int,
        upper: tuple[list[Any], list[Any]],
        lower: tuple[list[Any], list[Any]],
    ) -> list[Surface]:
        """Draw the patches of one layer, between two boundaries."""
        geometry = self._geometry
        (above, top), (below, bottom) = upper, lower
        upright = [geometry.add_line(*ends) for ends in zip(top, bottom, strict=True)]
        for line in upright:
            self._divide(line, Division(rows))
        surfaces = []
        for k in range(len(above)):
            loop = geometry.add_curve_loop([above[k], upright[k + 1], -below[k], -upright[k]])
            surface = geometry.add_plane_surface(loop)
            corners = [top[k], top[k + 1], bottom[k + 1], bottom[k]]
            geometry.set_transfinite_surface(surface, "Left", corners)
            on_back = band == 0 and k == len(above) - 1
            name = "nail" if on_back else LAYERS[band]
            surfaces.append((surface._id, LAYERS.index(name)))
        return surfaces

    def _inside(self, dermis: list[Any], knots: list[Any]) -> list[Surface]:
        """Draw subcutaneous tissue and bone, below the lower side of the dermis."""
        geometry, far_mm = self._geometry, self._far_mm
        points = self._section.bone(np.linspace(0.0, np.pi, _BONE_SAMPLES + 1))
        bone_knots = [self._point(point) for point in points]
        bone = geometry.add_spline(bone_knots)
        way_mm = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        self._divide(bone, even(way_mm, far_mm))
        middle = geometry.add_line(bone_knots[-1], bone_knots[0])
        height_mm = 2 * self._section.finger.bone.half_height_mm
        self._divide(middle, even(height_mm, far_mm))
        bottom = geometry.add_line(bone_knots[-1], knots[-1])
        top = self._axis(knots[0], bone_knots[0], -points[0, 1])
        below_mm = points[-1, 1] - float(knots[-1].x[1])
        self._divide(bottom, graded(below_mm, far_mm, far_mm))
        around = [*dermis, -bottom, -bone, *(-line for line in reversed(top))]
        tissue = geometry.add_plane_surface(geometry.add_curve_loop(around))
        inside = geometry.add_plane_surface(geometry.add_curve_loop([bone, middle]))
        geometry.set_recombined_surfaces([tissue, inside])
        return [
            (tissue._id, LAYERS.index("subcutaneous_tissue")),
            (inside._id, LAYERS.index("bone")),
        ]

    def _axis(
        self,
        dermis: Any,  # noqa: ANN401
        bone: Any,  # noqa: ANN401
        bone_mm: float,
    ) -> list[Any]:
        """Draw the line from dermis to bone, with a node where an afferent sits."""
        skin = self._section.finger.skin
        fine_mm = skin.dermis_mm / self._section.finger.resolution.dermis_rows
        lines: list[Any] = []
        here, here_mm = dermis, skin.dermis_depth_mm
        for stop_mm in self._sites_on_axis():
            there = self._geometry.add_point([0.0, -stop_mm, 0.0])
            lines.append(self._geometry.add_line(here, there))
            self._divide(lines[-1], graded(stop_mm - here_mm, fine_mm, fine_mm))
            here, here_mm = there, stop_mm
        lines.append(self._geometry.add_line(here, bone))
        self._divide(lines[-1], graded(bone_mm - here_mm, fine_mm, self._far_mm))
        return lines

    def _sites_on_axis(self) -> list[float]:
        finger = self._section.finger
        least_mm = finger.skin.dermis_depth_mm + _CLEAR_MM
        most_mm = finger.bone.depth_mm - finger.bone.half_height_mm - _CLEAR_MM
        return sorted(
            {
                site.depth_mm
                for site in finger.afferents.values()
                if site.layer == "subcutaneous_tissue"
                and site.x_mm == 0
                and least_mm < site.depth_mm < most_mm
            }
        )

    def _point(self, point_mm: Any) -> Any:  # noqa: ANN401
        return self._geometry.add_point([*point_mm, 0.0])

    def _divide(
        self,
        curve: Any,  # noqa: ANN401
        division: Division,
    ) -> None:
        self._geometry.set_transfinite_curve(
            curve, division.count + 1, "Progression", division.growth
        )
