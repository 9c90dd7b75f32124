"""The programs of the robot: each is a process, and none knows another."""
