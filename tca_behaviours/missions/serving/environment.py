"""The environment: what all tasks of a server share."""

import threading

from tca_module import Module


class Environment:
    """The base of environments: what a robot's tasks share, such as sensors, actuators and
    dimensions.

    *lock* is held in ``initialise``, ``iterate`` and ``terminate`` of periodic tasks. Tasks that
    run once hold it in ``initialise`` and ``terminate``; their ``iterate`` takes it where it needs
    it: ``with self.env.lock:``. While a task is in ``self.sleep()``, others may have it.
    """

    def __init__(self) -> None:
        self.lock = threading.RLock()

    def attach(self, module: Module) -> None:
        """Called once, with the server's module before it runs: to handle messages and to have
        functions called, by which sensors are read.
        """

    def close(self) -> None:
        """Called when the server has ended, after the last ``terminate``."""
