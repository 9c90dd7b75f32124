"""``tca check``: whether what a journal tells keeps the rules of task-level control, and the user's
own properties.
"""
