"""Sweeps: points of parameters, run on one machine or many, in files that can be continued."""
