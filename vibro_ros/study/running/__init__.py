"""Many runs of a study: in pieces, on the processes of this machine or of a cluster, kept in blocks that resume."""
