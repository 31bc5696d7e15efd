"""Many stimuli, fingers, probes and contacts: each solved once, in any number of goes.

`sweep.sweep` is the way in; a study is a TOML file (`read_study`) or a `Study`. What a
table says about parameters of the finger is in `fembridge.sensitivity`.
"""

from fembridge.sweeps.fingers import Variant
from fembridge.sweeps.study import Study, read_study
from fembridge.sweeps.sweep import Sweep

__all__ = ["Study", "Sweep", "Variant", "read_study"]
