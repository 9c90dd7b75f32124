"""The report of a run: one HTML file that a user can send to a colleague."""
