"""What is done with a recording: report, replay, recover, compare, vary.

A bag comes in; numbers, a picture, a verdict or another bag goes out. Each executable has a module: `report`, `replay`,
`recover`. Begin with `rerun`: what a bag says of its run (`RecordedRun`), and the device stepped as the robot stepped
it (`Rerun`). `Rerun.through` goes through a bag sample by sample, and gives the device what the robot received.
Loops over it are: `comparison`, which compares every message to the last bit; `replay.what_if`, which writes what
another robot would have done; `energy`, which keeps accounts. `summary` and `plots` need no simulation: they read the
arrays of the bag. `recover` seals what a killed robot left; all the others read such a bag as it is.
"""
