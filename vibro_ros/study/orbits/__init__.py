"""Study `orbits`: branches of periodic orbits over a parameter, and where they change their nature."""
