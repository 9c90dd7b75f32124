"""What the robot and its way look like."""
