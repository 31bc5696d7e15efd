"""The response map: stress at each afferent against depth of the probe; its file.

A map is TOML: small, readable, and sealed by a checksum. Those of the reference
fingers are stored in ``maps``, for machines without a solver: each is what the
recorded run ``fixtures/response_NAME`` of the repository gave, and
``python fixtures/record.py`` makes both again.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from decks.finger import Finger
from decks.presets import finger_table
from decks.probe import Probe
from fembridge.errors import ResponseError
from fembridge.results.stress import TENSOR, energy_stress_pa, von_mises_pa
from fembridge.run_folder import AfferentNode
from fembridge.stimulus import Stimulus
from fembridge.store import near_hint, read_sealed, write_sealed
from fembridge.trace import StressTrace
from fembridge.typing import FloatArray, Table
from neural.models import Model, model_of
from neural.parameters import AfferentParameters

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator

FORMAT = 1
MAP_FILE = "response.toml"
FOLDER = Path(__file__).parent / "maps"
ENERGY = "energy"
IN_PLANE = 4
"""Components of a tensor that plane strain has: xx, yy, zz, xy."""
_DEEP = "_deep"
_LENGTHS = ("x_mm", "y_mm", "depth_mm", "z_mm")
_PLACE_KEYS = ("node", "layer", *_LENGTHS)
_STRESS_KEYS = tuple(f"{name}_pa" for name in TENSOR[:IN_PLANE])
_KEYS = (
    "sha256",
    "format",
    "closure_percent",
    "depth_um",
    "force_n_per_mm",
    "origin",
    "afferents",
)

Models: TypeAlias = Mapping[str, Model] | Mapping[str, AfferentParameters]
"""By class of afferents: rows of the table of drives, or parameters."""


@dataclass(frozen=True, slots=True, eq=False)
class ResponseMap:
    """Stress tensors `tensor_pa` ``(K, afferent, 6)`` at `depth_um` ``(K,)``.

    Depths ascend from 0, where stress is 0; a probe that is lifted off leaves the
    skin at rest. Plane strain: the shears yz and zx are 0 throughout.
    `force_n_per_mm` ``(K,)`` is the force of the skin on the probe.
    `closure_percent` is what the load-unload run showed, NaN where none was
    compared; `origin` is what the map was made from.

    Raises
    ------
    ResponseError
        Shapes that do not belong together, depths that do not ascend from 0.
    """

    depth_um: FloatArray
    tensor_pa: FloatArray
    force_n_per_mm: FloatArray
    places: tuple[AfferentNode, ...]
    closure_percent: float
    origin: Mapping[str, Any] = field(default_factory=dict)
    _curve: "PchipInterpolator | None" = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("depth_um", "tensor_pa", "force_n_per_mm"):
            array = np.array(getattr(self, name), dtype=np.float64)
            if not np.isfinite(array).all():
                raise ResponseError(f"response map: {name} is not finite everywhere")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        depth_um, count = self.depth_um, self.depth_um.size
        expected = (count, len(self.places), len(TENSOR))
        if self.tensor_pa.shape != expected or self.force_n_per_mm.shape != (count,):
            raise ResponseError(
                f"response map: tensors {self.tensor_pa.shape} and forces "
                f"{self.force_n_per_mm.shape}, expected {expected} and ({count},)"
            )
        if depth_um.ndim != 1 or count < 3 or depth_um[0] or not (np.diff(depth_um) > 0).all():
            raise ResponseError("response map: expected three or more depths, ascending from 0")

    @property
    def deepest_um(self) -> float:
        """How deep a stimulus may go."""
        return float(self.depth_um[-1])

    def traces(self, stimulus: Stimulus, models: Models | None = None) -> list[StressTrace]:
        """Stress that drives each afferent while the probe follows `stimulus`.

        The tensor's components are interpolated (PCHIP: no overshoot between two
        depths), then von Mises stress is taken, so that it fits the tensor. Where the
        `quantity` of a drive in `models`, by class, is ``energy``, its afferent reads the
        uniaxial stress of equal strain energy.

        Raises
        ------
        ResponseError
            The stimulus goes deeper than the map, or its origin has not the material
            that an energy takes.
        """
        tensor_pa = self.tensors(stimulus.displacement_um, stimulus.id)
        return [
            StressTrace(
                self._scalar_pa(tensor_pa[:, column], place, (models or {}).get(place.afferent)),
                stimulus.dt_ms,
                place.node,
                place.afferent,
            )
            for column, place in enumerate(self.places)
        ]

    def stress_pa(
        self, model: Model | AfferentParameters, stimuli: Sequence[Stimulus]
    ) -> FloatArray:
        """Stress that drives the class of `model`, ``(T, stimulus)``; a short one holds its end.

        Errors are those of `traces`, and a `ResponseError` where the map lacks the class.
        """
        classes = [place.afferent for place in self.places]
        if model.afferent not in classes:
            raise ResponseError(f"no {model.afferent} in the response, only {', '.join(classes)}")
        column = classes.index(model.afferent)
        found = [
            self._scalar_pa(
                self.tensors(one.displacement_um, one.id, column), self.places[column], model
            )
            for one in stimuli
        ]
        longest = max(map(len, found))
        return np.stack([np.pad(one, (0, longest - len(one)), mode="edge") for one in found], -1)

    def _scalar_pa(
        self, tensor_pa: FloatArray, place: AfferentNode, model: Model | AfferentParameters | None
    ) -> FloatArray:
        if model is not None and _reads_energy(model):
            return energy_stress_pa(tensor_pa, self.poisson_at(place))
        return von_mises_pa(tensor_pa)

    def tensors(
        self, displacement_um: FloatArray, name: str = "probe", column: int | None = None
    ) -> FloatArray:
        """Stress tensors ``(T, afferent, 6)`` in Pa at probe depths ``(T,)``.

        Of the afferent in one `column` alone ``(T, 6)``.
        """
        deepest_um = float(displacement_um.max())
        if deepest_um > self.deepest_um:
            raise ResponseError(
                f"{name} goes {deepest_um:.9g} um deep, the response map reaches "
                f"{self.deepest_um:g} um"
            )
        from scipy.interpolate import PchipInterpolator, PPoly  # slow to import

        if self._curve is None:
            curve = PchipInterpolator(self.depth_um, self.tensor_pa, axis=0)
            object.__setattr__(self, "_curve", curve)
        known: PPoly = self._curve
        mine = known if column is None else PPoly(known.c[:, :, column], known.x)
        tensor_pa: FloatArray = mine(np.maximum(displacement_um, 0.0))
        return tensor_pa

    def poisson_at(self, place: AfferentNode) -> float:
        """Poisson's ratio of the layer in which an afferent lies."""
        try:
            return float(self.origin["finger"]["materials"][place.layer]["poisson"])
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise ResponseError(
                f"the response has no Poisson's ratio of {place.layer}, in which "
                f"{place.afferent} lies: no energy can be taken of its stress"
            ) from error


def reading_energy(models: Models) -> str | None:
    """The first class whose model reads energy; None: von Mises stress will do."""
    return next((name for name, model in models.items() if _reads_energy(model)), None)


def write_map(path: Path, response: ResponseMap) -> None:
    """Write `response`; the same map gives the same bytes."""
    table: Table = {
        "format": FORMAT,
        "closure_percent": response.closure_percent,
        "depth_um": response.depth_um.tolist(),
        "force_n_per_mm": response.force_n_per_mm.tolist(),
        "origin": dict(response.origin),
        "afferents": {
            place.afferent: {
                **place.to_table(),
                **{
                    key: response.tensor_pa[:, column, component].tolist()
                    for component, key in enumerate(_STRESS_KEYS)
                },
            }
            for column, place in enumerate(response.places)
        },
    }
    write_sealed(path, table)


def read_map(path: Path) -> ResponseMap:
    """Read a map that `write_map` wrote."""
    table = read_sealed(path, "response map", FORMAT)
    try:
        _check_keys(table, _KEYS, "the map")
        afferents = table["afferents"]
        for name, place in afferents.items():
            _check_keys(place, (*_PLACE_KEYS, *_STRESS_KEYS), name)
        depth_um = _reals(table["depth_um"], "depth_um")
        tensor_pa = np.zeros((depth_um.size, len(afferents), len(TENSOR)))
        for column, (name, place) in enumerate(afferents.items()):
            for component, key in enumerate(_STRESS_KEYS):
                stress_pa = _reals(place[key], f"{key} of {name}")
                if stress_pa.shape != depth_um.shape:
                    raise ValueError(
                        f"{key} of {name} has {stress_pa.size} numbers, expected {depth_um.size}"
                    )
                tensor_pa[:, column, component] = stress_pa
        if not afferents:
            raise ValueError("no afferents")
        closure_percent, origin = table["closure_percent"], table["origin"]
        if not isinstance(closure_percent, float | int) or not isinstance(origin, Mapping):
            raise TypeError("closure_percent or origin is of another kind")
        return ResponseMap(
            depth_um=depth_um,
            tensor_pa=tensor_pa,
            force_n_per_mm=_reals(table["force_n_per_mm"], "force_n_per_mm"),
            places=tuple(_place_in(name, place) for name, place in afferents.items()),
            closure_percent=float(closure_percent),
            origin=origin,
        )
    except (
        KeyError,
        TypeError,
        ValueError,
        AttributeError,
        OverflowError,
        ResponseError,
    ) as error:
        problem = f"no {error} in it" if isinstance(error, KeyError) else str(error)
        raise ResponseError(f"{path}: not a response map: {problem}") from error


def _check_keys(table: Mapping[str, Any], expected: Sequence[str], name: str) -> None:
    """Refuse a key that no version has written."""
    for key in table:
        if key not in expected:
            raise ValueError(f"unknown key {key!r} of {name}{near_hint(key, expected)}")


def _reals(numbers: object, name: str) -> FloatArray:
    """Finite numbers ``(n,)`` of a list in a table."""
    if not isinstance(numbers, list) or any(type(number) not in (int, float) for number in numbers):
        raise ValueError(f"{name} is no list of numbers")
    reals = np.array(numbers, dtype=np.float64)
    if not np.isfinite(reals).all():
        raise ValueError(f"{name} is not finite everywhere")
    return reals


def _place_in(name: str, table: Mapping[str, Any]) -> AfferentNode:
    """Where the afferent `name` sits."""
    node, layer = table["node"], table["layer"]
    if type(node) is not int or node < 1 or not isinstance(layer, str):
        raise ValueError(f"node {node!r} of {name} in layer {layer!r}")
    lengths_mm: list[Any] = [table.get(key) for key in _LENGTHS]
    if None in lengths_mm[:2]:
        raise ValueError(f"the place of {name} has no x_mm or y_mm")
    _reals([length_mm for length_mm in lengths_mm if length_mm is not None], f"the place of {name}")
    return AfferentNode(name, node, layer, *lengths_mm)


def stored_response(
    finger: Finger, probe: Probe, element: str, *, depth_um: float = 0.0, law: str = "linear"
) -> ResponseMap:
    """The stored response of exactly this finger, probe, element and law.

    Two are stored of each reference finger, ``NAME.toml`` and ``NAME_deep.toml``; the
    one that reaches `depth_um` is given, else the deeper.

    Raises
    ------
    ResponseError
        None is stored for them: it takes a solver.
    """
    path = FOLDER / f"{finger.name}.toml"
    if not path.is_file():
        stems = (file.stem for file in FOLDER.glob("*.toml"))
        names = ", ".join(sorted(stem for stem in stems if not stem.endswith(_DEEP)))
        raise ResponseError(f"no response is stored for finger {finger.name!r}, only for {names}")
    response = read_map(path)
    if depth_um > response.deepest_um:
        response = read_map(path.with_stem(finger.name + _DEEP))
    made_of = {
        "finger": finger_table(finger),
        "probe": asdict(probe),
        "element": element,
        "law": law,
    }
    for part, wanted in made_of.items():
        stored = response.origin.get(part, "linear" if part == "law" else None)
        if stored != wanted:
            raise ResponseError(
                f"no response is stored for this {part}: the one of finger "
                f"{finger.name!r} has {_difference(stored, wanted)}"
            )
    return response


def _reads_energy(model: Model | AfferentParameters) -> bool:
    drive = model_of(model) if isinstance(model, AfferentParameters) else model
    return drive.quantity == ENERGY


def _difference(stored: object, wanted: object, name: str = "") -> str:
    """The first entry that differs: what is stored, and what was asked for."""
    if isinstance(stored, Mapping) and isinstance(wanted, Mapping):
        for key in [*stored, *wanted]:
            if stored.get(key) != wanted.get(key):
                inner = f"{name}.{key}" if name else str(key)
                return _difference(stored.get(key), wanted.get(key), inner)
    return f"{name} {stored!r}, asked for is {wanted!r}".strip()
