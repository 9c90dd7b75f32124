"""Messages as a robot's vocabulary declares them: a name, a class and the types of data and reply.

Declared once, in the robot's own ``messages.py``::

    TAKE_STEPS = Goal("take steps", Arc)
    MOVE_LEG = Command("move leg", LegMove, result=Footfall)
    NEXT_STANCE = Query("next stance", Pose, reply=Stance)
"""

import warnings
from collections.abc import Sequence
from typing import Any, Generic, TypedDict, Unpack, overload

import msgspec

from tca_wire.errors import BadData, BadFormat, CopyableError
from tca_wire.life_cycles import GENERAL, LifeCycle
from tca_wire.messages.failures import misspelt
from tca_wire.messages.fitting import first_misfit
from tca_wire.messages.formats import Format
from tca_wire.messages.large_data import inline
from tca_wire.messages.message import D, Declaring, Message, R, checked_name, format_of
from tca_wire.packets.parts import MessageFormat, RetryPolicy
from tca_wire.vocabulary import LONGEST_TIME, Limit, MessageClass

__all__ = (
    "Broadcast",
    "Command",
    "D",
    "Failure",
    "FailureRaised",
    "Goal",
    "Inform",
    "Message",
    "MultiQuery",
    "Query",
    "R",
    "Retry",
    "TaskMessage",
    "Variable",
)


class Inform(Message[D, None]):
    """A one-way message to one handler, delivered in order and at most once.

    Args:
        name: the message's name.
        data: the type of its data (None: no data).
        journal: also keep data of 64 KiB and more on the disk, for the tools. Default: False.

    Raises:
        BadFormat: the name or type is not usable.

    Example::

        POSE = Inform("pose", Pose)
        module.inform(POSE, Pose(0.0, 1.0))
    """

    message_class = MessageClass.INFORM

    @overload
    def __init__(self: "Inform[None]", name: str, *, journal: bool = False) -> None: ...
    @overload
    def __init__(self, name: str, data: type[D], *, journal: bool = False) -> None: ...
    @overload
    def __init__(self, name: str, data: Any, *, journal: bool = False) -> None: ...
    def __init__(self, name: str, data: Any = None, *, journal: bool = False) -> None:
        super().__init__(name, data, journal=journal)


class Broadcast(Message[D, None]):
    """A one-way message to every module that handles it.

    Args:
        name: the message's name.
        data: the type of its data (None: no data).
        journal: also keep data of 64 KiB and more on the disk, for the tools. Default: False.

    Raises:
        BadFormat: the name or type is not usable.
    """

    message_class = MessageClass.BROADCAST

    @overload
    def __init__(self: "Broadcast[None]", name: str, *, journal: bool = False) -> None: ...
    @overload
    def __init__(self, name: str, data: type[D], *, journal: bool = False) -> None: ...
    @overload
    def __init__(self, name: str, data: Any, *, journal: bool = False) -> None: ...
    def __init__(self, name: str, data: Any = None, *, journal: bool = False) -> None:
        super().__init__(name, data, journal=journal)


class Query(Message[D, R]):
    """A question with a reply. It is not part of the task tree, so held goals do not delay it.

    Args:
        name: the message's name.
        data: the type of its data (None: no data).
        reply: the type of the reply.
        journal: also keep data of 64 KiB and more on the disk, for the tools. Default: False.

    Raises:
        BadFormat: the name or a type is not usable.

    Example::

        HEIGHT = Query("height", Place, reply=float)
        height = module.query(HEIGHT, Place(1.0, 2.0))
    """

    message_class = MessageClass.QUERY

    @overload
    def __init__(
        self: "Query[None, R]", name: str, *, reply: type[R], journal: bool = False
    ) -> None: ...
    @overload
    def __init__(
        self, name: str, data: type[D], *, reply: type[R], journal: bool = False
    ) -> None: ...
    @overload
    def __init__(
        self, name: str, data: Any = None, *, reply: Any, journal: bool = False
    ) -> None: ...
    def __init__(self, name: str, data: Any = None, *, reply: Any, journal: bool = False) -> None:
        super().__init__(name, data, reply, journal=journal)


class MultiQuery(Message[D, R]):
    """A question to every module that handles it, with one reply from each.

    Args:
        name: the message's name.
        data: the type of its data (None: no data).
        reply: the type of each reply.
        journal: also keep data of 64 KiB and more on the disk, for the tools. Default: False.

    Raises:
        BadFormat: the name or a type is not usable.
    """

    message_class = MessageClass.MULTI_QUERY

    @overload
    def __init__(
        self: "MultiQuery[None, R]", name: str, *, reply: type[R], journal: bool = False
    ) -> None: ...
    @overload
    def __init__(
        self, name: str, data: type[D], *, reply: type[R], journal: bool = False
    ) -> None: ...
    @overload
    def __init__(
        self, name: str, data: Any = None, *, reply: Any, journal: bool = False
    ) -> None: ...
    def __init__(self, name: str, data: Any = None, *, reply: Any, journal: bool = False) -> None:
        super().__init__(name, data, reply, journal=journal)


class TaskMessage(Message[D, R]):
    """A task: goal or command.

    Its handler may report intermediate results of the type *progress*. *life_cycle* defines the
    states of the task, and *retry* the retries of all tasks of the message.
    """

    def __init__(
        self,
        name: str,
        data: Any,
        result: Any,
        progress: Any,
        life_cycle: LifeCycle,
        retry: "Retry | None",
        *,
        journal: bool,
    ) -> None:
        super().__init__(name, data, result, journal=journal)
        self.progress: Format[Any] = format_of(
            progress, f"the intermediate results of {self.title}"
        )
        if not isinstance(life_cycle, LifeCycle):
            raise BadFormat(
                f"the life cycle of {self.title} must be a LifeCycle, such as GENERAL,"
                f" not {life_cycle!r:.60}"
            )
        self.life_cycle = life_cycle
        if not isinstance(retry, Retry | None):
            text = f"retry= of {self.title} must be a Retry, such as Retry(3), not {retry!r:.60}"
            raise BadFormat(text)
        self.retry = retry
        self._policy = None if retry is None else retry.policy_for(self)

    @property
    def format(self) -> MessageFormat:
        """The task's format, as registered with central."""
        progress = "" if self.progress.kind is type(None) else self.progress.schema
        life_cycle = "" if self.life_cycle == GENERAL else self.life_cycle.text
        return msgspec.structs.replace(
            super().format, progress=progress, life_cycle=life_cycle, retry=self._policy
        )

    def encode_progress(self, data: Any) -> bytes:
        """Encode an intermediate result. Raises BadData, naming message and field."""
        try:
            return self.kept(self.progress.encode(data))
        except BadData as error:
            what = f"the intermediate results of {self.title}"
            raise BadData(f"{what} are {self.progress}: {error}") from None

    @property
    def needs(self) -> Sequence[Message[Any, Any]]:
        """The messages that must be declared before this one: its fallback."""
        return self.retry.needs if self.retry is not None else ()


class _TaskOptions(TypedDict, total=False):
    """The options of a task's declaration, beside its data and result."""

    progress: Any
    life_cycle: LifeCycle
    retry: "Retry | None"
    journal: bool


class Goal(TaskMessage[D, None]):
    """A task that expands into subtasks. It may be planned while its achievement is still held.

    Args:
        name: the message's name.
        data: the type of its data (None: no data).
        progress: the type of its intermediate results (None: it reports none).
        life_cycle: the states of the task, by default ``GENERAL``.
        retry: how its tasks are retried, unless their sender gives another ``Retry`` (None: not).
        journal: also keep data of 64 KiB and more on the disk, for the tools. Default: False.

    Raises:
        BadFormat: the name, a type or the life cycle is not usable.

    Example::

        FETCH = Goal("fetch", str)

        @robot.handles(FETCH)
        def fetch(task: Task, thing: str) -> None:
            task.command(DRIVE, "kitchen")
            task.command(GRASP, thing)
    """

    message_class = MessageClass.GOAL

    @overload
    def __init__(self: "Goal[None]", name: str, **more: Unpack[_TaskOptions]) -> None: ...
    @overload
    def __init__(self, name: str, data: type[D], **more: Unpack[_TaskOptions]) -> None: ...
    @overload
    def __init__(self, name: str, data: Any, **more: Unpack[_TaskOptions]) -> None: ...
    def __init__(
        self,
        name: str,
        data: Any = None,
        *,
        progress: Any = None,
        life_cycle: LifeCycle = GENERAL,
        retry: "Retry | None" = None,
        journal: bool = False,
    ) -> None:
        super().__init__(name, data, None, progress, life_cycle, retry, journal=journal)


class Command(TaskMessage[D, R]):
    """A task that acts: it is handled only when it may be achieved. It may return a result.

    Args:
        name: the message's name.
        data: the type of its data (None: no data).
        result: the type of its result (None: no result).
        progress: the type of its intermediate results (None: it reports none).
        life_cycle: the states of the task, by default ``GENERAL``.
        retry: how its tasks are retried, unless their sender gives another ``Retry`` (None: not).
        journal: also keep data of 64 KiB and more on the disk, for the tools. Default: False.

    Raises:
        BadFormat: the name, a type or the life cycle is not usable.

    Example::

        MOVE_LEG = Command("move leg", LegMove, result=Footfall)
        footfall = module.command(MOVE_LEG, move).result()
    """

    message_class = MessageClass.COMMAND

    @overload
    def __init__(self: "Command[None, None]", name: str, **more: Unpack[_TaskOptions]) -> None: ...
    @overload
    def __init__(
        self: "Command[D, None]", name: str, data: type[D], **more: Unpack[_TaskOptions]
    ) -> None: ...
    @overload
    def __init__(
        self: "Command[None, R]", name: str, *, result: type[R], **more: Unpack[_TaskOptions]
    ) -> None: ...
    @overload
    def __init__(
        self, name: str, data: type[D], *, result: type[R], **more: Unpack[_TaskOptions]
    ) -> None: ...
    @overload
    def __init__(
        self, name: str, data: Any = None, *, result: Any = None, **more: Unpack[_TaskOptions]
    ) -> None: ...
    def __init__(
        self,
        name: str,
        data: Any = None,
        *,
        result: Any = None,
        progress: Any = None,
        life_cycle: LifeCycle = GENERAL,
        retry: "Retry | None" = None,
        journal: bool = False,
    ) -> None:
        super().__init__(name, data, result, progress, life_cycle, retry, journal=journal)


class Variable(Message[D, None]):
    """A value that central keeps for all modules (TCA 7.7). The newest value wins.

    The value outlives the module that set it. A handler of a variable watches it: central calls the
    handler with the present value, then with each new one. Values that arrive while the handler
    runs are skipped, except the newest. After a reconnect the handler may get a value twice.

    Args:
        name: the variable's name.
        data: the type of its value.
        journal: also keep data of 64 KiB and more on the disk, for the tools. Default: False.

    Raises:
        BadFormat: the name or type is not usable.

    Example::

        MODE = Variable("mode", str)
        module.set_variable(MODE, "walking")
    """

    message_class = MessageClass.VARIABLE

    @overload
    def __init__(self, name: str, data: type[D], *, journal: bool = False) -> None: ...
    @overload
    def __init__(self, name: str, data: Any, *, journal: bool = False) -> None: ...
    def __init__(self, name: str, data: Any, *, journal: bool = False) -> None:
        super().__init__(name, data, journal=journal)


class Failure(Generic[D], metaclass=Declaring):
    """A failure that a handler may raise, by name and with data: ``raise COLLISION(contact)``.

    Args:
        name: the failure's name.
        data: the type of its data (None: no data).
        kind_of: a more general failure, whose exception handlers also handle this one.
            It must have no data, or data of a type that this failure's data fits.

    Raises:
        BadFormat: the name or type is not usable, or the data does not fit that of *kind_of*.

    Example::

        COLLISION = Failure("collision", Contact)
        ROCK = Failure("rock", Contact, kind_of=COLLISION)
    """

    @overload
    def __init__(
        self: "Failure[None]", name: str, *, kind_of: "Failure[Any] | None" = None
    ) -> None: ...
    @overload
    def __init__(
        self, name: str, data: type[D], *, kind_of: "Failure[Any] | None" = None
    ) -> None: ...
    @overload
    def __init__(self, name: str, data: Any, *, kind_of: "Failure[Any] | None" = None) -> None: ...
    def __init__(
        self, name: str, data: Any = None, *, kind_of: "Failure[Any] | None" = None
    ) -> None:
        self.name = checked_name(name)
        if meant := misspelt(name):
            advice = f"give the built-in {meant.upper().replace(' ', '_')}, or use another name"
            warnings.warn(f"failure '{name}' is nearly '{meant}': {advice}", stacklevel=3)
        self.data: Format[D] = format_of(data, f"the data of failure '{name}'")
        self._check_kind(kind_of)
        self.kinds: list[str] = [kind_of.name, *kind_of.kinds] if kind_of is not None else []

    def __repr__(self) -> str:
        return f"Failure({self.name!r}, {self.data})"

    def _check_kind(self, kind_of: Any) -> None:
        if kind_of is None:
            return
        if not isinstance(kind_of, Failure):
            msg = f"the kind_of of failure '{self.name}' must be a Failure, not {kind_of!r:.60}"
            raise BadFormat(msg)
        if kind_of.data.kind is type(None):
            return
        if misfit := first_misfit(self.data.schema, kind_of.data.schema):
            text = f"failure '{self.name}' has data of type {self.data}, but exception handlers of"
            advice = f"declare both with the same type, or '{kind_of.name}' without data ({misfit})"
            raise BadFormat(f"{text} '{kind_of.name}' get data of type {kind_of.data}: {advice}")

    @overload
    def __call__(self: "Failure[None]", data: None = None, text: str = "") -> "FailureRaised": ...
    @overload
    def __call__(self, data: D, text: str = "") -> "FailureRaised": ...
    def __call__(self, data: Any = None, text: str = "") -> "FailureRaised":
        """Return the Python exception to raise. Raises BadData for unsuitable *data* or *text*."""
        if not isinstance(text, str):
            msg = f"the text of failure '{self.name}' must be a str, not {text!r:.60}"
            raise BadData(msg)
        try:
            return FailureRaised(self.name, text, inline(self.data.encode(data)), self.kinds)
        except BadData as error:
            msg = f"failure '{self.name}' wants data of type {self.data}: {error}"
            raise BadData(msg) from None


class FailureRaised(CopyableError):
    """A failure on its way from a handler to its task."""

    def __init__(self, name: str, text: str, body: bytes, kinds: Sequence[str] = ()) -> None:
        super().__init__(f"{name}: {text}" if text else name)
        self.name, self.text, self.body, self.kinds = name, text, body, list(kinds)


class Retry(metaclass=Declaring):
    """How central retries a task that fails, without an exception handler of yours.

    The option ``retry=`` of a task, or of a ``Goal`` or ``Command``. Central retries the task even
    if its sender has ended. A failure below a goal counts as a failure of the goal: all below it is
    killed, and the goal is handled again. The failure "uncertain" is not retried unless *failures*
    names it, because the handler may have acted.

    Args:
        attempts: the most handlings of the task, with the first one: 1 to 1000. Default: 3.
        pause: seconds before the first retry. Default: 1.
        backoff: the factor, 1 or more, by which each further pause is longer. Default: 2.
        longest_pause: seconds, the bound of all pauses. Default: 60.
        attempt_timeout: seconds, above 0, from the start of each attempt. An attempt that takes
            longer fails with "timeout". Default: None, no bound.
        failures: the failures to deal with; others go to exception handlers. Default: all but
            "uncertain".
        otherwise: a goal or command that replaces the task after its last attempt, or a pair of
            such a message and its data. When it is achieved, the failure is resolved, and the task
            has its result if the types agree. Alone it gets the task's own data. Default: None,
            and the failure goes to exception handlers.

    Raises:
        BadFormat: an argument has the wrong type or range.

    Example::

        LIFT = Command("lift", float, retry=Retry(3, pause=0.5, failures=[SLIPPED]))
        user.command(LIFT, 0.2, retry=Retry(attempt_timeout=5, otherwise=CALL_HELP))
    """

    def __init__(
        self,
        attempts: int = 3,
        *,
        pause: float = 1.0,
        backoff: float = 2.0,
        longest_pause: float = 60.0,
        attempt_timeout: float | None = None,
        failures: Sequence[Failure[Any]] = (),
        otherwise: TaskMessage[Any, Any] | tuple[TaskMessage[Any, Any], Any] | None = None,
    ) -> None:
        _check_number("attempts", attempts, 1, Limit.ATTEMPTS, int)
        for name, value, least in (
            ("pause", pause, 0),
            ("backoff", backoff, 1),
            ("longest_pause", longest_pause, 0),
        ):
            _check_number(name, value, least, LONGEST_TIME)
        if attempt_timeout is not None:
            _check_number("attempt_timeout", attempt_timeout, 1e-3, LONGEST_TIME)
        is_list = isinstance(failures, list | tuple | set | frozenset)
        if not (is_list and all(isinstance(one, Failure) for one in failures)):
            text = "failures must be a list of declared failures, such as [SLIPPED]"
            raise BadFormat(f"Retry(): {text}, not {failures!r:.60}")
        is_pair = isinstance(otherwise, tuple) and len(otherwise) == 2
        first, *data = otherwise if is_pair else (otherwise,)  # type: ignore[misc]
        if not isinstance(first, TaskMessage if is_pair else TaskMessage | None):
            text = "otherwise must be a goal or command, such as CALL_HELP, or a pair"
            example = "of one and its data, such as (CALL_HELP, 2.0)"
            raise BadFormat(f"Retry(): {text} {example}, not {otherwise!r:.60}")
        self.fallback: TaskMessage[Any, Any] | None = first
        self._policy = RetryPolicy(
            attempts,
            pause,
            backoff,
            longest_pause,
            attempt_timeout or 0,
            [one.name for one in failures],
            self.fallback.name if self.fallback is not None else "",
            inline(self.fallback.encode_data(data[0])) if self.fallback and data else b"",
        )

    @classmethod
    def of_policy(cls, policy: RetryPolicy) -> "Retry":
        """Return a declared policy, whose fallback is declared already."""
        retry = cls()
        retry._policy = policy
        return retry

    @property
    def needs(self) -> Sequence[Message[Any, Any]]:
        """The messages that must be declared before the policy: its fallback."""
        return () if self.fallback is None else (self.fallback,)

    def policy_for(self, message: TaskMessage[Any, Any]) -> RetryPolicy:
        """Return the policy of a message's tasks. Raises BadFormat if the fallback misfits."""
        fallback = self.fallback
        if fallback is None or self._policy.data or fallback.data.kind is type(None):
            return self._policy
        if misfit := first_misfit(message.data.schema, fallback.data.schema):
            raise BadFormat(
                f"{fallback.title} wants data of type {fallback.data}, but {message.title}, which"
                f" it replaces, has {message.data}: give otherwise=({fallback.name}, data)"
                f" ({misfit})"
            )
        return self._policy


def _check_number(
    name: str, value: Any, least: float, most: float, kind: Any = int | float
) -> None:
    if not isinstance(value, kind) or isinstance(value, bool) or not least <= value <= most:
        what = "a whole number" if kind is int else "a number"
        raise BadFormat(f"Retry(): {name} must be {what} from {least:g} to {most:g}, not {value!r}")
