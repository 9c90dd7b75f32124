"""The search through all runs of a scenario."""
