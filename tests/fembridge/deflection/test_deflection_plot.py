"""The picture of profiles: what is in it, and that nothing is on anything else."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from fembridge.deflection.profile import stored_deflections
from fembridge.errors import UsageError
from fembridge.plots.deflection import MOST_MESHES, deflection_figure
from fembridge.plots.style import save_figure

STORED = stored_deflections()


def drawn(figure):
    """Lay the figure out, as saving it does."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return canvas.get_renderer()


def test_down_is_down_and_each_mesh_has_its_line():
    panel = deflection_figure(STORED).axes[0]
    bottom, top = panel.get_ylim()
    assert bottom > 1.0 > 0.0 > top
    named = {line.get_label(): line for line in panel.get_lines()}
    for mesh in STORED:
        (line,) = (named[label] for label in named if label.startswith(mesh.name))
        assert_array_equal(line.get_xdata(), mesh.distance_mm)
        assert_array_equal(line.get_ydata(), mesh.deflection_mm)


def test_the_dots_are_those_of_the_finest_mesh_every_half_millimetre():
    panel = deflection_figure(STORED).axes[0]
    (dots,) = (line for line in panel.get_lines() if line.get_marker() == "o")
    assert_allclose(dots.get_xdata(), np.arange(0, 6.01, 0.5))
    assert_allclose(dots.get_ydata(), STORED[-1].at(np.arange(0, 6.01, 0.5)))


def test_the_middle_panel_shows_micrometres_from_the_finest_mesh():
    panel = deflection_figure(STORED).axes[1]
    zero, *lines = panel.get_lines()
    assert_array_equal(zero.get_ydata(), [0, 0])
    assert len(lines) == len(STORED) - 1
    for mesh, line in zip(STORED, lines, strict=False):
        at_mm = line.get_xdata()
        expected_um = 1000 * (mesh.at(at_mm) - STORED[-1].at(at_mm))
        assert_allclose(line.get_ydata(), expected_um)


def test_one_mesh_has_nothing_to_differ_from():
    figure = deflection_figure(STORED[:1])
    assert len(figure.axes) == 2
    assert_allclose(figure.axes[1].get_lines()[0].get_ydata(), 1000 * STORED[0].loading_n_per_mm)


def test_the_legend_covers_no_line():
    figure = deflection_figure(STORED)
    renderer = drawn(figure)
    panel = figure.axes[0]
    box = panel.get_legend().get_window_extent(renderer)
    for mesh in STORED:
        every_mm = np.linspace(0, 6, 601)
        points = np.stack([every_mm, mesh.at(every_mm)], -1)
        assert not box.count_contains(panel.transData.transform(points))


def test_colours_differ_from_mesh_to_mesh():
    lines = deflection_figure(STORED).axes[-1].get_lines()
    assert len({line.get_color() for line in lines}) == len(STORED)


def test_the_order_in_which_meshes_come_changes_no_byte(tmp_path):
    save_figure(deflection_figure(STORED), tmp_path / "a.svg")
    save_figure(deflection_figure(STORED[::-1]), tmp_path / "b.svg")
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


@pytest.mark.parametrize("count", [0, MOST_MESHES + 1])
def test_no_mesh_or_too_many_make_no_picture(count):
    with pytest.raises(UsageError, match=f"{count} profiles, expected 1 to 5"):
        deflection_figure([STORED[0]] * count)
