"""
A population under a bar
========================

A bar 1 mm wide is pressed into the fingertip. The afferents that fire show its orientation, SA most clearly along its edges.
"""

# sphinx_gallery_tags = ["fingertip", "shape", "population"]

import matplotlib.pyplot as plt

import fembridge as fb

plt.style.use("fembridge.plots.screen")
COLOUR = {"SA": "C0", "RA": "C1", "PC": "C2"}

# %%
# The same bar at three angles, 250 µm deep. Each dot is an afferent; its size is its firing rate.

angles_deg = (0, 45, 90)
fig, panels = plt.subplots(1, 3, figsize=(8.4, 3.4), sharex=True, sharey=True)
for panel, angle_deg in zip(panels, angles_deg, strict=True):
    touch = fb.touch("bar:width_mm=1,length_mm=12", press_um=250, angle_deg=angle_deg, seed=1)
    rates = touch.population.to_frame().merge(touch.rates, on=["unit", "afferent"])
    for name, colour in COLOUR.items():
        chosen = rates[rates["afferent"] == name]
        panel.plot(chosen["x_mm"], chosen["z_mm"], ".", color="0.85", ms=2, zorder=0)
        firing = chosen[chosen["rate_ips"] > 0]
        panel.scatter(
            firing["x_mm"],
            firing["z_mm"],
            s=2 + 1.5 * firing["rate_ips"],
            color=colour,
            alpha=0.7,
            label=name,
            lw=0,
        )
    panel.set(title=f"{angle_deg}°", xlabel="across (mm)", aspect="equal")
    print(
        f"{angle_deg}°: {(rates['rate_ips'] > 0).sum()} of {len(rates)} afferents fire, {touch.force_n.max():.2f} N"
    )
panels[0].set_ylabel("along (mm)")
panels[2].legend(loc="upper left", bbox_to_anchor=(1, 1), markerscale=1.2)
