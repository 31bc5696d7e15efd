"""Afferents of a fingertip: each unit has a place, a depth in its layer, and a class.

Places are those on the skin, x across and z along the finger, seen from above; a unit
lies `depth_mm` under its place, along the skin's normal. Densities are those of human
fingertips as TouchSim has them (Saal et al. 2017, after Johansson & Vallbo 1979), on a
jittered lattice.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from decks.finger import SITES, AfferentSite, Finger
from decks.presets import QUICK
from decks.section import section_of
from fembridge.errors import TableError, UsageError
from fembridge.store import near_hint
from fembridge.tables import AFFERENTS, read_table, write_table
from fembridge.touching.words import made_of
from fembridge.typing import FloatArray, IntArray

if TYPE_CHECKING:
    import pandas

COLUMNS = ("unit", "afferent", "x_mm", "z_mm", "depth_mm")
# Units a square centimetre of fingertip.
DENSITY_CM2: Mapping[str, float] = {"SA": 70.0, "RA": 140.0, "PC": 25.0}
# A fingertip reaches so far from its middle, across and along.
_HALF_WIDTH_MM, _HALF_LENGTH_MM = 7.0, 12.0
_MM_PER_CM = 10.0
# Fibres that branch in the skin; a Pacinian corpuscle is one ending.
BRANCHED = ("SA", "RA")
_MOST_ENDINGS_MM = 3.0
_MOST_UNITS = 200_000


@dataclass(frozen=True, slots=True, eq=False)
class Population:
    """Units: `unit` names ``(U,)``, classes, layers, places and depths in mm, deviates.

    A unit of `deviate` q needs ``exp(spread q)`` times the stress of the median unit of
    its class, where spread is that of the neural parameters. Of several `endings` the one
    with the largest stress drives a unit. With `sa_compression` SA units read compression
    along the skin's normal, a little less deep, in place of von Mises stress.
    """

    unit: tuple[str, ...]
    afferent: tuple[str, ...]
    layer: tuple[str, ...]
    x_mm: FloatArray
    z_mm: FloatArray
    depth_mm: FloatArray
    deviate: FloatArray
    endings_mm: float = 0.0
    sa_compression: bool = False

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

    def endings(self) -> Iterator[tuple[float, float, IntArray]]:
        """Places in mm from a unit's own, and which units have an ending there.

        All have one in the middle; `BRANCHED` have six more on a circle.
        """
        radius_mm = self.endings_mm
        yield 0.0, 0.0, np.arange(len(self))
        branched = np.flatnonzero(np.isin(self.afferent, BRANCHED))
        if radius_mm and branched.size:
            for angle in np.arange(6) * np.pi / 3:
                yield radius_mm * float(np.cos(angle)), radius_mm * float(np.sin(angle)), branched

    def to_frame(self) -> "pandas.DataFrame":
        """A row a unit."""
        import pandas

        return pandas.DataFrame(
            {
                "unit": list(self.unit),
                "afferent": list(self.afferent),
                "x_mm": self.x_mm,
                "z_mm": self.z_mm,
                "depth_mm": self.depth_mm,
                "deviate": self.deviate,
            }
        )

    def write(self, path: Path) -> None:
        """Write ``population.csv``; `Population.read` brings it back exactly."""
        columns = (self.x_mm, self.z_mm, self.depth_mm, self.deviate)
        rows = zip(self.unit, self.afferent, *(each.tolist() for each in columns), strict=True)
        write_table(path, (*COLUMNS, "deviate"), rows)

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
        parts = []
        for name, units_cm2 in DENSITY_CM2.items():
            pitch_mm = _MM_PER_CM / np.sqrt(units_cm2 * density)
            across, along = (
                (np.arange(int(2 * half / pitch_mm)) + 0.5) * pitch_mm - half
                for half in (reach_mm, _HALF_LENGTH_MM)
            )
            lattice = np.stack(np.meshgrid(across, along, indexing="ij"), -1).reshape(-1, 2)
            lattice = lattice + pitch_mm * rng.uniform(-0.5, 0.5, lattice.shape)
            arc_mm = lattice[:, 0]
            x_mm = np.sign(arc_mm) * np.interp(np.abs(arc_mm), *x_of_arc)
            parts.append((name, x_mm, lattice[:, 1], rng.standard_normal(len(lattice))))
        return cls._of(parts, finger)

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
        return cls._of([(name, x_mm, z_mm, np.zeros(x_mm.size)) for name in afferents], finger)

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
        places = (steps, 0 * steps) if along == "x" else (0 * steps, steps)
        return cls._of([(name, *places, 0 * steps) for name in afferents], finger)

    @classmethod
    def one_each(
        cls,
        x_mm: float = 0.0,
        z_mm: float = 0.0,
        afferents: Sequence[str] = AFFERENTS,
        finger: Finger = QUICK,
    ) -> "Population":
        """The median unit of each class, at one place."""
        place = np.array([x_mm]), np.array([z_mm]), np.zeros(1)
        return cls._of([(name, *place) for name in afferents], finger)

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
        numbers = np.arange(1, table.size + 1).astype(str)
        unit = table.words("unit") if "unit" in own else numbers
        if "unit" in own:
            import pandas

            table.refuse_duplicates(pandas.DataFrame({"unit": unit}))
        sites = [_site(name, finger) for name in names]
        layer = tuple(site.layer for site in sites)
        usual_mm = np.array([site.depth_mm for site in sites])
        depth_mm = table.numbers("depth_mm", least=0) if "depth_mm" in own else usual_mm
        deviate = table.numbers("deviate") if "deviate" in own else np.zeros(table.size)
        x_mm, z_mm = table.numbers("x_mm"), table.numbers("z_mm")
        return cls(tuple(unit.tolist()), tuple(names), layer, x_mm, z_mm, depth_mm, deviate)

    @classmethod
    def _of(
        cls,
        parts: Sequence[tuple[str, FloatArray, FloatArray, FloatArray]],
        finger: Finger,
    ) -> "Population":
        """Classes with places and deviates; a unit is named by class and number."""
        unit = tuple(f"{name}{k}" for name, x, _, _ in parts for k in range(1, x.size + 1))
        afferent = tuple(name for name, x, _, _ in parts for _ in range(x.size))
        x_mm, z_mm, deviate = (np.concatenate([part[k] for part in parts]) for k in (1, 2, 3))
        sites = [_site(name, finger) for name in afferent]
        layer = tuple(site.layer for site in sites)
        depth_mm = np.array([site.depth_mm for site in sites])
        return cls(unit, afferent, layer, x_mm, z_mm, depth_mm, deviate)


POPULATIONS: Mapping[str, Callable[..., Population]] = {
    name: getattr(Population, name) for name in ("fingertip", "grid", "line", "one_each")
}


def population_named(word: str, finger: Finger) -> Population:
    """The population of a word such as ``fingertip:seed=3``, or of a table.

    Raises
    ------
    UsageError, TableError
        No such population, number or file.
    """
    name = word.partition(":")[0]
    if name not in POPULATIONS:
        path = Path(word)
        if path.suffix or path.exists():
            return Population.read(path, finger)
        raise UsageError(
            f"population {name!r}, expected {', '.join(POPULATIONS)} or a table .csv"
            + near_hint(name, POPULATIONS)
        )
    return made_of(word, POPULATIONS[name], finger=finger)


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
