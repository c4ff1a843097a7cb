"""Motions as the turn map has them: periodic orbits, their branches, where a start leads, exponents, chaos."""
