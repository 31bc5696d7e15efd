"""From a probe on a fingertip to the spikes of its afferents.

``import fembridge`` loads NumPy and nothing heavier; each name below is
imported when it is first asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fembridge.errors import FembridgeError
    from fembridge.results import read
    from fembridge.stimulus import Stimulus
    from fembridge.trace import StressTrace

__version__ = "0.1.0"

_HOMES = {
    "FembridgeError": "fembridge.errors",
    "Stimulus": "fembridge.stimulus",
    "StressTrace": "fembridge.trace",
    "read": "fembridge.results",
}

__all__ = ["FembridgeError", "Stimulus", "StressTrace", "read"]


def __getattr__(name: str) -> Any:  # noqa: ANN401 - whatever the name stands for
    if name not in _HOMES:
        raise AttributeError(f"module 'fembridge' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
