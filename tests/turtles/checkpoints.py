"""In which order the three turtles must come to their checkpoints, whatever the link does."""

IN_TURN = [
    ("turtle1", (1.0, 1.0)),
    ("turtle2", (9.0, 1.0)),
    ("turtle3", (1.0, 9.0)),
    ("turtle1", (5.0, 5.0)),
    ("turtle2", (9.0, 9.0)),
    ("turtle3", (1.0, 1.0)),
]

EXPECTED = [(event, turtle, goal) for turtle, goal in IN_TURN for event in ("left for", "came to")]
"""The missions make each wait for the one before: no turtle leaves before the last one has come."""
