"""A program a module; `benchmark.contract` says what a module has."""
