"""Coordination of a robot's activities by a state machine that looks ahead."""
