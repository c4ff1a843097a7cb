"""Periodic orbits of the turn map, their multipliers, and branches of them as a parameter changes."""
