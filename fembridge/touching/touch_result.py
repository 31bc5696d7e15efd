"""The result of a touch: contact, stress and spikes of every unit, as tables and files."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.errors import ResponseError, ResultError, UsageError
from fembridge.host.memory import check_memory
from fembridge.host.store import filling, read_toml, replacing, write_text, write_toml
from fembridge.io.npz import NpzFile
from fembridge.io.spike_table import SpikeTrain
from fembridge.io.text_table import read_table
from fembridge.plots.shown import Shown
from fembridge.touching.contact_history import ContactHistory, with_layer_forces
from fembridge.touching.fingerprint import Fingerprint
from fembridge.touching.large_strain import LargeStrain, has_large_strain, sheet_of
from fembridge.touching.pad import Pad, SkinNodes
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.population import Population
from fembridge.touching.relaxation import Relaxation, pad_with_prony
from fembridge.touching.ridged_pad import with_ridges
from fembridge.touching.stress import ContactStress, von_mises_pa
from fembridge.touching.trajectory import PinArray, Trajectory
from fembridge.typing import FloatArray, IntArray, SingleArray, Table
from neural.encoder import UnitSpikes

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from fembridge.io.recording import Recording
    from fembridge.plots.style import Panels

POPULATION_FILE, TOUCH_FILE = "population.csv", "touch.csv"
SPIKES_FILE, RATES_FILE = "spikes.csv", "rates.csv"
CONTACT_FILE, RECORD_FILE = "contact.npz", "touch.toml"
PICTURES = ("pad", "raster", "psth", "isi", "force")
"""Kinds of `Touch.plot`."""
_MS_PER_S = 1.0e3
# Arrays of `CONTACT_FILE`: of the contact, and of the trajectory.
_CONTACT_ARRAYS = ("forces_n", "total_n", "depth_um", "knots", "position")
_LOADS = "large_strain_loads_n"
_TRAJECTORY_ARRAYS = ("x_mm", "z_mm", "pin_positions", "pin_depth_um")


@dataclass(frozen=True, eq=False, repr=False)
class Touch(Shown):
    """Result of `fembridge.touch`: contact, stress and spikes of a population.

    Parameters
    ----------
    population
        Units that were touched.
    trajectory
        Depth or force of the shape, and its position, as they were prescribed.
    force_n, depth_um
        Force of the shape in N (on a plane pad N/mm) and its depth in um, ``(T,)``.
    contact
        Forces on the nodes of the skin.
    fired
        Spikes of all units.
    trials
        Number of trials. Default: 1.
    origin
        Inputs of the touch, see `provenance`. Default: nothing.

    Examples
    --------
    >>> import fembridge as fb
    >>> result = fb.touch("punch:diameter_mm=1", press_um=200, population="one_each")
    >>> result.rates["afferent"].tolist(), bool(result.force_n.max() > 0)
    (['SA', 'RA', 'PC'], True)
    """

    population: Population
    trajectory: Trajectory
    force_n: FloatArray
    depth_um: FloatArray
    contact: ContactHistory
    fired: UnitSpikes
    trials: int = 1
    origin: Table = field(default_factory=dict)

    def _lines(self) -> list[str]:
        rates = ", ".join(
            f"{name} {row['firing']:.0f} of {row['units']:.0f}"
            for name, row in self.summary().items()
        )
        shape = self.origin.get("shape", {}).get("name")
        return [
            f"Touch: {shape + ', ' if shape else ''}{self.trajectory.name}",
            f"  up to {self.depth_um.max():.3g} um and {self.force_n.max():.3g} {self.force_unit}, "
            f"{self.trajectory.times_ms[-1]:g} ms, parameters "
            f"{self.origin.get('parameter_set', 'not named')}",
            f"  units that fire: {rates}",
            "  .rates, .spikes, .samples, .plot(), .write(folder)",
        ]

    @property
    def force_unit(self) -> str:
        """Unit of `force_n`: N, or N/mm on a plane pad."""
        return "N/mm" if self.contact.nodes.pad.plane else "N"

    @property
    def provenance(self) -> Table:
        """Version, shape, trajectory, pad, parameters, population, noise and seed, with digests."""
        return {
            **self.origin,
            "trajectory": self.trajectory.to_table(),
            "population": self.population.to_table(),
        }

    @cached_property
    def stress_pa(self) -> FloatArray:
        """Stress that drives each unit in Pa, ``(T, unit)``.

        Raises
        ------
        UsageError
            More memory than is available; `stress_of` gives some units.
        """
        return self.stress_of(range(len(self.population)))

    def stress_of(self, units: Sequence[int]) -> FloatArray:
        """Stress that drives some units in Pa, ``(T, len(units))``.

        Parameters
        ----------
        units
            Numbers of units, from 0.

        Raises
        ------
        UsageError
            More memory than is available.
        """
        rows, samples = np.asarray(units, dtype=np.int64), self.trajectory.level.size
        subject = f"stress of {rows.size} units at {samples} samples"
        check_memory(2 * 8 * samples * rows.size, subject, UsageError)
        return ContactStress(self.contact.nodes.pad, self.population, self.contact).stress_pa(rows)

    def skin_stress_pa(self, states: IntArray, x_mm: FloatArray, z_mm: FloatArray) -> FloatArray:
        """Von Mises stress at the depth of SA afferents in Pa, ``(state, z, x)``.

        Parameters
        ----------
        states
            Numbers of states of `contact`, from 0, ``(state,)``.
        x_mm, z_mm
            Positions of the grid across and along the finger in mm, ``(x,)`` and ``(z,)``.
        """
        pad = self.contact.nodes.pad
        site = pad.afferents.get("SA") or next(iter(pad.afferents.values()))
        x, z = (axis.ravel() for axis in np.meshgrid(x_mm, z_mm))
        layers, depth_mm = np.full(x.size, site.layer), np.full(x.size, site.depth_mm)
        nodes: SkinNodes
        forces_n: FloatArray | SingleArray
        if self.contact.large_strain is not None:
            nodes, forces_n = self.contact.large_strain.stressed(states)
        else:
            forces_n = self.contact.forces_in(site.layer)[states]
            nodes, forces_n = self.contact.nodes.spread_on_pad(forces_n)
        influence = pad.influence_pa(nodes, layers, *pad.clipped(x, z), depth_mm)
        stress_pa = von_mises_pa(influence, forces_n)
        return stress_pa.reshape(-1, z_mm.size, x_mm.size)

    # ---- Tables

    @cached_property
    def spikes(self) -> "pandas.DataFrame":
        """Spikes, one row each: ``stimulus, afferent, unit, trial, spike_time_ms``."""
        import pandas

        unit = np.array(self.population.unit, dtype=object)
        afferent = np.array(self.population.afferent, dtype=object)
        trial = self.fired.trial if self.trials > 1 else np.zeros_like(self.fired.trial)
        return pandas.DataFrame(
            {
                "stimulus": self.trajectory.name,
                "afferent": afferent[self.fired.unit],
                "unit": unit[self.fired.unit],
                "trial": trial,
                "spike_time_ms": self.fired.time_ms,
            }
        )

    @cached_property
    def rate_ips(self) -> FloatArray:
        """Mean rate of each unit over all trials in impulses/s, ``(unit,)``."""
        start_ms, end_ms = self.trajectory.window_ms
        is_inside = (self.fired.time_ms > start_ms) & (self.fired.time_ms <= end_ms)
        counts = np.bincount(self.fired.unit[is_inside], minlength=len(self.population))
        rate_ips = counts * _MS_PER_S / ((end_ms - start_ms) * self.trials)
        return np.asarray(rate_ips, dtype=np.float64)

    @cached_property
    def rates(self) -> "pandas.DataFrame":
        """Rates in impulses/s, a row a unit: ``stimulus, afferent, unit, rate_ips``."""
        import pandas

        return pandas.DataFrame(
            {
                "stimulus": self.trajectory.name,
                "afferent": list(self.population.afferent),
                "unit": list(self.population.unit),
                "rate_ips": self.rate_ips,
            }
        )

    @property
    def samples(self) -> "pandas.DataFrame":
        """The shape over time: ``time_ms, x_mm, z_mm, depth_um, force_n``.

        The position is relative to that of the shape at first; 0 where it does not slide.
        """
        import pandas

        still = np.zeros(self.trajectory.level.size)
        x_mm, z_mm = self.trajectory.x_mm, self.trajectory.z_mm
        return pandas.DataFrame(
            {
                "time_ms": self.trajectory.times_ms,
                "x_mm": still if x_mm is None else x_mm,
                "z_mm": still if z_mm is None else z_mm,
                "depth_um": self.depth_um,
                "force_n": self.force_n,
            }
        )

    def summary(self) -> dict[str, dict[str, float]]:
        """Units, firing units, mean and largest rate of each class."""
        afferent = np.array(self.population.afferent)
        classes = {}
        for name in dict.fromkeys(self.population.afferent):
            rate_ips = self.rate_ips[afferent == name]
            classes[name] = {
                "units": int(rate_ips.size),
                "firing": int((rate_ips > 0).sum()),
                "mean_ips": float(rate_ips.mean()),
                "most_ips": float(rate_ips.max()),
            }
        return classes

    def tables(self) -> "dict[str, pandas.DataFrame]":
        """Tables of ``fembridge touch`` by the names of their files."""
        return {
            POPULATION_FILE: self.population.to_frame(),
            SPIKES_FILE: self.spikes,
            RATES_FILE: self.rates,
            TOUCH_FILE: self.samples,
        }

    def to_recording(self) -> "Recording":
        """Recording for other programs: all trials, with position and class of each unit."""
        from fembridge.io.recording import Recording

        units, fired = self.population, self.fired
        return Recording.from_units(
            units.unit,
            units.afferent,
            self.trajectory.name,
            self.trials,
            (fired.trial, fired.unit, fired.time_ms),
            {name: getattr(units, name) for name in ("x_mm", "z_mm", "depth_mm", "deviate")},
            self.depth_um,
            self.trajectory.dt_ms,
        )

    def trains(self) -> list[SpikeTrain]:
        """Spike trains of all units and trials, also of silent ones."""
        units, fired = self.population, self.fired
        train = fired.unit * self.trials + fired.trial - 1
        times_ms = np.split(
            fired.time_ms, np.searchsorted(train, np.arange(1, len(units) * self.trials))
        )
        return [
            SpikeTrain(
                self.trajectory.name,
                units.afferent[row // self.trials],
                spikes_ms,
                unit=units.unit[row // self.trials],
                trial=row % self.trials + 1 if self.trials > 1 else 0,
            )
            for row, spikes_ms in enumerate(times_ms)
        ]

    # ---- Pictures

    def plot(self, kind: str | None = None, ax: "Panels | None" = None) -> "Figure":
        """Picture of the touch, as `fembridge touch` and `fembridge plot` draw it.

        Parameters
        ----------
        kind
            ``pad``: the skin from above, a panel a class with rates and contact pressure, and
            a panel of depth and force; ``raster``: depth and force, then the spikes of each
            class; ``psth`` and ``isi``: histograms of spikes and of intervals, a panel a class;
            ``force``: depth and force over time. Default: ``pad``.
        ax
            Axes to draw into, one per panel in this order; of ``pad`` the last may be left
            out. Default: a new figure.

        Raises
        ------
        UsageError
            An unknown kind, or another number of axes than panels.
        """
        from fembridge.plots.spike_figures import isi_figure, psth_figure
        from fembridge.plots.touch_view import force_figure, pad_figure, unit_raster_figure

        kind = kind or "pad"
        if kind not in PICTURES:
            raise UsageError(argument="kind", found=kind, expected=", ".join(PICTURES))
        axes = None if ax is None else list(np.ravel(np.asarray(ax, dtype=object)))
        if kind in ("psth", "isi"):
            draw = psth_figure if kind == "psth" else isi_figure
            return draw(self.trains(), axes=axes)
        figures = {"pad": pad_figure, "raster": unit_raster_figure, "force": force_figure}
        return figures[kind](self, axes)

    def animate(self, path: str | os.PathLike[str]) -> None:
        """Write a moving picture: contact pressure, stress under the skin, and spikes.

        Parameters
        ----------
        path
            File in ``.gif``, or in ``.mp4`` if ffmpeg is installed.

        Raises
        ------
        UsageError, MissingError
            Another suffix, or no ffmpeg.
        """
        from fembridge.plots.touch_view import write_movie

        write_movie(Path(path), self)

    # ---- Files

    def write_contact(self, path: Path) -> None:
        """Write the forces on the nodes and the trajectory as NPZ.

        Parameters
        ----------
        path
            Path of the file.
        """
        contact, trajectory = self.contact, self.trajectory
        arrays: dict[str, Any] = {
            **contact.nodes.to_arrays(),
            **{name: getattr(contact, name) for name in _CONTACT_ARRAYS},
            "level": trajectory.level,
        }
        if contact.drag is not None:
            arrays["drag"] = contact.drag
        if contact.large_strain is not None:
            arrays[_LOADS] = contact.large_strain.loads_n
        if trajectory.x_mm is not None:
            arrays |= {"x_mm": trajectory.x_mm, "z_mm": trajectory.z_mm}
        if trajectory.pins is not None:
            arrays["pin_positions"] = np.array(trajectory.pins.positions)
            arrays["pin_depth_um"] = trajectory.pins.depth_um
        with replacing(path) as draft, draft.open("wb") as file:
            np.savez_compressed(file, **arrays)

    def write(self, folder: str | os.PathLike[str]) -> None:
        """Write all tables, the contact and the record; `read` reads them.

        The files are ``population.csv``, ``spikes.csv``, ``rates.csv``, ``touch.csv``,
        ``contact.npz`` and ``touch.toml``, all or none.

        Parameters
        ----------
        folder
            Folder of the files, which is made.

        Raises
        ------
        OutputError
            The folder cannot be written.
        """
        with filling(Path(folder), last=RECORD_FILE) as draft:
            for name, table in self.tables().items():
                write_text(draft / name, table.to_csv(index=False, lineterminator="\n"))
            self.write_contact(draft / CONTACT_FILE)
            write_toml(draft / RECORD_FILE, self.provenance)

    @classmethod
    def read(cls, folder: str | os.PathLike[str], pad: "str | Pad | None" = None) -> "Touch":
        """The touch that `write` or ``fembridge touch`` wrote.

        Parameters
        ----------
        folder
            Folder of the files.
        pad
            Pad that was touched. Default: None, the one that the record names.

        Raises
        ------
        ResultError, TableError
            A file is absent, cut short or of another touch.
        UsageError, ResponseError
            The pad is not found, or is another one.

        Examples
        --------
        >>> import fembridge as fb
        >>> result = fb.touch("punch:diameter_mm=1", press_um=200, population="one_each")
        >>> result.write("touched")
        >>> fb.Touch.read("touched").rates.equals(result.rates)
        True
        """
        folder = Path(folder)
        record = read_toml(folder / RECORD_FILE, ResultError.at(folder / RECORD_FILE))
        try:
            return _read(folder, record, pad)
        except (KeyError, TypeError, AttributeError) as error:
            problem = f"not the record of a touch: {error!r}"
            raise ResultError(problem, folder / RECORD_FILE) from error


def _read(folder: Path, record: Table, pad: "str | Pad | None") -> Touch:
    """The touch of a folder with the `record`."""
    stated_pad, stated_units = record["pad"], record["population"]
    if pad is None and not stated_pad["source"]:
        raise UsageError(
            f"is missing: the pad of {folder} was in memory", argument="pad", expected="a pad"
        )
    skin = resolve_pad(stated_pad["source"] if pad is None else pad)
    if skin.sha256 != stated_pad["sha256"]:
        raise ResponseError(f"another pad than that of {folder / RECORD_FILE}")
    if pose := record.get("pose"):
        (across, along), (x_mm, z_mm) = pose["tilt_deg"], pose["at_mm"]
        skin = skin.seen_from((across, along), (x_mm, z_mm))
    relaxation = record.get("relaxation")
    if relaxation is not None:
        skin = pad_with_prony(skin, relaxation["prony"])
    if (ridges := record.get("ridges")) is not None:
        skin = with_ridges(skin, Fingerprint(**ridges))
    population = Population.from_table(folder / POPULATION_FILE, skin).with_endings(
        stated_units["endings_mm"], sa_von_mises=stated_units["sa_von_mises"]
    )
    contact, trajectory = _read_contact(folder / CONTACT_FILE, skin, record["trajectory"])
    if relaxation is not None:
        contact = with_layer_forces(contact, Relaxation.from_table(relaxation), trajectory)
    table = read_table(folder / TOUCH_FILE, ("time_ms", "depth_um", "force_n"))
    if table.size != trajectory.level.size:
        raise ResultError(
            f"{table.size} rows, expected {trajectory.level.size}", folder / TOUCH_FILE
        )
    trials = int(record["trials"])
    return Touch(
        population=population,
        trajectory=trajectory,
        force_n=table.numbers("force_n"),
        depth_um=table.numbers("depth_um"),
        contact=contact,
        fired=_read_spikes(folder / SPIKES_FILE, population, trials),
        trials=trials,
        origin={
            name: value
            for name, value in record.items()
            if name not in ("trajectory", "population")
        },
    )


def _read_contact(
    path: Path, pad: Pad, stated: Mapping[str, Any]
) -> tuple[ContactHistory, Trajectory]:
    """Contact and trajectory of `CONTACT_FILE`; `stated` is the record of the trajectory."""
    error = ResultError.at(path)
    with NpzFile(path, error) as archive:
        if missing := [name for name in (*_CONTACT_ARRAYS, "level") if name not in archive.headers]:
            raise error(f"no array {missing[0]}")
        optional = {
            name: archive.read_reals(name)
            for name in ("drag", *_TRAJECTORY_ARRAYS)
            if name in archive.headers
        }
        numbers = {
            name: archive.read(name).astype(np.int64)
            for name, header in archive.headers.items()
            if header is not None and header.dtype.kind == "i"
        }
        forces_n = archive.read("forces_n")
        values = {name: archive.read_reals(name) for name in _CONTACT_ARRAYS[1:]}
        level = archive.read_reals("level")
        loads_n = archive.read_reals(_LOADS) if _LOADS in archive.headers else None
    try:
        nodes = pad.nodes_from(numbers)
    except KeyError as missing_array:
        raise error(f"no array {missing_array.args[0]}") from missing_array
    except ValueError as problem:
        raise error(str(problem)) from problem
    counts = {forces_n.shape[0], *(values[name].size for name in ("total_n", "depth_um", "knots"))}
    if len(counts) > 1 or forces_n.shape[1] != nodes.size or values["position"].size != level.size:
        raise error("arrays of different lengths")
    pins = None
    if "pin_positions" in optional:
        positions = tuple((x, z, diameter) for x, z, diameter in optional["pin_positions"].tolist())
        pins = PinArray(positions, optional["pin_depth_um"])
    start_ms, end_ms = stated["window_ms"]
    computed = {
        "name", "samples", "dt_ms", "window_ms", "control", "sha256", "preindent_um", "pins"
    }  # fmt: skip
    trajectory = Trajectory(
        **{"force_n" if stated["control"] == "force" else "depth_um": level},
        x_mm=optional.get("x_mm"),
        z_mm=optional.get("z_mm"),
        dt_ms=stated["dt_ms"],
        window_ms=(start_ms, end_ms),
        name=stated["name"],
        preindent_um=stated.get("preindent_um"),
        pins=pins,
        origin={name: value for name, value in stated.items() if name not in computed},
    )
    if trajectory.to_table()["sha256"] != stated["sha256"]:
        raise error("another trajectory than that of the record")
    total_n, depth_um, knots, position = (values[name] for name in _CONTACT_ARRAYS[1:])
    drag, large_strain = optional.get("drag"), None
    if loads_n is not None:
        smooth = pad.from_above
        if not has_large_strain(smooth) or loads_n.shape != (knots.size, *sheet_of(smooth).shape):
            raise error(f"{_LOADS} is {loads_n.shape}, not of this pad and these states")
        large_strain = LargeStrain(smooth, loads_n.astype(np.float32), depth_um)
    contact = ContactHistory(
        nodes, forces_n, total_n, depth_um, knots, position, drag, large_strain=large_strain
    )
    return contact, trajectory


def _read_spikes(path: Path, population: Population, trials: int) -> UnitSpikes:
    """Spikes of the units of `population`."""
    import pandas

    table = read_table(path, ("unit", "trial", "spike_time_ms"))
    unit = pandas.Index(population.unit).get_indexer(pandas.Index(table.column("unit").astype(str)))
    table.refuse(unit < 0, lambda _: f"a unit that {POPULATION_FILE} does not have")
    trial = table.numbers("trial", 0, int)
    table.refuse(trial > (trials if trials > 1 else 0), lambda _: f"more than {trials} trials")
    return UnitSpikes(unit.astype(np.int64), np.maximum(trial, 1), table.numbers("spike_time_ms"))
