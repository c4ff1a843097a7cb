"""What only this repository's Makefile calls: benchmark, demo, lint, pictures and generated tables."""
