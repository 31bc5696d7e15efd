"""Abaqus: the dialect of Abaqus/Standard."""
