"""The controller executable: scripts, feedback, and goals of other programs.

In comes a script, a YAML file, or with `--serve` a goal by an action; out go the commands `motor_speed`, `upper_gap`
and `inclined_gap` to one robot. `controller.py` reads first: it checks everything, then plays. `script.py` unfolds the
file to segments in time; a speed over ground becomes commands by the map of `configuration/command_choice.py`.
`player.py` waits for a robot, keeps time, wall time or /clock, and sends what changes; on an abort the motor stops.
`commanded_robot.py` asks the robot for its limits, so that what it would refuse is refused before, and finds out if
there are two. A speed to hold or a position to reach is tracked by the laws of `feedback.py` over `odom`; `goals.py`
offers the same as actions. `map_adviser.py` warns where commands have several motions.
"""
