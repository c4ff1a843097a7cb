"""The ROS 2 shell around the device: the only package that imports rclpy.

In come commands, requests and parameters from ROS peers and from pages in the browser; out go the robot's messages,
bags, answers and the live page. `node` is the base of all nodes. `robot` is the robot executable: read it first, from
`robot/robot.py` and `robot/run.py` on. `controller` is the executable that commands a robot by a script or by goals,
and `live` shows a live robot in the browser. What a message means is defined in the room `messages`.
"""
