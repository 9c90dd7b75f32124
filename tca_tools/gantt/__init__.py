"""What every module did when: a Gantt chart of a run, as text and as a picture."""
