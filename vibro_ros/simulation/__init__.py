"""The stateful device, one run, many runs, and what they return.

A scene and commands come in, samples and events go out. Begin with `simulator`: `Simulator` checks what it is asked and
hands it to `motion.Motion`, which holds the solver's state, lets it advance, and changes it at commands, at a given
state (`given_state`) and at pushes and faults (`disturbances`). `readout` makes the fields of `samples.Samples` of what
the solver samples. `runs` has `simulate`, one run from its start to its end, and `simulate_many`, which spreads runs
over `processes`. `kernels` and `preparation` compile or load the numerical kernels before a clock starts. `provenance`
says what a recording must name for its bits to be computed again, and `validity` what the model leaves out.
"""
