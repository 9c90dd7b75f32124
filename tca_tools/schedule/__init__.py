"""Schedules of the agents of coordinators, with several runs one above the other."""
