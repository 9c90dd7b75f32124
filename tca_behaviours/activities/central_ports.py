"""Connects ports with central's messages. Through them, components talk to the robot's other
programs.
"""

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
_MAX_WAITING = 1000


def receive(
    module: Module, message: Inform[T] | Broadcast[T] | Variable[T], port: InputPort[T]
) -> None:
    """Connect a message with an input port, so that the message's data arrive at the port.

    Args:
        module: the module that handles the message.
        message: an inform, broadcast or variable.
        port: a port of the type of the message's data.

    Raises:
        MisuseError: the types differ.
    """
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
    """Connect an output port with a message, so that the port's values are sent.

    The module sends them once a period, so that no tick waits for central. For a variable it sends
    only the newest value. Up to 1000 values wait while the module does not run. While central is
    away, the newest value of a variable waits. Informs and broadcasts of that time are lost, and
    the module logs the loss.

    Args:
        module: the module that sends the message.
        port: a port of the type of the message's data.
        message: an inform, broadcast or variable.
        period: seconds between two sendings. Default: 0.05.

    Raises:
        MisuseError: the types differ.
    """
    _check(message, port)
    waiting: deque[T] = deque(maxlen=_MAX_WAITING)
    port.on_set(waiting.append)

    @module.every(period)
    def send(callback: Callback) -> None:
        while waiting:
            try:
                _send(callback, message, waiting[0], is_newest=len(waiting) == 1)
            except (CentralLost, Timeout):
                return  # send it when central is back
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
            f"{message.title} has data of type {message.data}, but port is {port!r}: use one type"
        )
