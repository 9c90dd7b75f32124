"""The order in which the three turtles must reach their checkpoints, with any network link."""

IN_TURN = [
    ("turtle1", (1.0, 1.0)),
    ("turtle2", (9.0, 1.0)),
    ("turtle3", (1.0, 9.0)),
    ("turtle1", (5.0, 5.0)),
    ("turtle2", (9.0, 9.0)),
    ("turtle3", (1.0, 1.0)),
]

EXPECTED = [(event, turtle, goal) for turtle, goal in IN_TURN for event in ("left for", "came to")]
"""The expected order. Each turtle waits for its predecessor: none leaves before the one before it
has arrived.
"""
