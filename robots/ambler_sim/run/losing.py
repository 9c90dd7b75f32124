"""Programs of the robot are killed while it walks, and started again: the walk goes on.

Central comes back on the same journal, and knows all that it knew. What a module had in hand has failed with "module
lost".
"""

import time

from robots.processes import Processes
from tca_module import Task

CENTRAL = "central"
_LOOK_AGAIN = 0.02  # seconds


def lose(processes: Processes, task: Task, name: str) -> None:
    """Kill a program with SIGKILL, and start it again. Returns when it is back."""
    process = processes.kill_and_restart(name)
    while not any(name == CENTRAL or one.process.endswith(f":{process}") for one in task.modules()):
        time.sleep(_LOOK_AGAIN)
