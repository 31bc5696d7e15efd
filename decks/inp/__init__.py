"""Keyword decks (``.inp``): what CalculiX and Abaqus have in common."""
