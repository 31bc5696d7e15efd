"""Marc's post files, binary and formatted: records, blocks, mesh, increments."""
