"""From what the robot believes to where feet and body go. Pure: no messages, no simulator."""
