"""All runs of a scenario, and what is found in them."""
