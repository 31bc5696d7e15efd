"""Quadrilaterals: what a mesh must be, and gmsh that makes one of a section."""
