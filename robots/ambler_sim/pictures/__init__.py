"""Pictures of the robot and its way."""
