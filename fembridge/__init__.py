"""From a probe on a fingertip to the spikes of its afferents.

>>> import fembridge as fb
>>> result = fb.simulate("sine_100_250", stored=True)
>>> result.rates["afferent"].tolist()
['SA', 'RA', 'PC']

``import fembridge`` loads NumPy and nothing heavier; a name is imported when it is first
asked for. Beside those of ``__all__`` there are ``Shape`` and ``Population`` for `touch`,
``make_stimulus`` and ``resolve`` of the catalogue, ``read_history``, ``read_fields`` and
``write_vtu_series`` for whole result files, ``Recording`` for spikes in other programs'
formats, ``ResponseMap``, ``read_observed`` and ``touchsim_rates``.
"""

from fembridge import interrupt as _interrupt  # noqa: F401 - first: the rest takes long

# isort: split
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fembridge.version import __version__ as __version__

if TYPE_CHECKING:
    from decks.finger import Finger
    from decks.probe import Probe
    from decks.stimuli import resolve as resolve
    from decks.waveform import make_stimulus as make_stimulus
    from fembridge.api import (
        build_deck,
        encode,
        fit,
        plot,
        run,
        simulate,
        thresholds,
        validate,
    )
    from fembridge.errors import FembridgeError, FembridgeWarning
    from fembridge.evidence import touchsim_rates as touchsim_rates
    from fembridge.observed import read_observed as read_observed
    from fembridge.recording import Recording as Recording
    from fembridge.response.response_map import ResponseMap as ResponseMap
    from fembridge.results import read
    from fembridge.results import read_fields as read_fields
    from fembridge.results import read_history as read_history
    from fembridge.results.vtu import write_vtu_series as write_vtu_series
    from fembridge.stimulus import Stimulus
    from fembridge.sweeps.sweep import sweep
    from fembridge.touching.field import receptive_field
    from fembridge.touching.population import Population as Population
    from fembridge.touching.shape import Shape as Shape
    from fembridge.touching.touch import touch
    from fembridge.trace import StressTrace

__all__ = [  # noqa: RUF022 - the main job first, then from deck to spikes, then what is built on it
    "simulate",
    "plot",
    "build_deck",
    "run",
    "read",
    "encode",
    "touch",
    "receptive_field",
    "sweep",
    "fit",
    "thresholds",
    "validate",
    "Stimulus",
    "StressTrace",
    "Finger",
    "Probe",
    "FembridgeError",
    "FembridgeWarning",
]

_HOMES = {
    name: home
    for home, names in (
        ("fembridge.api", "simulate plot build_deck run encode fit thresholds validate"),
        ("fembridge.results", "read read_fields read_history"),
        ("fembridge.results.vtu", "write_vtu_series"),
        ("fembridge.touching.touch", "touch"),
        ("fembridge.touching.field", "receptive_field"),
        ("fembridge.touching.shape", "Shape"),
        ("fembridge.touching.population", "Population"),
        ("fembridge.sweeps.sweep", "sweep"),
        ("fembridge.stimulus", "Stimulus"),
        ("fembridge.trace", "StressTrace"),
        ("fembridge.recording", "Recording"),
        ("fembridge.response.response_map", "ResponseMap"),
        ("fembridge.observed", "read_observed"),
        ("fembridge.evidence", "touchsim_rates"),
        ("fembridge.errors", "FembridgeError FembridgeWarning"),
        ("decks.finger", "Finger"),
        ("decks.probe", "Probe"),
        ("decks.stimuli", "resolve"),
        ("decks.waveform", "make_stimulus"),
    )
    for name in names.split()
}
"""Where each public name is."""


def __getattr__(name: str) -> Any:  # noqa: ANN401 - whatever the name stands for
    if name not in _HOMES:
        raise AttributeError(f"module 'fembridge' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])


def _refuse_strangers() -> None:
    """Stop when ``decks`` or ``neural`` would be somebody else's module.

    Both are plain words, so a file ``neural.py`` in the current folder or another
    installed package can stand in the way of the packages installed beside this
    one. They are looked up, not imported.
    """
    home = Path(__file__).resolve().parent.parent
    for name in ("decks", "neural"):
        try:
            spec = find_spec(name)
        except ValueError:  # a module without a spec has been put there by hand
            spec = None
        locations = [] if spec is None else list(spec.submodule_search_locations or [])
        if str(home / name) in {str(Path(folder).resolve()) for folder in locations}:
            continue
        if spec is None:
            raise ImportError(f"fembridge: no package {name!r} in {home}; install fembridge again")
        foreign_origin = spec.origin or ", ".join(locations)
        raise ImportError(
            f"fembridge: {foreign_origin} is in the way of the package {name!r} of "
            f"fembridge, expected in {home / name}; rename it or take it off the path"
        )


_refuse_strangers()
