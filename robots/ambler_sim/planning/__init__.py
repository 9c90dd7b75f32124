"""Plans of foot and body moves, from the robot's beliefs. Pure: no messages, no simulator."""
