"""Following tasks: the client's mirror of a task's state, its changes as they come, and what a
client may ask for.
"""
