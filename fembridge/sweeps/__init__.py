"""Sweeps over stimuli, fingers, probes and contacts; each response is solved once.

`sweep.sweep` runs a study, which is a TOML file (`read_study`) or a `Study`. The effects of
the finger's parameters are computed in `fembridge.sensitivity.effects`.
"""

from fembridge.sweeps.fingers import Variant
from fembridge.sweeps.study_file import Study, read_study
from fembridge.sweeps.sweep import Sweep

__all__ = ["Study", "Sweep", "Variant", "read_study"]
