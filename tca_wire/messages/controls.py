"""Declarations of exception handlers and monitors, which control other tasks.

::

    TERRAIN_COLLISION = Failure("terrain collision", Contact)
    HIGHER_SWING = ExceptionHandler("higher swing", Contact)
    BATTERY = PollingMonitor("battery", condition=IS_LOW, action=GO_HOME)
"""

from collections.abc import Sequence
from typing import Any, TypedDict, Unpack, overload

import msgspec

from tca_wire.errors import BadFormat
from tca_wire.messages.declarations import Broadcast, Command, D, Goal, Inform, Message, Query
from tca_wire.messages.fitting import alternatives, first_misfit
from tca_wire.messages.formats import NIL, NO_DATA
from tca_wire.messages.schemas import schema_text
from tca_wire.packets.parts import MessageFormat
from tca_wire.vocabulary import MessageClass

Action = Goal[Any] | Command[Any, Any] | Inform[Any] | Broadcast[Any]
"""The messages that a monitor may send."""


class ExceptionHandler(Message[D, None]):
    """A task that decides what becomes of a failed task. It gets the failure's data, or no data.

    Args:
        name: the message's name.
        data: the type of the failure's data (None: the handler needs no data).

    Raises:
        BadFormat: the name or type is not usable.

    Example::

        HIGHER_SWING = ExceptionHandler("higher swing", Contact)

        @expert.handles(HIGHER_SWING)
        def swing_higher(task: Task, contact: Contact) -> None:
            task.trouble.failing.retry()
    """

    message_class = MessageClass.EXCEPTION

    @overload
    def __init__(self: "ExceptionHandler[None]", name: str) -> None: ...
    @overload
    def __init__(self, name: str, data: type[D]) -> None: ...
    @overload
    def __init__(self, name: str, data: Any) -> None: ...
    def __init__(self, name: str, data: Any = None) -> None:
        super().__init__(name, data)

    def decode_data(self, data: bytes) -> D:
        """Return the failure's data; None if the handler is declared without data."""
        nothing: Any = None
        return nothing if self.data.kind is type(None) else super().decode_data(data or NIL)


class Monitor(Message[D, None]):
    """A task that watches, carried out by central. Use one of the subclasses."""

    def __init__(self, name: str, data: Any, parts: "list[Message[Any, Any] | None]") -> None:
        super().__init__(name, data)
        self.parts = parts

    @property
    def format(self) -> MessageFormat:
        """The monitor's format, as registered with central."""
        names = [part.name if part is not None else "" for part in self.parts]
        return msgspec.structs.replace(super().format, parts=names)

    @property
    def needs(self) -> Sequence[Message[Any, Any]]:
        """The messages that must be declared before this one: its parts."""
        return [part for part in self.parts if part is not None]

    def _check_class(self, part_name: str, message: Any, kinds: tuple[type, ...]) -> None:
        if not isinstance(message, kinds):
            wanted = " or ".join(kind.__name__ for kind in kinds if kind is not type(None))
            raise BadFormat(
                f"the {part_name} of {self.title} must be a {wanted}, not {message!r:.60}"
            )

    def _check_data(
        self, part_name: str, message: "Message[Any, Any] | None", data: str, source: str
    ) -> None:
        """Raise BadFormat for a part that does not fit the data that it will get."""
        if message is None or message.data.schema == NO_DATA:
            return
        if misfit := first_misfit(data, message.data.schema):
            raise BadFormat(
                f"the {part_name} '{message.name}' of {self.title} wants data of type"
                f" {message.data}, but gets {source}:"
                f" declare both with the same type, or it without data ({misfit})"
            )

    def _check_own_data(self, part_name: str, message: "Message[Any, Any] | None") -> None:
        """Raise BadFormat for a part that does not fit the monitor's own data."""
        self._check_data(part_name, message, self.data.schema, f"the monitor's own, {self.data}")


_ACTION_TYPES = (Goal, Command, Inform, Broadcast, type(None))
_NULL, _BOOLEAN = (one for kind in (None, bool) for one in alternatives(schema_text(kind)))


class ConditionMonitor(Monitor[D]):
    """A monitor that asks a query. Use one of the subclasses.

    The condition does not hold if the reply is None or False. If the reply is True, the action gets
    the monitor's own data. Any other reply is itself the data of the action. A condition or action
    that is declared without data gets none.

    Args:
        name: the message's name.
        data: the type of the monitor's data, which the condition gets (None: no data).
        condition: the query to ask.
        action: the message to send when the condition holds (None: nothing).

    Raises:
        BadFormat: the condition or action does not fit the data that it would get.
    """

    @overload
    def __init__(
        self, name: str, data: Any = None, *, condition: Query[D, Any], action: Action | None = None
    ) -> None: ...
    @overload
    def __init__(
        self, name: str, data: type[D], *, condition: Query[None, Any], action: Action | None = None
    ) -> None: ...
    def __init__(
        self,
        name: str,
        data: Any = None,
        *,
        condition: Query[Any, Any],
        action: Action | None = None,
    ) -> None:
        super().__init__(name, data, [condition, action])
        self._check_class("condition", condition, (Query,))
        self._check_class("action", action, _ACTION_TYPES)
        self._check_own_data("condition", condition)
        source = f"the reply of '{condition.name}', {condition.reply}"
        replies = [
            one for one in alternatives(condition.reply.schema) if one not in (_NULL, _BOOLEAN)
        ]
        for reply in replies:
            self._check_data("action", action, reply, source)
        if not replies:
            self._check_own_data("action", action)


class PointMonitor(ConditionMonitor[D]):
    """A monitor that tests its condition once, in its turn (TCA 8.5: RegisterPointMonitor)."""

    message_class = MessageClass.POINT_MONITOR


class PollingMonitor(ConditionMonitor[D]):
    """A monitor that tests its condition every period (TCA 8.5: RegisterPollingMonitor)."""

    message_class = MessageClass.POLLING_MONITOR


class _DemonMessages(TypedDict, total=False):
    """The messages that a demon monitor sends."""

    set_up: Action | None
    action: Action | None
    cancel: Action | None


class DemonMonitor(Monitor[D]):
    """A monitor that modules fire (TCA 8.5: RegisterDemonMonitor).

    Args:
        name: the message's name.
        data: the type of the monitor's data (None: no data).
        set_up: the message to send at the start, with the monitor's data.
        action: the message to send when a module fires the monitor, with data from that module.
        cancel: the message to send at the end, with the monitor's data.

    Raises:
        BadFormat: the set-up or cancel message has data of another type.

    Example::

        CUPS = DemonMonitor("cups", set_up=WATCH, action=FETCH)
        user.monitor(CUPS)                # sends WATCH
        task.monitor_ref.fire(FETCH, cup) # in the handler of WATCH: sends FETCH
    """

    message_class = MessageClass.DEMON_MONITOR

    @overload
    def __init__(self: "DemonMonitor[None]", name: str, **sent: Unpack[_DemonMessages]) -> None: ...
    @overload
    def __init__(self, name: str, data: type[D], **sent: Unpack[_DemonMessages]) -> None: ...
    @overload
    def __init__(self, name: str, data: Any, **sent: Unpack[_DemonMessages]) -> None: ...
    def __init__(
        self,
        name: str,
        data: Any = None,
        *,
        set_up: Action | None = None,
        action: Action | None = None,
        cancel: Action | None = None,
    ) -> None:
        super().__init__(name, data, [set_up, action, cancel])
        self.action = action
        for part_name, part in (("set-up", set_up), ("action", action), ("cancel message", cancel)):
            self._check_class(part_name, part, _ACTION_TYPES)
        for part_name, part in (("set-up", set_up), ("cancel message", cancel)):
            self._check_own_data(part_name, part)
