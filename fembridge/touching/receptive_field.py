"""Receptive fields: where on the skin a probe makes an afferent fire.

A prism is the same all along z, so a probe that is pressed once at each position across the
finger, over endings that lie further and further along it, is a probe at every position over
one unit. On a mesh the probe is pressed at every position.

Fields were recorded on free skin, or under an array of probes that are all pressed into the skin
before one of them goes further (Vega-Bermudez & Johnson 1999). Its neighbours hold the skin, so
that the same step deforms it more: ``background_um``.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from decks.stimuli import DT_MS
from fembridge.errors import ResultError, UsageError, warn
from fembridge.host.progress import advance
from fembridge.host.store import filling, read_toml, write_text, write_toml
from fembridge.io.text_table import read_table
from fembridge.plots.shown import Shown
from fembridge.ranges import ABOVE_ZERO, Range, check_range
from fembridge.solver.mechanics import check_mechanics
from fembridge.touching.contact import (
    MM_PER_UM,
    MOST_UM,
    ContactSolver,
    blas_threads,
    press_to,
)
from fembridge.touching.contact_warnings import depth_warning, narrow_warning
from fembridge.touching.pad import Pad, SkinNodes
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
from neural.parameters import Parameters, quantiles

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from fembridge.plots.style import Panels

SUMMARY_FILE, UNITS_FILE, AREAS_FILE = "summary.csv", "units.csv", "areas.csv"
MAPS_FILE, RECORD_FILE = "fields.csv", "receptive_field.toml"
UNIT_COLUMNS = ("unit", "afferent", "deviate", "threshold_um", "threshold_mn", "hot_spots")
MAP_COLUMNS = ("unit", "afferent", "depth_um", "x_mm", "z_mm", "impulses")
_OF_UNITS = ("unit", *UNIT_COLUMNS[2:])
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
# A probe fires no unit whose drive it changes less than this share of its drive at threshold.
_LEAST_DRIVE = 0.5
# Of one unit at one depth so many traces are encoded, evenly spaced in the logarithm of their
# peak; a position has the impulses of the trace whose peak is nearest. Near the border of the
# field, where one of so many traces to both sides responds and another does not, all are encoded.
_TRACES, _TRACES_AROUND = 64, 4
# A local maximum of the drive is a hot spot from this share of the largest one on.
_HOT_SHARE = 0.5
_MN_PER_N = 1.0e3
# Two depths or positions that are nearer are the same, in um or mm.
_ROUNDED = 1e-6
_STEP_MM = 0.25
# Distance of the probes of an array, in diameters.
_PITCH = 1.5


@dataclass(frozen=True, eq=False, repr=False)
class ReceptiveField(Shown):
    """Result of `fembridge.receptive_field`: impulses of units of a class by position of the probe.

    The units differ in sensitivity, from the most to the least sensitive, and in their endings.

    Parameters
    ----------
    afferent
        Class of the units: ``SA``, ``RA`` or ``PC``.
    unit, deviate
        Names and sensitivities of the units, ``(U,)``, as of `fembridge.Population`.
    probe_diameter_mm
        Diameter of the probe in mm.
    x_mm, z_mm
        Positions of the probe from the unit, across and along the finger, in mm, ``(X,)`` and
        ``(Z,)``.
    times_threshold
        Which depths are multiples of the threshold of each unit, ``(depth,)``; NaN where a
        depth is the same for all.
    depth_um
        Depths, or amplitudes, of the probe in um, ``(unit, depth)``; NaN where a multiple is
        deeper than 2 mm or the unit has no threshold.
    impulses
        Impulses, ``(unit, depth, x, z)``.
    criterion
        Share of the impulses at the hot spot that counts as a response.
    threshold_um, threshold_mn
        Least depth in um at which each unit fires at its most sensitive position, and the force
        on the probe in mN there, ``(U,)``; infinite if it never does.
    hot_spots
        Number of local maxima of the sensitivity to the probe, of half the largest sensitivity
        or more, ``(U,)``.
    origin
        Pad, parameters and version, for the record. Default: nothing.

    Examples
    --------
    >>> import fembridge as fb
    >>> fields = fb.receptive_field("SA", units=3, depth_um=[200], step_mm=1.0)
    >>> fields.threshold_um.shape
    (3,)
    """

    afferent: str
    unit: tuple[str, ...]
    deviate: FloatArray
    probe_diameter_mm: float
    x_mm: FloatArray
    z_mm: FloatArray
    times_threshold: FloatArray
    depth_um: FloatArray
    impulses: IntArray
    criterion: float
    threshold_um: FloatArray
    threshold_mn: FloatArray
    hot_spots: IntArray
    origin: Mapping[str, Any] = field(default_factory=dict)

    def _lines(self) -> list[str]:
        count = f"{len(self.unit)} units of {self.afferent}"
        medians = self.summary.set_index("quantity")["median"]
        areas = ", ".join(
            f"{medians[f'area_mm2 at {label}']:.1f} mm² at {label}" for label in self.depth_labels
        )
        return [
            f"Receptive fields of {count}, probe {self.probe_diameter_mm:g} mm",
            f"  median threshold {medians['threshold_um']:.3g} um, "
            f"{medians['threshold_mn']:.2g} mN; {medians['hot_spots']:.0f} hot spots",
            f"  median area: {areas}",
            "  .summary, .areas, .units, .impulses, .plot(), .write(folder)",
        ]

    @property
    def middle(self) -> int:
        """Index of the unit of median sensitivity."""
        return len(self.unit) // 2

    @property
    def provenance(self) -> Table:
        """Version, probe, criterion, depths, positions, units, pad and parameters."""
        shared = np.isnan(self.times_threshold)
        return {
            **self.origin,
            "afferent": self.afferent,
            "probe_diameter_mm": float(self.probe_diameter_mm),
            "criterion": float(self.criterion),
            "depth_um": self.depth_um[0, shared].tolist(),
            "times_threshold": self.times_threshold[~shared].tolist(),
            "x_mm": self.x_mm.tolist(),
            "z_mm": self.z_mm.tolist(),
            **{name: np.array(getattr(self, name)).tolist() for name in _OF_UNITS},
        }

    @property
    def depth_labels(self) -> list[str]:
        """Name of each depth: ``50 um``, or ``4.5 x threshold``."""
        return [
            f"{depth:g} um" if np.isnan(times) else f"{times:g} x threshold"
            for times, depth in zip(self.times_threshold, self.depth_um[0], strict=True)
        ]

    @cached_property
    def responds(self) -> BoolArray:
        """Whether the unit responds to the probe, ``(unit, depth, x, z)``."""
        hot = self.impulses.max(axis=(2, 3), keepdims=True)
        return np.asarray((self.impulses >= np.maximum(self.criterion * hot, 1)) & (hot > 0))

    @cached_property
    def areas(self) -> "pandas.DataFrame":
        """Areas: ``unit, afferent, times_threshold, depth_um, area_mm2, whole``.

        `whole` is false where the field reaches the edge of the modelled skin. `area_mm2` is
        NaN where the depth is.
        """
        import pandas

        x_edges, z_edges = (
            np.concatenate([[axis[0]], 0.5 * (axis[1:] + axis[:-1]), [axis[-1]]])
            for axis in (self.x_mm, self.z_mm)
        )
        if self.origin.get("background_um"):  # each probe of an array has its own cell
            x_edges, z_edges = (
                np.concatenate([[2 * axis[0] - edges[1]], edges[1:-1], [2 * axis[-1] - edges[-2]]])
                for axis, edges in ((self.x_mm, x_edges), (self.z_mm, z_edges))
            )
        cell_mm2 = np.diff(x_edges)[:, None] * np.diff(z_edges)
        inside = self.responds
        border = inside[..., [0, -1], :].any(axis=(2, 3)) | inside[..., [0, -1]].any(axis=(2, 3))
        area_mm2 = np.where(np.isnan(self.depth_um), np.nan, (inside * cell_mm2).sum(axis=(2, 3)))
        count = self.times_threshold.size
        return pandas.DataFrame(
            {
                "unit": np.repeat(self.unit, count),
                "afferent": self.afferent,
                "times_threshold": np.tile(self.times_threshold, len(self.unit)),
                "depth_um": self.depth_um.ravel(),
                "area_mm2": area_mm2.ravel(),
                "whole": ~border.ravel(),
            }
        )

    @property
    def units(self) -> "pandas.DataFrame":
        """A row a unit: ``unit, afferent, deviate, threshold_um, threshold_mn, hot_spots``."""
        import pandas

        return pandas.DataFrame({name: getattr(self, name) for name in UNIT_COLUMNS})

    @cached_property
    def summary(self) -> "pandas.DataFrame":
        """Quartiles over the units: ``afferent, quantity, lower_quartile, median, upper_quartile``.

        Quantities are the thresholds in um and mN, the number of hot spots, and the area in mm2
        at each depth. A unit without a threshold counts as one with a larger threshold than all
        others; areas that are NaN do not count.
        """
        import pandas

        values = {name: self.units[name].to_numpy(np.float64) for name in UNIT_COLUMNS[3:]}
        areas = self.areas["area_mm2"].to_numpy().reshape(len(self.unit), -1)
        labels = [f"area_mm2 at {label}" for label in self.depth_labels]
        values |= dict(zip(labels, areas.T, strict=True))
        shares, rows = [0.25, 0.5, 0.75], []
        for name, column in values.items():
            known = np.sort(column[~np.isnan(column)])
            # Between a finite and an infinite value, or two infinite ones, nothing is linear.
            linear = bool(np.isfinite(known).all())
            quartiles = (
                np.quantile(known, shares, method="linear" if linear else "higher").tolist()
                if known.size
                else [np.nan] * len(shares)
            )
            rows.append([self.afferent, name, *quartiles])
        columns = ["afferent", "quantity", "lower_quartile", "median", "upper_quartile"]
        return pandas.DataFrame(rows, columns=columns)

    def to_frame(self) -> "pandas.DataFrame":
        """Maps: ``unit, afferent, depth_um, x_mm, z_mm, impulses``, a row a position that fires."""
        import pandas

        unit, depth, x, z = np.nonzero(self.impulses)
        return pandas.DataFrame(
            {
                "unit": np.array(self.unit)[unit],
                "afferent": self.afferent,
                "depth_um": self.depth_um[unit, depth],
                "x_mm": self.x_mm[x],
                "z_mm": self.z_mm[z],
                "impulses": self.impulses[unit, depth, x, z],
            }
        )

    def plot(self, kind: str | None = None, ax: "Panels | None" = None) -> "Figure":
        """Picture of the fields, as `fembridge receptive-field` draws it.

        Parameters
        ----------
        kind
            ``field``: maps of impulses of the unit of median sensitivity, one per depth (five at
            most), then maps of other units at the largest depth, then area against depth;
            ``area``: areas of all units against depth alone. Default: ``field``.
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
        """Write the tables and the record of ``fembridge receptive-field``; `read` reads them.

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
        """The fields that `write` or ``fembridge receptive-field`` wrote.

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
        >>> fields = fb.receptive_field("RA", units=3, step_mm=1.0)
        >>> fields.write("field")
        >>> fb.ReceptiveField.read("field").areas.equals(fields.areas)
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
        origin = dict(record[afferent])
        try:
            probe_diameter_mm, criterion = origin.pop("probe_diameter_mm"), origin.pop("criterion")
            x_mm, z_mm, depths, multiples, deviate, threshold_um, threshold_mn = (
                np.array(origin.pop(name), dtype=np.float64)
                for name in ("x_mm", "z_mm", "depth_um", "times_threshold", *_OF_UNITS[1:4])
            )
            unit, hot_spots = tuple(origin.pop("unit")), np.array(origin.pop("hot_spots"))
            origin.pop("afferent")
        except KeyError as error:
            raise ResultError(f"no {error.args[0]} of {afferent}", path) from error
        deepest_um = MOST_UM - origin.get("background_um", 0.0)
        depth_um = _depths_of_units(depths, multiples, threshold_um, deepest_um)
        maps = read_table(folder / MAPS_FILE, MAP_COLUMNS)
        maps = maps.where(maps.column("afferent") == afferent)
        # Rows of the map by unit, depth and position, each the one that is nearest.
        names = {name: row for row, name in enumerate(unit)}
        rows = np.array(
            [names.get(name, -1) for name in maps.words("unit").tolist()], dtype=np.int64
        )
        apart = [np.abs(depth_um[rows] - maps.numbers("depth_um")[:, None])]
        apart += [
            np.abs(axis - maps.numbers(name)[:, None])
            for axis, name in ((x_mm, "x_mm"), (z_mm, "z_mm"))
        ]
        apart = [np.where(np.isnan(each), np.inf, each) for each in apart]
        beside = (rows < 0) | np.any([each.min(axis=1) > _ROUNDED for each in apart], axis=0)
        if beside.any():
            problem = f"a unit, depth or position of {afferent} that {RECORD_FILE} has not"
            raise ResultError(problem, maps.path, int(maps.lines[beside.argmax()]))
        impulses = np.zeros((*depth_um.shape, x_mm.size, z_mm.size), dtype=np.int64)
        impulses[rows, *(each.argmin(axis=1) for each in apart)] = maps.numbers("impulses")
        return cls(
            afferent=afferent,
            unit=unit,
            deviate=deviate,
            probe_diameter_mm=probe_diameter_mm,
            x_mm=x_mm,
            z_mm=z_mm,
            times_threshold=np.concatenate([np.full(depths.size, np.nan), multiples]),
            depth_um=depth_um,
            impulses=impulses,
            criterion=criterion,
            threshold_um=threshold_um,
            threshold_mn=threshold_mn,
            hot_spots=hot_spots,
            origin=origin,
        )


def _depths_of_units(
    depths: FloatArray, multiples: FloatArray, threshold_um: FloatArray, deepest_um: float
) -> FloatArray:
    """Depths ``(unit, depth)`` in um, the shared ones first; NaN where a multiple is too deep."""
    own_um = threshold_um[:, None] * multiples
    own_um = np.where(own_um <= deepest_um, own_um, np.nan)
    shared_um = np.broadcast_to(depths, (threshold_um.size, depths.size))
    return np.concatenate([shared_um, own_um], axis=1)


def write_fields(
    folder: str | os.PathLike[str],
    fields: Sequence[ReceptiveField],
    more: Mapping[str, Callable[[Path], object]] | None = None,
) -> None:
    """Write the tables and the record of the fields of one class or several, all or none.

    Parameters
    ----------
    folder
        Folder of the files, which is made.
    fields
        Fields, one result a class.
    more
        Functions that write further files, by name. Default: None.
    """
    import pandas

    tables = {
        SUMMARY_FILE: [item.summary for item in fields],
        UNITS_FILE: [item.units for item in fields],
        AREAS_FILE: [item.areas for item in fields],
        MAPS_FILE: [item.to_frame() for item in fields],
    }
    with filling(Path(folder), last=RECORD_FILE) as draft:
        for name, write in (more or {}).items():
            write(draft / name)
        for name, parts in tables.items():
            table = pandas.concat(parts, ignore_index=True)
            write_text(draft / name, table.to_csv(index=False, lineterminator="\n"))
        write_toml(draft / RECORD_FILE, {item.afferent: item.provenance for item in fields})


def receptive_field(
    afferent: str = "RA",
    *,
    units: int = 21,
    probe_diameter_mm: float = 0.5,
    depth_um: Sequence[float] = (50.0, 100.0, 200.0),
    times_threshold: Sequence[float] = (4.5,),
    criterion: float = 0.1,
    frequency_hz: float | None = None,
    background_um: float = 0.0,
    step_mm: float | None = None,
    endings_mm: float = ENDINGS_MM,
    sa_von_mises: bool = False,
    pad: str | Path | Pad = PAD,
    parameters: str | Path | ParameterSet | None = None,
) -> ReceptiveField:
    """Where on the skin a probe makes units of a class fire, over what area, and from what depth.

    The units lie below the middle of the pad; a flat round probe is pressed at each position, by
    a ramp of 20 ms and a hold of 100 ms, or vibrates.

    Parameters
    ----------
    afferent
        Class: ``SA``, ``RA`` or ``PC``. Default: ``"RA"``.
    units
        Number of units, with sensitivities at even quantiles of those of the class and endings of
        their own; 1 is a unit of median sensitivity. Default: 21.
    probe_diameter_mm
        Diameter of the probe in mm, from 0.01 to the reach of the pad. Default: 0.5.
    depth_um
        Depths of the press in um, or with `frequency_hz` amplitudes of the sinusoid.
        Default: 50, 100 and 200.
    times_threshold
        Further depths, as multiples of the threshold of each unit. Default: 4.5.
    criterion
        Share of the impulses at the hot spot that counts as a response, at least one impulse.
        Default: 0.1.
    frequency_hz
        Frequency of a sinusoid of 200 ms in Hz, 1 to 1000. Default: None, a press.
    background_um
        Depth in um to which an array of such probes, `step_mm` apart, is pressed into the skin
        before one of them goes deeper; the units have adapted to it, so that only the change of
        their stress drives them. Default: 0, a single probe on free skin.
    step_mm
        Distance of two positions of the probe in mm, 0.1 to 2; in an array more than the
        diameter. Default: None, 0.25, in an array 1.5 diameters.
    endings_mm
        Radius in mm of the area of the endings of an SA or RA unit, as in `Population`; 0: a
        single ending. Default: 1.5.
    sa_von_mises
        Whether SA units respond to von Mises stress. Default: False.
    pad
        As in `touch`, but not ``"plane"``. Default: ``"reference"``.
    parameters
        As in `touch`. Default: None, ``"fitted_pad"``.

    Returns
    -------
    ReceptiveField
        ``summary`` has medians and quartiles, ``areas`` and ``units`` are DataFrames,
        ``impulses`` ``(unit, depth, x, z)`` are the maps, exact near the borders of the fields,
        elsewhere those of a position with nearly the same stress; ``plot()`` shows them,
        ``write(folder)`` writes the files of ``fembridge receptive-field``.

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
    >>> fields = fb.receptive_field("SA", units=3, depth_um=[200], step_mm=1.0)
    >>> fields.summary["quantity"].tolist()[-2:]
    ['area_mm2 at 200 um', 'area_mm2 at 4.5 x threshold']
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
    check_range("units", units)
    check_range("probe_diameter_mm", probe_diameter_mm, Range(_MIN_PROBE_MM, skin.reach_mm))
    check_range("criterion", criterion)
    check_range("background_um", background_um)
    if step_mm is None:
        step_mm = min(_PITCH * probe_diameter_mm, 2.0) if background_um else _STEP_MM
    check_range("step_mm", step_mm)
    if background_um and step_mm <= probe_diameter_mm:
        expected = f"more than the diameter of the probes of an array, {probe_diameter_mm:g} mm"
        raise UsageError(argument="step_mm", found=step_mm, expected=expected)
    depths, multiples = (
        np.unique(_checked(argument, values)).tolist()
        for argument, values in (("depth_um", depth_um), ("times_threshold", times_threshold))
    )
    half_mm = skin.reach_mm - 0.5 * probe_diameter_mm
    across = np.arange(-int(half_mm / step_mm), int(half_mm / step_mm) + 1.0) * step_mm
    half_length_mm = min(_HALF_LENGTH_MM, skin.half_length_mm - 0.5 * probe_diameter_mm)
    along = np.arange(-int(half_length_mm / step_mm), int(half_length_mm / step_mm) + 1.0) * step_mm
    deepest_um = MOST_UM - background_um if multiples else max(depths, default=0.0)
    if deepest_um + background_um > MOST_UM:
        raise UsageError(
            argument="depth_um",
            found=deepest_um,
            expected=f"at most {MOST_UM:g} with background_um",
        )
    probe = _Probe(
        skin, probe_diameter_mm, deepest_um * (np.arange(_LEVELS) / (_LEVELS - 1)) ** 2,
        background_um, step_mm,
    )  # fmt: skip
    zeros = np.zeros(units)
    population = replace(
        Population.at([afferent] * units, zeros, zeros, deviate=quantiles(units), finger=skin),
        endings_mm=endings_mm,
        sa_von_mises=sa_von_mises,
    )
    wave = _wave(frequency_hz)
    drive_pa, force_n = probe.drive(population, across, along)
    response = _Response(afferent, class_parameters, population, probe.level_um, drive_pa)
    hot = response.hot_spot()
    threshold_um = response.thresholds_um(hot, wave)
    force_there_n = force_n.reshape(len(force_n), -1)[:, hot]
    threshold_mn = np.array(
        [
            _MN_PER_N * np.interp(depth, probe.level_um, force) if np.isfinite(depth) else np.inf
            for depth, force in zip(threshold_um, force_there_n.T, strict=True)
        ]
    )
    every_depth = _depths_of_units(
        np.array(depths), np.array(multiples), threshold_um, MOST_UM - background_um
    )
    if not np.isfinite(every_depth).any():
        raise UsageError(f"{afferent} does not fire up to {deepest_um:g} um: no depth to map")
    # The hot spot is pressed, so the pre-indentation of the fit does not matter here.
    finger = skin.mechanics
    check_mechanics(selected, finger, None)
    for text in (
        narrow_warning(skin, f"punch {probe_diameter_mm:g} mm", probe_diameter_mm),
        depth_warning(background_um + (depths[-1] if depths else 0.0)),
    ):
        if text:
            warn(text)
    impulses = np.stack(
        [response.impulses(depth, wave, threshold_um, hot, criterion) for depth in every_depth.T],
        axis=1,
    )
    return ReceptiveField(
        afferent=afferent,
        unit=population.unit,
        deviate=population.deviate,
        probe_diameter_mm=probe_diameter_mm,
        x_mm=across,
        z_mm=along,
        times_threshold=np.array([np.nan] * len(depths) + multiples, dtype=np.float64),
        depth_um=every_depth,
        impulses=impulses,
        criterion=criterion,
        threshold_um=threshold_um,
        threshold_mn=threshold_mn,
        hot_spots=hot_spot_counts(drive_pa[-1]),
        origin={
            "fembridge": __version__,
            "pad": {"source": skin.source, "sha256": skin.sha256, **skin.origin},
            "finger": finger,
            "parameter_set": selected.name,
            "parameters": parameters_to_table(class_parameters),
            "endings_mm": float(endings_mm),
            "sa_von_mises": bool(sa_von_mises),
            **({} if frequency_hz is None else {"frequency_hz": float(frequency_hz)}),
            **({"background_um": float(background_um)} if background_um else {}),
        },
    )


def _checked(argument: str, values: Sequence[float]) -> list[float]:
    numbers = list(np.atleast_1d(values))
    for value in numbers:
        check_range(argument, value, Range(ABOVE_ZERO, MOST_UM))
    return numbers


def _wave(frequency_hz: float | None) -> FloatArray:
    """Depth of the probe over time as a share of its largest depth."""
    if frequency_hz is None:
        return Trajectory.press(press_um=1.0, ramp_ms=_RAMP_MS, hold_ms=_HOLD_MS).level
    check_range("frequency_hz", frequency_hz, Range(1, 1000))
    times_ms = np.arange(int(_VIBRATION_MS / DT_MS) + 1) * DT_MS
    return np.asarray(np.sin(2 * np.pi * frequency_hz * times_ms / 1000.0))


@dataclass(frozen=True, slots=True)
class _Probe:
    """A probe of `diameter_mm` at the depths `level_um` ``(L,)``, alone or in an array."""

    skin: Pad
    diameter_mm: float
    level_um: FloatArray
    background_um: float
    pitch_mm: float

    def drive(
        self, units: Population, across: FloatArray, along: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Stress ``(L, unit, x, z)`` in Pa that drives units in the middle, and force of the probe.

        The force is ``(L, x, z)`` in N. In an array both are changes from the background.
        """
        uniform = self.skin.uniform_along  # units further along are a probe further along
        steps_mm = along if uniform else np.zeros(1)
        unit, x_mm, z_mm, sensitivity = units.endings()
        alike = unit.size == len(units)  # one ending each, all in the middle
        if alike:
            unit, x_mm, z_mm, sensitivity = unit[:1], x_mm[:1], z_mm[:1], sensitivity[:1]
        count = unit.size * steps_mm.size
        endings = Population(
            unit=tuple(map(str, range(count))),
            afferent=units.afferent[:1] * count,
            layer=units.layer[:1] * count,
            x_mm=np.repeat(x_mm, steps_mm.size),
            z_mm=(z_mm[:, None] - steps_mm).ravel(),
            depth_mm=np.full(count, units.depth_mm[0]),
            deviate=np.zeros(count),
            endings_mm=0.0,
            sa_von_mises=units.sa_von_mises,
        )
        first = np.flatnonzero(np.diff(unit, prepend=-1))
        shape = len(self.level_um), len(first), across.size, along.size
        drive, force_n = np.zeros(shape), np.zeros((shape[0], *shape[2:]))
        for column, probe_x_mm in enumerate(across.tolist()):
            for row, probe_z_mm in enumerate([0.0] if uniform else along.tolist()):
                share = (column + row / along.size) / across.size
                advance(f"field of {units.afferent[0]}", share)
                nodes, forces, own_n = self._press(probe_x_mm, probe_z_mm)
                place = np.s_[:, :, column, :] if uniform else np.s_[:, :, column, row : row + 1]
                force_n[place[:1] + place[2:]] = own_n[:, None]
                if not forces.size:
                    continue
                stress = driving_stress_pa(self.skin, nodes, forces, endings)
                stress = stress.reshape(shape[0], unit.size, -1) * sensitivity[:, None]
                if self.background_um:
                    stress -= stress[0].copy()
                    most = np.maximum.reduceat(stress, first, axis=1)
                    least = np.minimum.reduceat(stress, first, axis=1)
                    drive[place] = np.where(most >= -least, most, least)
                else:
                    drive[place] = np.maximum.reduceat(stress, first, axis=1)
        advance(f"field of {units.afferent[0]}", 1.0)
        if alike:
            drive = np.broadcast_to(drive, (shape[0], len(units), *shape[2:]))
        return drive, force_n

    def _press(self, x_mm: float, z_mm: float) -> tuple[SkinNodes, FloatArray, FloatArray]:
        """Nodes, their forces ``(L, node)`` and the force of the probe ``(L,)`` at a position."""
        none = self.skin.skin_nodes().subset(np.zeros(0, dtype=np.int64))
        nothing = none, np.zeros((self.level_um.size, 0)), np.zeros(self.level_um.size)
        probe = Shape.punch(self.diameter_mm).moved(x_mm, z_mm)
        nodes = self.skin.skin_nodes()
        if not np.isfinite(nodes.gaps_mm(probe)).any():  # beside the skin
            return nothing
        if not self.background_um:
            nodes, forces, _ = press_to(self.skin, probe, self.level_um)
            return nodes, forces, forces.sum(axis=1)
        seen_x_mm, seen_z_mm = nodes.seen_mm
        radius_mm = 0.5 * self.diameter_mm + _ROUNDED
        below = np.hypot(seen_x_mm - x_mm, seen_z_mm - z_mm) <= radius_mm
        away_mm = np.hypot(
            *(position - self.pitch_mm * np.round(position / self.pitch_mm)
              for position in (seen_x_mm, seen_z_mm))
        )  # fmt: skip
        plate = Shape.plate()
        gap_mm = nodes.gaps_mm(plate) - self.skin.first_touch_mm(plate)
        deepest_mm = MM_PER_UM * (self.background_um + np.where(below, self.level_um[-1], 0.0))
        reached = np.flatnonzero((away_mm <= radius_mm) & (gap_mm < deepest_mm))
        nodes, gap_mm, below = nodes.subset(reached), gap_mm[reached], below[reached]
        forces = np.empty((self.level_um.size, reached.size))
        with blas_threads(reached.size):
            contact = ContactSolver.on_nodes(nodes)
            for step, level_um in enumerate(self.level_um.tolist()):
                depth_um = self.background_um + level_um * below
                forces[step] = contact.press_by(gap_mm - MM_PER_UM * depth_um, 0.0, by_force=False)[
                    0
                ]
        own_n = forces[:, below].sum(axis=1)
        return nodes, forces, own_n - own_n[0]


@dataclass(frozen=True, slots=True)
class _Response:
    """Impulses of units of a class by the drive ``(L, unit, x, z)`` at the depths `level_um`."""

    afferent: str
    parameters: Parameters
    units: Population
    level_um: FloatArray
    drive_pa: FloatArray

    def hot_spot(self) -> IntArray:
        """The position, counted from 0 over x and z, that drives each unit most, ``(U,)``."""
        deepest = self.drive_pa[-1].reshape(len(self.units), -1)
        return np.asarray(deepest.argmax(axis=1))

    def thresholds_um(self, hot: IntArray, wave: FloatArray) -> FloatArray:
        """Least depth with an impulse at the hot spot, to a thousandth; infinite without one."""
        at_hot = self._curves(np.arange(len(self.units)), hot)

        def fires(depth_um: FloatArray) -> BoolArray:
            return self._counts(at_hot, depth_um, wave, np.arange(len(self.units))) > 0

        high = np.full(len(self.units), self.level_um[-1])
        low, ever = 1e-5 * high, fires(high)
        for _ in range(_HALVINGS):
            middle = np.sqrt(low * high)
            fired = fires(middle)
            low, high = np.where(fired, low, middle), np.where(fired, middle, high)
        return np.where(ever, high, np.inf)

    def impulses(
        self,
        depth_um: FloatArray,
        wave: FloatArray,
        threshold_um: FloatArray,
        hot: IntArray,
        criterion: float,
    ) -> IntArray:
        """Impulses ``(unit, x, z)``, each unit at its depth ``(U,)``; none where that is NaN."""
        count, positions = len(self.units), int(np.prod(self.drive_pa.shape[2:]))
        impulses = np.zeros((count, positions), dtype=np.int64)

        def encode(places: list[tuple[int, IntArray]]) -> None:
            """Encode the traces of units at positions."""
            owner = np.concatenate([np.full(place.size, unit) for unit, place in places])
            place = np.concatenate([place for _, place in places])
            curves = self._curves(owner, place)
            impulses[owner, place] = self._counts(curves, depth_um[owner], wave, owner)

        nearest: list[tuple[int, IntArray, IntArray, IntArray]] = []
        for unit in np.flatnonzero(np.isfinite(depth_um) & np.isfinite(threshold_um)).tolist():
            drive = self.drive_pa[:, unit].reshape(-1, positions)
            peak = _at(depth_um[unit], self.level_um, drive)
            least = _LEAST_DRIVE * _at(threshold_um[unit], self.level_um, drive[:, hot[unit]])
            for sign in (1, -1):
                places = np.flatnonzero(sign * peak >= least)
                if places.size:
                    nearest.append((unit, places, *_traces(np.log(sign * peak[places]))))
        if nearest:
            encode([(unit, places[traces]) for unit, places, traces, _ in nearest])
            border: list[tuple[int, IntArray]] = []
            for unit, places, traces, trace in nearest:
                counts = impulses[unit, places[traces]]
                impulses[unit, places] = counts[trace]
                responds = counts >= max(criterion * impulses[unit].max(), 1)
                window = np.pad(responds, _TRACES_AROUND, mode="edge")
                around = np.lib.stride_tricks.sliding_window_view(window, 2 * _TRACES_AROUND + 1)
                near_border = np.asarray(around.any(axis=1) & ~around.all(axis=1))
                if traces.size < places.size:
                    border.append((unit, places[near_border[trace]]))
            if border:
                encode(border)
        return impulses.reshape(count, *self.drive_pa.shape[2:])

    def _curves(self, unit: IntArray, position: IntArray) -> FloatArray:
        """Drive ``(L, n)`` of units at positions."""
        _, _, *grid = self.drive_pa.shape
        x, z = np.unravel_index(position, grid)
        curves: FloatArray = self.drive_pa[:, unit, x, z]
        return curves

    def _counts(
        self, curves: FloatArray, depth_um: FloatArray, wave: FloatArray, unit: IntArray
    ) -> IntArray:
        """Impulses ``(n,)`` of units ``(n,)`` by the drive ``(L, n)``, at depths ``(n,)``."""
        trace = np.empty((wave.size, depth_um.size))
        for depth in np.unique(depth_um).tolist():
            rows = depth_um == depth
            samples = np.maximum(depth * wave, 0.0)
            trace[:, rows] = interpolate_states(self.level_um, curves[:, rows], samples)
        classes = [self.afferent] * depth_um.size
        deviate, sign = self.units.deviate[unit], self.units.sign[unit]
        fired = encode_units(trace, classes, DT_MS, self.parameters, deviate, sign=sign)
        return np.bincount(fired.unit, minlength=depth_um.size)


def _at(depth_um: float, level_um: FloatArray, drive: FloatArray) -> FloatArray:
    """Drive ``(L, ...)`` at one depth, linear between two levels."""
    row = min(int(np.searchsorted(level_um, depth_um, "right")) - 1, level_um.size - 2)
    share = (depth_um - level_um[row]) / (level_um[row + 1] - level_um[row])
    values: FloatArray = (1 - share) * drive[row] + share * drive[row + 1]
    return values


def _traces(values: FloatArray) -> tuple[IntArray, IntArray]:
    """Rows of at most `_TRACES` of `values` ``(n,)``, rising; of each value the nearest of them."""
    order = np.argsort(values, kind="stable")
    rising = values[order]
    selected = np.arange(values.size)
    if values.size > _TRACES:
        marks = np.linspace(rising[0], rising[-1], _TRACES)
        selected = np.unique(np.searchsorted(rising, marks - 1e-12).clip(0, values.size - 1))
    middles = 0.5 * (rising[selected][1:] + rising[selected][:-1])
    return order[selected], np.asarray(np.searchsorted(middles, values))


def hot_spot_counts(drive: FloatArray) -> IntArray:
    """Number of local maxima of each map ``(unit, x, z)`` that reach half of its largest value.

    A maximum is larger than its eight neighbours; of a flat one the first position counts.
    """
    padded = np.pad(drive, ((0, 0), (1, 1), (1, 1)), constant_values=-np.inf)
    _, width, length = drive.shape
    is_peak = drive >= np.maximum(_HOT_SHARE * drive.max(axis=(1, 2), keepdims=True), 1e-300)
    for x in (0, 1, 2):
        for z in (0, 1, 2):
            if (x, z) == (1, 1):
                continue
            beside = padded[:, x : x + width, z : z + length]
            is_peak &= drive > beside if (x, z) < (1, 1) else drive >= beside
    return np.asarray(is_peak.sum(axis=(1, 2)))
