"""The sensors of the device: measurements with seeded noise, delays and dropouts.

A scene whose `sensors.*.rate` are above 0 comes in; measurements with their instants go out. Read `device` first:
`SensedSimulator` is a `Simulator` that stops at each instant at which a sensor is due, and each sensor (`Imu`,
`Encoder`, `Current`, `Tracking`) measures the device there and releases the measurement after its delay. `noise` has
the errors: data of real parts, clipping, bias and quantisation, and random numbers that depend only on the seed, the
stream's name and the sample's number. So the motion is that of a `Simulator` to the last bit, and the measurements do
not depend on how time is divided into calls, and are the same in every replay. `new_device` returns a
`SensedSimulator` if the scene has a sensor, else a `Simulator`.
"""
