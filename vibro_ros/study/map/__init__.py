"""The command map: which motions a machine has at each motor speed and gap, and the file that `controller` reads."""
