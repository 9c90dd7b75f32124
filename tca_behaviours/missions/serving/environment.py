"""The environment that all tasks of a server share."""

import threading

from tca_module import Module


class Environment:
    """The base of environments: what a robot's tasks share, such as sensors, actuators and
    dimensions.

    *lock* allows one task at a time. The server holds it during ``initialise``, ``iterate`` and
    ``terminate`` of a task. The ``iterate`` of a OnceTask is an exception. It takes the lock itself
    where necessary, with ``with self.env.lock:``. If the server holds the lock, ``self.sleep()``
    releases it, and takes it again before it returns.

    Example::

        class Cart(Environment):
            place = 0.0
    """

    def __init__(self) -> None:
        self.lock = threading.RLock()

    def attach(self, module: Module) -> None:
        """Prepare the server's module before it runs. Called once.

        Override it to handle messages, or to read sensors periodically.

        Args:
            module: the module of the server.
        """

    def close(self) -> None:
        """Release what the environment holds. Called when the server has ended, after the last
        ``terminate``.
        """
