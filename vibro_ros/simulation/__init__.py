"""The stateful device, one run, many runs, and their results.

A scene and commands come in, samples and events go out. Read `simulator` first: `Simulator` checks its arguments and
hands them to `motion.Motion`, which holds the solver's state, advances it, and changes it at commands (`actuators`), at
a given state (`given_state`), at a `checkpoint` and at pushes and faults (`disturbances`). `readout` computes the
fields of `samples.Samples` from the channels that the solver samples, and collects events. `runs` has `simulate`, one
run from its start to its end, and `simulate_many`, which distributes runs over the processes of `workers`. `provenance`
lists what a recording must store so that its run can be computed again bit for bit, and `validity` judges whether the
pitch and the motor's heat, which the model leaves out, matter.
"""
