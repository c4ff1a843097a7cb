"""The live view of a robot in the browser: what it hears, and what it asks."""
