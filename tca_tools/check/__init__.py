"""``tca check``: check a journal against the rules of task-level control and own properties."""
