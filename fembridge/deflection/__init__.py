"""How far the skin around a thin probe goes down: the paper's first check, Fig. 2c."""
