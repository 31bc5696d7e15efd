"""Afferents of a fingertip: each unit has a position, a depth in its layer, and a class.

Positions are on the skin, x across and z along the finger, seen from above; a unit lies
`depth_mm` below its position, along the normal of the skin. Densities are those of human
fingertips in TouchSim (Saal et al. 2017, after Johansson & Vallbo 1979), on a jittered
lattice.

The fibre of an SA or RA unit branches: its most sensitive ending is at the position of the unit,
less sensitive ones lie around it at random. Each unit has a number, `endings_seed`, from which its
endings are drawn, so that it keeps them in every selection, table and process (decision 0060).
From the same number follows the sign of a PC unit: some corpuscles are depolarised by a rise of the
stress, others by a fall, depending on how the ending is turned (decision 0071).
"""

import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING
from zlib import crc32

import numpy as np

from decks.finger import SITES, Finger
from fembridge.errors import TableError, UsageError, warn
from fembridge.host.store import write_text
from fembridge.io.text_table import read_table
from fembridge.ranges import ABOVE_ZERO, Range, check_range
from fembridge.solver.analysis import load_finger
from fembridge.touching.pad import Pad, Site
from fembridge.touching.prism_pad import finger_extent_mm
from fembridge.touching.specification import from_specification
from fembridge.trace import AFFERENTS
from fembridge.typing import BoolArray, FloatArray, IntArray, Table

if TYPE_CHECKING:
    import pandas
    from numpy.typing import ArrayLike, NDArray

COLUMNS = ("unit", "afferent", "x_mm", "z_mm", "depth_mm")
# Units a square centimetre of fingertip.
DENSITY_CM2: Mapping[str, float] = {"SA": 70.0, "RA": 140.0, "PC": 25.0}
_MM_PER_CM = 10.0
# Fibres that branch in the skin. A Pacinian corpuscle is one ending.
BRANCHED = ("SA", "RA")
# Classes whose units have either sign (Nishi & Sato 1968, J. Physiol. 199:383).
SIGNED = ("PC",)
# Chosen by receptive fields and gaps, decision 0060: radius of the area of a unit's endings; their
# number; and of all but the most sensitive ending, which is in the middle and has 1, the least
# distance from it as a share of the radius and the range of sensitivities.
ENDINGS_MM = 1.5
_FEWEST_ENDINGS, _MOST_ENDINGS = 5, 10
_LEAST_DISTANCE = 0.5
# Numbers of a seed that its endings take; the next one is that of the sign.
_ENDING_NUMBERS = 2 + 3 * _MOST_ENDINGS
_LEAST_SENSITIVITY, _LARGEST_SENSITIVITY = 0.45, 0.75
_MOST_UNITS = 200_000
_RANGES: Mapping[str, Range] = {
    "x_mm": Range(-1000, 1000),
    "z_mm": Range(-1000, 1000),
    "depth_mm": Range(0, 100),
    "deviate": Range(-20, 20),
    "endings_seed": Range(0, 2**53, is_whole=True),
}


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Population:
    """Units of the three classes, with their positions and sensitivities.

    Class methods make the usual ones: `fingertip`, `grid`, `line`, `one_each`, `at`,
    `from_table`. A mask, a slice or a list of numbers selects units, and ``+`` joins two
    populations.

    Parameters
    ----------
    unit
        Names, each once, ``(U,)``.
    afferent, layer
        Class of each unit, ``SA``, ``RA`` or ``PC``, and layer of the finger, ``(U,)``.
    x_mm, z_mm, depth_mm
        Position across and along the finger and depth below the skin in mm, ``(U,)``.
    deviate
        Sensitivity, ``(U,)``: a unit of deviate q needs ``exp(spread q)`` times the stress of
        the median unit of its class; the spread is that of the neural parameters.
    endings_mm
        An SA or RA unit has 5 to 10 endings: the most sensitive at its position, the others,
        with 0.45 to 0.75 of its sensitivity, around it at random, up to this distance in mm. The
        ending with the largest drive counts. 0: a single ending. Default: 1.5.
    sa_von_mises
        Whether SA units respond to von Mises stress, as in the paper, instead of compression
        and stretch, see `fembridge.touching.stress`. Default: False.
    endings_seed
        Whole numbers from 0 to 2^53 from which the endings of each unit, and the `sign` of a PC
        unit, are drawn, ``(U,)``. Default: the CRC-32 of each name.

    Raises
    ------
    UsageError
        No units, a name twice, arrays of different lengths, or a number out of range.

    Examples
    --------
    >>> import fembridge as fb
    >>> units = fb.Population.fingertip(seed=1)
    >>> units[units.x_mm > 0] + fb.Population.at(["PC"], [0.0], [2.0], unit=["probe"])
    Population(438 units: 123 SA, 266 RA, 49 PC)
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
    endings_seed: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __post_init__(self) -> None:
        check_range("endings_mm", self.endings_mm)
        if not np.size(self.endings_seed):
            object.__setattr__(self, "endings_seed", [crc32(name.encode()) for name in self.unit])
        if not self.unit:
            raise UsageError(
                "has no unit on this skin; one_each has one of each class under the middle",
                argument="population",
                found=0,
                expected="a unit or more",
            )
        _check_count(len(self.unit))
        if len(set(self.unit)) < len(self.unit):
            [(duplicate, _)] = Counter(self.unit).most_common(1)
            raise UsageError(f"has the name {duplicate!r} twice", argument="unit", found=duplicate)
        for argument in ("afferent", "layer"):
            if len(getattr(self, argument)) != len(self.unit):
                raise UsageError(
                    f"has {len(getattr(self, argument))} entries, expected {len(self.unit)}, one "
                    "a unit",
                    argument=argument,
                )
        for argument, limits in _RANGES.items():
            values = np.asarray(getattr(self, argument), dtype=np.float64)
            object.__setattr__(self, argument, values)
            if values.shape != (len(self.unit),):
                raise UsageError(
                    f"has shape {values.shape}, expected ({len(self.unit)},), one a unit",
                    argument=argument,
                )
            is_outside = ~((values >= limits.low) & (values <= limits.high))
            if limits.is_whole:
                is_outside |= values != np.floor(values)
                object.__setattr__(self, argument, np.where(is_outside, 0, values).astype(np.int64))
            if is_outside.any():
                row = int(is_outside.argmax())
                raise UsageError(
                    f"of unit {self.unit[row]} is {values[row]:g}, expected {limits}",
                    argument=argument,
                    found=float(values[row]),
                    expected=str(limits),
                )

    def __repr__(self) -> str:
        counts = ", ".join(f"{count} {name}" for name, count in Counter(self.afferent).items())
        return f"Population({len(self)} units: {counts})"

    def __getitem__(self, rows: "BoolArray | IntArray | slice | Sequence[int]") -> "Population":
        """Units of a mask ``(U,)``, a slice, or numbers counted from 0."""
        try:
            numbers = np.arange(len(self))[np.asarray(rows) if isinstance(rows, Sequence) else rows]
        except IndexError as error:
            raise UsageError(
                f"do not select from {len(self)} units", argument="rows", found=rows
            ) from error
        numbers = np.atleast_1d(numbers)
        unit, afferent, layer = (
            tuple(names[row] for row in numbers.tolist())
            for names in (self.unit, self.afferent, self.layer)
        )
        return replace(
            self,
            unit=unit,
            afferent=afferent,
            layer=layer,
            x_mm=self.x_mm[numbers],
            z_mm=self.z_mm[numbers],
            depth_mm=self.depth_mm[numbers],
            deviate=self.deviate[numbers],
            endings_seed=self.endings_seed[numbers],
        )

    def __add__(self, other: "Population") -> "Population":
        """Units of both, these first; their names differ and their endings are the same."""
        if not isinstance(other, Population):
            return NotImplemented
        for argument in ("endings_mm", "sa_von_mises"):
            first, second = getattr(self, argument), getattr(other, argument)
            if first != second:
                raise UsageError(f"differs: {first} and {second}", argument=argument, found=second)
        return replace(
            self,
            unit=self.unit + other.unit,
            afferent=self.afferent + other.afferent,
            layer=self.layer + other.layer,
            x_mm=np.concatenate([self.x_mm, other.x_mm]),
            z_mm=np.concatenate([self.z_mm, other.z_mm]),
            depth_mm=np.concatenate([self.depth_mm, other.depth_mm]),
            deviate=np.concatenate([self.deviate, other.deviate]),
            endings_seed=np.concatenate([self.endings_seed, other.endings_seed]),
        )

    def __len__(self) -> int:
        return len(self.unit)

    def endings(self) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """Unit of each ending, rising, its position x and z in mm, and sensitivity, ``(E,)``.

        The first ending of a unit is at its position and has sensitivity 1.
        """
        branched = np.isin(self.afferent, BRANCHED) & (self.endings_mm > 0)
        if not branched.any():
            return np.arange(len(self)), self.x_mm, self.z_mm, np.ones(len(self))
        number, turn, *drawn = _uniform_numbers(self.endings_seed, _ENDING_NUMBERS).T
        span = _MOST_ENDINGS - _FEWEST_ENDINGS + 1
        count = np.where(branched, _FEWEST_ENDINGS + (span * number).astype(np.int64), 1)
        unit = np.repeat(np.arange(len(self)), count)
        nth = np.arange(unit.size) - np.searchsorted(unit, unit)
        area, jitter, level = np.array(drawn).reshape(3, _MOST_ENDINGS, -1)[:, nth - 1, unit]
        # Each of the others lies in a sector of its own, anywhere on the ring.
        angle = 2 * np.pi * (turn[unit] + (nth - jitter) / np.maximum(count[unit] - 1, 1))
        inner = _LEAST_DISTANCE**2
        away_mm = self.endings_mm * np.sqrt(inner + (1 - inner) * area) * (nth > 0)
        sensitivity = _LEAST_SENSITIVITY + (_LARGEST_SENSITIVITY - _LEAST_SENSITIVITY) * level
        return (
            unit,
            self.x_mm[unit] + away_mm * np.cos(angle),
            self.z_mm[unit] + away_mm * np.sin(angle),
            np.where(nth > 0, sensitivity, 1.0),
        )

    @property
    def sign(self) -> FloatArray:
        """Sign by which each unit's drive is multiplied, ``(U,)``: 1, or −1 for half of all PC.

        A PC unit of sign −1 responds to a fall of the stress as others respond to a rise. It is
        drawn from `endings_seed`; PC1, the unit of `one_each`, has 1 by its name.
        """
        drawn = _uniform_numbers(self.endings_seed, _ENDING_NUMBERS + 1)[:, _ENDING_NUMBERS]
        is_negative = np.isin(self.afferent, SIGNED) & (drawn >= 0.5)
        return np.where(is_negative, -1.0, 1.0)

    def with_endings(self, endings_mm: float, *, sa_von_mises: bool = False) -> "Population":
        """The same units with other endings.

        Parameters
        ----------
        endings_mm
            Radius in mm of the area of the endings of an SA or RA unit; 0: a single ending.
        sa_von_mises
            Whether SA units respond to von Mises stress. Default: False.
        """
        return replace(self, endings_mm=endings_mm, sa_von_mises=sa_von_mises)

    def to_table(self) -> Table:
        """Number of units, settings of the endings and digest, for a record."""
        digest = sha256("\n".join((*self.unit, *self.afferent, *self.layer)).encode())
        for name in _RANGES:
            digest.update(np.ascontiguousarray(getattr(self, name)).tobytes())
        return {
            "units": len(self),
            "endings_mm": float(self.endings_mm),
            "sa_von_mises": bool(self.sa_von_mises),
            "sha256": digest.hexdigest(),
        }

    def to_frame(self) -> "pandas.DataFrame":
        """Table ``unit, afferent, x_mm, z_mm, depth_mm, deviate, endings_seed``, a row a unit."""
        import pandas

        names = (*COLUMNS, "deviate", "endings_seed")
        return pandas.DataFrame({name: np.array(getattr(self, name)) for name in names})

    def write(self, path: Path | str) -> None:
        """Write the table of `to_frame` as CSV; `from_table` reads it back exactly.

        Parameters
        ----------
        path
            Path of the file.
        """
        write_text(Path(path), self.to_frame().to_csv(index=False, lineterminator="\n"))

    # ---- Populations

    @classmethod
    def fingertip(
        cls, seed: int = 0, density: float = 1.0, finger: "str | Finger | Pad | None" = None
    ) -> "Population":
        """All three classes at the densities of a human fingertip.

        Parameters
        ----------
        seed
            Seed of positions, sensitivities and endings, a whole number >= 0. Default: 0.
        density
            Multiple of the human densities, up to 100. Default: 1.
        finger
            Finger with the layers of the classes: ``"quick"``, ``"paper"``, the path of a TOML
            file, a `Finger`, or a `Pad`. Default: None, ``"quick"``.

        Notes
        -----
        At `density` 1 each class fills the whole rows and columns of a square lattice: on the
        reference finger 888 units, 260 SA, 532 RA and 96 PC. Another `density` has ``888
        density`` units on the same skin, to the nearest whole number, and each class to less
        than 1. They form columns along the finger, evenly spaced, whose numbers of units differ
        by at most 1.
        """
        check_range("seed", seed)
        check_range("density", density, Range(ABOVE_ZERO, 100))
        rng = np.random.default_rng(seed)
        finger = _resolve_finger(finger)
        extent_mm = finger.extent_mm() if isinstance(finger, Pad) else finger_extent_mm(finger)
        x_of_arc, half_mm, half_length_mm = extent_mm[:2], *extent_mm[2:]
        reach_mm = float(np.interp(half_mm, x_of_arc[1], x_of_arc[0]))
        classes = _available(tuple(DENSITY_CM2), finger)
        pitches_mm = [float(_MM_PER_CM / np.sqrt(DENSITY_CM2[name])) for name in classes]
        cells = [
            (int(2 * reach_mm / pitch_mm), int(2 * half_length_mm / pitch_mm))
            for pitch_mm in pitches_mm
        ]
        counts = _whole_counts(density * np.array([across * along for across, along in cells]))
        _check_count(int(counts.sum()))
        afferent: list[str] = []
        places, deviates = [], []
        for name, pitch_mm, (across, along), count in zip(
            classes, pitches_mm, cells, counts.tolist(), strict=True
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
            lattice = (np.stack([column, nth], -1) + 0.5) * step_mm - (reach_mm, half_length_mm)
            lattice = lattice + step_mm * rng.uniform(-0.5, 0.5, lattice.shape)
            arc_mm = lattice[:, 0]
            lattice[:, 0] = np.sign(arc_mm) * np.interp(np.abs(arc_mm), *x_of_arc)
            afferent += [name] * count
            places.append(lattice)
            deviates.append(rng.standard_normal(count))
        x_mm, z_mm = np.concatenate(places).T
        units = cls.at(afferent, x_mm, z_mm, deviate=np.concatenate(deviates), finger=finger)
        units = replace(units, endings_seed=rng.integers(2**32, size=len(units)))
        if not isinstance(finger, Pad):
            return units
        beside = [margin.rows for margin in finger.margins(x_mm, z_mm)]  # the skin is no rectangle
        return units[~np.any(beside, axis=0)]

    @classmethod
    def grid(
        cls,
        step_mm: float = 1.0,
        half_width_mm: float = 5.0,
        half_length_mm: float = 5.0,
        afferents: Sequence[str] = AFFERENTS,
        finger: "str | Finger | Pad | None" = None,
    ) -> "Population":
        """Median units of each class on a square grid.

        Parameters
        ----------
        step_mm
            Distance of two units in mm. Default: 1.
        half_width_mm, half_length_mm
            Extent in mm from the middle, across and along the finger. Default: 5.
        afferents
            Classes. Default: SA, RA and PC.
        finger
            Finger with the layers of the classes: ``"quick"``, ``"paper"``, the path of a TOML
            file, a `Finger`, or a `Pad`. Default: None, ``"quick"``.
        """
        across, along = (_steps(half, step_mm) for half in (half_width_mm, half_length_mm))
        _check_count(len(afferents) * across.size * along.size)
        x_mm, z_mm = (places.ravel() for places in np.meshgrid(across, along, indexing="ij"))
        return cls._median_units(afferents, x_mm, z_mm, finger)

    @classmethod
    def line(
        cls,
        step_mm: float = 0.25,
        half_length_mm: float = 5.0,
        along: str = "z",
        afferents: Sequence[str] = AFFERENTS,
        finger: "str | Finger | Pad | None" = None,
    ) -> "Population":
        """Median units of each class on a line through the middle of the pad.

        Parameters
        ----------
        step_mm
            Distance of two units in mm. Default: 0.25.
        half_length_mm
            Extent of the line in mm from the middle. Default: 5.
        along
            ``"x"``, across the finger, or ``"z"``. Default: ``"z"``.
        afferents
            Classes. Default: SA, RA and PC.
        finger
            Finger with the layers of the classes: ``"quick"``, ``"paper"``, the path of a TOML
            file, a `Finger`, or a `Pad`. Default: None, ``"quick"``.
        """
        if along not in ("x", "z"):
            raise UsageError(f"a line along {along!r}, expected x or z")
        steps = _steps(half_length_mm, step_mm)
        zeros = np.zeros_like(steps)
        places = (steps, zeros) if along == "x" else (zeros, steps)
        return cls._median_units(afferents, *places, finger)

    @classmethod
    def one_each(
        cls,
        x_mm: float = 0.0,
        z_mm: float = 0.0,
        afferents: Sequence[str] = AFFERENTS,
        finger: "str | Finger | Pad | None" = None,
    ) -> "Population":
        """The median unit of each class, at one position.

        Parameters
        ----------
        x_mm, z_mm
            Position across and along the finger in mm. Default: 0.
        afferents
            Classes. Default: SA, RA and PC.
        finger
            Finger with the layers of the classes: ``"quick"``, ``"paper"``, the path of a TOML
            file, a `Finger`, or a `Pad`. Default: None, ``"quick"``.
        """
        return cls._median_units(afferents, np.array([x_mm]), np.array([z_mm]), finger)

    @classmethod
    def from_table(
        cls,
        table: "str | os.PathLike[str] | pandas.DataFrame",
        finger: "str | Finger | Pad | None" = None,
    ) -> "Population":
        """Units of a table ``afferent,x_mm,z_mm``, a row a unit.

        Parameters
        ----------
        table
            A DataFrame or the path of a CSV file. Optional columns are ``unit``, the name;
            ``depth_mm``, else the depth of the class in `finger`; ``deviate``, else 0; and
            ``endings_seed``, else the endings of a unit are drawn from its name.
        finger
            Finger with the layers of the classes: ``"quick"``, ``"paper"``, the path of a TOML
            file, a `Finger`, or a `Pad`. Default: None, ``"quick"``.

        Raises
        ------
        TableError
            Not such a table, with the line; an unknown column; a name twice.
        """
        optional = ("unit", "depth_mm", "deviate", "endings_seed")
        rows = read_table(table, ("afferent", "x_mm", "z_mm"), optional)
        if not rows.size:
            raise TableError("a header and no rows, expected units", rows.path)
        _check_count(rows.size)
        columns = rows.header
        unit = rows.words("unit") if "unit" in columns else np.arange(1, rows.size + 1).astype(str)
        if "unit" in columns:
            import pandas

            rows.refuse_duplicates(pandas.DataFrame({"unit": unit}))
        units = cls.at(
            rows.choices("afferent", AFFERENTS).tolist(),
            rows.numbers("x_mm"),
            rows.numbers("z_mm"),
            rows.numbers("depth_mm", least=0) if "depth_mm" in columns else None,
            rows.numbers("deviate") if "deviate" in columns else None,
            finger,
            unit.tolist(),
        )
        if "endings_seed" not in columns:
            return units
        return replace(units, endings_seed=rows.numbers("endings_seed"))

    @classmethod
    def at(
        cls,
        afferent: str | Sequence[str],
        x_mm: "ArrayLike",
        z_mm: "ArrayLike",
        depth_mm: "ArrayLike | None" = None,
        deviate: "ArrayLike | None" = None,
        finger: "str | Finger | Pad | None" = None,
        unit: Sequence[str] | None = None,
    ) -> "Population":
        """Units at the positions `x_mm`, `z_mm`.

        Parameters
        ----------
        afferent
            Classes, ``(U,)``, or one class for all units.
        x_mm, z_mm
            Positions across and along the finger in mm, ``(U,)``.
        depth_mm
            Depths below the skin in mm, ``(U,)``. Default: None, those of the classes in `finger`.
        deviate
            Sensitivities, ``(U,)``. Default: None, 0: median units.
        finger
            Finger with the layers of the classes: ``"quick"``, ``"paper"``, the path of a TOML
            file, a `Finger`, or a `Pad`. Default: None, ``"quick"``.
        unit
            Names, ``(U,)``. Default: None, class and number.
        """
        finger = _resolve_finger(finger)
        x_mm, z_mm = np.atleast_1d(x_mm), np.atleast_1d(z_mm)
        if isinstance(afferent, str):
            afferent = [afferent] * x_mm.size
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
            x_mm=np.asarray(x_mm),
            z_mm=np.asarray(z_mm),
            depth_mm=usual_mm if depth_mm is None else np.asarray(depth_mm),
            deviate=np.zeros(len(unit)) if deviate is None else np.asarray(deviate),
        )

    @classmethod
    def _median_units(
        cls,
        afferents: Sequence[str],
        x_mm: FloatArray,
        z_mm: FloatArray,
        finger: "str | Finger | Pad | None",
    ) -> "Population":
        """A median unit of each class at each position."""
        finger = _resolve_finger(finger)
        afferents = _available(afferents, finger)
        count = len(afferents)
        names = np.repeat(afferents, x_mm.size).tolist()
        return cls.at(names, np.tile(x_mm, count), np.tile(z_mm, count), finger=finger)


def _resolve_finger(finger: str | Finger | Pad | None) -> Finger | Pad:
    """A pad or a finger as it is, a preset or a file; None is the reference finger."""
    return finger if isinstance(finger, Pad) else load_finger(finger or "quick")


POPULATIONS: Mapping[str, Callable[..., Population]] = {
    name: getattr(Population, name) for name in ("fingertip", "grid", "line", "one_each")
}


def resolve_population(
    population: "str | os.PathLike[str] | pandas.DataFrame | Population", finger: Finger | Pad
) -> Population:
    """The population of a specification such as ``fingertip:seed=3``, or of a table.

    Parameters
    ----------
    population
        A specification, the path of a table, a DataFrame as for `Population.from_table`, or a
        `Population`, which is returned unchanged.
    finger
        Finger or pad with the layers of the classes.

    Raises
    ------
    UsageError, TableError
        No such population, setting or file, or a table that is none.
    """
    if isinstance(population, Population):
        return population
    if hasattr(population, "columns") or isinstance(population, Path):
        return Population.from_table(population, finger)
    if not isinstance(population, str):
        expected = "a Population, a DataFrame, a text or a path"
        raise UsageError(argument="population", found=population, expected=expected)
    if isinstance(finger, Pad) and population.partition(":")[0] in POPULATIONS:
        return _named(population, finger)
    read = partial(Population.from_table, finger=finger)
    return from_specification(population, "population", POPULATIONS, read, ".csv", finger=finger)


@lru_cache(maxsize=4)
def _named(population: str, pad: Pad) -> Population:
    """The population of a specification on a pad, kept for the next touch."""
    return from_specification(population, "population", POPULATIONS, finger=pad)


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
    _check_places(pad, units)
    far = pad.far_margin(units.x_mm, units.z_mm)
    if far is not None and far.rows.any():
        row = int(far.rows.argmax())
        warn(f"unit {units.unit[row]} {far.problem(row)}{_and_others(far.rows)}")


@lru_cache(maxsize=4)
def _check_places(pad: Pad, units: Population) -> None:
    """Refuse units where the pad has no skin or stress; those of earlier touches are not."""
    for margin in pad.margins(units.x_mm, units.z_mm):
        _refuse(units, margin.rows, margin.problem)
    unit, x_mm, z_mm, _ = units.endings()
    layers, depth_mm = np.array(units.layer)[unit], units.depth_mm[unit]
    for layer in np.unique(layers):
        rows = np.flatnonzero(layers == layer)
        try:
            least_mm, most_mm = pad.depth_range_mm(str(layer), x_mm[rows], z_mm[rows])
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


def _available(afferents: Sequence[str], finger: Finger | Pad) -> tuple[str, ...]:
    """Those of all classes that a pad has; classes that were chosen stay as they are."""
    if isinstance(finger, Pad) and tuple(afferents) == AFFERENTS:
        return tuple(name for name in afferents if name in finger.afferents)
    return tuple(afferents)


def _check_count(count: int) -> None:
    if count > _MOST_UNITS:
        raise UsageError(f"{count} units, expected at most {_MOST_UNITS}")


def _whole_counts(shares: FloatArray) -> IntArray:
    """Whole numbers, each less than 1 from its share, whose sum is that of all shares."""
    counts = np.floor(shares).astype(np.int64)
    missing = round(float(shares.sum())) - int(counts.sum())
    counts[np.argsort(counts - shares, kind="stable")[:missing]] += 1
    return counts


def _site(afferent: str, finger: Finger | Pad) -> Site:
    if isinstance(finger, Pad) and afferent in SITES and afferent not in finger.afferents:
        raise UsageError(
            f"the pad has no afferents of class {afferent}, but of {', '.join(finger.afferents)}",
            argument="population",
            found=afferent,
        )
    site: Site | None = finger.afferents.get(afferent, SITES.get(afferent))
    if site is None:
        raise UsageError(f"afferent {afferent!r}, expected one of {', '.join(SITES)}")
    return site


def _uniform_numbers(seed: IntArray, count: int) -> FloatArray:
    """Numbers from 0 to 1 ``(seed, count)``, of each seed the same everywhere: SplitMix64.

    Steele, Lea & Flood (2014), Fast splittable pseudorandom number generators. The state is
    mixed twice, since seeds may be consecutive.
    """

    def mixed(bits: "NDArray[np.uint64]") -> "NDArray[np.uint64]":
        for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
            bits = (bits ^ (bits >> np.uint64(shift))) * np.uint64(factor)
        return bits ^ (bits >> np.uint64(31))

    golden = np.uint64(0x9E3779B97F4A7C15)
    step = golden * np.arange(1, count + 1, dtype=np.uint64)
    first = mixed(seed.astype(np.uint64) + golden)
    numbers = mixed(first[:, None] + step) >> np.uint64(11)
    return np.asarray(numbers * 2.0**-53, dtype=np.float64)


def _steps(half_mm: float, step_mm: float) -> FloatArray:
    if not (step_mm > 0 and 0 <= half_mm <= 50 and half_mm / step_mm <= 1000):
        raise UsageError(f"steps of {step_mm:g} mm up to {half_mm:g} mm, expected at most 1000")
    count = int(half_mm / step_mm + 1e-9)
    return np.arange(-count, count + 1, dtype=np.float64) * step_mm
