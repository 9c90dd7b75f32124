"""The lab of a seed: two rooms with a door between them, tables, a bin and a charger. Pure."""

import random

from robots.office_sim.vocabulary import Block, FloorPlan, Spot

WIDTH, DEPTH = 10.0, 7.0
WALL = 0.15
DOOR = (2.6, 4.0)
DOOR_AT = 6.3
"""The wall between the rooms: its thickness, the door's two ends in it, and its x (m)."""

TABLES = ((1.6, 2.2), (4.4, 1.6), (3.2, 4.7), (8.4, 5.2))
"""The approximate places of the tables' middles."""
SIZES = ((1.6, 0.8), (0.8, 1.4), (1.2, 0.8))
MOST_OFFSET = 0.3
"""How far (m) a table may be moved from its approximate place, in x and in y."""


def make_floor(rng: random.Random) -> FloorPlan:
    """Make a lab in which every free spot can be reached."""
    walls = [
        Block(DOOR_AT, 0.0, DOOR_AT + WALL, DOOR[0]),
        Block(DOOR_AT, DOOR[1], DOOR_AT + WALL, DEPTH),
    ]
    tables = []
    for x, y in TABLES:
        width, depth = rng.choice(SIZES)
        middle = (
            x + rng.uniform(-MOST_OFFSET, MOST_OFFSET),
            y + rng.uniform(-MOST_OFFSET, MOST_OFFSET),
        )
        left, bottom = middle[0] - width / 2, middle[1] - depth / 2
        tables.append(Block(left, bottom, left + width, bottom + depth))
    return FloorPlan(WIDTH, DEPTH, walls, tables, bin=Spot(0.5, 6.5), charger=Spot(9.5, 0.5))
