"""Kills programs of the robot while it walks and starts them again. The walk continues.

Central restarts on the same journal, with all its state. The work of a lost module has failed with
"module lost".
"""

import threading
import time
from collections.abc import Callable

from robots.ambler_sim.messages import FAULT_BEGAN
from robots.ambler_sim.modules.fault_injector import CENTRAL
from robots.ambler_sim.modules.planners import PLANNERS
from robots.ambler_sim.vocabulary import Fault
from tca_module import Client, Task, connect
from tca_tools.supervise.programs import START_TIME, Programs

PATIENCE = 4.0
"""The seconds that the other programs get to come to rest before a program is killed. A stopped
planner is killed after the same time if no query comes.
"""

_POLL_PERIOD = 0.02  # seconds


class ProgramKiller:
    """Kills programs, one after the other, while a move is held and all other work is done.

    So the lost work does not depend on timing. A planner is stopped at once, and killed when it has
    its next query.
    """

    def __init__(self, programs: Programs, address: str) -> None:
        self._programs = programs
        self._address = address
        self._killer: threading.Thread | None = None

    def close(self) -> None:
        """Wait until all lost programs are back."""
        if self._killer is not None:
            self._killer.join()

    def kill(self, task: Task, name: str) -> None:
        """Kill a program, and return when it is back. A planner is stopped, and killed later."""
        self.close()
        _wait(lambda: is_at_rest(task), PATIENCE)
        if name in PLANNERS:
            self._programs.halt(name)
            self._killer = threading.Thread(target=self._kill_when_asked, args=(name,))
            self._killer.start()
            return
        process = self._programs.kill_and_restart(name)
        # A restarted central is back as soon as it answers.
        _wait(lambda: is_connected(task, process) or name == CENTRAL, START_TIME)
        task.broadcast(FAULT_BEGAN, Fault("lost central" if name == CENTRAL else "lost module"))

    def _kill_when_asked(self, planner: str) -> None:
        try:
            with connect("losses", self._address) as client:
                _wait(lambda: planner in busy(client), PATIENCE)
        finally:  # even if central does not answer, or the planner would stay stopped
            process = self._programs.kill_and_restart(planner)
        with connect("losses", self._address) as client:
            client.broadcast(FAULT_BEGAN, Fault("lost module"))
            _wait(lambda: is_connected(client, process), START_TIME)


def is_at_rest(task: Task) -> bool:
    """Return whether only the modules that cause the loss have work."""
    return not busy(task) - {"task manager", "fault injector"}


def busy(sender: Task | Client) -> set[str]:
    """Return the modules with a delivery from central that they have not finished."""
    return {
        module.name
        for module in sender.modules()
        if any(resource.handling for resource in module.resources)
    }


def is_connected(sender: Task | Client, process: int) -> bool:
    """Return whether a module of this process is connected to central."""
    return any(module.process.endswith(f":{process}") for module in sender.modules())


def _wait(condition: Callable[[], bool], seconds: float) -> None:
    deadline = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline:
        time.sleep(_POLL_PERIOD)
