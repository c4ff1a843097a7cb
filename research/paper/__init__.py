"""Study `paper`: every figure and claim of the paper under each reading that its text leaves open."""
