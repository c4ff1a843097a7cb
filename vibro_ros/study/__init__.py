"""What the machine can do: the paper's claims, sweeps, the optimum, results from the literature."""
