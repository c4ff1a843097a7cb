"""The stateful device, one run, many runs, and what they return."""
