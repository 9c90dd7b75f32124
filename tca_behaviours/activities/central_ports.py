"""Ports and central's messages: how components talk to the other programs of a robot."""

from collections import deque
from typing import Any, TypeVar

from tca_behaviours.activities.components import InputPort, OutputPort
from tca_module import (
    Broadcast,
    Callback,
    CentralLost,
    Inform,
    MisuseError,
    Module,
    TcaError,
    Timeout,
    Variable,
)
from tca_module.log import log_of

_LOG = log_of("activities")
T = TypeVar("T")
_MOST_WAITING = 1000


def receive(
    module: Module, message: Inform[T] | Broadcast[T] | Variable[T], port: InputPort[T]
) -> None:
    """Let the data of a message arrive at an input port. *module* handles the message."""
    _check(message, port)

    @module.handles(message)
    def arrive(_: object, data: T) -> None:
        port.put(data)


def publish(
    module: Module,
    port: OutputPort[T],
    message: Inform[T] | Broadcast[T] | Variable[T],
    *,
    period: float = 0.05,
) -> None:
    """Send what is set at an output port. *module* sends it, once a period, so that no tick waits
    for central: all values; of a variable the newest. While it does not run, the newest thousand
    wait. While central is away, the newest of a variable waits, and informs and broadcasts are
    lost, which the module's log says.
    """
    _check(message, port)
    waiting: deque[T] = deque(maxlen=_MOST_WAITING)
    port.on_set(waiting.append)

    @module.every(period)
    def send(callback: Callback) -> None:
        while waiting:
            try:
                _send(callback, message, waiting[0], is_newest=len(waiting) == 1)
            except (CentralLost, Timeout):
                return  # it is sent when central is back
            except TcaError as error:
                _LOG.error("a value of port %r is not sent: %s", port, error)
            waiting.popleft()


def _send(callback: Callback, message: Any, value: Any, *, is_newest: bool) -> None:
    if isinstance(message, Broadcast):
        callback.broadcast(message, value)
    elif isinstance(message, Inform):
        callback.inform(message, value)
    elif is_newest:
        callback.set_variable(message, value)


def _check(message: Any, port: InputPort[Any] | OutputPort[Any]) -> None:
    if message.data.kind != port.type:
        raise MisuseError(
            f"{message.title} has data of type {message.data}, and port {port!r}: declare the same"
        )
