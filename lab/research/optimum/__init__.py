"""Report on the optimum: the searches of docs/optimum.md."""
