"""``tca run``: a robot's programs, kept running."""
