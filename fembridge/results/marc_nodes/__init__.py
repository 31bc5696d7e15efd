"""From Marc's integration points to nodes: quantities, layers, shares of a node."""
