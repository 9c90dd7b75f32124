"""Missions: plain Python that runs the tasks of servers."""
