"""The picture of a mesh; and no words of any picture run out of it, or into other words."""

from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from decks.finger import AfferentSite, Material
from decks.presets import PAPER, QUICK, mesh_of
from decks.probe import Probe
from decks.stimuli import CATALOGUE, resolve
from decks.synthesis import make_stimulus
from fembridge.errors import UsageError
from fembridge.io.spike_table import Rate, SpikeTrain
from fembridge.plots.finger_mesh import (
    afferent_nodes,
    boundary_edges,
    mesh_figure,
    pad_window,
    probe_outline,
)
from fembridge.plots.rate_comparison import rates_figure
from fembridge.plots.sensitivity_charts import effects_figure, regressions_figure
from fembridge.plots.spike_figures import isi_figure, psth_figure, raster_figure
from fembridge.plots.stress_history import trace_figure
from fembridge.plots.style import spread_heights
from fembridge.plots.waveform_overview import waveform_figure
from fembridge.sensitivity.effects import (
    OUTPUT,
    QUANTITIES,
    SweptFingers,
    rank_regressions,
    single_effects,
)
from fembridge.stimulus import Stimulus
from fembridge.trace import AFFERENTS, StressTrace

CROWDED = replace(
    QUICK,
    afferents={
        "SA": AfferentSite("epidermis", -0.25, 0.55),
        "RA": AfferentSite("epidermis", 0.25, 0.55),
        "PC": AfferentSite("epidermis", 0.0, 0.5),
    },
)
FAR = replace(
    QUICK,
    afferents={
        "SA": AfferentSite("epidermis", -1.5, 0.7),
        "PC": AfferentSite("subcutaneous_tissue", 1.0, 4.0),
    },
)


def test_a_boundary_is_an_edge_between_layers_or_with_one_element():
    mesh = mesh_of(QUICK)
    found = {}
    for element, quad in enumerate(mesh.quad.tolist()):
        for start, end in zip(quad, quad[1:] + quad[:1], strict=True):
            found.setdefault(frozenset((start, end)), []).append(mesh.layer[element])
    expected = {edge for edge, layers in found.items() if layers[0] != layers[-1]}
    expected |= {edge for edge, layers in found.items() if len(layers) == 1}
    row_of = {tuple(point): row for row, point in enumerate(mesh.node_mm.tolist())}
    ends = boundary_edges(mesh)
    drawn = [frozenset(row_of[tuple(end)] for end in pair) for pair in ends.tolist()]
    assert len(drawn) == len(expected)
    assert set(drawn) == expected


@pytest.mark.parametrize(
    ("shape", "diameter_mm"), [("cylinder", 0.05), ("cylinder", 1.0), ("flat", 0.2), ("flat", 3.0)]
)
def test_the_drawn_probe_is_as_wide_as_it_is_said_to_be_and_touches(shape, diameter_mm):
    mesh = mesh_of(QUICK)
    probe = Probe(shape=shape, diameter_mm=diameter_mm, x_mm=0.3)
    body_mm = probe_outline(probe, mesh)
    assert_allclose(np.ptp(body_mm[:, 0]), diameter_mm, rtol=1e-6)
    assert_allclose(body_mm[:, 0].mean(), 0.3, atol=0.02 * diameter_mm)
    skin_mm = np.linspace(boundary_edges(mesh)[:, 0], boundary_edges(mesh)[:, 1], 21)
    low = body_mm[body_mm[:, 1] <= body_mm[:, 1].min() + 0.1 * diameter_mm]
    gap_mm = np.linalg.norm(skin_mm.reshape(-1, 1, 2) - low, axis=-1).min()
    assert gap_mm < 0.02


@pytest.mark.parametrize("finger", [QUICK, PAPER])
def test_a_marked_afferent_is_the_node_that_a_deck_would_watch(finger):
    mesh = mesh_of(finger)
    for place in afferent_nodes(finger, mesh):
        row = mesh.node_at(finger.afferents[place.afferent])
        assert place.node == row + 1
        assert_array_equal(mesh.node_mm[row], [place.x_mm, place.y_mm])
        assert place.depth_mm == -place.y_mm


@pytest.mark.parametrize(
    ("finger", "probe"),
    [
        pytest.param(QUICK, Probe(), id="quick", marks=pytest.mark.slow),
        pytest.param(PAPER, Probe(diameter_mm=0.05, x_mm=-1.2), id="paper", marks=pytest.mark.slow),
        pytest.param(CROWDED, Probe(shape="flat", diameter_mm=4.0), id="crowded"),
        pytest.param(FAR, Probe(x_mm=2.0), id="far apart"),
    ],
)
def test_no_words_overlap_and_none_leave_the_page(finger, probe, check_words):
    mesh = mesh_of(replace(finger, afferents=QUICK.afferents))
    figure = mesh_figure(finger, mesh, probe)
    check_words(figure)
    section, pad = figure.axes
    for site in afferent_nodes(finger, mesh):
        assert pad.viewLim.contains(site.x_mm, site.y_mm)
    assert all(section.viewLim.contains(*corner) for corner in pad.viewLim.corners())


def test_materials_are_named_with_the_numbers_they_have(words_of):
    dermis = Material(young_mpa=0.085, poisson=0.495)
    finger = replace(QUICK, materials={**QUICK.materials, "dermis": dermis})
    figure = mesh_figure(finger, mesh_of(finger), Probe())
    shown = [text.get_text() for text in words_of(figure)]
    assert "Dermis\n$E$ = 85 kPa, $\\nu$ = 0.495" in shown
    assert "Bone\n$E$ = 17 GPa, $\\nu$ = 0.30" in shown
    assert "Probe\nrigid, cylinder, 1 mm" in shown


@given(heights=st.lists(st.floats(-5, 5), min_size=1, max_size=6), step=st.floats(0.01, 1.5))
def test_names_are_moved_apart_in_order_and_stay_on_the_panel(heights, step):
    wanted = sorted(heights, reverse=True)
    placed = np.array(spread_heights(wanted, step, -5.0, 5.0))
    assert (-np.diff(placed) >= step - 1e-9).all()
    assert placed.max() <= 5 + 1e-9
    assert placed.min() >= -5 - 1e-9
    if (-np.diff(wanted) >= step).all():
        assert_allclose(placed, wanted, atol=1e-12)


@given(
    sites=st.lists(st.tuples(st.floats(-3, 3), st.floats(-5, -0.1)), min_size=1, max_size=4),
    x_mm=st.floats(-3, 3),
    aspect=st.floats(0.4, 1.5),
)
def test_the_close_view_has_its_shape_and_all_that_matters_in_it(sites, x_mm, aspect):
    body_mm = np.array([[x_mm - 0.5, 0.5], [x_mm, -0.1], [x_mm + 0.5, 0.5]])
    window = pad_window(np.array(sites), body_mm, aspect)
    assert window.aspect == pytest.approx(aspect)
    assert np.diff(window.x_mm)[0] >= 2.0 - 1e-9
    assert window.y_mm[0] <= -2.3 + 1e-9
    for x, y in [*sites, (x_mm, -0.1)]:
        assert window.x_mm[0] < x < window.x_mm[1]
        assert window.y_mm[0] < y < window.y_mm[1]


ALL = [entry.id for entry in CATALOGUE]
LONG = "an_own_stimulus_of_a_very_long_name_with_W" + "W" * 60 + "_and_$its$_end"
SETS = {"one": [LONG], "five": [*ALL[:2], ALL[40], ALL[70], LONG], "all": ALL}
WAVE_MS = np.arange(501) * 0.5


def wave(name):
    depth_um = 1234.567 + 9876.5 * np.sin(WAVE_MS / 9)
    return Stimulus(name, depth_um, 0.5, (100.0, 200.0), 1234.567, {"family": name[:4]})


def trains(names):
    rng = np.random.default_rng(1)
    return [
        SpikeTrain(name, afferent, 0.5 * np.sort(rng.choice(500, 1 + k % 60, False)), cell)
        for k, name in enumerate(names)
        for afferent in AFFERENTS
        for cell in (1, 2, 3)
    ]


def spikes(draw, **options):
    def picture(names, axes=None):
        alone = {"waveform": wave(names[0])} if len(names) == 1 and draw is not isi_figure else {}
        return draw(trains(names), **options, **alone, axes=axes)

    return picture


def rates(names, axes=None):
    model = [Rate(n, a, 123.4 * k) for k, n in enumerate(names) for a in AFFERENTS]
    model += [Rate("sine_999.999999_9999.999999", "PC", 1999.0)]
    return rates_figure(model, observed=model[:3], touchsim=model[:3], axes=axes)


def swept(names):
    rows = np.vstack([np.zeros(len(names)), np.eye(len(names))])
    outputs = [(afferent, quantity, "all") for afferent in AFFERENTS for quantity in QUANTITIES]
    answers = np.arange(1.0, len(rows) + 1)[:, None] * 1234.5 * np.arange(1, len(outputs) + 1)
    columns = pd.MultiIndex.from_tuples(outputs, names=OUTPUT)
    parameters = pd.DataFrame(rows, columns=[f"{k} {name}" for k, name in enumerate(names)])
    return SweptFingers(parameters, pd.DataFrame(answers, columns=columns))


def ranked(names, axes=None):
    rng = np.random.default_rng(2)
    count = 2 * len(names) + 4
    few = swept(names)
    parameters = pd.DataFrame(rng.random((count, len(names))), columns=few.parameters.columns)
    answers = pd.DataFrame(rng.random((count, 6)), columns=few.answers.columns)
    return regressions_figure(
        rank_regressions(SweptFingers(parameters, answers), resamples=3), count, axes
    )


PICTURES = {
    "raster": spikes(raster_figure, window_ms=(100.0, 200.0)),
    "psth": spikes(psth_figure, window_ms=(100.0, 200.0)),
    "isi": spikes(isi_figure),
    "rates": rates,
    "stimulus": lambda names, axes=None: waveform_figure([wave(name) for name in names], axes),
    "trace": lambda names, axes=None: trace_figure(
        [StressTrace(1e6 + 1e5 * np.sin(WAVE_MS), 0.5, 12345678)] * 3,
        waveform=wave(names[0]),
        axes=axes,
    ),
    "effects": lambda names, axes=None: effects_figure(single_effects(swept(names[:20])), axes),
    "ranks": lambda names, axes=None: ranked(names[:20], axes),
}


ROWS = ("raster", "psth", "isi", "stimulus")
CASES = [(picture, "five") for picture in ("raster", "psth", "stimulus")]
CASES += [
    pytest.param(picture, names, marks=pytest.mark.slow)
    for picture in PICTURES
    for names in SETS
    if (picture, names) not in CASES and (names != "all" or picture in (*ROWS, "rates"))
]


@pytest.mark.parametrize(("picture", "names"), CASES)
def test_words_stay_on_the_page_and_apart(picture, names, check_words):
    check_words(PICTURES[picture](SETS[names]))


def content_of(panel):
    """Drawn data of a panel."""
    lines = [line.get_xydata().tolist() for line in panel.lines]
    parts = [path.vertices.tolist() for part in panel.collections for path in part.get_paths()]
    return lines, parts


@pytest.mark.parametrize("names", ["one", pytest.param("five", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "picture",
    [
        pytest.param(picture, marks=[pytest.mark.slow] * (picture in ("effects", "ranks", "psth")))
        for picture in PICTURES
    ],
)
def test_a_picture_is_drawn_into_the_axes_of_the_caller(picture, names):
    from matplotlib.figure import Figure

    draw = partial(PICTURES[picture], SETS[names])
    expected = draw().axes
    if picture == "trace" or (names == "one" and picture in ("raster", "psth")):
        expected = expected[1:] if picture == "trace" else expected[len(expected) // 2 :]
    figure = Figure()
    axes = figure.subplots(1, len(expected), squeeze=False)
    assert draw(axes=axes) is figure
    assert figure.axes == [*axes.flat]
    assert not figure.legends
    for panel, alone in zip(axes.flat, expected, strict=True):
        assert content_of(panel) == content_of(alone)
        assert_allclose(panel.get_xlim(), alone.get_xlim(), rtol=1e-12, atol=1e-12)
        assert_allclose(panel.get_ylim(), alone.get_ylim(), rtol=1e-12, atol=1e-12)
    with pytest.raises(UsageError) as refused:
        draw(axes=[*axes.flat, axes[0, 0]])
    assert (refused.value.argument, refused.value.found) == ("ax", len(expected) + 1)
    with pytest.raises(UsageError):
        draw(axes=[None] * len(expected))


def test_panels_of_a_grid_share_their_scales_also_in_the_axes_of_the_caller():
    from matplotlib.figure import Figure

    axes = Figure().subplots(1, 3)
    for _ in range(2):
        raster_figure(trains(ALL[:3]), axes=axes)
        assert axes[0].get_shared_y_axes().joined(axes[0], axes[2])
        shown = [panel.yaxis.get_tick_params()["labelleft"] for panel in axes]
        assert shown == [True, False, False]


def test_a_probe_that_was_deep_before_time_0_is_drawn_so():
    [stimulus] = [make_stimulus(one, 75.0) for one in resolve("sine_20_250")]
    spike = SpikeTrain(stimulus.id, "SA", np.array([10.0]))
    for figure in (
        raster_figure([spike], waveform=stimulus),
        psth_figure([spike], waveform=stimulus),
        trace_figure([StressTrace(np.ones(501), 0.5, 1)], waveform=stimulus),
    ):
        depth_um = figure.axes[0].lines[0].get_ydata()
        assert (depth_um[0], depth_um.max()) == (75.0, 325.0)
