"""Files of our own: tables, waveforms, run folders, recordings; text of numbers."""
