"""CalculiX on this machine: solves a run folder, and accepts the results or names the cause."""
