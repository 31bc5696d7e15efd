"""Input of the solvers: fingers, probes, stimuli and decks.

``import decks`` loads no NumPy: names are imported when they are used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from decks.contact_analysis import Contact, ContactAnalysis, Model
    from decks.dialects import DIALECTS, DeckOptions
    from decks.finger import Finger
    from decks.own_model.inp_deck import rebase_inp
    from decks.presets import PRESETS, mesh_of, read_finger
    from decks.probe import Probe
    from decks.stimuli import CATALOGUE, resolve
    from decks.synthesis import make_stimulus

__all__ = [
    "CATALOGUE",
    "DIALECTS",
    "PRESETS",
    "Contact",
    "ContactAnalysis",
    "DeckOptions",
    "Finger",
    "Model",
    "Probe",
    "make_stimulus",
    "mesh_of",
    "read_finger",
    "rebase_inp",
    "resolve",
]

_MODULES = {
    name: module
    for module, names in {
        "contact_analysis": ("ContactAnalysis", "Contact", "Model"),
        "dialects": ("DIALECTS", "DeckOptions"),
        "finger": ("Finger",),
        "own_model.inp_deck": ("rebase_inp",),
        "presets": ("PRESETS", "mesh_of", "read_finger"),
        "probe": ("Probe",),
        "stimuli": ("CATALOGUE", "resolve"),
        "synthesis": ("make_stimulus",),
    }.items()
    for name in names
}


def __getattr__(name: str) -> Any:  # noqa: ANN401 - any exported object
    if name not in _MODULES:
        raise AttributeError(f"module 'decks' has no attribute {name!r}")
    return getattr(import_module(f"decks.{_MODULES[name]}"), name)
