"""CalculiX on this machine: a run folder in, accepted results or the cause out."""
