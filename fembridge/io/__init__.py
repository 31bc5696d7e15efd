"""Files of our own: tables, waveforms, run folders, recordings; text of numbers."""

RUN_FILE = "run.toml"
"""File that makes a folder a run folder."""
