"""Stress at each afferent as a function of probe depth, from one indentation.

Without inertia and viscosity, and where unloading follows the loading curve, stress
depends on the probe's depth alone, so one indentation gives the stress of every stimulus.
"""
