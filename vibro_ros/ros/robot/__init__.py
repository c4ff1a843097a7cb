"""The robot executable: steps the device in real time, serves requests, records.

In come commands and requests over DDS; out go samples, to topics and to a bag, in real time. `robot.py` comes first:
it reads parameters, prepares the device and runs the main loop until a signal comes. `run.py` has the device behind
one lock: a thread of its own takes commands (`subscriptions.py`) and ticks, services act at once; `publishers.py`
gives the bytes of each message to ROS and to the bag. `pacing.py` says when a tick is due, and why one came late;
`recording.py` begins and seals bags. `services.py` are the robot's own services, and `simulation_services.py` those of
simulation_interfaces. `diagnostics.py` tells of all this once a second, and `lock_step.py` lets each sample wait for
the nodes that follow the robot.
"""
