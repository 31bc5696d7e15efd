"""Pictures of the first page and the tutorials, drawn by the program when the site is built.

They are results of the commands beside them, on stored responses, so they cannot differ from the
program. `docs/images/made` is not part of the repository.
"""

import os
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import matplotlib as mpl

mpl.use("agg")

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from sphinx.application import Sphinx

import decks
import fembridge as fb
from decks.finger import LAYERS
from fembridge.plots.finger_mesh import afferent_nodes, probe_outline
from fembridge.plots.style import LAYER_COLOURS, PROBE_COLOUR

FOLDER = Path("images/made")
COLOURS = {"SA": "#009e73", "RA": "#0072b2", "PC": "#d55e00"}
CARD_IN = (4.4, 3.3)


def twenty_hertz() -> Figure:
    """The raster of ``fembridge simulate --stimulus sine_20``."""
    return fb.simulate("sine_20", stored=True).plot()


def taps() -> Figure:
    """The raster of the sample waveform, two taps."""
    return fb.simulate(fb.sample("waveform"), stored=True).plot()


def thresholds() -> Figure:
    """The figure of ``fembridge threshold --afferent PC``."""
    return fb.threshold(["PC"]).plot()


def fit() -> Figure:
    """Rates of a quick fit to the sample rates, and its trade-offs."""
    return fb.fit(fb.sample("rates"), search=fb.Search(evaluations=400)).plot()


def pressure_signal() -> Figure:
    """The raster of the sample pressure signal, as ``encode`` draws it."""
    return fb.encode(fb.sample("pressure")).plot()


def own_results() -> Figure:
    """Stress and spikes of the sample results, as ``encode`` draws them."""
    return fb.encode(fb.read(fb.sample("frd"))).plot()


def card_touch() -> Figure:
    """A vibration, and the spikes of three classes."""
    result = fb.simulate("sine_20_130", stored=True)
    stimulus = result.stimuli[0]
    figure, panels = _signal_and_spikes(result.spikes)
    panels[0].plot(stimulus.times_ms, stimulus.displacement_um, color="0.2", lw=1.5)
    panels[0].set_ylabel("depth\n(µm)")
    panels[-1].set_xlim(0, 250)
    return figure


def card_robot() -> Figure:
    """A pressure signal, and its spikes."""
    table = pd.read_csv(fb.sample("pressure"))
    encoding = fb.encode(
        table, columns={"time": "time_s", "value": "pressure_kpa"}, resample_ms=0.5,
        afferents=["SA", "RA", "PC"],
    )  # fmt: skip
    figure, panels = _signal_and_spikes(encoding.spikes)
    panels[0].plot(1000 * table["time_s"], table["pressure_kpa"], color="0.2", lw=1.2)
    panels[0].set_ylabel("pressure\n(kPa)")
    panels[-1].set_xlim(0, 1000 * table["time_s"].max())
    return figure


def card_model() -> Figure:
    """The mesh under a probe, with a node for each class, and the stress there."""
    finger, probe = decks.PRESETS["quick"], fb.Probe()
    mesh = decks.mesh_of(finger)
    trace = fb.simulate("ramp_300_100_100_100", stored=True).traces[0]
    figure, (section, stress) = plt.subplots(
        1, 2, figsize=CARD_IN, width_ratios=(1, 1), layout="constrained"
    )
    fills = [to_rgb(LAYER_COLOURS[LAYERS[layer]]) for layer in mesh.layer]
    edges = [tuple(0.7 * share for share in fill) for fill in fills]
    polygons = mesh.node_mm[mesh.quad]
    section.add_collection(
        PolyCollection(polygons, facecolors=fills, edgecolors=edges, linewidths=0.3)
    )
    section.add_patch(Polygon(probe_outline(probe, mesh), facecolor=PROBE_COLOUR))
    section.set(xlim=(-1.0, 1.0), ylim=(-2.4, 0.6), aspect="equal", xticks=[], yticks=[])
    for site in afferent_nodes(finger, mesh):
        section.plot(
            site.x_mm, site.y_mm, "o", ms=7, mfc=COLOURS[site.afferent], mec="white", clip_on=False
        )
    for history in trace:
        times_ms, kpa = history.dt_ms * np.arange(history.stress_pa.size), history.stress_pa / 1000
        colour = COLOURS[history.afferent]
        stress.plot(times_ms, kpa, color=colour, lw=2)
        stress.annotate(
            history.afferent, (200, kpa.max()), (0, 4), textcoords="offset points", ha="center",
            color=colour, weight="bold",
        )  # fmt: skip
    stress.set(xlabel="time (ms)", ylabel="stress (kPa)")
    stress.spines[["top", "right"]].set_visible(False)
    return figure


def _signal_and_spikes(spikes: pd.DataFrame) -> tuple[Figure, list[Axes]]:
    """A panel for a signal above a panel of spikes for each class, on one time axis."""
    figure, panels = plt.subplots(
        4, 1, figsize=CARD_IN, sharex=True, height_ratios=(1.6, 1, 1, 1), layout="constrained"
    )
    for panel, (name, colour) in zip(panels[1:], COLOURS.items(), strict=True):
        of_class = spikes[spikes["afferent"] == name]
        panel.scatter(
            of_class["spike_time_ms"], of_class["cell"], marker="|", s=28, lw=1.1, color=colour
        )
        panel.set(yticks=[], ylim=(0, 11))
        panel.set_ylabel(name, rotation=0, ha="right", va="center", color=colour, weight="bold")
    panels[-1].set_xlabel("time (ms)")
    for panel in panels:
        panel.spines[["top", "right"]].set_visible(False)
    return figure, list(panels)


PICTURES: dict[str, Callable[[], Figure]] = {
    function.__name__: function
    for function in (
        twenty_hertz, taps, thresholds, fit, pressure_signal, own_results,
        card_touch, card_model, card_robot,
    )
}  # fmt: skip


@contextmanager
def _folder_of_its_own() -> Iterator[None]:
    """Draw in a temporary folder, which gets the samples, and without a solver on the PATH."""
    folder, path = Path.cwd(), os.environ["PATH"]
    with tempfile.TemporaryDirectory() as temporary:
        try:
            os.chdir(temporary)
            os.environ["PATH"] = ""
            yield
        finally:
            os.chdir(folder)
            os.environ["PATH"] = path


def draw_pictures(app: Sphinx) -> None:
    """Draw each picture that is missing, or older than the program."""
    folder = Path(app.srcdir).resolve() / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    sources = [Path(__file__)]
    for package in ("fembridge", "neural", "decks"):
        sources += (Path(app.srcdir).resolve().parent / package).rglob("*.py")
    newest = max(source.stat().st_mtime for source in sources)
    with _folder_of_its_own(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "There are no gridspecs with layoutgrids")
        for name, draw in PICTURES.items():
            path = folder / f"{name}.png"
            if not path.is_file() or path.stat().st_mtime < newest:
                figure = draw()
                figure.savefig(path, dpi=130, facecolor="white", bbox_inches="tight")
                plt.close(figure)


def setup(app: Sphinx) -> dict[str, bool]:
    """Draw the pictures before Sphinx reads the pages."""
    app.connect("builder-inited", draw_pictures)
    return {"parallel_read_safe": True}
