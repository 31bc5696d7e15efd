"""What CalculiX prints beside the ``.frd``: ``.dat``, ``.sta`` and ``.cvg``."""
