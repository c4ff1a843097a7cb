"""Offline tools and plots, started from the command line."""
