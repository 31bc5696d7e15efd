"""One indentation answers every stimulus: stress as a function of probe depth.

Without inertia and viscosity, and when a load–unload run comes back to where it
was, stress does not depend on how the probe got to a depth.
"""
