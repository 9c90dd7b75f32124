"""``tca tree``: the task tree of a run at any moment, as text or as a picture."""
