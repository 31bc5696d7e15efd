"""Is the finite-element model to be trusted? Studies with bounds, and their page.

Each study is a module with a function ``study(bench) -> Finding``; `studies` lists
them. A bound that is not met is a failed check, never a changed bound.
"""
