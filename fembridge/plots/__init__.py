"""Figures: one module a kind, drawn with Matplotlib's objects, without pyplot."""
