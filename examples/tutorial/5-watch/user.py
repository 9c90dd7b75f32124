"""Ask the robot for one round after the other, until Ctrl-C."""

from contextlib import suppress
from itertools import count

from tca_module import connect

from messages import ROUND, Plant

PLANTS = [
    Plant("fern", "kitchen", 0.5),
    Plant("palm", "study", 0.8),
    Plant("rose", "bedroom", 0.3),
]

with suppress(KeyboardInterrupt), connect("user", patience=60) as user:
    for number in count(1):
        print("round", number, "is", user.goal(ROUND, PLANTS).wait())
