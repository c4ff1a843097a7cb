"""Published results of other machines, held against the model."""
