"""The controller executable: scripts, feedback, and a bag's commands played again."""
