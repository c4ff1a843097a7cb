"""Build of the Python types of interface packages that PyPI lacks, from definitions, for the pinned ROS wheels."""
