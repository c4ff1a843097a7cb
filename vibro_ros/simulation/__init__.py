"""The stateful device, one run, many runs, what they return, and how `auto` chooses a method."""
