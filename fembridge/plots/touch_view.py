"""A touch from above: where the shape is, how hard it presses, and who fires how much.

Pictures, and a moving picture: contact pressure, stress under the skin, spikes.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.errors import MissingError, UsageError
from fembridge.host.store import replacing
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    HAIR_PT,
    INK,
    LINE_PT,
    PAGE_WIDTH_IN,
    SERIES_COLOURS,
    SMALL_TEXT_PT,
    TEXT_PT,
    TINY_TEXT_PT,
    WHITE,
    checked_axes,
    class_style,
    in_style,
    make_plain,
    new_figure,
)
from fembridge.typing import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from PIL.Image import Image

    from fembridge.touching.touch_result import Touch

# A unit's area in the picture grows with its rate up to this, that of the class's
# liveliest unit, in points squared.
_LEAST_PT2, _MOST_PT2 = 1.5, 38.0
_MARGIN_MM = 0.8
# A view is at least so long, of its width.
_LEAST_SHARE = 0.8
_TRACE_IN = 0.75
_MOST_HEIGHT_IN = 4.2
_KPA_PER_N_MM2 = 1000.0
_MOST_ROWS = 60
_FORCE_COLOUR = SERIES_COLOURS[2]

# Moving.
FRAMES = 60
_FRAMES_A_SECOND = 12
_DPI = 90
# A unit is lit for so long after a spike.
_LIT_MS = 25.0
_GRID_MM = 0.5
_KPA = 1e-3


@in_style
def pad_figure(touch: "Touch", axes: "Sequence[Axes] | None" = None) -> "Figure":
    """The pad from above, a panel a class: units by rate, contact pressure, and the trajectory.

    A panel of depth and force follows. `axes` are these panels in the figure of the caller, with
    or without the last. Raises UsageError: another number of axes.
    """
    classes = [name for name in AFFERENT_COLOURS if name in touch.population.afferent]
    if axes is None:
        figure, panels = _pad_panels(touch, len(classes))
    else:
        count = len(classes) if len(axes) == len(classes) else len(classes) + 1
        figure, panels = checked_axes(axes, count)
    image = None
    for column, name in enumerate(classes):
        panel = panels[column]
        image = _draw_pressure(panel, touch, _hardest(touch))
        is_class = np.array(touch.population.afferent) == name
        _draw_units(panel, touch, is_class, AFFERENT_COLOURS[name])
        _draw_view(panel, touch, first=column == 0)
        firing = int((touch.rate_ips[is_class] > 0).sum())
        panel.set_title(f"{name}: {firing} of {int(is_class.sum())} fire", **class_style(name))
    if image is not None:
        neighbours = list(panels[: len(classes)]) if axes is None else panels[len(classes) - 1]
        bar = figure.colorbar(image, ax=neighbours, fraction=0.025, pad=0.01, shrink=0.9)
        bar.set_label("Contact pressure (kPa)")
        make_plain(bar.ax)
    if len(panels) > len(classes):
        _draw_samples(panels[-1], touch)
    return figure


def _pad_panels(touch: "Touch", classes: int) -> "tuple[Figure, list[Axes]]":
    """A new figure with a panel a class and one of depth and force below."""
    from fembridge.plots.notebook_figure import NotebookFigure

    width_mm, height_mm = (2 * half_mm for half_mm in _view_mm(touch))
    panel_in = (PAGE_WIDTH_IN - 1.4) / 3
    tall_in = min(panel_in * height_mm / width_mm, _MOST_HEIGHT_IN)
    figure = NotebookFigure(
        figsize=(PAGE_WIDTH_IN, tall_in + _TRACE_IN + 1.25), layout="constrained"
    )
    grid = figure.add_gridspec(
        2, classes, height_ratios=[tall_in, _TRACE_IN], hspace=0.04, wspace=0.02
    )
    panels = [figure.add_subplot(grid[0, column]) for column in range(classes)]
    return figure, [*panels, figure.add_subplot(grid[1, :])]


@in_style
def force_figure(touch: "Touch", axes: "Sequence[Axes] | None" = None) -> "Figure":
    """Depth and force of the shape over time; `axes` is the one panel to draw into."""
    figure, panels = new_figure(_TRACE_IN + 1.2, axes=axes)
    _draw_samples(panels[0, 0], touch)
    return figure


@in_style
def unit_raster_figure(touch: "Touch", axes: "Sequence[Axes] | None" = None) -> "Figure":
    """Depth and force, then the spikes of every unit that fires, a panel a class.

    Units are in order along the finger. `axes` are these panels. Raises UsageError: another
    number of axes.
    """
    classes = [name for name in AFFERENT_COLOURS if name in touch.population.afferent]
    units, fired = touch.population, touch.fired
    along_finger = np.lexsort((units.x_mm, units.z_mm))
    firing = along_finger[np.isin(along_finger, fired.unit)]
    rows = {name: firing[np.array(units.afferent)[firing] == name] for name in classes}
    heights = [max(0.45, min(2.6, 0.028 * rows[name].size * touch.trials)) for name in classes]
    figure, panels = new_figure(
        sum(heights) + _TRACE_IN + 0.9,
        len(classes) + 1,
        sharex=True,
        heights=[_TRACE_IN, *heights],
        axes=axes,
    )
    _draw_samples(panels[0, 0], touch)
    panels[0, 0].set_xlabel("")
    for panel, name in zip(panels[1:, 0], classes, strict=True):
        line = np.full(len(units), -1)
        line[rows[name]] = np.arange(rows[name].size)
        is_class = line[fired.unit] >= 0
        bottom = line[fired.unit[is_class]] + (fired.trial[is_class] - 1) / touch.trials + 0.05
        lines = max(rows[name].size, 1)
        panel.vlines(
            fired.time_ms[is_class],
            bottom,
            bottom + 0.85 / touch.trials,
            colors=AFFERENT_COLOURS[name],
            linewidths=LINE_PT if lines < _MOST_ROWS else 0.6,
        )
        panel.set_ylim(0, lines)
        panel.set_yticks([])
        style = class_style(name, SMALL_TEXT_PT) | {"rotation": 0, "ha": "right", "va": "center"}
        panel.set_ylabel(f"{name}\n{rows[name].size} units", **style)
    panels[-1, 0].set_xlabel("Time (ms), units from base to tip")
    panels[0, 0].set_xlim(0, float(touch.trajectory.times_ms[-1]))
    return figure


PICTURES = {"pad": pad_figure, "raster": unit_raster_figure}
"""Pictures that ``fembridge touch`` writes, by their names."""


def _view_mm(touch: "Touch") -> tuple[float, float]:
    """Half width and half length of the view: units, contact and outline, with a margin."""
    units, nodes = touch.population, touch.contact.nodes
    outline_mm = nodes.pad.outline()
    along_mm = outline_mm[:, 1::2] if nodes.pad.outline_ends else outline_mm[:0]
    half_width, half_length = (
        float(np.abs(np.concatenate([np.ravel(part) for part in parts])).max(initial=1.0))
        + _MARGIN_MM
        for parts in (
            (units.x_mm, nodes.x_mm, outline_mm[:, ::2]),
            (units.z_mm, nodes.z_mm, along_mm),
        )
    )
    return half_width, max(half_length, _LEAST_SHARE * half_width)


def _look_at_pad(panel: "Axes", touch: "Touch") -> tuple[float, float]:
    """Show what is in view and the outline, x as long as z; half width and half length of that."""
    from matplotlib.collections import LineCollection

    half_width, half_length = _view_mm(touch)
    pieces_mm = touch.contact.nodes.pad.outline().reshape(-1, 2, 2)
    panel.add_collection(LineCollection(list(pieces_mm), colors=INK, linewidths=HAIR_PT, zorder=1))
    panel.set_xlim(-half_width, half_width)
    panel.set_ylim(-half_length, half_length)
    panel.set_aspect("equal")
    make_plain(panel)
    return half_width, half_length


def _draw_pressure(panel: "Axes", touch: "Touch", row: int) -> Any:  # noqa: ANN401 - an image
    """Contact pressure of the solved state `row` as a map; None where nothing touches."""
    from matplotlib.colors import LinearSegmentedColormap

    if not touch.contact.nodes.size:
        return None
    nodes, values = touch.contact.nodes, _pressure_kpa(touch, row)
    cells = nodes.cells()
    top = max(float(np.nanmax(values, initial=0.0)), 1e-3)
    # Greys without white and black: on paper all of it is seen.
    greys = LinearSegmentedColormap.from_list("pressure", ["#E4E4E4", "#303030"])
    look: dict[str, Any] = {"cmap": greys, "vmin": 0.0, "vmax": top, "rasterized": True}
    if cells.triangles is not None:
        return panel.tripcolor(
            cells.x_mm, cells.z_mm, np.ma.masked_invalid(values), triangles=cells.triangles, **look
        )
    along_mm = _view_mm(touch)[1] * np.array([-1, 1]) if nodes.pad.plane else cells.z_mm
    return panel.pcolormesh(cells.x_mm, along_mm, values, **look)


def _pressure_kpa(touch: "Touch", row: int) -> FloatArray:
    """Pressure on the cells of the skin; NaN where nothing touches."""
    nodes = touch.contact.nodes
    pressure_kpa = touch.contact.forces_n[row] / nodes.area_mm2 * _KPA_PER_N_MM2
    return nodes.cells().values(pressure_kpa)


def _draw_samples(panel: "Axes", touch: "Touch") -> None:
    """Depth and force over time."""
    times_ms, depth_um = touch.trajectory.times_ms, touch.depth_um
    panel.plot(times_ms, depth_um)
    panel.set_xlabel("Time (ms)")
    panel.set_ylabel("Depth (µm)")
    panel.set_ylim(min(float(depth_um.min()), 0.0), 1.15 * max(float(depth_um.max()), 1.0))
    panel.set_xlim(0, float(times_ms[-1]))
    other = panel.twinx()
    other.plot(times_ms, touch.force_n, color=_FORCE_COLOUR, linestyle=(0, (4, 1.5)))
    unit = "N/mm" if touch.contact.nodes.pad.plane else "N"
    other.set_ylabel(f"Force ({unit})", color=_FORCE_COLOUR)
    other.spines["right"].set_visible(True)
    other.spines["left"].set_visible(False)
    other.set_ylim(0, 1.15 * max(float(touch.force_n.max()), 1e-6))
    for axes in (panel, other):
        make_plain(axes)


def _draw_units(panel: "Axes", touch: "Touch", is_class: BoolArray, colour: str) -> None:
    """Units of a class, larger the more they fire, and what the largest stands for."""
    rate, units = touch.rate_ips[is_class], touch.population
    x_mm, z_mm, fires = units.x_mm[is_class], units.z_mm[is_class], rate > 0
    hollow: dict[str, Any] = {"facecolors": "none", "edgecolors": FAINT, "linewidths": 0.35}
    panel.scatter(x_mm[~fires], z_mm[~fires], s=_LEAST_PT2, zorder=2, **hollow)
    if not fires.any():
        return
    most_ips = float(rate.max())
    firing: dict[str, Any] = {"color": colour, "edgecolors": WHITE, "linewidths": 0.3}
    firing |= {"alpha": 0.9, "zorder": 3}
    size_pt2 = _LEAST_PT2 + (_MOST_PT2 - _LEAST_PT2) * rate[fires] / most_ips
    panel.scatter(x_mm[fires], z_mm[fires], s=size_pt2, **firing)
    panel.legend(
        [panel.scatter([], [], s=_MOST_PT2, **firing)],
        [f"{most_ips:.3g}/s"],
        loc="lower right",
        fontsize=SMALL_TEXT_PT - 1,
        frameon=True,
        framealpha=0.85,
        edgecolor="none",
        borderpad=0.2,
        handletextpad=0.2,
    )


def _draw_view(panel: "Axes", touch: "Touch", *, first: bool) -> None:
    half_width, half_length = _look_at_pad(panel, touch)
    panel.set_xlabel("Across the finger (mm)")
    panel.set_ylabel("Along the finger (mm)" if first else "")
    if not first:
        panel.tick_params(labelleft=False)
    x_mm, z_mm = touch.trajectory.x_mm, touch.trajectory.z_mm
    if x_mm is None or z_mm is None:
        return
    path_mm = np.stack([x_mm, z_mm], -1)
    moved = path_mm - path_mm[0]
    step = moved[np.hypot(*moved.T).argmax()]  # the farthest
    arrow = {"arrowstyle": "->", "color": INK, "linewidth": LINE_PT}
    if np.abs(moved @ (-step[1], step[0])).max() > 0.01 * float(step @ step):
        panel.plot(x_mm, z_mm, linewidth=HAIR_PT)  # a curve
        panel.annotate(
            "", xy=path_mm[-1], xytext=path_mm[-1 - len(path_mm) // 10], arrowprops=arrow
        )
    elif step.any():  # an arrow of 2.5 mm in that direction
        half = 1.25 * step / np.hypot(*step)
        middle = np.array([1.6 - half_width, half_length - 1.6])
        panel.annotate("", xy=middle + half, xytext=middle - half, arrowprops=arrow)


def _hardest(touch: "Touch") -> int:
    """The solved state with the largest force that was reached."""
    return touch.contact.hardest if touch.contact.forces_n.size else 0


def check_movie(path: Path) -> None:
    """Refuse a file that cannot be written, before anything is computed.

    Raises UsageError: another suffix than .gif or .mp4. MissingError: an MP4 without ffmpeg.
    """
    if path.suffix.lower() not in (".gif", ".mp4"):
        raise UsageError(f"{path}: expected a name in .gif or .mp4", expected=".gif or .mp4")
    from matplotlib.animation import FFMpegWriter

    if path.suffix.lower() == ".mp4" and not FFMpegWriter.isAvailable():
        raise MissingError("an MP4 takes ffmpeg, which is not on the PATH; take .gif")


@in_style
def write_movie(path: Path, touch: "Touch") -> None:
    """Write a GIF, or an MP4 where ffmpeg is installed; see `check_movie`."""
    check_movie(path)
    from matplotlib.animation import FFMpegWriter
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    samples = np.unique(np.linspace(0, touch.trajectory.level.size - 1, FRAMES).astype(np.int64))
    figure, moving, show = _scene(touch, samples)
    canvas = FigureCanvasAgg(figure)
    figure.set_dpi(_DPI)
    with replacing(path) as draft:
        if path.suffix.lower() == ".gif":
            first, *others = _pictures(canvas, moving, show, samples)
            how = {"duration": round(1000 / _FRAMES_A_SECOND), "loop": 0}
            first.save(draft, format="GIF", save_all=True, append_images=others, **how)
            return
        writer = FFMpegWriter(fps=_FRAMES_A_SECOND)
        with writer.saving(figure, draft, _DPI):
            for sample in samples.tolist():
                show(sample)
                writer.grab_frame()


# Pillow's MAXCOVERAGE: colours of few pixels, as the dots of a legend, stay what they are.
_FEW_DOTS = 1


def _pictures(
    canvas: Any,  # noqa: ANN401 - its methods are untyped
    moving: "Sequence[Artist]",
    show: Callable[[int], None],
    samples: IntArray,
) -> "Iterator[Image]":
    """A picture a sample; the parts that do not move are drawn once."""
    from PIL.Image import fromarray

    for artist in moving:
        artist.set_animated(True)
    canvas.draw()
    still = canvas.copy_from_bbox(canvas.figure.bbox)
    for sample in samples.tolist():
        canvas.restore_region(still)
        show(sample)
        for artist in moving:
            canvas.figure.draw_artist(artist)
        yield fromarray(np.array(canvas.buffer_rgba())).convert("RGB").quantize(256, _FEW_DOTS)


def _scene(
    touch: "Touch", samples: IntArray
) -> tuple["Figure", "list[Artist]", Callable[[int], None]]:
    """The figure, its moving parts, and a function that moves them to a sample."""
    from matplotlib.lines import Line2D
    from scipy.interpolate import make_interp_spline

    from fembridge.plots.notebook_figure import NotebookFigure

    half_width, half_length = _view_mm(touch)
    tall_in = min((PAGE_WIDTH_IN - 1.6) / 3 * half_length / half_width, 3.6)
    height_in = tall_in + 1.9
    figure = NotebookFigure(figsize=(PAGE_WIDTH_IN, height_in))
    top = 1 - 0.53 / height_in  # the clock stands above
    grid = figure.add_gridspec(
        2, 3, height_ratios=[tall_in, 0.7], left=0.08, right=0.93, bottom=0.1, top=top, hspace=0.45
    )
    panels = [figure.add_subplot(grid[0, column]) for column in range(3)]
    for panel in panels:
        _look_at_pad(panel, touch)
        panel.set_xlabel("Across (mm)")
    panels[0].set_ylabel("Along (mm)")
    samples_panel = figure.add_subplot(grid[1, :])
    _draw_samples(samples_panel, touch)
    cursor = samples_panel.axvline(0.0, color=INK, linewidth=HAIR_PT)
    pressure = _draw_pressure(panels[0], touch, _hardest(touch))
    most_kpa = pressure.get_clim()[1] if pressure else 0.0
    panels[0].set_title("Contact pressure", fontsize=TEXT_PT)
    if pressure and most_kpa:
        _scale_beside(panels[0], pressure, "kPa")
    knots, position = touch.contact.knots, touch.contact.position
    # The states on both sides of each frame.
    after = np.clip(np.searchsorted(knots, position[samples]), 1, knots.size - 1)
    states = np.unique(np.concatenate([after - 1, after]))
    field, extent, beside = _stress_field(touch, states)
    top_kpa = max(float(np.percentile(field, 99.9)) * _KPA, 1e-3)
    stress = panels[1].imshow(
        field[0], extent=extent, origin="lower", cmap="magma", vmin=0, vmax=top_kpa,
        interpolation="bilinear", aspect="equal",
    )  # fmt: skip
    panels[1].set_title("Stress where SA is", fontsize=TEXT_PT)
    _scale_beside(panels[1], stress, "kPa")
    units = touch.population
    colours = [AFFERENT_COLOURS[name] for name in units.afferent]
    panels[2].scatter(units.x_mm, units.z_mm, s=1.0, color=FAINT)
    lights = panels[2].scatter(units.x_mm, units.z_mm, s=0.0, c=colours, linewidths=0)
    panels[2].set_title(f"Spikes of the last {_LIT_MS:g} ms", fontsize=TEXT_PT)
    named = [Line2D([], [], ls="", marker="o", ms=4, color=AFFERENT_COLOURS[name], label=name)
             for name in dict.fromkeys(units.afferent)]  # fmt: skip
    panels[2].legend(
        handles=named, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=len(named),
        frameon=False, handletextpad=0.1, columnspacing=0.8,
    )  # fmt: skip
    clock = figure.suptitle("")
    times_ms, fired = touch.trajectory.times_ms, touch.fired
    frame_of = {int(sample): frame for frame, sample in enumerate(samples)}
    # Linear between states: enough for the eye.
    shown = make_interp_spline(knots[states], field, k=1)(position[samples]) * _KPA
    shown[:, beside] = np.nan

    def show(sample: int) -> None:
        if pressure:
            row = int(np.abs(knots - position[sample]).argmin())
            pressure.set_array(_pressure_kpa(touch, row))
        stress.set_data(shown[frame_of[sample]])
        since_ms = times_ms[sample] - fired.time_ms
        recent = fired.unit[(since_ms >= 0) & (since_ms < _LIT_MS)]
        lit = np.bincount(recent, minlength=len(units))
        lights.set_sizes(np.where(lit > 0, 10.0 + 6.0 * lit, 0.0))
        cursor.set_xdata([times_ms[sample]] * 2)
        clock.set_text(f"{times_ms[sample]:.0f} ms")

    moving = [*([pressure] if pressure else []), stress, lights, cursor, clock]
    return figure, moving, show


def _scale_beside(panel: "Axes", image: Any, unit: str) -> None:  # noqa: ANN401 - any mappable
    """Colour bar beside a `panel`, which keeps its size; moving parts would cover one inside."""
    place = panel.inset_axes((1.03, 0.0, 0.04, 0.45))
    bar = panel.figure.colorbar(image, cax=place)
    place.tick_params(labelsize=TINY_TEXT_PT, length=2, colors=INK)
    place.set_title(unit, fontsize=TINY_TEXT_PT)
    bar.outline.set_linewidth(HAIR_PT)


def _stress_field(
    touch: "Touch", states: IntArray
) -> tuple[FloatArray, tuple[float, float, float, float], BoolArray]:
    """Stress ``(state, z, x)`` at SA's depth on a grid in some states, and the edges of that.

    And the points of the grid ``(z, x)`` beside the skin of which the pad has stress.
    """
    half_width, half_length = _view_mm(touch)
    x_mm, z_mm = (np.arange(-half, half + _GRID_MM, _GRID_MM) for half in (half_width, half_length))
    field = touch.skin_stress_pa(states, x_mm, z_mm)
    across_mm, along_mm = (axis.ravel() for axis in np.meshgrid(x_mm, z_mm))
    nearest_mm = touch.contact.nodes.pad.clipped(across_mm, along_mm)
    beside = np.hypot(nearest_mm[0] - across_mm, nearest_mm[1] - along_mm) > _GRID_MM
    beside = beside.reshape(field.shape[1:])
    margin = 0.5 * _GRID_MM
    edges = (x_mm[0] - margin, x_mm[-1] + margin, z_mm[0] - margin, z_mm[-1] + margin)
    extent = float(edges[0]), float(edges[1]), float(edges[2]), float(edges[3])
    return field, extent, beside
