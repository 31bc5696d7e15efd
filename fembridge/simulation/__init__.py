"""From stimuli to stress and spikes, and spikes of stress traces from anywhere."""

METHODS = ("map", "transient")
AUTO = "auto"
"""Values of the argument `method` of `simulate`."""
