"""Basins: which start leads to which motion, how much of the starts each motion has, and what upsets it."""
