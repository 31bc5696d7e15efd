"""
A receptive field
=================

Where on the skin a probe of 0.5 mm makes RA afferents fire, and how the field grows with depth. Fields have several hot spots: each
fibre branches to several endings.
"""

# sphinx_gallery_tags = ["fingertip", "receptive field"]

import fembridge as fb

field = fb.receptive_field("RA", units=9, step_mm=0.4)
figure = field.plot("field")

# %%
# Medians and quartiles over units: threshold, and area at each depth.

print(field.summary.round(1).T.to_string(header=False))
