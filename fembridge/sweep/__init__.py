"""Many stimuli, fingers, probes and contacts: each solved once, in any number of goes.

`run_sweep` is the way in; a study is a TOML file (`read_study`) or a `Study`.
"""

from fembridge.sweep.study import Study
from fembridge.sweep.study_file import read_study
from fembridge.sweep.sweep import Sweep, run_sweep
from fembridge.sweep.variant import Variant

__all__ = ["Study", "Sweep", "Variant", "read_study", "run_sweep"]
