"""Study `paper`: all figures and claims of the paper, under each reading that its text allows."""
