"""``tca tree``: the task tree of a run at any time, as text or as a picture."""
