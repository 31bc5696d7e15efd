"""Receptive fields: where on the skin a probe makes an afferent fire.

A prism is the same all along z, so a probe that is pressed once at each position across the
finger, over afferents that lie further and further along it, is a probe at every position over
one afferent. On a mesh the probe is pressed at every position.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from decks.stimuli import DT_MS
from fembridge.errors import ResultError, UsageError, warn
from fembridge.host.store import filling, read_toml, write_text, write_toml
from fembridge.io.text_table import read_table
from fembridge.plots.shown import Shown
from fembridge.ranges import ABOVE_ZERO, Range, check_range
from fembridge.solver.mechanics import check_mechanics
from fembridge.touching.contact import MOST_UM, press_to
from fembridge.touching.contact_warnings import depth_warning, narrow_warning
from fembridge.touching.pad import Pad
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.population import ENDINGS_MM, Population
from fembridge.touching.relaxation import relaxation_of
from fembridge.touching.shape import Shape
from fembridge.touching.stress import driving_stress_pa, interpolate_states
from fembridge.touching.touch import PAD, parameters_on
from fembridge.touching.trajectory import Trajectory
from fembridge.typing import BoolArray, FloatArray, IntArray, Table
from fembridge.version import __version__
from neural.encoder import encode_units
from neural.parameter_sets import ParameterSet, parameters_to_table

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from fembridge.plots.style import Panels

AREAS_FILE, MAPS_FILE, RECORD_FILE = "areas.csv", "fields.csv", "receptive_field.toml"
MAP_COLUMNS = ("afferent", "depth_um", "x_mm", "z_mm", "impulses")
FIELD, AREA = PICTURES = ("field", "area")
"""Kinds of `ReceptiveField.plot`."""
# A ramp of 20 ms, as fast as a probe is put on by hand, and a short hold.
_RAMP_MS, _HOLD_MS = 20.0, 100.0
# Length of a sinusoid, for the field of a vibration.
_VIBRATION_MS = 200.0
_HALF_LENGTH_MM = 8.0
_LEVELS = 21
_MIN_PROBE_MM = 0.01
# Halvings of the search for a threshold.
_HALVINGS = 14


@dataclass(frozen=True, eq=False, repr=False)
class ReceptiveField(Shown):
    """Result of `fembridge.receptive_field`: impulses of an afferent by position of the probe.

    Parameters
    ----------
    afferent
        Class of the afferent: ``SA``, ``RA`` or ``PC``.
    probe_diameter_mm
        Diameter of the probe in mm.
    x_mm, z_mm
        Positions of the probe from the afferent, across and along the finger, in mm, ``(X,)``
        and ``(Z,)``.
    depth_um
        Depths, or amplitudes, of the probe in um, ``(depth,)``.
    impulses
        Impulses, ``(depth, x, z)``.
    criterion
        Share of the impulses at the hot spot that counts as a response.
    threshold_um
        Least depth in um at which the afferent fires at its hot spot; infinite if it never does.
    origin
        Pad, parameters and version, for the record. Default: nothing.
    """

    afferent: str
    probe_diameter_mm: float
    x_mm: FloatArray
    z_mm: FloatArray
    depth_um: FloatArray
    impulses: IntArray
    criterion: float
    threshold_um: float
    origin: Mapping[str, Any] = field(default_factory=dict)

    def _lines(self) -> list[str]:
        areas = ", ".join(
            f"{'' if row.whole else '> '}{row.area_mm2:.1f} mm² at {row.depth_um:.0f} um"
            for row in self.areas.itertuples()
        )
        return [
            f"Receptive field of {self.afferent}, probe {self.probe_diameter_mm:g} mm",
            f"  threshold {self.threshold_um:.3g} um",
            f"  area: {areas}",
            "  .areas, .impulses, .plot(), .write(folder)",
        ]

    @property
    def provenance(self) -> Table:
        """Version, probe, criterion, threshold, pad and parameters."""
        return {
            **self.origin,
            "afferent": self.afferent,
            "probe_diameter_mm": float(self.probe_diameter_mm),
            "criterion": float(self.criterion),
            "threshold_um": float(self.threshold_um),
        }

    @cached_property
    def responds(self) -> BoolArray:
        """Whether the afferent responds to the probe, ``(depth, x, z)``."""
        hot = self.impulses.max(axis=(1, 2), keepdims=True)
        return np.asarray((self.impulses >= np.maximum(self.criterion * hot, 1)) & (hot > 0))

    @cached_property
    def areas(self) -> "pandas.DataFrame":
        """Areas: ``afferent, depth_um, area_mm2, whole``.

        `whole` is false where the field reaches the edge of the modelled skin.
        """
        import pandas

        x_edges, z_edges = (
            np.concatenate([[axis[0]], 0.5 * (axis[1:] + axis[:-1]), [axis[-1]]])
            for axis in (self.x_mm, self.z_mm)
        )
        cell_mm2 = np.diff(x_edges)[:, None] * np.diff(z_edges)
        inside = self.responds
        border = inside[:, [0, -1]].any(axis=(1, 2)) | inside[:, :, [0, -1]].any(axis=(1, 2))
        return pandas.DataFrame(
            {
                "afferent": self.afferent,
                "depth_um": self.depth_um,
                "area_mm2": (inside * cell_mm2).sum(axis=(1, 2)),
                "whole": ~border,
            }
        )

    def to_frame(self) -> "pandas.DataFrame":
        """Maps: ``afferent, depth_um, x_mm, z_mm, impulses``, a row a position and depth."""
        import pandas

        depth, x, z = np.meshgrid(self.depth_um, self.x_mm, self.z_mm, indexing="ij")
        columns = {"depth_um": depth, "x_mm": x, "z_mm": z, "impulses": self.impulses}
        flat = {name: values.ravel() for name, values in columns.items()}
        return pandas.DataFrame({"afferent": self.afferent, **flat})

    def plot(self, kind: str | None = None, ax: "Panels | None" = None) -> "Figure":
        """Picture of the field, as `fembridge receptive-field` draws it.

        Parameters
        ----------
        kind
            ``field``: a map of impulses per depth (five at most), then area against depth;
            ``area``: area against depth alone. Default: ``field``.
        ax
            Axes to draw into, one per panel in this order. Default: a new figure.

        Raises
        ------
        UsageError
            An unknown kind, or another number of axes than panels.
        """
        from fembridge.plots.field_maps import area_figure, field_figure

        kind = kind or FIELD
        if kind not in PICTURES:
            raise UsageError(argument="kind", found=kind, expected=" or ".join(PICTURES))
        axes = None if ax is None else list(np.ravel(np.asarray(ax, dtype=object)))
        return field_figure(self, axes) if kind == FIELD else area_figure(self, axes)

    def write(self, folder: str | os.PathLike[str]) -> None:
        """Write ``areas.csv``, ``fields.csv`` and ``receptive_field.toml``; `read` reads them.

        Parameters
        ----------
        folder
            Folder of the files, which is made.

        Raises
        ------
        OutputError
            The folder cannot be written.
        """
        write_fields(folder, [self])

    @classmethod
    def read(cls, folder: str | os.PathLike[str], afferent: str | None = None) -> "ReceptiveField":
        """The field that `write` or ``fembridge receptive-field`` wrote.

        Parameters
        ----------
        folder
            Folder of the files.
        afferent
            Class of the afferent. Default: None, the first of the folder.

        Raises
        ------
        ResultError, TableError
            A file is absent, cut short or of another kind.
        UsageError
            A class of which the folder has no field.

        Examples
        --------
        >>> import fembridge as fb
        >>> field = fb.receptive_field("RA", depth_um=[200], step_mm=1.0)
        >>> field.write("field")
        >>> fb.ReceptiveField.read("field").areas.equals(field.areas)
        True
        """
        folder = Path(folder)
        path = folder / RECORD_FILE
        record = read_toml(path, ResultError.at(path))
        classes = list(record)
        afferent = afferent or (classes[0] if classes else "")
        if afferent not in classes:
            expected = f"one of {', '.join(classes)}"
            raise UsageError(argument="afferent", found=afferent, expected=expected)
        table = read_table(folder / MAPS_FILE, MAP_COLUMNS)
        table = table.where(table.column("afferent") == afferent)
        values = [table.numbers(name) for name in MAP_COLUMNS[1:]]
        depth_um, x_mm, z_mm = (np.unique(axis) for axis in values[:3])
        if depth_um.size * x_mm.size * z_mm.size != table.size:
            raise ResultError(f"{table.size} rows of {afferent}, expected a grid", table.path)
        order = np.lexsort((values[2], values[1], values[0]))
        impulses = values[3][order].astype(np.int64)
        origin = dict(record[afferent])
        try:
            settings = {name: origin.pop(name) for name in ("probe_diameter_mm", "criterion")}
            threshold_um = origin.pop("threshold_um")
            origin.pop("afferent")
        except KeyError as error:
            raise ResultError(f"no {error.args[0]} of {afferent}", path) from error
        return cls(
            afferent=afferent,
            x_mm=x_mm,
            z_mm=z_mm,
            depth_um=depth_um,
            impulses=impulses.reshape(depth_um.size, x_mm.size, z_mm.size),
            threshold_um=threshold_um,
            origin=origin,
            **settings,
        )


def write_fields(
    folder: str | os.PathLike[str],
    fields: Sequence[ReceptiveField],
    more: Mapping[str, Callable[[Path], object]] | None = None,
) -> None:
    """Write the tables and the record of one field or several, all or none.

    Parameters
    ----------
    folder
        Folder of the files, which is made.
    fields
        Fields, one a class.
    more
        Functions that write further files, by name. Default: None.
    """
    import pandas

    tables = {
        MAPS_FILE: pandas.concat([item.to_frame() for item in fields], ignore_index=True),
        AREAS_FILE: pandas.concat([item.areas for item in fields], ignore_index=True),
    }
    with filling(Path(folder), last=RECORD_FILE) as draft:
        for name, write in (more or {}).items():
            write(draft / name)
        for name, table in tables.items():
            write_text(draft / name, table.to_csv(index=False, lineterminator="\n"))
        write_toml(draft / RECORD_FILE, {item.afferent: item.provenance for item in fields})


def receptive_field(
    afferent: str = "RA",
    *,
    probe_diameter_mm: float = 0.5,
    depth_um: Sequence[float] = (100.0, 200.0, 300.0, 400.0, 500.0),
    times_threshold: Sequence[float] = (),
    criterion: float = 0.1,
    frequency_hz: float | None = None,
    step_mm: float = 0.25,
    endings_mm: float = ENDINGS_MM,
    sa_von_mises: bool = False,
    pad: str | Path | Pad = PAD,
    parameters: str | Path | ParameterSet | None = None,
) -> ReceptiveField:
    """Where on the skin a probe makes the median afferent of a class fire, and over what area.

    The afferent lies below the middle of the pad; a flat round probe is pressed at each
    position, by a ramp of 20 ms and a hold of 100 ms, or vibrates.

    Parameters
    ----------
    afferent
        Class: ``SA``, ``RA`` or ``PC``. Default: ``"RA"``.
    probe_diameter_mm
        Diameter of the probe in mm, from 0.01 to the reach of the pad. Default: 0.5.
    depth_um
        Depths of the press in um, or with `frequency_hz` amplitudes of the sinusoid.
        Default: 100 to 500 by 100.
    times_threshold
        Further depths, as multiples of the threshold at the hot spot. Default: none.
    criterion
        Share of the impulses at the hot spot that counts as a response, at least one impulse.
        Default: 0.1.
    frequency_hz
        Frequency of a sinusoid of 200 ms in Hz, 1 to 1000. Default: None, a press.
    step_mm
        Distance of two positions of the probe in mm, 0.1 to 2. Default: 0.25.
    endings_mm
        Distance in mm of the further endings of SA and RA units, as in `Population`.
        Default: 1.2.
    sa_von_mises
        Whether SA units respond to von Mises stress. Default: False.
    pad
        As in `touch`, but not ``"plane"``. Default: ``"reference"``.
    parameters
        As in `touch`. Default: None, ``"fitted_pad"``.

    Returns
    -------
    ReceptiveField
        ``areas`` is a DataFrame, ``impulses`` ``(depth, x, z)`` are the maps; ``plot()`` shows
        them, ``write(folder)`` writes the files of ``fembridge receptive-field``.

    Raises
    ------
    UsageError
        An unknown class, or a number out of range.

    Warns
    -----
    FembridgeWarning
        Depths of more than 1 mm, a probe narrower than 1.75 node distances, or parameters that
        were fitted on other mechanics.

    Examples
    --------
    >>> import fembridge as fb
    >>> field = fb.receptive_field("SA", depth_um=[200], step_mm=1.0)
    >>> list(field.areas.columns)
    ['afferent', 'depth_um', 'area_mm2', 'whole']
    """
    skin = resolve_pad(pad)
    if skin.plane:
        raise UsageError(
            "is plane: its probes are endless along the finger", argument="pad", found=pad
        )
    if relaxation_of(skin) is not None:
        warn("the pad relaxes, but a receptive field is that of its instantaneous moduli")
    selected = parameters_on(skin, parameters)
    class_parameters = selected.parameters
    if afferent not in tuple(class_parameters) or afferent not in skin.afferents:
        expected = f"one of {', '.join(class_parameters)}"
        raise UsageError(argument="afferent", found=afferent, expected=expected)
    check_range("probe_diameter_mm", probe_diameter_mm, Range(_MIN_PROBE_MM, skin.reach_mm))
    check_range("criterion", criterion)
    check_range("step_mm", step_mm)
    depths, multiples = list(np.atleast_1d(depth_um)), list(np.atleast_1d(times_threshold))
    for argument, values in (("depth_um", depths), ("times_threshold", multiples)):
        for value in values:
            check_range(argument, value, Range(ABOVE_ZERO, MOST_UM))
    depths = sorted(map(float, depths))
    half_mm = skin.reach_mm - 0.5 * probe_diameter_mm
    across = np.arange(-int(half_mm / step_mm), int(half_mm / step_mm) + 1.0) * step_mm
    half_length_mm = min(_HALF_LENGTH_MM, skin.half_length_mm - 0.5 * probe_diameter_mm)
    along = np.arange(0, int(half_length_mm / step_mm) + 1.0) * step_mm
    if not skin.uniform_along:
        along = np.concatenate([-along[:0:-1], along])
    wave = _wave(frequency_hz)
    deepest = MOST_UM if multiples else max(depths, default=0.0)
    level_um = deepest * (np.arange(_LEVELS) / (_LEVELS - 1)) ** 1.5
    probe = Shape.punch(probe_diameter_mm)

    def stress_under(probe_mm: tuple[float, float], z_mm: FloatArray) -> FloatArray:
        """Stress ``(level, z)`` of afferents at `z_mm` under a probe."""
        moved = probe.moved(*probe_mm)
        if not np.isfinite(skin.skin_nodes().gaps_mm(moved)).any():  # beside the skin
            return np.zeros((level_um.size, z_mm.size))
        nodes, forces, _ = press_to(skin, moved, level_um)
        units = Population.at([afferent] * z_mm.size, 0 * z_mm, z_mm, finger=skin)
        units = units.with_endings(endings_mm, sa_von_mises=sa_von_mises)
        return driving_stress_pa(skin, nodes, forces, units)

    def curves(x_mm: float, away_mm: FloatArray) -> FloatArray:
        """Stress ``(level, z)`` under probes at `x_mm` and so far along the finger."""
        if skin.uniform_along:  # as if the afferents were there
            return stress_under((x_mm, 0.0), away_mm)
        middle = np.zeros(1)
        stress = [stress_under((x_mm, z_mm), middle) for z_mm in away_mm.tolist()]
        return np.concatenate(stress, axis=1)

    def impulses(stress: FloatArray, depth: float) -> IntArray:
        """Impulses ``(place,)`` of stress ``(level, place)`` at one depth."""
        trace = interpolate_states(level_um, stress, np.maximum(depth * wave, 0.0))
        classes = [afferent] * stress.shape[1]
        fired = encode_units(trace, classes, DT_MS, class_parameters)
        return np.bincount(fired.unit, minlength=stress.shape[1])

    middle = curves(0.0, np.zeros(1))
    threshold_um = _threshold(lambda depth: int(impulses(middle, depth)[0]), deepest)
    depths += [times * threshold_um for times in multiples if times * threshold_um <= MOST_UM]
    depths = sorted(depths)
    if not depths:
        raise UsageError(f"{afferent} does not fire up to {MOST_UM:g} um: no depth to map")
    # The hot spot is pressed, so the pre-indentation of the fit does not matter here.
    finger = skin.mechanics
    check_mechanics(selected, finger, None)
    for text in (
        narrow_warning(skin, probe.name, probe_diameter_mm),
        depth_warning(depths[-1]),
    ):
        if text:
            warn(text)
    stress = np.concatenate([curves(float(x), along) for x in across], axis=1)
    half = np.stack([impulses(stress, depth).reshape(across.size, -1) for depth in depths])
    return ReceptiveField(
        afferent=afferent,
        probe_diameter_mm=probe_diameter_mm,
        x_mm=across,
        z_mm=np.concatenate([-along[:0:-1], along]) if skin.uniform_along else along,
        depth_um=np.array(depths),
        impulses=np.concatenate([half[:, :, :0:-1], half], axis=2) if skin.uniform_along else half,
        criterion=criterion,
        threshold_um=threshold_um,
        origin={
            "fembridge": __version__,
            "pad": {"source": skin.source, "sha256": skin.sha256, **skin.origin},
            "finger": finger,
            "parameter_set": selected.name,
            "parameters": parameters_to_table(class_parameters),
            "endings_mm": float(endings_mm),
            "sa_von_mises": bool(sa_von_mises),
            **({} if frequency_hz is None else {"frequency_hz": float(frequency_hz)}),
        },
    )


def _wave(frequency_hz: float | None) -> FloatArray:
    """Depth of the probe over time as a share of its largest depth."""
    if frequency_hz is None:
        return Trajectory.press(press_um=1.0, ramp_ms=_RAMP_MS, hold_ms=_HOLD_MS).level
    check_range("frequency_hz", frequency_hz, Range(1, 1000))
    times_ms = np.arange(int(_VIBRATION_MS / DT_MS) + 1) * DT_MS
    return np.asarray(np.sin(2 * np.pi * frequency_hz * times_ms / 1000.0))


def _threshold(count: Callable[[float], int], deepest_um: float) -> float:
    """Least depth with an impulse, to a thousandth; infinite if there is none."""
    if not count(deepest_um):
        return float("inf")
    low, high = deepest_um * 1e-5, deepest_um
    for _ in range(_HALVINGS):
        middle = (low * high) ** 0.5
        low, high = (low, middle) if count(middle) else (middle, high)
    return high
