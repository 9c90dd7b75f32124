"""The tasks of a turtle, a file each: the task server offers whatever stands here."""
