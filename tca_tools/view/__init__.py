"""A run in the browser: its task tree and its Gantt chart at any moment, live and afterwards the
same.
"""
