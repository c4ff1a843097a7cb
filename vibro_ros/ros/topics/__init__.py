"""The robot's topics: messages out, commands in."""
