"""
Your own deck
=============

fembridge reads a finite-element model as it is, and says what it holds and what a run would cost before anything is solved. The deck here
is a sample that travels with the package.
"""

# sphinx_gallery_tags = ["own model", "finite elements"]

import tempfile

import fembridge as fb
from decks.own_model.deck_mesh import read_deck_mesh
from fembridge.plots.deck_mesh import deck_mesh_figure

# %%
# ``fembridge sample deck`` writes the same file. Its mesh, coloured by material:

folder = tempfile.TemporaryDirectory()
deck = fb.sample("deck", folder.name)
figure = deck_mesh_figure(read_deck_mesh(deck), {})

# %%
# What a check finds: elements, what the waveform would move, and the cost of a stimulus.

check = fb.check(deck, "sine_20_250")
print(check)
print(f"passed: {check.passed}")
folder.cleanup()
