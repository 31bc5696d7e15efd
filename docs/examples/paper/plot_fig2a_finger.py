"""
The finger and its afferents
============================

The cross-section of the fingertip: stratum corneum, epidermis, dermis with ridges and papillae, subcutaneous tissue, bone and nail, and
the three points at which afferents read the stress (the paper's Fig. 2a).
"""

# sphinx_gallery_tags = ["paper", "finite elements"]

import matplotlib.pyplot as plt
from matplotlib.collections import PolyCollection

from decks.finger import LAYERS
from decks.presets import QUICK, mesh_of

plt.style.use("fembridge.plots.screen")

# %%
# The mesh of the finger is stored with the package: nodes in mm, and quadrilaterals with the number of their layer.

mesh = mesh_of(QUICK)
fills = ["#96794E", "#E8C699", "#D0958F", "#F8F0DA", "#BCC3CC", "#73849C"]

fig, (whole, close) = plt.subplots(1, 2, figsize=(7.2, 4.2), width_ratios=(1.35, 1))
for panel, line in ((whole, 0.1), (close, 0.4)):
    for layer, name in enumerate(LAYERS):
        quads = mesh.node_mm[mesh.quad[mesh.layer == layer]]
        label = name.replace("_", " ")
        faces = {"facecolor": fills[layer], "edgecolor": (0, 0, 0, 0.35), "linewidth": line}
        panel.add_collection(PolyCollection(quads, label=label, **faces))
    panel.set_aspect("equal")
for (name, site), colour in zip(QUICK.afferents.items(), ("C0", "C1", "C2"), strict=True):
    x_mm, y_mm = mesh.node_mm[mesh.node_at(site)]
    close.plot(x_mm, y_mm, "o", color=colour, markeredgecolor="white", markersize=9)
    close.annotate(name, (x_mm, y_mm), (1.08, y_mm), color=colour, weight="bold", va="center")
    print(f"{name}: {-y_mm:.2f} mm below the skin, in the {site.layer}")
whole.autoscale_view()
whole.set(xlabel="across the finger (mm)", ylabel="height (mm)")
close.set(xlim=(-1.0, 1.6), ylim=(-2.4, 0.2), xlabel="across the finger (mm)", title="the pad")
whole.set_title("A fingertip in cross-section")
fig.legend(*whole.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=9)

# %%
# ``decks.finger.Finger`` has all sizes and stiffnesses. A changed finger is a file of a few lines; it needs a solver.

for name in LAYERS:
    material = QUICK.materials[name]
    print(f"{name.replace('_', ' '):20} {material.young_mpa:8g} MPa, Poisson {material.poisson:g}")
