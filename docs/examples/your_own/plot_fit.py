"""
Parameters of your own recordings
=================================

A table of firing rates is enough to fit the model: NSGA-II minimises the errors at all frequencies at once. Here the rates are those of
TouchSim, another model, so that everybody can run the example.
"""

# sphinx_gallery_tags = ["fit", "rates"]

import matplotlib.pyplot as plt
import pandas as pd

import fembridge as fb
from fembridge.evidence import touchsim_rates

plt.style.use("fembridge.plots.screen")

# %%
# The columns of observed rates are ``stimulus, afferent, rate_ips``. 400 evaluations are a quick look; the default is 10 000.

observed = pd.DataFrame(
    [(rate.stimulus, rate.afferent, rate.rate_ips) for rate in touchsim_rates() if rate.stimulus.startswith("sine_")],
    columns=["stimulus", "afferent", "rate_ips"],
)  # fmt: skip
fit = fb.fit(observed, afferents="SA", search=fb.Search(evaluations=400, population=40))

# %%
# Fitted rates against observed ones; each dot is a sinusoid.

fitted = fb.simulate("sine", parameters=fit.parameters, stored=True).rates
both = observed.merge(fitted, on=["stimulus", "afferent"], suffixes=("_observed", "_fitted"))
both = both[both["afferent"] == "SA"]
fig, panel = plt.subplots(figsize=(4.6, 4.2))
limit = 1.1 * both[["rate_ips_observed", "rate_ips_fitted"]].max().max()
panel.plot([0, limit], [0, limit], color="0.7", lw=1)
panel.plot(both["rate_ips_observed"], both["rate_ips_fitted"], "o", color="C0", alpha=0.7)
panel.set(
    xlabel="observed rate (impulses/s)",
    ylabel="fitted rate (impulses/s)",
    title="SA after 400 evaluations",
)

# %%
error = ((both["rate_ips_observed"] - both["rate_ips_fitted"]) ** 2).mean() ** 0.5
print(
    f"RMSE {error:.1f} impulses/s, correlation {both['rate_ips_observed'].corr(both['rate_ips_fitted']):.2f}"
)
