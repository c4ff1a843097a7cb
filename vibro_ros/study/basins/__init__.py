"""Basins: which start leads to which motion, and how much of the starts each motion has."""
