"""``tca replay``: a run message by message in the terminal, at any speed, forwards and
backwards.
"""
