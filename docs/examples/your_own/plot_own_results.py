"""
Your own results
================

A result file of CalculiX becomes stress histories, and these become spikes. The file is one of the recorded runs in ``fixtures``.
"""

# sphinx_gallery_tags = ["own model", "results"]

from pathlib import Path

import fembridge as fb

fixtures = next(p / "fixtures" for p in Path.cwd().parents if (p / "fixtures").is_dir())
traces = fb.read(fixtures / "transient_sine" / "job.frd")
encoding = fb.encode(traces, parameters="published")
figure = encoding.plot()

# %%
# Largest stress of each afferent in Pa, and its rate in impulses per second:

print(traces.to_frame().groupby("afferent")["von_mises_pa"].max().round())
print(encoding.rates[["afferent", "rate_ips"]].to_string(index=False))
