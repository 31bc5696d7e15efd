"""The response map: stress at each afferent against depth of the probe; its file.

A map of our finger begins at depth 0, where the probe leaves the skin. A map of a user's deck
may have depths below 0, any number of units of a class, and a load instead of a displacement.

A map is a small, readable TOML file with a checksum. The maps of the reference fingers
are stored in ``maps``, for machines without a solver: each is the result of the recorded
run ``fixtures/response_NAME`` of the repository, and ``python fixtures/record.py``
makes both again.
"""

import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np

from decks.finger import Finger
from decks.own_model import LoadScale
from decks.presets import finger_table
from decks.probe import Probe
from fembridge.errors import ResponseError, UsageError
from fembridge.host.store import near_hint, read_sealed, write_sealed
from fembridge.io.run_folder import AfferentNode
from fembridge.results.von_mises import TENSOR, energy_stress_pa, von_mises_pa
from fembridge.stimulus import Stimulus
from fembridge.trace import StressTrace, afferent_key, split_afferent_key
from fembridge.typing import FloatArray, Table
from neural.models import AfferentModel, model_of
from neural.parameters import AfferentParameters

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator

_LOGGER = logging.getLogger(__name__)

FORMAT = 1
MAP_FILE = "response.toml"
RESPONSE_FOLDER = "response"
FOLDER = Path(__file__).parent / "maps"
ENERGY = "energy"
IN_PLANE = 4
"""Number of non-zero stress components in plane strain: xx, yy, zz, xy."""
_DEEP = "_deep"
_LENGTHS = ("x_mm", "y_mm", "depth_mm", "z_mm")
_SITE_KEYS = ("node", "layer", *_LENGTHS)
_STRESS_KEYS = tuple(f"{name}_pa" for name in TENSOR)
_KEYS = (
    "sha256",
    "format",
    "closure_percent",
    "depth_um",
    "force_n_per_mm",
    "force_n",
    "is_mean",
    "lifts_off",
    "load",
    "origin",
    "afferents",
)
_MAX_BYTES = 100_000_000

ResponseLike: TypeAlias = "ResponseMap | HasResponse | str | PathLike[str]"
"""A response map, a result that has one, or the folder or file of one."""

Models: TypeAlias = Mapping[str, AfferentModel] | Mapping[str, AfferentParameters]
"""Models or parameters by afferent class."""


class HasResponse(Protocol):
    """A result with a response map, such as `fembridge.DeckResponse`."""

    @property
    def response(self) -> "ResponseMap":
        """The map."""


@dataclass(frozen=True, slots=True, eq=False)
class ResponseMap:
    """Stress at each afferent against the depth of the probe, from one indentation.

    Parameters
    ----------
    depth_um
        Depth of the probe in um, ``(K,)``, K at least 3, ascending from 0 or less. Where `load`
        is set, the depth stands for a force or a pressure.
    tensor_pa
        Stress tensors in Pa, ``(K, afferent, 6)``: xx, yy, zz, xy, yz, zx. In plane strain yz
        and zx are 0.
    force_n_per_mm
        Force of the skin on the probe, ``(K,)`` in N per mm of thickness; ``(0,)`` where it is
        unknown.
    places
        Node, layer and position of each afferent; a unit where its class has several.
    closure_percent
        Largest difference of unloading from loading in percent, NaN where nothing was compared.
    origin
        Inputs of the map: solver, deck, finger, probe. Default: empty.
    lifts_off
        Whether the probe has left the skin at the smallest depth, so that stress is the same
        at any smaller one. Default: True.
    load
        Force or pressure that `depth_um` stands for. Default: None, a displacement.
    force_n
        Force on a probe on a whole fingertip, ``(K,)`` in N. Default: ``(0,)``, not known.
    is_mean
        Whether the units of a class are one afferent under several positions of a probe, over
        which rates are means. Default: False.

    Raises
    ------
    ResponseError
        Shapes that do not match, or depths that do not ascend or lack 0.

    Examples
    --------
    >>> import fembridge as fb
    >>> response = fb.PadProbe(pad="reference").response
    >>> traces = response.traces(fb.make_stimulus("sine_20_100"))
    >>> len(traces)  # three classes at three positions across a ridge
    9
    """

    depth_um: FloatArray
    tensor_pa: FloatArray
    force_n_per_mm: FloatArray
    places: tuple[AfferentNode, ...]
    closure_percent: float
    origin: Mapping[str, Any] = field(default_factory=dict)
    lifts_off: bool = True
    load: LoadScale | None = None
    force_n: FloatArray = field(default_factory=lambda: np.empty(0))
    is_mean: bool = False
    _curve: "PchipInterpolator | None" = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("depth_um", "tensor_pa", "force_n_per_mm", "force_n"):
            array = np.array(getattr(self, name), dtype=np.float64)
            if not np.isfinite(array).all():
                raise ResponseError(f"response map: {name} is not finite everywhere")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        depth_um, count = self.depth_um, self.depth_um.size
        expected = (count, len(self.places), len(TENSOR))
        for force in (self.force_n_per_mm, self.force_n):
            if self.tensor_pa.shape != expected or force.shape not in ((count,), (0,)):
                raise ResponseError(
                    f"response map: tensors {self.tensor_pa.shape} and forces "
                    f"{force.shape}, expected {expected} and ({count},)"
                )
        if (
            depth_um.ndim != 1
            or count < 3
            or not (np.diff(depth_um) > 0).all()
            or 0.0 not in depth_um
        ):
            raise ResponseError(
                "response map: expected three or more depths, ascending, one of them 0"
            )
        keys = [site.key for site in self.places]
        if len(set(keys)) < len(keys):
            raise ResponseError(f"response map: {max(keys, key=keys.count)} is there twice")

    def __repr__(self) -> str:
        depths = f"{self.depth_um.size} depths to {self.deepest_um:g} um"
        if self.depth_um[0] < 0:
            depths = f"{self.depth_um.size} depths, {self.depth_um[0]:g} to {self.deepest_um:g} um"
        return f"ResponseMap({self.classes_text()}, {depths})"

    def class_names(self) -> list[str]:
        """The classes, each once."""
        return list(dict.fromkeys(site.afferent for site in self.places))

    def classes_text(self) -> str:
        """The classes, with the number of units where a class has several."""
        counts = Counter(site.afferent for site in self.places)
        return ", ".join(f"{name} ({n} units)" if n > 1 else name for name, n in counts.items())

    def with_units(self, units: Sequence[str]) -> "ResponseMap":
        """The map with one unit of some classes, and all others.

        Parameters
        ----------
        units
            The unit of each class, as ``"SA=12"``.

        Raises
        ------
        UsageError
            A unit that the map lacks, or two of a class.
        """
        chosen: dict[str, str] = {}
        for text in units:
            afferent, _, unit = text.partition("=")
            keys = [afferent_key(site.afferent, site.unit) for site in self.places]
            if afferent in chosen or afferent_key(afferent, unit) not in keys:
                expected = ", ".join(key.replace(" ", "=") for key in keys)
                expected = f"one of each class, of {expected}"
                raise UsageError(argument="unit", found=text, expected=expected)
            chosen[afferent] = unit
        columns = [
            column
            for column, site in enumerate(self.places)
            if chosen.get(site.afferent, site.unit) == site.unit
        ]
        places = tuple(self.places[column] for column in columns)
        return replace(self, tensor_pa=self.tensor_pa[:, columns], places=places)

    @property
    def is_of_deck(self) -> bool:
        """Whether the map is of a user's deck, whose position of the probe is depth 0."""
        return "base_deck" in self.origin

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
                unit=site.unit,
            )
            for column, site in enumerate(self.places)
        ]

    def stress_pa(
        self, model: AfferentModel | AfferentParameters, stimuli: Sequence[Stimulus]
    ) -> FloatArray:
        """Stress in Pa that drives the class of `model`, ``(T, stimulus, position)``.

        A shorter stimulus keeps its last stress up to the length of the longest. There is one
        position, except where the map `is_mean`. Of several units of the class of another map the
        one with the largest stress is taken.

        Parameters
        ----------
        model
            Model or parameters of the class.
        stimuli
            Probe depths in um against time in ms.

        Raises
        ------
        ResponseError
            Those of `traces`; or the map lacks the class.
        """
        columns = [k for k, site in enumerate(self.places) if site.afferent == model.afferent]
        if not columns:
            raise ResponseError(
                f"no {model.afferent} in the response, only {self.classes_text()}",
                found=model.afferent,
                expected=self.classes_text(),
            )
        if len(columns) > 1 and not self.is_mean:
            peaks_pa = von_mises_pa(self.tensor_pa[:, columns]).max(axis=0)
            column = columns[int(peaks_pa.argmax())]
            _LOGGER.info(
                f"{model.afferent} is unit {self.places[column].unit}, of {len(columns)} that with "
                "the largest stress"
            )
            columns = [column]
        samples = max(stimulus.displacement_um.size for stimulus in stimuli)
        stress_pa = np.empty((samples, len(stimuli), len(columns)))
        for row, stimulus in enumerate(stimuli):
            size = stimulus.displacement_um.size
            for position, column in enumerate(columns):
                tensor_pa = self.tensors(stimulus.displacement_um, stimulus.id, column)
                trace_pa = self._scalar_pa(tensor_pa, self.places[column], model)
                stress_pa[:size, row, position] = trace_pa
                stress_pa[size:, row, position] = trace_pa[-1]
        return stress_pa

    def force_at_n(self, depth_um: FloatArray) -> FloatArray:
        """Force on the probe in N at depths in um, of any shape; NaN where it is not known.

        Parameters
        ----------
        depth_um
            Depths of the probe in um, ``(T,)`` or of another shape, at most `deepest_um`; above the
            skin the force is 0.
        """
        if not self.force_n.size:
            return np.full(np.shape(depth_um), np.nan)
        from scipy.interpolate import PchipInterpolator

        force_n: FloatArray = PchipInterpolator(self.depth_um, self.force_n)(
            np.maximum(depth_um, self.depth_um[0])
        )
        return force_n

    def _scalar_pa(
        self,
        tensor_pa: FloatArray,
        site: AfferentNode,
        model: AfferentModel | AfferentParameters | None,
    ) -> FloatArray:
        if model is not None and _reads_energy(model):
            return energy_stress_pa(tensor_pa, self.poisson_at(site))
        return von_mises_pa(tensor_pa)

    def tensors(
        self, displacement_um: FloatArray, name: str = "probe", column: int | None = None
    ) -> FloatArray:
        """Stress tensors ``(T, afferent, 6)`` in Pa at depths of the probe.

        Parameters
        ----------
        displacement_um
            Depth of the probe in um, ``(T,)``.
        name
            Name of the stimulus in an error. Default: ``"probe"``.
        column
            Row of an afferent in `places`, whose tensors alone are computed, ``(T, 6)``.
            Default: None, all afferents.

        Raises
        ------
        ResponseError
            A depth beyond those of the map.
        """
        deepest_um, highest_um = float(displacement_um.max()), float(displacement_um.min())
        if deepest_um > self.deepest_um:
            raise ResponseError(
                f"{name} goes {deepest_um:.9g} um deep, the response map reaches "
                f"{self.deepest_um:g} um",
                found=deepest_um,
                expected=f"at most {self.deepest_um:g} um",
            )
        if highest_um < self.depth_um[0] and not self.lifts_off:
            raise ResponseError(
                f"{name} goes up to {highest_um:.9g} um, the response map begins at "
                f"{self.depth_um[0]:g} um: a pre-indentation (--preindent-um) keeps it inside, or "
                "a map with a larger --retract-um",
                found=highest_um,
                expected=f"at least {self.depth_um[0]:g} um",
            )
        from scipy.interpolate import PchipInterpolator, PPoly  # slow to import

        if self._curve is None:
            curve = PchipInterpolator(self.depth_um, self.tensor_pa, axis=0)
            object.__setattr__(self, "_curve", curve)
        interpolant: PPoly = self._curve
        selected = (
            interpolant if column is None else PPoly(interpolant.c[:, :, column], interpolant.x)
        )
        tensor_pa: FloatArray = selected(np.maximum(displacement_um, self.depth_um[0]))
        return tensor_pa

    def poisson_at(self, site: AfferentNode) -> float:
        """Poisson's ratio of the layer around an afferent.

        Parameters
        ----------
        site
            The afferent, one of `places`.

        Raises
        ------
        ResponseError
            `origin` lacks the material of the layer.
        """
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
    components = len(TENSOR) if response.tensor_pa[..., IN_PLANE:].any() else IN_PLANE
    table: Table = {
        "format": FORMAT,
        "closure_percent": response.closure_percent,
        "depth_um": response.depth_um.tolist(),
        **({"force_n_per_mm": force.tolist()} if (force := response.force_n_per_mm).size else {}),
        **({"force_n": force.tolist()} if (force := response.force_n).size else {}),
        **({"is_mean": True} if response.is_mean else {}),
        **({} if response.lifts_off else {"lifts_off": False}),
        **({} if response.load is None else {"load": asdict(response.load)}),
        "origin": dict(response.origin),
        "afferents": {
            site.key: {
                **{key: value for key, value in site.to_table().items() if key in _SITE_KEYS},
                **{
                    key: response.tensor_pa[:, column, component].tolist()
                    for component, key in enumerate(_STRESS_KEYS[:components])
                },
            }
            for column, site in enumerate(response.places)
        },
    }
    write_sealed(path, table)


def read_map(path: Path | str) -> ResponseMap:
    """Read a map that `write_map` wrote; `path` is the file, or a folder that has it.

    The folder may be that of ``fembridge map`` or the output folder of ``fembridge simulate``.

    Raises
    ------
    ResponseError
        There is none, or it was not written by fembridge.
    """
    path = map_file(path)
    table = read_sealed(path, "response map", FORMAT, _MAX_BYTES)
    try:
        _check_keys(table, _KEYS, "the map")
        afferents = table["afferents"]
        for name, section in afferents.items():
            _check_keys(section, (*_SITE_KEYS, *_STRESS_KEYS), name)
        depth_um = _parse_numbers(table["depth_um"], "depth_um")
        tensor_pa = np.zeros((depth_um.size, len(afferents), len(TENSOR)))
        for column, (name, section) in enumerate(afferents.items()):
            for component, key in enumerate(_STRESS_KEYS):
                if component >= IN_PLANE and key not in section:
                    continue
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
        lifts_off, load = table.get("lifts_off", True), table.get("load")
        if not isinstance(lifts_off, bool) or not isinstance(load, Mapping | None):
            raise TypeError("lifts_off is not true or false, or load no table")
        if not isinstance(is_mean := table.get("is_mean", False), bool):
            raise TypeError("is_mean is not true or false")
        return ResponseMap(
            depth_um=depth_um,
            tensor_pa=tensor_pa,
            force_n_per_mm=_parse_numbers(table.get("force_n_per_mm", []), "force_n_per_mm"),
            places=tuple(_parse_site(name, section) for name, section in afferents.items()),
            closure_percent=float(closure_percent),
            origin=origin,
            lifts_off=lifts_off,
            load=None if load is None else LoadScale(**load),
            force_n=_parse_numbers(table.get("force_n", []), "force_n"),
            is_mean=is_mean,
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
        raise ResponseError(f"not a response map: {problem}", path) from error


def load_response(response: ResponseLike) -> ResponseMap:
    """The map of `response`: itself, that of a result, or that of a folder or file.

    Raises
    ------
    UsageError
        A value of another type.
    ResponseError
        There is no map, or it was not written by fembridge.
    """
    if isinstance(response, ResponseMap):
        return response
    if isinstance(response, str | PathLike):
        return read_map(Path(response))
    inner = getattr(response, "response", None)
    if not isinstance(inner, ResponseMap):
        expected = "a ResponseMap, a DeckResponse, a PadProbe, or the folder or file of a map"
        raise UsageError(argument="response", found=response, expected=expected)
    return inner


def map_file(path: Path | str) -> Path:
    """The file of a map: `path` itself, or the one in this folder.

    Raises
    ------
    ResponseError
        A folder without a map.
    """
    path = Path(path)
    candidates = (path / MAP_FILE, path / RESPONSE_FOLDER / MAP_FILE)
    found = next(filter(Path.is_file, candidates), path)
    if found.is_dir():
        raise ResponseError(
            f"no {MAP_FILE} here nor in {RESPONSE_FOLDER}/, expected the output folder of "
            "`fembridge map` or `fembridge simulate`",
            path,
        )
    return found


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
    afferent, unit = split_afferent_key(name)
    x_mm, y_mm, depth_mm, z_mm = lengths_mm
    return AfferentNode(afferent, node, layer, x_mm, y_mm, depth_mm, z_mm, unit=unit)


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


def _reads_energy(model: AfferentModel | AfferentParameters) -> bool:
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
