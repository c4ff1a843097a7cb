"""Base of every ROS node of this package: start, spin, parameters, arguments, refusals.

In come a command line and the requests of peers; out comes a node that keeps running, whatever they send. Read
`process.py` first: a node from `rclpy.init` to a clean shutdown. `node.py` has the guarded node, whose services answer
even when a callback fails, the subscription that is polled, and the quality of service of topics. `parameters.py`
declares ROS parameters from the package's tables, and `robot_parameters.py` asks a robot for its own. `arguments.py`
finds mistakes in a command line that ROS would ignore, and `refusals.py` counts and logs what is refused, without
flooding the log.
"""
