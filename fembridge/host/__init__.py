"""What the machine gives: files and locks, cache, cores, memory, processes, terminal."""
