"""The ``.frd``, block by block; `fembridge.results.frd` reads traces through it."""
