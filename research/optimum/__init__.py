"""The written optimum."""
