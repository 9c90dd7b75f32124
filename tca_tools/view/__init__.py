"""``tca view``: a run in the browser, with its task tree and Gantt chart at any time."""
