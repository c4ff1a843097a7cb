"""What every ROS node of this package stands on: start, spin, parameters, arguments, refusals.

In come a process's words and the requests of peers; out comes a node that goes on, whatever they send. `process.py`
comes first: from `rclpy.init` to the clean end. `node.py` has the guarded node, whose services answer even where a
callback fails, and the subscription that is polled. `parameters.py` declares ROS parameters from the package's tables,
`arguments.py` reads what ROS would ignore of a command line, `qos.py` makes the quality of service of `TOPICS` and
checks `qos_overrides`, and `refusals.py` counts and says what cannot be taken, without flooding the log.
"""
