"""Parameters of afferents from observed rates: problem, search, choice, files."""
