"""Which robot made a recording: its parameters with intervals, whether the model fits, and what to record next.

In comes a bag and a scene with free parameters; out come values, intervals and a scene that moves as the recording
does. Read `recording` first: it takes the measured channels, their noise and the commands out of a bag. The room is a
client of `Simulator`, whose map from parameters to motion is exact through every blow. Only `study` and the executable
`twin` import this room.
"""
