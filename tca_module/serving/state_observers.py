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


class StateObserver:
    """A function, and the tasks whose changes it is called with."""

    def __init__(self, message: Message[Any, Any] | None, states: Collection[str], function: ObservingFunction) -> None:
        check_function("observes()", function, "(sender, change) or (change)", (2, 1))
        self._message = message
        self._states = checked_states("observes()", message, states)
        self._function = function

    def begin(self, connection: Connection) -> None:
        """The thread of that connection calls it from now on. Raises what ``declare`` does."""
        name = ""
        if self._message is not None:
            connection.declare(self._message)
            name = self._message.name
        what = f"observing '{name}'" if name else "observing all tasks"
        observation = Observation(connection, Observe(0, message=name, states=self._states), what)
        callback = ChangeCallback("observes()", connection, self._function, lambda news: change_of(connection, news))
        observation.on_news = callback.put
        observation.hold()
