"""Programs that work on a recording: report, replay, recover, compare, vary.

In comes a bag; out go numbers, a picture, a verdict or another bag. Each executable has a module: `report`, `replay`,
`recover`. Read `rerun` first: `RecordedRun` has the parameters of the recorded run, and `Rerun` steps a device as the
robot did. `Rerun.through` simulates the run of a bag sample by sample, and passes to the device what the robot
received. Three modules loop over it: `comparison` compares every message to the last bit; `replay.what_if` writes what
a robot with other parameters would have done; `energy` computes energy accounts. `summary` and the pictures of `report`
need no simulation: they read the arrays of the bag. `recover` seals the bag of a killed robot; all other modules read
such a bag as it is.
"""
