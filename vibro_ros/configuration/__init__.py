"""Scenes, parameters and command maps as files, and where the shipped ones are.

In come files that a user or another program has written; out come a `Scene`, checked parameters or a `CommandMap`, or
one line that names the file, the place and the remedy. `scene_file.py` reads first: `load_scene` follows a scene to
the one that it changes, and `DEVICE_PARAMETERS` is the table of the node's own parameters. A scene is an ordinary ROS
parameter file, whose sections `parameter_file.py` merges for a node exactly as rcl does; the YAML below is read by
`strict_yaml.py`, within limits and without surprises. `command_map.py` is the file that `study map` writes, which
motions a machine has at which commands, and `command_choice.py` finds the commands for a mean speed in it. Nothing
here runs a simulation, and nothing knows ROS.
"""
