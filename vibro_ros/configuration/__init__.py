"""Scenes, parameters and scripts as files: strict YAML, ROS parameter files, and where the shipped ones are."""
