"""``tca run``: start a robot's programs, and restart them when they crash."""
