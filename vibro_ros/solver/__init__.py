"""Event-driven integration of piecewise linear systems; knows nothing of robots."""
