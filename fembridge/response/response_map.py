"""The response map: stress at each afferent against depth of the probe; its file.

A map is a small, readable TOML file with a checksum. The maps of the reference fingers
are stored in ``maps``, for machines without a solver: each is the result of the recorded
run ``fixtures/response_NAME`` of the repository, and ``python fixtures/record.py``
makes both again.
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
"""Number of non-zero stress components in plane strain: xx, yy, zz, xy."""
_DEEP = "_deep"
_LENGTHS = ("x_mm", "y_mm", "depth_mm", "z_mm")
_SITE_KEYS = ("node", "layer", *_LENGTHS)
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
"""Models or parameters by afferent class."""


@dataclass(frozen=True, slots=True, eq=False)
class ResponseMap:
    """Stress tensors `tensor_pa` ``(K, afferent, 6)`` at `depth_um` ``(K,)``.

    Depths ascend from 0, where stress is 0; above depth 0 the skin is unstressed. The
    section is in plane strain: the shears yz and zx are 0.
    `force_n_per_mm` ``(K,)`` is the force of the skin on the probe per mm of thickness.
    `closure_percent` is the difference between loading and unloading, NaN where nothing
    was compared; `origin` holds the inputs of the map.

    Raises
    ------
    ResponseError
        Shapes that do not match, or depths that do not ascend from 0.
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
        """Largest probe depth in um of a stimulus."""
        return float(self.depth_um[-1])

    def traces(self, stimulus: Stimulus, models: Models | None = None) -> list[StressTrace]:
        """Stress that drives each afferent while the probe follows `stimulus`.

        The tensor's components are interpolated (PCHIP: no overshoot between two
        depths); von Mises stress is computed from the interpolated tensor.

        Parameters
        ----------
        stimulus
            Probe depth in um against time in ms.
        models
            Models or parameters by afferent class. A class whose `quantity` is ``energy``
            reads the uniaxial stress of equal strain energy. Default: von Mises stress.

        Raises
        ------
        ResponseError
            The stimulus goes deeper than the map, or the origin of the map lacks
            Poisson's ratio, which strain energy needs.
        """
        tensor_pa = self.tensors(stimulus.displacement_um, stimulus.id)
        return [
            StressTrace(
                self._scalar_pa(tensor_pa[:, column], site, (models or {}).get(site.afferent)),
                stimulus.dt_ms,
                site.node,
                site.afferent,
            )
            for column, site in enumerate(self.places)
        ]

    def stress_pa(
        self, model: Model | AfferentParameters, stimuli: Sequence[Stimulus]
    ) -> FloatArray:
        """Stress in Pa that drives the class of `model`, ``(T, stimulus)``.

        A shorter stimulus keeps its last stress up to the length of the longest. Raises the
        errors of `traces`, and a `ResponseError` where the map lacks the class.
        """
        classes = [site.afferent for site in self.places]
        if model.afferent not in classes:
            raise ResponseError(f"no {model.afferent} in the response, only {', '.join(classes)}")
        column = classes.index(model.afferent)
        traces_pa = [
            self._scalar_pa(
                self.tensors(stimulus.displacement_um, stimulus.id, column),
                self.places[column],
                model,
            )
            for stimulus in stimuli
        ]
        samples = max(map(len, traces_pa))
        padded_pa = [np.pad(pa, (0, samples - len(pa)), mode="edge") for pa in traces_pa]
        return np.stack(padded_pa, axis=-1)

    def _scalar_pa(
        self, tensor_pa: FloatArray, site: AfferentNode, model: Model | AfferentParameters | None
    ) -> FloatArray:
        if model is not None and _reads_energy(model):
            return energy_stress_pa(tensor_pa, self.poisson_at(site))
        return von_mises_pa(tensor_pa)

    def tensors(
        self, displacement_um: FloatArray, name: str = "probe", column: int | None = None
    ) -> FloatArray:
        """Stress tensors ``(T, afferent, 6)`` in Pa at probe depths ``(T,)`` in um.

        With a `column`, those of one afferent, ``(T, 6)``. `name` is the stimulus in an error.
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
        interpolant: PPoly = self._curve
        selected = (
            interpolant if column is None else PPoly(interpolant.c[:, :, column], interpolant.x)
        )
        tensor_pa: FloatArray = selected(np.maximum(displacement_um, 0.0))
        return tensor_pa

    def poisson_at(self, site: AfferentNode) -> float:
        """Poisson's ratio of the layer around an afferent."""
        try:
            return float(self.origin["finger"]["materials"][site.layer]["poisson"])
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise ResponseError(
                f"the response lacks Poisson's ratio of {site.layer}, the layer of "
                f"{site.afferent}: strain energy cannot be computed"
            ) from error


def reading_energy(models: Models) -> str | None:
    """The first class whose model reads strain energy; None where all read von Mises stress."""
    return next((name for name, model in models.items() if _reads_energy(model)), None)


def write_map(path: Path, response: ResponseMap) -> None:
    """Write `response` to `path`; the same map gives the same bytes."""
    table: Table = {
        "format": FORMAT,
        "closure_percent": response.closure_percent,
        "depth_um": response.depth_um.tolist(),
        "force_n_per_mm": response.force_n_per_mm.tolist(),
        "origin": dict(response.origin),
        "afferents": {
            site.afferent: {
                **site.to_table(),
                **{
                    key: response.tensor_pa[:, column, component].tolist()
                    for component, key in enumerate(_STRESS_KEYS)
                },
            }
            for column, site in enumerate(response.places)
        },
    }
    write_sealed(path, table)


def read_map(path: Path) -> ResponseMap:
    """Read a map that `write_map` wrote."""
    table = read_sealed(path, "response map", FORMAT)
    try:
        _check_keys(table, _KEYS, "the map")
        afferents = table["afferents"]
        for name, section in afferents.items():
            _check_keys(section, (*_SITE_KEYS, *_STRESS_KEYS), name)
        depth_um = _parse_numbers(table["depth_um"], "depth_um")
        tensor_pa = np.zeros((depth_um.size, len(afferents), len(TENSOR)))
        for column, (name, section) in enumerate(afferents.items()):
            for component, key in enumerate(_STRESS_KEYS):
                stress_pa = _parse_numbers(section[key], f"{key} of {name}")
                if stress_pa.shape != depth_um.shape:
                    raise ValueError(
                        f"{key} of {name} has {stress_pa.size} numbers, expected {depth_um.size}"
                    )
                tensor_pa[:, column, component] = stress_pa
        if not afferents:
            raise ValueError("no afferents")
        closure_percent, origin = table["closure_percent"], table["origin"]
        if not isinstance(closure_percent, float | int) or not isinstance(origin, Mapping):
            raise TypeError("closure_percent is no number or origin no table")
        return ResponseMap(
            depth_um=depth_um,
            tensor_pa=tensor_pa,
            force_n_per_mm=_parse_numbers(table["force_n_per_mm"], "force_n_per_mm"),
            places=tuple(_parse_site(name, section) for name, section in afferents.items()),
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
        problem = f"key {error} is missing" if isinstance(error, KeyError) else str(error)
        raise ResponseError(f"{path}: not a response map: {problem}") from error


def _check_keys(table: Mapping[str, Any], expected: Sequence[str], name: str) -> None:
    """Raise ValueError for a key that no version has written."""
    for key in table:
        if key not in expected:
            raise ValueError(f"unknown key {key!r} of {name}{near_hint(key, expected)}")


def _parse_numbers(numbers: object, name: str) -> FloatArray:
    """Finite numbers ``(n,)`` of a list in a table."""
    if not isinstance(numbers, list) or any(type(number) not in (int, float) for number in numbers):
        raise ValueError(f"{name} is not a list of numbers")
    array = np.array(numbers, dtype=np.float64)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} is not finite everywhere")
    return array


def _parse_site(name: str, table: Mapping[str, Any]) -> AfferentNode:
    """Position and layer of the afferent `name`, from its section of a map."""
    node, layer = table["node"], table["layer"]
    if type(node) is not int or node < 1 or not isinstance(layer, str):
        raise ValueError(f"{name}: node {node!r} in layer {layer!r}")
    lengths_mm: list[Any] = [table.get(key) for key in _LENGTHS]
    if None in lengths_mm[:2]:
        raise ValueError(f"{name} lacks x_mm or y_mm")
    _parse_numbers(
        [length_mm for length_mm in lengths_mm if length_mm is not None], f"position of {name}"
    )
    return AfferentNode(name, node, layer, *lengths_mm)


def stored_response(
    finger: Finger, probe: Probe, element: str, *, depth_um: float = 0.0, law: str = "linear"
) -> ResponseMap:
    """The stored response of exactly this finger, probe, element and law.

    Each reference finger has two, ``NAME.toml`` and ``NAME_deep.toml``. The result is the
    shallower one where it reaches `depth_um` (default: 0), else the deeper one.

    Raises
    ------
    ResponseError
        None is stored for these inputs; a solver is needed.
    """
    path = FOLDER / f"{finger.name}.toml"
    if not path.is_file():
        stems = (file.stem for file in FOLDER.glob("*.toml"))
        names = ", ".join(sorted(stem for stem in stems if not stem.endswith(_DEEP)))
        raise ResponseError(f"no response is stored for finger {finger.name!r}, only for {names}")
    response = read_map(path)
    if depth_um > response.deepest_um:
        response = read_map(path.with_stem(finger.name + _DEEP))
    requested_parts = {
        "finger": finger_table(finger),
        "probe": asdict(probe),
        "element": element,
        "law": law,
    }
    for part, requested in requested_parts.items():
        stored = response.origin.get(part, "linear" if part == "law" else None)
        if stored != requested:
            raise ResponseError(
                f"no response is stored for this {part}: the stored one of finger "
                f"{finger.name!r} has {_difference(stored, requested)}"
            )
    return response


def _reads_energy(model: Model | AfferentParameters) -> bool:
    drive = model_of(model) if isinstance(model, AfferentParameters) else model
    return drive.quantity == ENERGY


def _difference(stored: object, requested: object, name: str = "") -> str:
    """The first entry that differs, with its stored and its requested value."""
    if isinstance(stored, Mapping) and isinstance(requested, Mapping):
        for key in [*stored, *requested]:
            if stored.get(key) != requested.get(key):
                path = f"{name}.{key}" if name else str(key)
                return _difference(stored.get(key), requested.get(key), path)
    return f"{name} {stored!r}, requested is {requested!r}".strip()
