"""Tools that read the journals of runs: as a text log, a task tree and a Gantt chart. They never
open a socket.
"""
