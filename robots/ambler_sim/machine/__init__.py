"""The simulated machine: ground, mechanism, sensors, and the robot that moves them tick by tick."""
