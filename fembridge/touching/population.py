"""Afferents of a fingertip: each unit has a place, a depth in its layer, and a class.

Places are those on the skin, x across and z along the finger, seen from above; a unit
lies `depth_mm` under its place, along the skin's normal. Densities are those of human
fingertips as TouchSim has them (Saal et al. 2017, after Johansson & Vallbo 1979), on a
jittered lattice.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from decks.finger import SITES, AfferentSite, Finger
from decks.presets import QUICK
from decks.section import section_of
from fembridge.errors import TableError, UsageError
from fembridge.store import write_text
from fembridge.tables import AFFERENTS, read_table
from fembridge.touching.named import named
from fembridge.typing import FloatArray, IntArray

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
        if len(self.unit) > _MOST_UNITS:
            raise UsageError(f"{len(self.unit)} units, expected at most {_MOST_UNITS}")

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
        """All three classes at the densities of a human fingertip, times `density`."""
        if seed < 0 or not 0 < density <= 100:
            raise UsageError(f"seed {seed}, density {density:g}: expected >= 0, and 0 to 100")
        rng = np.random.default_rng(seed)
        section = section_of(finger)
        widest = int(section.point_mm[:, 0].argmax())
        half_mm = min(_HALF_WIDTH_MM, 0.9 * finger.outline.half_width_mm)
        x_of_arc = section.arc_mm[: widest + 1], section.point_mm[: widest + 1, 0]
        reach_mm = float(np.interp(half_mm, x_of_arc[1], x_of_arc[0]))
        afferent: list[str] = []
        places, deviates = [], []
        for name, units_cm2 in DENSITY_CM2.items():
            pitch_mm = _MM_PER_CM / np.sqrt(units_cm2 * density)
            across, along = (
                (np.arange(int(2 * half / pitch_mm)) + 0.5) * pitch_mm - half
                for half in (reach_mm, _HALF_LENGTH_MM)
            )
            lattice = np.stack(np.meshgrid(across, along, indexing="ij"), -1).reshape(-1, 2)
            lattice = lattice + pitch_mm * rng.uniform(-0.5, 0.5, lattice.shape)
            arc_mm = lattice[:, 0]
            lattice[:, 0] = np.sign(arc_mm) * np.interp(np.abs(arc_mm), *x_of_arc)
            afferent += [name] * len(lattice)
            places.append(lattice)
            deviates.append(rng.standard_normal(len(lattice)))
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
        x_mm, z_mm = (each.ravel() for each in np.meshgrid(across, along, indexing="ij"))
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
            Not such a table, with the line.
        """
        path = Path(path)
        table = read_table(path, ("afferent", "x_mm", "z_mm"))
        if not table.size:
            raise TableError("a header and no rows, expected units", path)
        names = table.choices("afferent", AFFERENTS).tolist()
        own = table.header
        unit = table.words("unit") if "unit" in own else np.arange(1, table.size + 1).astype(str)
        if "unit" in own:
            import pandas

            table.refuse_duplicates(pandas.DataFrame({"unit": unit}))
        units = cls.at(
            names,
            table.numbers("x_mm"),
            table.numbers("z_mm"),
            table.numbers("depth_mm", least=0) if "depth_mm" in own else None,
            table.numbers("deviate") if "deviate" in own else None,
            finger,
        )
        return replace(units, unit=tuple(unit.tolist()))

    @classmethod
    def at(
        cls,
        afferent: Sequence[str],
        x_mm: FloatArray,
        z_mm: FloatArray,
        depth_mm: FloatArray | None = None,
        deviate: FloatArray | None = None,
        finger: Finger = QUICK,
    ) -> "Population":
        """Units of the classes `afferent` ``(U,)`` at places, in the layers of `finger`.

        They are named by class and number; without depths they lie at those of `finger`,
        without deviates they are median units.
        """
        sites = {name: _site(name, finger) for name in dict.fromkeys(afferent)}
        usual_mm = np.array([sites[name].depth_mm for name in afferent])
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
