"""What every ROS node of this package stands on: start, spin, parameters, arguments, refusals."""
