"""Afferents of a fingertip: each unit has a place, a depth in its layer, and a class.

Places are those on the skin, x across and z along the finger, seen from above; a unit
lies `depth_mm` under its place, along the skin's normal. Densities are those of human
fingertips as TouchSim has them (Saal et al. 2017, after Johansson & Vallbo 1979), on a
jittered lattice.
"""

import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from decks.finger import SITES, AfferentSite, Finger
from decks.presets import QUICK
from decks.section import section_of
from fembridge.errors import FembridgeWarning, TableError, UsageError
from fembridge.store import write_text
from fembridge.tables import AFFERENTS, read_table
from fembridge.touching.named import named
from fembridge.touching.pad import LATTICE_LENGTH_MM, Pad
from fembridge.typing import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    import pandas

COLUMNS = ("unit", "afferent", "x_mm", "z_mm", "depth_mm")
# Units a square centimetre of fingertip.
DENSITY_CM2: Mapping[str, float] = {"SA": 70.0, "RA": 140.0, "PC": 25.0}
# A fingertip reaches so far from its middle, across and along.
_HALF_WIDTH_MM, _HALF_LENGTH_MM = 7.0, 12.0
_MM_PER_CM = 10.0
# Fibres that branch in the skin: around the ending at their place they have others that are
# less sensitive. A Pacinian corpuscle is one ending. Chosen by receptive fields, decision 0039.
BRANCHED = ("SA", "RA")
ENDINGS_MM = 1.2
OTHERS, OTHERS_SHARE = 8, 0.5
_MOST_ENDINGS_MM = 3.0
_MOST_UNITS = 200_000
# A unit is no further from the middle, and no more or less sensitive than that.
_ROUNDING_MM = 1e-6
_MAX_AWAY_MM, _MAX_DEPTH_MM, _MAX_DEVIATE = 1_000.0, 100.0, 20.0


@dataclass(frozen=True, slots=True, eq=False)
class Population:
    """Units: `unit` names ``(U,)``, classes, layers, places and depths in mm, deviates.

    A unit of `deviate` q needs ``exp(spread q)`` times the stress of the median unit of
    its class, where spread is that of the neural parameters. SA and RA units have
    `OTHERS` endings `endings_mm` around their place, `OTHERS_SHARE` as sensitive as the
    one at it, and feel by the one that is driven most. With `sa_von_mises` SA units read
    von Mises stress, see `fembridge.touching.stress`.
    """

    unit: tuple[str, ...]
    afferent: tuple[str, ...]
    layer: tuple[str, ...]
    x_mm: FloatArray
    z_mm: FloatArray
    depth_mm: FloatArray
    deviate: FloatArray
    endings_mm: float = ENDINGS_MM
    sa_von_mises: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.endings_mm <= _MOST_ENDINGS_MM:
            raise UsageError(
                f"endings within {self.endings_mm:g} mm, expected 0 to {_MOST_ENDINGS_MM:g}"
            )
        if not self.unit:
            raise UsageError("a population without units")
        _check_count(len(self.unit))
        for name in ("afferent", "layer"):
            if len(getattr(self, name)) != len(self.unit):
                raise UsageError(f"{len(getattr(self, name))} of {name}, {len(self.unit)} units")
        for name, least, most in (
            ("x_mm", -_MAX_AWAY_MM, _MAX_AWAY_MM),
            ("z_mm", -_MAX_AWAY_MM, _MAX_AWAY_MM),
            ("depth_mm", 0.0, _MAX_DEPTH_MM),
            ("deviate", -_MAX_DEVIATE, _MAX_DEVIATE),
        ):
            values = np.asarray(getattr(self, name))
            if values.shape != (len(self.unit),):
                raise UsageError(f"{name} {values.shape}, expected one a unit: {len(self.unit)}")
            if not ((values >= least) & (values <= most)).all():
                row = int((~((values >= least) & (values <= most))).argmax())
                raise UsageError(
                    f"unit {self.unit[row]}: {name} is {values[row]:g}, expected {least:g} to "
                    f"{most:g}"
                )

    def __len__(self) -> int:
        return len(self.unit)

    def endings(self) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """Unit of each ending, rising, its place x and z in mm, and sensitivity, ``(E,)``."""
        branched = np.isin(self.afferent, BRANCHED) & (self.endings_mm > 0)
        unit = np.repeat(np.arange(len(self)), np.where(branched, 1 + OTHERS, 1))
        nth = np.arange(unit.size) - np.searchsorted(unit, unit)
        angle, away_mm = nth * 2 * np.pi / OTHERS, self.endings_mm * (nth > 0)
        return (
            unit,
            self.x_mm[unit] + away_mm * np.cos(angle),
            self.z_mm[unit] + away_mm * np.sin(angle),
            np.where(nth > 0, OTHERS_SHARE, 1.0),
        )

    def to_frame(self) -> "pandas.DataFrame":
        """``unit, afferent, x_mm, z_mm, depth_mm, deviate``, a row a unit."""
        import pandas

        names = (*COLUMNS, "deviate")
        return pandas.DataFrame({name: np.array(getattr(self, name)) for name in names})

    def write(self, path: Path) -> None:
        """Write ``population.csv``; `Population.read` brings it back exactly."""
        write_text(path, self.to_frame().to_csv(index=False, lineterminator="\n"))

    # ---- Populations

    @classmethod
    def fingertip(cls, seed: int = 0, density: float = 1.0, finger: Finger = QUICK) -> "Population":
        """All three classes at the densities of a human fingertip, times `density`.

        Notes
        -----
        At `density` 1 a class fills a square lattice of 1 unit a cell with whole rows and
        columns: on the reference finger 888 units, 260 SA, 532 RA and 96 PC. Another
        `density` has that many times the units on the same skin: ``888 density`` to the
        nearest whole number, and each class to less than 1. They form columns along the
        finger, evenly spaced, whose numbers of units differ by 1 at most.
        """
        if seed < 0 or not 0 < density <= 100:
            raise UsageError(f"seed {seed}, density {density:g}: expected >= 0, and 0 to 100")
        rng = np.random.default_rng(seed)
        section = section_of(finger)
        widest = int(section.point_mm[:, 0].argmax())
        half_mm = min(_HALF_WIDTH_MM, 0.9 * finger.outline.half_width_mm)
        x_of_arc = section.arc_mm[: widest + 1], section.point_mm[: widest + 1, 0]
        reach_mm = float(np.interp(half_mm, x_of_arc[1], x_of_arc[0]))
        pitches_mm = [float(_MM_PER_CM / np.sqrt(units)) for units in DENSITY_CM2.values()]
        cells = [
            (int(2 * reach_mm / pitch_mm), int(2 * _HALF_LENGTH_MM / pitch_mm))
            for pitch_mm in pitches_mm
        ]
        counts = _whole_counts(density * np.array([across * along for across, along in cells]))
        _check_count(int(counts.sum()))
        afferent: list[str] = []
        places, deviates = [], []
        for name, pitch_mm, (across, along), count in zip(
            DENSITY_CM2, pitches_mm, cells, counts.tolist(), strict=True
        ):
            columns = max(1, round(across * np.sqrt(count / max(across * along, 1))))
            in_column = np.diff(np.arange(columns + 1) * count // columns)
            column = np.repeat(np.arange(columns), in_column)
            nth = np.arange(count) - np.repeat(np.cumsum(in_column) - in_column, in_column)
            # Where the count is that of the whole lattice, both steps are its pitch exactly.
            step_mm = np.stack(
                [
                    np.full(count, pitch_mm * (across / columns)),
                    pitch_mm * (along / np.repeat(in_column, in_column)),
                ],
                axis=-1,
            )
            lattice = (np.stack([column, nth], -1) + 0.5) * step_mm - (reach_mm, _HALF_LENGTH_MM)
            lattice = lattice + step_mm * rng.uniform(-0.5, 0.5, lattice.shape)
            arc_mm = lattice[:, 0]
            lattice[:, 0] = np.sign(arc_mm) * np.interp(np.abs(arc_mm), *x_of_arc)
            afferent += [name] * count
            places.append(lattice)
            deviates.append(rng.standard_normal(count))
        x_mm, z_mm = np.concatenate(places).T
        return cls.at(afferent, x_mm, z_mm, deviate=np.concatenate(deviates), finger=finger)

    @classmethod
    def grid(
        cls,
        step_mm: float = 1.0,
        half_width_mm: float = 5.0,
        half_length_mm: float = 5.0,
        afferents: Sequence[str] = AFFERENTS,
        finger: Finger = QUICK,
    ) -> "Population":
        """Median units of each class on a square grid."""
        across, along = (_steps(half, step_mm) for half in (half_width_mm, half_length_mm))
        _check_count(len(afferents) * across.size * along.size)
        x_mm, z_mm = (places.ravel() for places in np.meshgrid(across, along, indexing="ij"))
        return cls._each(afferents, x_mm, z_mm, finger)

    @classmethod
    def line(
        cls,
        step_mm: float = 0.25,
        half_length_mm: float = 5.0,
        along: str = "z",
        afferents: Sequence[str] = AFFERENTS,
        finger: Finger = QUICK,
    ) -> "Population":
        """Median units of each class on a line through the middle, `along` x or z."""
        if along not in ("x", "z"):
            raise UsageError(f"a line along {along!r}, expected x or z")
        steps = _steps(half_length_mm, step_mm)
        zeros = np.zeros_like(steps)
        places = (steps, zeros) if along == "x" else (zeros, steps)
        return cls._each(afferents, *places, finger)

    @classmethod
    def one_each(
        cls,
        x_mm: float = 0.0,
        z_mm: float = 0.0,
        afferents: Sequence[str] = AFFERENTS,
        finger: Finger = QUICK,
    ) -> "Population":
        """The median unit of each class, at one place."""
        return cls._each(afferents, np.array([x_mm]), np.array([z_mm]), finger)

    @classmethod
    def read(cls, path: Path | str, finger: Finger = QUICK) -> "Population":
        """A table ``afferent,x_mm,z_mm``, and if there ``unit``, ``depth_mm``, ``deviate``.

        Raises
        ------
        TableError
            Not such a table, with the line; a column of another name.
        """
        path = Path(path)
        table = read_table(path, ("afferent", "x_mm", "z_mm"), ("unit", "depth_mm", "deviate"))
        if not table.size:
            raise TableError("a header and no rows, expected units", path)
        _check_count(table.size)
        names = table.choices("afferent", AFFERENTS).tolist()
        own = table.header
        unit = table.words("unit") if "unit" in own else np.arange(1, table.size + 1).astype(str)
        if "unit" in own:
            import pandas

            table.refuse_duplicates(pandas.DataFrame({"unit": unit}))
        return cls.at(
            names,
            table.numbers("x_mm"),
            table.numbers("z_mm"),
            table.numbers("depth_mm", least=0) if "depth_mm" in own else None,
            table.numbers("deviate") if "deviate" in own else None,
            finger,
            unit.tolist(),
        )

    @classmethod
    def at(
        cls,
        afferent: Sequence[str],
        x_mm: FloatArray,
        z_mm: FloatArray,
        depth_mm: FloatArray | None = None,
        deviate: FloatArray | None = None,
        finger: Finger = QUICK,
        unit: Sequence[str] | None = None,
    ) -> "Population":
        """Units of the classes `afferent` ``(U,)`` at places, in the layers of `finger`.

        Without names they are named by class and number; without depths they lie at those
        of `finger`, without deviates they are median units.
        """
        sites = {name: _site(name, finger) for name in dict.fromkeys(afferent)}
        usual_mm = np.array([sites[name].depth_mm for name in afferent])
        if unit is None:
            number: Counter[str] = Counter()
            unit = []
            for name in afferent:
                number[name] += 1
                unit.append(f"{name}{number[name]}")
        return cls(
            unit=tuple(unit),
            afferent=tuple(afferent),
            layer=tuple(sites[name].layer for name in afferent),
            x_mm=x_mm,
            z_mm=z_mm,
            depth_mm=usual_mm if depth_mm is None else depth_mm,
            deviate=np.zeros(len(unit)) if deviate is None else deviate,
        )

    @classmethod
    def _each(
        cls, afferents: Sequence[str], x_mm: FloatArray, z_mm: FloatArray, finger: Finger
    ) -> "Population":
        """A median unit of each class at each place."""
        count = len(afferents)
        names = np.repeat(afferents, x_mm.size).tolist()
        return cls.at(names, np.tile(x_mm, count), np.tile(z_mm, count), finger=finger)


POPULATIONS: Mapping[str, Callable[..., Population]] = {
    name: getattr(Population, name) for name in ("fingertip", "grid", "line", "one_each")
}


def population_named(wanted: str | Population, finger: Finger) -> Population:
    """The population of a word such as ``fingertip:seed=3``, of a table, or as it is.

    Raises
    ------
    UsageError, TableError
        No such population, number or file.
    """
    if isinstance(wanted, Population):
        return wanted
    read = partial(Population.read, finger=finger)
    return named(wanted, "population", POPULATIONS, read, ".csv", finger=finger)


def check_inside(pad: Pad, units: Population) -> None:
    """Refuse units where `pad` has no skin or holds no stress.

    Endings of a unit beside the skin count as at its side; a pad that is plane has no ends.

    Raises
    ------
    UsageError
        A unit beside the finger, at a depth or in a layer without stress, or so far along
        the finger that no force on the pad reaches it. The unit is named.

    Warns
    -----
    FembridgeWarning
        Units along the finger that a force in the middle of the pad does not reach.
    """
    half_width_mm = float(pad.section.point_mm[:, 0].max())
    reach_mm = min(pad.widest_mm + pad.spacing_mm, half_width_mm)
    outside = np.abs(units.x_mm) > reach_mm + _ROUNDING_MM
    _refuse(units, outside, lambda row: (
        f"at x = {units.x_mm[row]:g} mm is beside the skin, which reaches {reach_mm:.3g} mm to "
        "both sides"
    ))  # fmt: skip
    if not pad.plane:
        held_mm, lattice_mm = float(pad.stress_z_mm[-1]), 0.5 * LATTICE_LENGTH_MM
        away_mm = np.abs(units.z_mm)
        _refuse(units, away_mm > held_mm + lattice_mm, lambda row: (
            f"at z = {units.z_mm[row]:g} mm is beyond the pad: it may be touched up to "
            f"{lattice_mm:g} mm along the finger, and stress is held {held_mm:.3g} mm further"
        ))  # fmt: skip
        if (far := away_mm > held_mm).any():
            row = int(far.argmax())
            warnings.warn(
                f"unit {units.unit[row]} at z = {units.z_mm[row]:g} mm{_and_others(far)}: a force "
                f"in the middle of the pad gives no stress more than {held_mm:.3g} mm away",
                FembridgeWarning,
                stacklevel=3,
            )
    unit, x_mm, _, _ = units.endings()
    layers, depth_mm = np.array(units.layer)[unit], units.depth_mm[unit]
    for layer in np.unique(layers):
        rows = np.flatnonzero(layers == layer)
        try:
            least_mm, most_mm = pad.depth_range_mm(str(layer), x_mm[rows])
        except UsageError as error:
            raise UsageError(f"unit {units.unit[unit[rows[0]]]}: {error}") from error
        outside = (depth_mm[rows] < least_mm) | (depth_mm[rows] > most_mm)
        if outside.any():
            first = int(outside.argmax())
            raise UsageError(
                f"unit {units.unit[unit[rows[first]]]} is {depth_mm[rows[first]]:g} mm deep in "
                f"{layer} at x = {x_mm[rows[first]]:g} mm: the pad holds stress from "
                f"{least_mm[first]:.3g} to {most_mm[first]:.3g} mm there"
            )


def _refuse(units: Population, bad: BoolArray, problem: Callable[[int], str]) -> None:
    """Refuse the first of `units` that is `bad` ``(U,)``, by its name."""
    if bad.any():
        row = int(bad.argmax())
        raise UsageError(f"unit {units.unit[row]} {problem(row)}{_and_others(bad)}")


def _and_others(bad: BoolArray) -> str:
    count = int(bad.sum()) - 1
    return f" (and {count} others)" if count else ""


def _check_count(count: int) -> None:
    if count > _MOST_UNITS:
        raise UsageError(f"{count} units, expected at most {_MOST_UNITS}")


def _whole_counts(shares: FloatArray) -> IntArray:
    """Whole numbers, each less than 1 from its share, whose sum is that of all shares."""
    counts = np.floor(shares).astype(np.int64)
    missing = round(float(shares.sum())) - int(counts.sum())
    counts[np.argsort(counts - shares, kind="stable")[:missing]] += 1
    return counts


def _site(afferent: str, finger: Finger) -> AfferentSite:
    site = finger.afferents.get(afferent, SITES.get(afferent))
    if site is None:
        raise UsageError(f"afferent {afferent!r}, expected one of {', '.join(SITES)}")
    return site


def _steps(half_mm: float, step_mm: float) -> FloatArray:
    if not (step_mm > 0 and 0 <= half_mm <= 50 and half_mm / step_mm <= 1000):
        raise UsageError(f"steps of {step_mm:g} mm up to {half_mm:g} mm, expected at most 1000")
    count = int(half_mm / step_mm + 1e-9)
    return np.arange(-count, count + 1, dtype=np.float64) * step_mm
