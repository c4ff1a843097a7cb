"""Scenes and parameters as files, and where the shipped ones are.

In come files that a user or another program has written; out come a `Scene` or checked parameters, or an error of one
line that names the file, the place and the remedy. Read `scene_file.py` first: `load_scene` loads a scene and the scene
that it is based on, and `DEVICE_PARAMETERS` is the table of the node's own parameters. A scene is an ordinary ROS
parameter file, whose sections `parameter_file.py` merges for a node exactly as rcl does. The YAML is parsed by
`strict_yaml.py`, within limits and without duplicate keys. `scene_file.py:find_file` finds every file that comes with
the package. Nothing here runs a simulation, and nothing needs ROS.
"""
