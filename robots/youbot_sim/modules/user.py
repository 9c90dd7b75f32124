"""Gives objects."""

from robots.youbot_sim.delivery import make_delivery
from robots.youbot_sim.user import make_module
from tca_coordination import Coordinator

user = make_module(Coordinator(make_delivery()))

if __name__ == "__main__":
    user.run()
