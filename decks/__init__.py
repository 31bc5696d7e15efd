"""What a solver is given: the finger, the probe, the stimuli, and the deck itself.

``import decks`` loads no NumPy. The catalogue of stimuli is text and numbers;
:mod:`decks.stimuli.waveform` makes samples of an entry.
"""

from decks.stimuli.catalogue import CATALOGUE, resolve
from decks.stimuli.entry import Diharmonic, Entry, Noise, Sine

__all__ = ["CATALOGUE", "Diharmonic", "Entry", "Noise", "Sine", "resolve"]
