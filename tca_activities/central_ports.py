"""Ports and central's messages: how components talk to the other programs of a robot."""

from collections import deque
from typing import Any, TypeVar

from tca_activities.components import InputPort, OutputPort
from tca_module import Broadcast, Callback, Inform, MisuseError, Module, Variable

T = TypeVar("T")
_MOST_WAITING = 1000


def receive(module: Module, message: Inform[T] | Broadcast[T] | Variable[T], port: InputPort[T]) -> None:
    """Let the data of a message arrive at an input port. *module* handles the message."""
    _check(message, port)

    @module.handles(message)
    def arrive(_: object, data: T) -> None:
        port.put(data)


def publish(
    module: Module, port: OutputPort[T], message: Inform[T] | Broadcast[T] | Variable[T], *, period: float = 0.05
) -> None:
    """Send what is set at an output port. *module* sends it, once a period, so that no tick waits for central: all
    values; of a variable the newest. While it does not run, the newest thousand wait.
    """
    _check(message, port)
    waiting: deque[T] = deque(maxlen=1 if isinstance(message, Variable) else _MOST_WAITING)
    port.on_set(waiting.append)

    @module.every(period)
    def send(callback: Callback) -> None:
        while waiting:
            value = waiting.popleft()
            if isinstance(message, Variable):
                callback.set_variable(message, value)
            elif isinstance(message, Broadcast):
                callback.broadcast(message, value)
            else:
                callback.inform(message, value)


def _check(message: Any, port: InputPort[Any] | OutputPort[Any]) -> None:
    if message.data.kind is not port.type:
        raise MisuseError(f"{message.title} has data of type {message.data}, and port {port!r}: declare the same")
