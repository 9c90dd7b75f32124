"""Programs of the robot are killed while it walks, and started again: the walk goes on.

Central comes back on the same journal, and knows all that it knew. What a module had in hand has
failed with "module lost".
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
"""Seconds that all are given to come to rest, and then a planner to be asked, before a program is
killed.
"""

_LOOK_AGAIN = 0.02  # seconds


class ProgramKiller:
    """Kills programs, one after the other, while a move is held and all that could be done beside
    it is done: so what is lost does not depend on what was faster. A planner that is asked is then
    made to stand still, and killed with the next question in hand.
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
        """Kill a program, and return when it is back; or stop a planner, which is killed soon
        after.
        """
        self.close()
        _wait(lambda: is_quiet(task), PATIENCE)
        if name in PLANNERS:
            self._programs.halt(name)
            self._killer = threading.Thread(target=self._kill_when_asked, args=(name,))
            self._killer.start()
            return
        process = self._programs.kill_and_restart(name)
        _wait(
            lambda: is_there(task, process) or name == CENTRAL, START_TIME
        )  # central, once it answers
        task.broadcast(FAULT_BEGAN, Fault("lost central" if name == CENTRAL else "lost module"))

    def _kill_when_asked(self, planner: str) -> None:
        try:
            with connect("losses", self._address) as client:
                _wait(lambda: planner in busy(client), PATIENCE)
        finally:  # also where central does not answer: else it would stand still for ever
            process = self._programs.kill_and_restart(planner)
        with connect("losses", self._address) as client:
            client.broadcast(FAULT_BEGAN, Fault("lost module"))
            _wait(lambda: is_there(client, process), START_TIME)


def is_quiet(task: Task) -> bool:
    """Whether nobody does anything but those who see to the loss."""
    return not busy(task) - {"task manager", "fault injector"}


def busy(sender: Task | Client) -> set[str]:
    """The modules to which central has given something that they have not done yet."""
    return {
        one.name for one in sender.modules() if any(resource.handling for resource in one.resources)
    }


def is_there(sender: Task | Client, process: int) -> bool:
    """Whether central knows a module of this process."""
    return any(one.process.endswith(f":{process}") for one in sender.modules())


def _wait(condition: Callable[[], bool], seconds: float) -> None:
    deadline = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline:
        time.sleep(_LOOK_AGAIN)
