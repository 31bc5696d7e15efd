"""A user's own deck, kept to the byte but for waveform, increments and output."""
