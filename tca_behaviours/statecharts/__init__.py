"""State machines: how they are written, what is refused, and two interpreters. Missions, coordination and activities
build on them.
"""
