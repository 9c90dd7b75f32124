"""A Cartesian robot that cleans a wall: two axes and a tool, each a joint with four regions."""

import robots.cartesian_sim.making  # noqa: F401 - whatever module is wanted, those that it needs are there
