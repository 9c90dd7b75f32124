"""Missions for one turtle, and for three that wait for each other."""
