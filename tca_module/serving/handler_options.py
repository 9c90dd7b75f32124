"""The options with which a message is handled, checked when its handler is declared."""

from collections.abc import Collection, Mapping
from typing import Annotated, Any, Literal, NamedTuple, TypedDict

from tca_module import checks
from tca_module.checks import check_options, quoted
from tca_module.errors import MisuseError
from tca_module.following.followed_task import life_cycle_of
from tca_wire.messages.controls import Monitor
from tca_wire.messages.declarations import Message, Variable
from tca_wire.packets.parts import HandlerFormat
from tca_wire.vocabulary import Busy, Party

WhenBusy = Literal["queue", "preempt", "reject"]


BUSY = checks.one_of("'queue', 'preempt' or 'reject'", Busy)
_TRANSITIONS = checks.collection_of(
    "a list of transitions, such as ['update', 'cancel']", checks.instance_of("a name", str)
)


class HandlerOptions(TypedDict, total=False):
    """The options of a handler. The last four are for handlers of tasks only.

    Args:
        resource: name of the resource that handles the message. Default: None, the module's own.
        pool: name of a pool. The modules of a pool share the messages: a free module gets the next
            message. Default: None, no pool.
        pending: number of messages that may wait for this handler. One more displaces the oldest
            message: an inform or broadcast is dropped, a query fails with "overload", a goal or
            command is killed. Default: None, no bound.
        accepts: the handler calls ``task.accept()`` itself. Default: False, a task counts as
            accepted when the handler starts.
        takes: requests of clients that the handler decides about, such as ["update", "cancel"].
            Default: none. An update then restarts the task with the new goal, and a cancel kills
            the task.
        refuses: requests of clients that are always refused. Default: none.
        when_busy: the fate of a task that would have to wait: "queue" (it waits), "preempt" (the
            other tasks are cancelled) or "reject". Default: None, the resource's *when_busy*.
    """

    resource: Annotated[str | None, checks.NAME_OR_NONE, None]
    pool: Annotated[str | None, checks.NAME_OR_NONE, None]
    pending: Annotated[int | None, checks.PENDING, None]
    accepts: Annotated[bool, checks.FLAG, False]
    takes: Annotated[Collection[str], _TRANSITIONS, ()]
    refuses: Annotated[Collection[str], _TRANSITIONS, ()]
    when_busy: Annotated[WhenBusy | None, BUSY.or_none(), None]


_OF_TASKS = ("accepts", "takes", "refuses", "when_busy")


class ResourcePlan(NamedTuple):
    """A resource as its module has declared it."""

    capacity: int = 1
    hung_after: float = 0.0
    """Seconds after which a hung handler is left behind; 0: never."""
    when_busy: WhenBusy = "queue"
    is_declared: bool = False
    """Whether ``resource()`` declared it. Other resources are only named in options."""


def checked_format(
    message: Message[Any, Any],
    options: HandlerOptions,
    own_resource: str,
    resources: Mapping[str, ResourcePlan],
) -> HandlerFormat:
    """Return a handler as it is declared to central.

    *own_resource*: the name of the module's own resource, the default. Raises MisuseError for
    options with which the message can't be handled.
    """
    checks.check("handles()", checks.MESSAGE, message=message)
    check_options(message.title, options, HandlerOptions)
    _check_class(message, options.get("pending"))
    _check_transitions(message, options)
    resource = options.get("resource") or own_resource
    when_busy: WhenBusy = "queue"
    if message.message_class.is_task:
        when_busy = resources.get(resource, ResourcePlan()).when_busy
    return HandlerFormat(
        message.name,
        resource,
        options.get("pool") or "",
        options.get("pending") or 0,
        options.get("accepts", False),
        sorted(options.get("takes", ())),
        sorted(options.get("refuses", ())),
        Busy(options.get("when_busy") or when_busy),
    )


def _check_class(message: Message[Any, Any], pending: int | None) -> None:
    what = message.title
    if isinstance(message, Monitor):
        why = "central carries it out; handle the messages that it sends"
        raise MisuseError(f"{what} can't be handled: {why}")
    if isinstance(message, Variable) and pending not in (None, 1):
        why = "only its newest value waits"
        raise MisuseError(f"{what} can't be handled with pending={pending}: {why}")


def _check_transitions(message: Message[Any, Any], options: HandlerOptions) -> None:
    given = [name for name in _OF_TASKS if options.get(name)]
    if given and not message.message_class.is_task:
        what = f"{message.title} can't be handled with {given[0]}="
        raise MisuseError(f"{what}: only tasks have states")
    cycle = life_cycle_of(message)
    names = cycle.names(Party.CLIENT)
    takes, refuses = set(options.get("takes", ())), set(options.get("refuses", ()))
    if unknown := sorted((takes | refuses) - set(names)):
        what = f"{message.title} has no client's transition '{unknown[0]}'"
        raise MisuseError(f"{what}: {cycle} has {quoted(names)}")
    if both := sorted(takes & refuses):
        what = f"{message.title} can't be handled with '{both[0]}' in both takes= and refuses="
        raise MisuseError(f"{what}: choose one")
