"""Programs of the robot are killed while it walks, and started again: the walk goes on.

Central comes back on the same journal, and knows all that it knew. What a module had in hand has failed with "module
lost".
"""

import threading
import time
from collections.abc import Callable
from typing import Self

from robots.ambler_sim.messages import FAULT_BEGAN
from robots.ambler_sim.vocabulary import Fault
from robots.processes import Processes
from tca_module import Client, Task, connect

CENTRAL = "central"
PATIENCE = 4.0
"""Seconds that a program is given to come to rest, and then to get something in hand, before it is killed."""

START_TIME = 60.0
"""Seconds in which it must be back."""

_LOOK_AGAIN = 0.02  # seconds


class Losses:
    """Kills programs, one after the other. A module is made to stand still once it is at rest, and killed with the next
    message that it is given: so what is lost with it does not depend on what was faster.
    """

    def __init__(self, processes: Processes, address: str) -> None:
        self._processes = processes
        self._address = address
        self._killer: threading.Thread | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def end(self) -> None:
        """Wait until all lost programs are back."""
        if self._killer is not None:
            self._killer.join()

    def lose(self, task: Task, name: str) -> None:
        """Kill central, and return when it is back; or stop a module, which is killed soon after."""
        self.end()
        if name == CENTRAL:
            self._processes.kill_and_restart(name)
            task.modules()
            task.broadcast(FAULT_BEGAN, Fault("lost central"))
            return
        _wait(lambda: not has_something_in_hand(task, name))
        self._processes.halt(name)
        self._killer = threading.Thread(target=self._kill, args=(name,))
        self._killer.start()

    def _kill(self, name: str) -> None:
        with connect("losses", self._address) as client:
            _wait(lambda: has_something_in_hand(client, name))
            process = self._processes.kill_and_restart(name)
            _wait(lambda: any(one.process.endswith(f":{process}") for one in client.modules()), START_TIME)
            client.broadcast(FAULT_BEGAN, Fault("lost module"))


def has_something_in_hand(sender: Task | Client, name: str) -> bool:
    """Whether central has given the module something that it has not done yet."""
    return any(resource.handling for one in sender.modules() if one.name == name for resource in one.resources)


def _wait(condition: Callable[[], bool], seconds: float = PATIENCE) -> None:
    deadline = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline:
        time.sleep(_LOOK_AGAIN)
