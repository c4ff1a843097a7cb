"""What the machine can do: the paper's claims, sweeps, the optimum, published results, orbits, basins, command maps."""
