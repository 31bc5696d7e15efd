"""A page to explore a finished result: it plays a touch or a simulation, and is scrubbed.

The page is one HTML file without anything from elsewhere. Of a touch it shows the fingertip in
three dimensions (three.js, in ``explorer_page/three``) with contact pressure and firing units; of a
simulation the section of the finger under the probe; of both the raster and curves over time.
Numbers are arrays, compressed by zlib: times and spikes in double precision, stress and positions
in single precision, and pressure as bytes, 255 for the largest.
"""

from __future__ import annotations

import base64
import json
import os
import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from fembridge.errors import FembridgeError, UsageError
from fembridge.host.store import write_text
from fembridge.io.run_folder import RUN_FILE, read_run_folder
from fembridge.simulation.folder import RECORD_FILE, TRACES_FILE, stimuli_in
from fembridge.touching.touch_result import RECORD_FILE as TOUCH_RECORD
from fembridge.touching.touch_result import Touch
from fembridge.typing import FloatArray, IntArray
from fembridge.version import __version__

if TYPE_CHECKING:
    from decks.finger import Finger
    from fembridge.io.spike_table import SpikeTrain
    from fembridge.simulation.simulation import Simulation
    from fembridge.stimulus import Stimulus
    from fembridge.trace import StressTrace

PAGE = "explore.html"
FRAMES = 120
"""Most moments of which the page of a touch has contact pressure."""
_SOURCES = Path(__file__).parent / "explorer_page"
_SURFACE_MM, _FIELD_MM = 0.5, 0.25
_SIDE = 0.96  # of half the width: beyond, the skin of the pad is upright
_KPA_PER_N_MM2, _KPA_PER_PA = 1000.0, 1e-3
_BYTE = 255
_EXPECTED = "a Touch, a Simulation, or the folder of one or of a solved run"

Explorable: TypeAlias = "Touch | Simulation | str | os.PathLike[str]"
"""A result, or the folder of one."""


class Explorer:
    """The page of a result to explore, of `explore`.

    Parameters
    ----------
    kind
        ``touch`` or ``simulation``.
    title, lead
        Title and first line of the page.
    facts
        Provenance: version, parameters, pad or finger, and others, by name.
    values
        Texts and numbers that the page shows, by name, as JSON has them.
    arrays
        Arrays that the page shows, by name: positions in mm ``(N, 3)``, times in ms, ``(spikes,)``
        and ``(T,)``, and values at moments, ``(frame, N)``.
    folder
        Folder of the result. Default: None, it is in memory.

    Examples
    --------
    >>> import fembridge as fb
    >>> explorer = fb.explore(fb.simulate("sine_20_250", stored=True))
    >>> explorer.kind
    'simulation'
    """

    def __init__(
        self,
        kind: str,
        title: str,
        lead: str,
        facts: Mapping[str, str],
        values: Mapping[str, Any],
        arrays: Mapping[str, np.ndarray[Any, Any]],
        folder: Path | None = None,
    ) -> None:
        self.kind, self.title, self.lead, self.facts = kind, title, lead, dict(facts)
        self.values, self.arrays, self.folder = dict(values), dict(arrays), folder

    def __repr__(self) -> str:
        return f"Explorer of a {self.kind}: {self.title}\n  {self.lead}\n  .write(path)"

    def _repr_html_(self) -> str:
        look = "width: 100%; height: 760px; border: 0"
        return f'<iframe style="{look}" srcdoc="{escape(self.to_html())}"></iframe>'

    @property
    def provenance(self) -> dict[str, str]:
        """Version, parameters, pad or finger, and others, as in the last line of the page."""
        return dict(self.facts)

    def to_html(self) -> str:
        """The page: style, scripts and data in one text."""
        data = {
            "kind": self.kind,
            **self.values,
            "arrays": {name: _packed(array) for name, array in self.arrays.items()},
        }
        scripts = [_source("three/three.min.js")] if self.kind == "touch" else []
        # In a script, "</" would end it.
        text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")
        scripts.append(_source("explorer.js").replace("/*DATA*/ null", text))
        facts = " · ".join(f"{escape(name)} {escape(text)}" for name, text in self.facts.items())
        parts = {
            "TITLE": escape(self.title),
            "LEAD": escape(self.lead),
            "FACTS": facts,
            "STYLE": _source("explorer.css"),
            "SCRIPTS": "\n".join(f"<script>\n{script}\n</script>" for script in scripts),
        }
        pieces = _source("explorer.html").split("@@")
        return "".join(parts.get(piece, piece) for piece in pieces)

    def write(self, path: str | os.PathLike[str] | None = None) -> Path:
        """Write the page and return its path.

        Parameters
        ----------
        path
            HTML file. Default: None, ``explore.html`` in the folder of the result.

        Raises
        ------
        UsageError
            No path, and the result is in memory.
        OutputError
            The file cannot be written.
        """
        if path is None and self.folder is None:
            raise UsageError(
                "is missing: the result is in memory", argument="path", expected="an HTML file"
            )
        page = Path(path) if path is not None else Path(self.folder or "") / PAGE
        write_text(page, self.to_html())
        return page


def explore(result: Explorable) -> Explorer:
    """A page to play and scrub a touch or a simulation.

    Parameters
    ----------
    result
        A `Touch`, a `Simulation`, or the folder of one, or of a solved run.

    Returns
    -------
    Explorer
        ``write(path)`` writes the page, one HTML file without anything from elsewhere; a notebook
        shows it.

    Raises
    ------
    UsageError
        Another type of value, or a folder without a result.
    FembridgeError
        A file of the folder is damaged.

    Examples
    --------
    >>> import fembridge as fb
    >>> touch = fb.touch("punch", press_um=200, population="one_each")
    >>> fb.explore(touch).write("touch.html").name
    'touch.html'
    """
    from fembridge.simulation.simulation import Simulation

    if isinstance(result, Touch):
        return _of_touch(result)
    if isinstance(result, Simulation):
        return _of_simulation(result)
    if not isinstance(result, str | os.PathLike):
        raise UsageError(argument="result", found=result, expected=_EXPECTED)
    folder = Path(result)
    if (folder / TOUCH_RECORD).is_file():
        return _of_touch(Touch.read(folder), folder)
    if (folder / RECORD_FILE).is_file() and (folder / TRACES_FILE).is_file():
        return _of_simulation(Simulation.read(folder), folder)
    if (folder / RUN_FILE).is_file():
        return _of_run(folder)
    problem = "is none of these" if folder.exists() else "no such folder, expected"
    raise UsageError(
        f"{problem}: {_EXPECTED}",
        folder,
        expected=_EXPECTED,
    )


def _source(name: str) -> str:
    return (_SOURCES / name).read_text(encoding="utf-8")


def _packed(array: np.ndarray[Any, Any]) -> dict[str, Any]:
    """An array as the page reads it: type, shape, and zlib's bytes in base 64."""
    plain = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    text = base64.b64encode(zlib.compress(plain.tobytes(), 9)).decode()
    return {"type": plain.dtype.name, "shape": list(plain.shape), "zlib": text}


def _facts(origin: Mapping[str, Any], **more: object) -> dict[str, str]:
    facts: dict[str, object] = {
        "fembridge": origin.get("fembridge", __version__),
        "parameters": origin.get("parameter_set"),
        **more,
    }
    return {name.replace("_", " "): str(value) for name, value in facts.items() if value}


# ---- A touch


def _of_touch(touch: Touch, folder: Path | None = None) -> Explorer:
    origin, pad, units = touch.origin, touch.contact.nodes.pad, touch.population
    frames = _frames(touch.trajectory.times_ms.size)
    surface_mm, triangles = _surface(touch)
    contact = _contact(touch, frames)
    stress_kpa = _surface_stress_kpa(touch, surface_mm, frames)
    most_stress_kpa = float(stress_kpa.max(initial=0.0))
    classes = list(dict.fromkeys(units.afferent))
    fired = touch.fired
    order = np.argsort(fired.time_ms, kind="stable")
    height_mm = _height_mm(surface_mm, units.x_mm, units.z_mm)
    firing = sum(int(row["firing"]) for row in touch.summary().values())
    shape = origin.get("shape", {}).get("name") or "pins"
    duration_ms = float(touch.trajectory.times_ms[-1])
    lead = (
        f"{firing} of {len(units)} units fire {fired.time_ms.size} times in {duration_ms:g} ms; "
        f"the shape goes {touch.depth_um.max():.3g} µm deep, with up to "
        f"{touch.force_n.max():.3g} {touch.force_unit}."
    )
    pad_table = origin.get("pad", {})
    facts = _facts(
        origin,
        pad=pad_table.get("source") or pad.mechanics["name"],
        pad_sha256=str(pad_table.get("sha256", ""))[:12],
        stimulus=touch.trajectory.name,
    )
    values = {
        "classes": classes,
        "units": list(units.unit),
        "force_unit": touch.force_unit,
        "duration_ms": duration_ms,
        "trials": touch.trials,
        "most_kpa": contact.pop("most_kpa"),
        "most_stress_kpa": most_stress_kpa,
        "window_ms": [float(edge) for edge in touch.trajectory.window_ms],
    }
    arrays = {
        "surface_mm": surface_mm,
        "triangles": triangles,
        "stress": _as_bytes(stress_kpa, most_stress_kpa),
        **contact,
        "frame_ms": touch.trajectory.times_ms[frames],
        "unit_class": np.array([classes.index(name) for name in units.afferent], np.uint8),
        "unit_mm": np.stack([units.x_mm, height_mm, units.z_mm], -1).astype(np.float32),
        "unit_normal": pad.normal_at(units.x_mm, units.z_mm).astype(np.float32),
        "unit_depth_mm": units.depth_mm.astype(np.float32),
        "rate_ips": touch.rate_ips.astype(np.float32),
        "spike_ms": fired.time_ms[order],
        "spike_unit": fired.unit[order].astype(np.uint32),
        "spike_trial": fired.trial[order].astype(np.uint16),
        "time_ms": touch.trajectory.times_ms,
        "depth_um": touch.depth_um.astype(np.float32),
        "force_n": touch.force_n.astype(np.float32),
    }
    title = f"{shape}, {touch.trajectory.name}".replace(" um", " µm")
    return Explorer("touch", title, lead, facts, values, arrays, folder)


def _frames(samples: int) -> IntArray:
    """Numbers of the samples with pressure, evenly spaced."""
    even = np.linspace(0, samples - 1, min(samples, FRAMES))
    return np.round(even).astype(np.int64)


def frame_pressure_kpa(touch: Touch, frames: IntArray) -> FloatArray:
    """Contact pressure on the nodes at some samples in kPa, ``(frame, node)``.

    Between two solved states it is interpolated linearly.

    Parameters
    ----------
    touch
        The touch.
    frames
        Numbers of samples from 0, ``(frame,)``.
    """
    contact = touch.contact
    if not contact.nodes.size:
        return np.zeros((frames.size, 0))
    before, after, share = _states(touch, frames)
    forces_n = (1.0 - share)[:, None] * contact.forces_n[before] + share[
        :, None
    ] * contact.forces_n[after]
    pressure: FloatArray = forces_n / contact.nodes.area_mm2 * _KPA_PER_N_MM2
    return pressure


def _states(touch: Touch, frames: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
    """States before and after some samples, and the share of the later one, ``(frame,)`` each."""
    position, knots = touch.contact.position[frames], touch.contact.knots
    after = np.minimum(np.searchsorted(knots, position), knots.size - 1)
    before = np.maximum(after - 1, 0)
    width = np.where(after > before, knots[after] - knots[before], 1.0)
    share = np.where(after > before, np.clip((position - knots[before]) / width, 0.0, 1.0), 0.0)
    return before, after, share


def _surface(touch: Touch) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Skin of the pad: vertices ``(V, 3)`` in mm, x across, y up, z along; and triangles."""
    from fembridge.touching.mesh_pad import MeshPad
    from fembridge.touching.prism_pad import PrismPad
    from fembridge.touching.ridged_pad import RidgedPad

    pad = touch.contact.nodes.pad
    smooth = pad.smooth_pad if isinstance(pad, RidgedPad) else pad
    if isinstance(smooth, PrismPad):
        outline = smooth.finger.outline
        x_mm = _even(_SIDE * outline.half_width_mm)
        z_mm = _even(np.abs(touch.population.z_mm).max(initial=1.0) + 1.0)
        height = smooth.skin_height_mm(x_mm[None, :], z_mm[:, None])
        side = np.sqrt(1.0 - np.square(x_mm / outline.half_width_mm)) - 1.0
        is_upright = np.abs(x_mm) > smooth.reach_mm
        below = outline.half_height_mm * side - smooth.skin_height_mm(x_mm, np.zeros(1))
        height = height + np.where(is_upright, below, 0.0)
        grid = np.stack(np.broadcast_arrays(x_mm[None, :], height, z_mm[:, None]), -1)
        return grid.reshape(-1, 3).astype(np.float32), _lattice_triangles(*height.shape)
    if isinstance(pad, MeshPad):
        return pad.position_mm.astype(np.float32), pad.triangles.astype(np.uint32)
    raise UsageError("has a pad of another kind", argument="result", found=type(pad).__name__)


def _even(half: float) -> FloatArray:
    count = max(1, round(half / _SURFACE_MM))
    return np.linspace(-half, half, 2 * count + 1)


def _surface_stress_kpa(
    touch: Touch, surface_mm: np.ndarray[Any, Any], frames: IntArray
) -> FloatArray:
    """Stress below the vertices of the skin, at the depth of SA, ``(frame, V)`` in kPa.

    It is 0 where the pad has none.
    """
    from scipy.interpolate import RegularGridInterpolator

    if not touch.contact.nodes.size:
        return np.zeros((frames.size, len(surface_mm)))
    x_mm, z_mm = (np.unique(column) for column in surface_mm[:, ::2].T)
    if x_mm.size * z_mm.size != len(surface_mm):  # of a mesh, no lattice
        x_mm, z_mm = (
            np.linspace(axis[0], axis[-1], 2 + int((axis[-1] - axis[0]) / _FIELD_MM))
            for axis in (x_mm, z_mm)
        )
    before, after, share = _states(touch, frames)
    states = np.unique(np.concatenate([before, after]))
    field = np.moveaxis(touch.skin_stress_pa(states, x_mm, z_mm) * _KPA_PER_PA, 0, -1)
    at_vertices = RegularGridInterpolator((z_mm, x_mm), field)(surface_mm[:, ::-2])
    nearest = touch.contact.nodes.pad.clipped(surface_mm[:, 0], surface_mm[:, 2])
    distance_mm = np.hypot(nearest[0] - surface_mm[:, 0], nearest[1] - surface_mm[:, 2])
    at_vertices[distance_mm > _SURFACE_MM] = 0.0
    rows = np.searchsorted(states, before), np.searchsorted(states, after)
    stress: FloatArray = (
        (1.0 - share) * at_vertices[:, rows[0]] + share * at_vertices[:, rows[1]]
    ).T
    return stress


def _lattice_triangles(rows: int, columns: int) -> np.ndarray[Any, Any]:
    """Two triangles for each cell of a lattice of vertices, cell after cell, seen from above."""
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    right, above = first + 1, first + columns
    pairs = [[first, above, right], [right, above, above + 1]]
    return np.stack(pairs, 0).transpose(2, 0, 1).reshape(-1, 3).astype(np.uint32)


def _height_mm(surface_mm: np.ndarray[Any, Any], x_mm: FloatArray, z_mm: FloatArray) -> FloatArray:
    """Height of the skin over positions: that of the nearest three vertices, weighted."""
    from scipy.spatial import cKDTree

    tree = cKDTree(surface_mm[:, ::2])
    distance, row = tree.query(np.stack([x_mm, z_mm], -1), k=3)
    weight = 1.0 / (distance + 1e-9)
    height: FloatArray = (weight * surface_mm[row, 1]).sum(1) / weight.sum(1)
    return height


def _contact(touch: Touch, frames: IntArray) -> dict[str, Any]:
    """Cells of the skin that are pressed: vertices, triangles, and pressure of each over time."""
    nodes = touch.contact.nodes
    nothing = {
        "cell_mm": np.zeros((0, 3), np.float32),
        "cell_triangles": np.zeros((0, 3), np.uint32),
        "cell_of_triangle": np.zeros(0, np.uint32),
        "pressure": np.zeros((frames.size, 0), np.uint8),
        "most_kpa": 0.0,
    }
    if not nodes.size:
        return nothing
    cells, at_nodes = nodes.cells(), frame_pressure_kpa(touch, frames)
    values = np.stack([np.ravel(np.nan_to_num(cells.values(row))) for row in at_nodes])
    most_kpa = float(values.max(initial=0.0))
    pressed = np.flatnonzero(values.any(axis=0))
    if not pressed.size:
        return nothing
    if cells.triangles is None:
        half_mm = np.array([-1.0, 1.0]) * _SURFACE_MM
        edges_mm = half_mm if nodes.pad.plane else cells.z_mm
        columns = cells.x_mm.size - 1
        row, column = pressed // columns, pressed % columns
        corner = (
            np.stack([row, row, row + 1, row + 1], -1),
            np.stack([column, column + 1, column, column + 1], -1),
        )
        x_mm, z_mm = cells.x_mm[corner[1]].ravel(), edges_mm[corner[0]].ravel()
        pad: Any = nodes.pad
        height = pad.skin_height_mm(x_mm, z_mm)
        first = 4 * np.arange(pressed.size)[:, None]
        triangles = (first + np.array([0, 2, 1, 1, 2, 3])).reshape(-1, 3)
        owner = np.repeat(np.arange(pressed.size), 2)
        vertices = np.stack([x_mm, height, z_mm], -1)
    else:
        pad = nodes.pad
        vertices = pad.position_mm[cells.triangles[pressed].ravel()]
        triangles = np.arange(vertices.shape[0]).reshape(-1, 3)
        owner = np.arange(pressed.size)
    return {
        "cell_mm": vertices.astype(np.float32),
        "cell_triangles": triangles.astype(np.uint32),
        "cell_of_triangle": owner.astype(np.uint32),
        "pressure": _as_bytes(values[:, pressed], most_kpa),
        "most_kpa": most_kpa,
    }


def _as_bytes(values: FloatArray, most: float) -> np.ndarray[Any, Any]:
    """Values from 0 to `most` as bytes from 0 to 255."""
    return np.round(values / (most or 1.0) * _BYTE).astype(np.uint8)


# ---- A simulation, or a solved run


def _of_simulation(result: Simulation, folder: Path | None = None) -> Explorer:
    response = result.origin.get("response")
    response = response if isinstance(response, Mapping) else {}
    finger = _finger_of(response.get("finger"))
    sites = {} if finger is None else _sites(finger)
    names = [stimulus.id for stimulus in result.stimuli]
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    facts = _facts(
        result.origin,
        method=result.origin.get("method"),
        finger=finger.name if finger else "",
    )
    return _of_stimuli(
        f"{', '.join(names[:3])}{more}",
        result.stimuli,
        result.traces,
        result.trains,
        {(rate.stimulus, rate.afferent, rate.unit): rate.rate_ips for rate in result.mean_rates},
        finger,
        response.get("probe"),
        sites,
        facts,
        folder,
    )


def _of_run(folder: Path) -> Explorer:
    from fembridge.simulation.encode import encode

    run, stimuli = read_run_folder(folder), stimuli_in(folder).stimuli
    encoding = encode(run)
    is_own = isinstance(run.inputs.get("base_deck"), Mapping)
    finger = None if is_own else _finger_of(run.inputs.get("finger"))
    sites = {site.key: (site.x_mm, site.y_mm) for site in run.afferents} if finger else {}
    name = stimuli[0].id
    facts = _facts(
        {"parameter_set": encoding.parameters.name},
        solver=run.solver,
        deck=run.deck.name,
        deck_sha256=run.deck_sha256[:12],
    )
    return _of_stimuli(
        name,
        stimuli,
        [list(encoding.traces)],
        encoding.trains,
        {(name, rate.afferent, rate.unit): rate.rate_ips for rate in encoding.mean_rates},
        finger,
        run.inputs.get("probe"),
        sites,
        facts,
        folder,
    )


def _finger_of(table: object) -> Finger | None:
    from decks.presets import PRESETS, finger_from

    if isinstance(table, str):
        return PRESETS.get(table)
    if isinstance(table, Mapping):
        with suppress(FembridgeError):
            return finger_from(table, name=str(table.get("name", "own")))
    return None


def _sites(finger: Finger) -> dict[str, tuple[float, float]]:
    return {name: (site.x_mm, -site.depth_mm) for name, site in finger.afferents.items()}


def _of_stimuli(
    title: str,
    stimuli: Sequence[Stimulus],
    traces: Sequence[Sequence[StressTrace]],
    trains: Sequence[SpikeTrain],
    rates: Mapping[tuple[str, str, str], float],
    finger: Finger | None,
    probe: object,
    sites: Mapping[str, tuple[float, float]],
    facts: Mapping[str, str],
    folder: Path | None,
) -> Explorer:
    """The page of stress and spikes under a probe; a column of `traces` is an afferent."""
    from fembridge.trace import afferent_key

    columns = [(str(trace.afferent), trace.unit) for trace in traces[0]]
    cells = [
        max([train.cell for train in trains if (train.afferent, train.unit) == key], default=0)
        for key in columns
    ]
    names = [afferent_key(*key) for key in columns]
    arrays: dict[str, Any] = {}
    entries = []
    for row, (stimulus, of_stimulus) in enumerate(zip(stimuli, traces, strict=True)):
        fired = [train for train in trains if train.stimulus in (stimulus.id, "")]
        spikes = [
            (time_ms, columns.index((train.afferent, train.unit)), max(train.cell, 1) - 1)
            for train in fired
            for time_ms in train.times_ms.tolist()
        ]
        spikes.sort()
        table = np.array(spikes, dtype=np.float64).reshape(-1, 3)
        first = of_stimulus[0]
        arrays |= {
            f"depth_um_{row}": stimulus.displacement_um.astype(np.float32),
            f"stress_pa_{row}": np.stack([t.stress_pa for t in of_stimulus]).astype(np.float32),
            f"spike_ms_{row}": table[:, 0],
            f"spike_afferent_{row}": table[:, 1].astype(np.uint16),
            f"spike_cell_{row}": table[:, 2].astype(np.uint16),
        }
        if stimulus.aside_um is not None:
            arrays[f"aside_um_{row}"] = stimulus.aside_um.astype(np.float32)
        entries.append(
            {
                "id": stimulus.id,
                "depth_dt_ms": float(stimulus.dt_ms),
                "stress_dt_ms": float(first.dt_ms),
                "start_ms": float(first.start_ms),
                "window_ms": [float(edge) for edge in stimulus.window_ms],
                "rates_ips": [rates.get((stimulus.id, *key), 0.0) for key in columns],
            }
        )
    values = {
        "stimuli": entries,
        "afferents": [
            {"name": name, "class": key[0], "cells": max(count, 1), "at_mm": sites.get(name)}
            for name, key, count in zip(names, columns, cells, strict=True)
        ],
        "section": None,
    }
    # The probe of a map on a pad is a shape; it has no section.
    if finger is not None and isinstance(probe, Mapping) and "diameter_mm" in probe:
        with suppress(FembridgeError):  # no mesher for a finger of one's own
            values["section"], section = _section(finger, probe)
            arrays |= section
    count = sum(train.times_ms.size for train in trains)
    plural = "stimuli" if len(stimuli) > 1 else "stimulus"
    lead = f"{len(stimuli)} {plural}, {len(names)} afferents, {count} spikes."
    return Explorer("simulation", title, lead, facts, values, arrays, folder)


def _section(finger: Finger, probe: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Mesh of a finger's section with colours of its layers, and the probe at first touch."""
    from decks.finger import LAYERS
    from decks.presets import mesh_of
    from decks.probe import Probe, mesh_probe
    from fembridge.plots.style import LAYER_COLOURS

    mesh = mesh_of(finger)
    placed = Probe(**probe)
    indentor, _ = mesh_probe(placed, mesh)
    values = {
        "layers": [name.replace("_", " ") for name in LAYERS],
        "colours": [LAYER_COLOURS[name] for name in LAYERS],
        "probe": {"x_mm": placed.x_mm, "shape": placed.shape, "diameter_mm": placed.diameter_mm},
    }
    arrays = {
        "node_mm": mesh.node_mm.astype(np.float32),
        "quad": mesh.quad.astype(np.uint32),
        "layer": mesh.layer.astype(np.uint8),
        "probe_mm": indentor.node_mm[indentor.lower_node].astype(np.float32),
    }
    return values, arrays
