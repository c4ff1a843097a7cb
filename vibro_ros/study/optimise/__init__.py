"""Study `optimise`: the fastest robot, the thriftiest one, and the front between them."""
