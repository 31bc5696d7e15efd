"""A touch as a moving picture: contact pressure, stress under the skin, spikes."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.errors import MissingError, UsageError
from fembridge.plots.pad import (
    draw_pressure,
    draw_way,
    hardest,
    look_at_pad,
    pressure_kpa,
    view_mm,
)
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    HAIR_PT,
    INK,
    PAGE_WIDTH_IN,
    TEXT_PT,
    in_style,
)
from fembridge.store import replacing
from fembridge.touching.stress import influence_pa, von_mises_pa
from fembridge.touching.touch import Touch
from fembridge.typing import FloatArray, IntArray

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

FRAMES = 60
_FRAMES_A_SECOND = 12
_DPI = 90
# A unit is lit for so long after a spike.
_LIT_MS = 25.0
_GRID_MM = 0.5
_KPA = 1e-3


def check_movie(path: Path) -> None:
    """Refuse what cannot be written, before anything is computed.

    Raises
    ------
    UsageError
        Another suffix than .gif or .mp4.
    MissingError
        An MP4 without ffmpeg.
    """
    if path.suffix.lower() not in (".gif", ".mp4"):
        raise UsageError(f"{path}: expected a name in .gif or .mp4")
    from matplotlib.animation import FFMpegWriter

    if path.suffix.lower() == ".mp4" and not FFMpegWriter.isAvailable():
        raise MissingError("an MP4 takes ffmpeg, which is not on the PATH; take .gif")


@in_style
def write_movie(path: Path, touch: Touch) -> None:
    """Write a GIF, or an MP4 where ffmpeg is installed; see `check_movie`."""
    check_movie(path)
    from matplotlib.animation import FFMpegWriter
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    samples = np.unique(np.linspace(0, touch.way.pressed.size - 1, FRAMES).astype(np.int64))
    figure, moving, show = _scene(touch, samples)
    canvas = FigureCanvasAgg(figure)
    figure.set_dpi(_DPI)
    with replacing(path) as draft:
        if path.suffix.lower() == ".gif":
            _write_gif(draft, canvas, moving, show, samples)
            return
        writer = FFMpegWriter(fps=_FRAMES_A_SECOND)
        with writer.saving(figure, draft, _DPI):
            for sample in samples.tolist():
                show(sample)
                writer.grab_frame()


def _write_gif(
    path: Path,
    canvas: Any,  # noqa: ANN401 - its methods are untyped
    moving: "Sequence[Artist]",
    show: Callable[[int], None],
    samples: IntArray,
) -> None:
    """What stands still is drawn once."""
    from PIL import Image

    for one in moving:
        one.set_animated(True)
    canvas.draw()
    still = canvas.copy_from_bbox(canvas.figure.bbox)
    pictures = []
    for sample in samples.tolist():
        canvas.restore_region(still)
        show(sample)
        for one in moving:
            canvas.figure.draw_artist(one)
        picture = Image.fromarray(np.array(canvas.buffer_rgba())).convert("RGB")
        pictures.append(picture.quantize(256))
    pictures[0].save(
        path,
        format="GIF",
        save_all=True,
        append_images=pictures[1:],
        duration=round(1000 / _FRAMES_A_SECOND),
        loop=0,
    )


def _scene(
    touch: Touch, samples: IntArray
) -> tuple["Figure", "list[Artist]", Callable[[int], None]]:
    """The figure, what moves in it, and what brings that to a sample."""
    from matplotlib.figure import Figure
    from scipy.interpolate import make_interp_spline

    half_width, half_length = view_mm(touch)
    tall_in = min((PAGE_WIDTH_IN - 1.6) / 3 * half_length / half_width, 3.6)
    height_in = tall_in + 1.9
    figure = Figure(figsize=(PAGE_WIDTH_IN, height_in))
    top = 1 - 0.53 / height_in  # the clock stands above
    grid = figure.add_gridspec(
        2, 3, height_ratios=[tall_in, 0.7], left=0.08, right=0.93, bottom=0.1, top=top, hspace=0.45
    )
    panels = [figure.add_subplot(grid[0, column]) for column in range(3)]
    for panel in panels:
        look_at_pad(panel, touch)
        panel.set_xlabel("Across (mm)")
    panels[0].set_ylabel("Along (mm)")
    way = figure.add_subplot(grid[1, :])
    draw_way(way, touch)
    cursor = way.axvline(0.0, color=INK, linewidth=HAIR_PT)
    pressure = draw_pressure(panels[0], touch, hardest(touch))
    most_kpa = pressure.get_clim()[1] if pressure else 0.0
    panels[0].set_title(f"Pressure, up to {most_kpa:.0f} kPa", fontsize=TEXT_PT)
    field, extent = _stress_field(touch)
    top_kpa = max(float(np.percentile(field, 99.9)) * _KPA, 1e-3)
    stress = panels[1].imshow(
        field[0], extent=extent, origin="lower", cmap="magma", vmin=0, vmax=top_kpa,
        interpolation="bilinear", aspect="equal",
    )  # fmt: skip
    panels[1].set_title(f"Stress at SA, up to {top_kpa:.0f} kPa", fontsize=TEXT_PT)
    units = touch.population
    colours = [AFFERENT_COLOURS[name] for name in units.afferent]
    panels[2].scatter(units.x_mm, units.z_mm, s=1.0, color=FAINT)
    lights = panels[2].scatter(units.x_mm, units.z_mm, s=0.0, c=colours, linewidths=0)
    panels[2].set_title(f"Spikes of the last {_LIT_MS:g} ms", fontsize=TEXT_PT)
    clock = figure.suptitle("")
    at, times_ms, fired = touch.solved.at, touch.way.times_ms, touch.fired
    frame_of = {int(sample): frame for frame, sample in enumerate(samples)}
    # Linear between states: enough for the eye.
    shown = make_interp_spline(touch.solved.knots, field, k=1)(at[samples]) * _KPA

    def show(sample: int) -> None:
        if pressure:
            row = int(np.abs(touch.solved.knots - at[sample]).argmin())
            pressure.set_array(pressure_kpa(touch, row))
        stress.set_data(shown[frame_of[sample]])
        since_ms = times_ms[sample] - fired.time_ms
        recent = fired.unit[(since_ms >= 0) & (since_ms < _LIT_MS)]
        lit = np.bincount(recent, minlength=len(units))
        lights.set_sizes(np.where(lit > 0, 10.0 + 6.0 * lit, 0.0))
        cursor.set_xdata([times_ms[sample]] * 2)
        clock.set_text(f"{times_ms[sample]:.0f} ms")

    moving = [*([pressure] if pressure else []), stress, lights, cursor, clock]
    return figure, moving, show


def _stress_field(touch: Touch) -> tuple[FloatArray, tuple[float, float, float, float]]:
    """Stress ``(state, z, x)`` at SA's depth on a grid, and the edges of that."""
    half_width, half_length = view_mm(touch)
    x_mm, z_mm = (np.arange(-half, half + _GRID_MM, _GRID_MM) for half in (half_width, half_length))
    pad = touch.solved.nodes.pad
    site = pad.finger.afferents["SA"]
    x, z = (each.ravel() for each in np.meshgrid(x_mm, z_mm))
    inside = np.clip(x, -pad.widest_mm, pad.widest_mm)
    depth = np.full(x.size, site.depth_mm)
    influence = influence_pa(pad, touch.solved.nodes, np.full(x.size, site.layer), inside, z, depth)
    field = von_mises_pa(influence, touch.solved.forces_n).reshape(-1, z_mm.size, x_mm.size)
    margin = 0.5 * _GRID_MM
    edges = (x_mm[0] - margin, x_mm[-1] + margin, z_mm[0] - margin, z_mm[-1] + margin)
    return field, (float(edges[0]), float(edges[1]), float(edges[2]), float(edges[3]))
