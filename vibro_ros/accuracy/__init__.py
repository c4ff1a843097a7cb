"""What accuracy costs: methods, references, errors, averages and the words and diagrams about them."""
