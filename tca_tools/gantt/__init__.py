"""The Gantt chart of a run, as text and as a picture: what each module did, and when."""
