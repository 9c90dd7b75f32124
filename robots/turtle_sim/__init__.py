"""A turtle that draws, its tasks, and missions for one turtle and for three."""
