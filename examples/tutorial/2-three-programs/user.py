"""Ask the robot to water the fern."""

from tca_module import connect

from messages import WATER, Plant

with connect("user") as user:
    watering = user.goal(WATER, Plant("fern", "kitchen", 0.5))
    print("sent:", watering)
    watering.result()
    print("the fern is watered")
