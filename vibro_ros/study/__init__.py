"""What a machine can do: sweeps, the optimum, branches of orbits, orbit diagrams, basins, command maps."""
