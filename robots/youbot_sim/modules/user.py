"""Gives objects."""

from robots.youbot_sim.coordination import make_coordinator
from robots.youbot_sim.user import make_module

user = make_module(make_coordinator())

if __name__ == "__main__":
    user.run()
