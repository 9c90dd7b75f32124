"""State machines: how they are written and checked, and the python-statemachine interpreter.

Missions, coordination and activities build on them.
"""
