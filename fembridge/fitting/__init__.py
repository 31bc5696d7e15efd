"""Fits afferent parameters to observed rates: problem, search, choice, files."""
