"""What a device measures of itself, with seeded noise, delays and dropouts.

A scene comes in whose `sensors.*.rate` are above 0; measurements with their instants go out. Begin with `device`:
`SensedSimulator` is a `Simulator` that stops at each instant at which a sensor is due, and each sensor (`Imu`,
`Encoder`, `Current`, `Tracking`) says what it makes of the device there and when that comes out. `noise` has the
errors: data of real parts, clipping, bias and quantisation, and random numbers that follow from the seed, the stream's
name and the sample's number alone. So the motion is that of a `Simulator` to the last bit, and the measurements are the
same however time is cut up and in every replay. `new_device` chooses between the two.
"""
