"""The tasks of a turtle, a file each. The task server offers every task in this folder."""
