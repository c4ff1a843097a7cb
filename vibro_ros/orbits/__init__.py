"""Periodic orbits of the turn map: where a motion repeats itself, and whether it comes back when disturbed."""
