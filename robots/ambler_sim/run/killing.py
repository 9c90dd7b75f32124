"""Programs of the robot are killed while it walks, and started again: the walk goes on.

Central comes back on the same journal, and knows all that it knew. What a module had in hand has failed with "module
lost"; the error recovery has it done again.
"""

import time
from collections.abc import Callable, Sequence
from random import Random

from robots.processes import Processes
from tca_module import Module

CENTRAL = "central"

_WITHIN = 1.0
"""Seconds after the step that a kill belongs to."""

_LAST = 1.0
"""Metres before the end of the walk."""

_LOOK_AGAIN = 0.05


def schedule(central: int, modules: Sequence[str]) -> list[str]:
    """Who is killed, in turn: central so many times, and each of the modules; evenly mixed."""
    kills = [((number + 0.5) / central, CENTRAL) for number in range(central)]
    kills += [((number + 0.5) / len(modules), name) for number, name in enumerate(modules)]
    return [name for _, name in sorted(kills)]


class Killings:
    """Kills programs, one after the other, at even distances along the walk."""

    def __init__(self, victims: Sequence[str], metres: float, seed: int) -> None:
        self.walked = 0.0  #: metres so far
        self._waiting = list(victims)
        self._every = max(0.0, metres - _LAST) / max(1, len(victims))
        self._done = 0
        self._random = Random(seed)  # noqa: S311

    def kill_next(self, processes: Processes, module: Module, tell: Callable[[str], None]) -> None:
        """If it is time, kill a program in the middle of whatever it does, and start it again. Returns when it is
        back.
        """
        if not self._waiting or self.walked < self._done * self._every:
            return
        time.sleep(self._random.random() * _WITHIN)
        name, self._done = self._waiting.pop(0), self._done + 1
        process, began = processes.kill_and_restart(name), time.monotonic()
        while not any(name == CENTRAL or one.process.endswith(f":{process}") for one in module.modules()):
            time.sleep(_LOOK_AGAIN)
        tell(f"{self.walked:.1f} m: {name} was killed, and is back after {time.monotonic() - began:.1f} s")
