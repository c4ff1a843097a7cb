"""Python types of interface packages that PyPI lacks, built from their definitions beside the pinned ROS wheels."""
