"""Comparison of published results on other machines with the model."""
