"""State machines: how they are written, what is refused, and the interpreter that is
python-statemachine. Missions, coordination and activities build on them.
"""
