"""Ask the robot to water three plants."""

from tca_module import connect

from messages import ROUND, Plant

PLANTS = [
    Plant("fern", "kitchen", 0.5),
    Plant("palm", "study", 0.8),
    Plant("rose", "bedroom", 0.3),
]

with connect("user") as user:
    user.goal(ROUND, PLANTS).result()
    print("all plants are watered")
