"""Looks into box B."""

from robots.youbot_sim.perception import make_module

perception = make_module()

if __name__ == "__main__":
    perception.run()
