"""The robot executable: steps the device in real time, serves requests, records.

In come commands and requests over DDS; out go samples, to topics and to a bag, in real time. Read `robot.py` first: it
reads parameters, prepares the device and runs the main loop until a signal comes. `run.py` has the device behind one
lock: its own thread takes commands (`subscriptions.py`), ticks, and publishes each sample, while services act at once;
`recording.py` passes the same bytes to the bag, and begins and seals bags. `pacing.py` computes when a tick is due and
reports stalls. `services.py` has the robot's own services, `simulation_services.py` those of simulation_interfaces.
`diagnostics.py` reports on all this once a second, and `lock_step.py` lets each sample wait for the nodes that follow
the robot.
"""
