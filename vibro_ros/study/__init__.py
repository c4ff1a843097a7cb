"""What the machine can do: the paper's claims, sweeps, the optimum, and results from the literature."""
