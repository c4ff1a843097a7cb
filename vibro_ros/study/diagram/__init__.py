"""Orbit diagrams: the states once a turn over a parameter, swept up and down."""
