"""The task tree of a run, as it was at any moment: as text and as a picture."""
