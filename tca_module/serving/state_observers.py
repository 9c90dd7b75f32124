"""Functions of a module that one of its threads calls with changes of tasks' states, whoever sends and handles them."""

from collections.abc import Callable, Collection
from typing import Any, TypeVar

from tca_module.checks import check_function
from tca_module.following.mirror import ChangeCallback
from tca_module.following.observation import Observation
from tca_module.link.connection import Connection
from tca_module.sending.sender import Sender
from tca_module.sending.task_ref import Change, change_of
from tca_module.sending.watching import checked_states
from tca_wire.messages.declarations import Message
from tca_wire.packets.changes import Observe

ObservingFunction = Callable[[Sender, Change], object] | Callable[[Change], object]
O = TypeVar("O", bound=ObservingFunction)  # noqa: E741 - as F and D


def state_observer(
    message: Message[Any, Any] | None, states: Collection[str], function: ObservingFunction
) -> Callable[[Connection], None]:
    """A function that has the thread of a connection call *function* from then on. It raises what ``declare`` does."""
    check_function("observes()", function, "(sender, change) or (change)", (2, 1))
    wanted = checked_states("observes()", message, states)
    header = Observe(0, message=message.name if message is not None else "", states=wanted)

    def begin(connection: Connection) -> None:
        if message is not None:
            connection.declare(message)
        what = f"observing '{message.name}'" if message is not None else "observing all tasks"
        observation = Observation(connection, header, what)
        callback = ChangeCallback("observes()", connection, function, lambda news: change_of(connection, news))
        observation.call(callback.put)

    return begin
