"""The Gantt chart of a run, as text and as a picture: what every module did, and when."""
