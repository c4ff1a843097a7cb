"""The controller executable: scripts and feedback.

In comes a script, a YAML file; out go the commands `motor_speed`, `upper_gap` and `inclined_gap` to one robot. Read
`controller.py` first: it checks everything, then plays. `script.py` unfolds the file into segments in time. `player.py`
waits for a robot, keeps time by the wall clock or /clock, and sends each change; on an abort the motor stops.
`commanded_robot.py` asks the robot for its limits, so that a script beyond them is refused before it starts, and
detects a second robot. The control laws of `feedback.py` hold a speed or reach a position with feedback from `odom`.
"""
