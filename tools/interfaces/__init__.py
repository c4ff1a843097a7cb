"""Build of the Python types of interface packages that PyPI lacks, from their packages, with colcon."""
