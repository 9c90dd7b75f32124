"""The scripts of a scenario: plain functions that send like a module's handlers do.

Theory of operation. A script is run anew from its start whenever it has got something back: the calls whose answers
are known return them, and the first one whose answer is not there ends the run (``_Pause``). So a script that is half
through is nothing but its data and what it got, which can be copied and compared; and functions need not be
generators. It must do the same each time: it may know nothing but its arguments, and keep nothing.
"""

import inspect
import traceback
from collections.abc import Callable, Iterable
from typing import Any, NoReturn, TypedDict, TypeVar, Unpack

import msgspec

from tca_explorer.errors import ExplorerError, QueryFailed, Refused, ScenarioError
from tca_explorer.steps import (
    OWN,
    AddConstraints,
    Branch,
    Fail,
    Got,
    Hang,
    History,
    KillTask,
    Return,
    Say,
    Step,
    WaitUntil,
    sent,
)
from tca_wire.constraints import Constraint, Flags
from tca_wire.controls import PointMonitor
from tca_wire.declarations import Broadcast, Command, FailureRaised, Goal, Inform, Message, MultiQuery, Query
from tca_wire.points import Moment, Point, TaskId
from tca_wire.vocabulary import Outcome, Refusal

T = TypeVar("T")

HANDLER_ERROR = "handler error"
"""The failure of a handler whose query failed and that did not catch it, as in the module library."""

CHOOSE, CANCELLED = "choose", "cancelled"


class _Pause(BaseException):
    """The script got to a step whose answer is not there yet. No ``except Exception`` of a script catches it."""

    def __init__(self, step: Step) -> None:
        super().__init__(step)
        self.step = step


class _Fork(BaseException):
    """The script got to a decision that has not been made yet."""

    def __init__(self, decisions: Iterable[Got]) -> None:
        super().__init__()
        self.decisions = tuple(decisions)


class TaskOptions(TypedDict, total=False):
    """How a new task relates to its siblings; as in the module library."""

    sequential: bool
    """It is achieved after the sibling before it (SEQ_ACH); True unless said otherwise."""
    sequential_planning: bool
    """It is planned after the sibling before it has been planned (SEQ_PLANNING)."""
    plan_first: bool
    """All of it is planned before any of it is done (PLAN_FIRST)."""
    delay_planning: bool
    """It is planned only when it may be achieved (DELAY_PLANNING)."""
    priority: int
    """Higher goes first where several wait for one resource."""
    constraints: Iterable[Constraint]
    """Others: ``tca_wire.points.THIS`` stands for the new task, and ``.id`` for those that exist."""


class TaskRef:
    """A goal or command that the script sent; *id* stands for it in constraints."""

    def __init__(self, script: "Script", task_id: TaskId, message: str) -> None:
        self.id = task_id
        self.message = message
        self._script = script

    def wait(self, moment: Moment = Moment.END_ACHIEVING) -> Outcome:
        """Wait until the task reaches *moment*; how it stands then."""
        got = self._script.do(WaitUntil(Point(self.id, moment)))
        _check(got, f"waiting for '{self.message}'")
        return Outcome(got.outcome)

    def kill(self) -> None:
        """End the task and everything under it."""
        _check(self._script.do(KillTask(self.id)), f"killing '{self.message}'")


class Script:
    """What a script can do; each call that reaches central is one step of the exploration."""

    def __init__(self, history: History) -> None:
        self._history = history
        self._at = 0
        self._sent = 0
        self._end: BaseException | None = None

    # --- what the module library has, too ----------------------------------------------------------------------------

    def goal(self, message: Goal[Any], data: Any = None, **options: Unpack[TaskOptions]) -> TaskRef:
        """Make a subtask that expands into subtasks."""
        return self._task(message, data, Goal, options)

    def command(self, message: Command[Any, Any], data: Any = None, **options: Unpack[TaskOptions]) -> TaskRef:
        """Make a subtask that acts."""
        return self._task(message, data, Command, options)

    def monitor(self, message: PointMonitor[Any], data: Any = None, **options: Unpack[TaskOptions]) -> TaskRef:
        """Make a subtask in which central asks the monitor's condition, when its turn comes."""
        return self._task(message, data, PointMonitor, options)

    def _task(self, message: Message[Any, Any], data: Any, wanted: type, options: TaskOptions) -> TaskRef:
        got = self._say(
            message, data, wanted, flags=_flags(options), constraints=tuple(options.get("constraints", ())),
            priority=options.get("priority", 0),
        )  # fmt: skip
        _check(got, f"{message.message_class} '{message.name}'")
        self._sent += 1
        return TaskRef(self, sent(self._sent - 1), message.name)

    def query(self, message: Query[Any, Any], data: Any = None, *, priority: int = 0) -> Any:
        """Ask, and wait for the reply. Raises QueryFailed if its handler fails or is lost."""
        got = self._say(message, data, Query, priority=priority)
        _check(got, f"query '{message.name}'")
        if got.outcome is not Outcome.DONE:
            raise QueryFailed(message.name, got.failure or str(got.outcome))
        return msgspec.msgpack.decode(got.bodies[0])

    def multi_query(self, message: MultiQuery[Any, Any], data: Any = None, *, maximum: int = 0) -> list[Any]:
        """Ask every module that handles the message; the replies, in the order they came."""
        got = self._say(message, data, MultiQuery, maximum=maximum)
        return [msgspec.msgpack.decode(body) for body in got.bodies]

    def inform(self, message: Inform[Any], data: Any = None) -> None:
        """Tell the one module that handles the message."""
        self._say(message, data, Inform)

    def broadcast(self, message: Broadcast[Any], data: Any = None) -> None:
        """Tell every module that handles the message."""
        self._say(message, data, Broadcast)

    def constrain(self, *constraints: Constraint) -> None:
        """Add constraints between tasks that exist."""
        _check(self.do(AddConstraints(constraints)), f"constraint {', '.join(map(str, constraints))}")

    # --- what only a scenario has ------------------------------------------------------------------------------------

    def choose(self, *alternatives: T) -> T:
        """One of these: each is explored."""
        if not alternatives:
            raise ScenarioError("choose() has nothing to choose from: give it the alternatives")
        got = self._decided(CHOOSE, (Got(CHOOSE, choice=i, words=str(one)) for i, one in enumerate(alternatives)))
        return alternatives[got.choice]

    def hang(self) -> NoReturn:
        """Never go on, and never return."""
        self.do(Hang())
        raise AssertionError

    # --- how it is run -----------------------------------------------------------------------------------------------

    def do(self, step: Step) -> Got:
        """Take a step: what it got, or the end of this run."""
        if self._at < len(self._history):
            return self._past(step.kind)
        if self._end is None:
            self._end = _Pause(step)
        raise self._end  # again, where code that cleans up goes on

    def _decided(self, kind: str, decisions: Iterable[Got]) -> Got:
        if self._at < len(self._history):
            return self._past(kind)
        if self._end is None:
            self._end = _Fork(decisions)
        raise self._end

    def _past(self, kind: str) -> Got:
        got = self._history[self._at]
        if got.kind != kind:
            text = "it does not do the same when it is run again: it may use nothing but its arguments"
            raise ScenarioError(text)
        self._at += 1
        return got

    def _say(self, message: Message[Any, Any], data: Any, wanted: type, **options: Any) -> Got:
        if not isinstance(message, wanted):
            raise ScenarioError(f"{message!r} is sent as a {wanted.__name__}, which it is not")
        return self.do(Say(message, msgspec.msgpack.encode(data), **options))


class Task(Script):
    """What a handler sees of the message that it handles, and sends from."""

    def __init__(self, history: History, message: str) -> None:
        super().__init__(history)
        self.id = OWN  #: in constraints
        self.message = message

    @property
    def cancelled(self) -> bool:
        """Whether the handler has been told that its task was killed."""
        past = self._history[: self._at]
        if any(got.kind == CANCELLED and got.choice for got in past):
            return True
        return bool(self._decided(CANCELLED, (Got(CANCELLED, choice=i) for i in range(2))).choice)


class Program:
    """A script of the scenario: a function, and what it has been seen to do."""

    def __init__(self, name: str, function: Callable[..., Any], message: Message[Any, Any] | None) -> None:
        self.name = name
        self.message = message  #: None: what a module does by itself
        self._function = function
        self._arguments = _number_of_arguments(name, function, 2 if message else 1)
        self._branches: dict[tuple[bytes, History], tuple[Branch, ...]] = {}
        self._lives: dict[tuple[bytes, History], int] = {}

    def branches(self, body: bytes, history: History) -> tuple[Branch, ...]:
        """The ways in which a script with this data and life may go on. Raises ScenarioError."""
        key = body, history
        if key not in self._branches:
            self._branches[key] = tuple(self._explore(body, history, ()))
        return self._branches[key]

    def life(self, body: bytes, history: History) -> int:
        """A number for this data and life; equal ones have the same."""
        return self._lives.setdefault((body, history), len(self._lives))

    def _explore(self, body: bytes, history: History, decisions: History) -> Iterable[Branch]:
        try:
            step = self._run(body, history + decisions)
        except _Fork as fork:
            for decision in fork.decisions:
                yield from self._explore(body, history, (*decisions, decision))
        else:
            yield Branch(decisions, step)

    def _run(self, body: bytes, history: History) -> Step:
        """Run to the first step that is not past."""
        script = Task(history, self.message.name) if self.message else Script(history)
        try:
            result = self._function(script, *[msgspec.msgpack.decode(body)][: self._arguments - 1])
            return Return(msgspec.msgpack.encode(result) if self.message else b"")
        except _Pause as pause:
            return pause.step
        except FailureRaised as failure:
            return Fail(failure.name, failure.text, failure.body)
        except QueryFailed as error:
            return Fail(HANDLER_ERROR, str(error), b"")
        except Exception as error:
            known = isinstance(error, ExplorerError)
            raise ScenarioError(f"{self._where(error)}: {error if known else repr(error)}") from error

    def _where(self, error: Exception) -> str:
        """The place in the script at which an error was raised."""
        code = inspect.unwrap(self._function).__code__
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if frame.filename == code.co_filename]
        return f"the script of {self.name} ({code.co_filename}, line {lines[-1] if lines else code.co_firstlineno})"


def _flags(options: TaskOptions) -> Flags:
    flags = Flags.SEQ_ACH if options.get("sequential", True) else Flags.NONE
    flags |= Flags.SEQ_PLANNING if options.get("sequential_planning") else Flags.NONE
    flags |= Flags.PLAN_FIRST if options.get("plan_first") else Flags.NONE
    return flags | (Flags.DELAY_PLANNING if options.get("delay_planning") else Flags.NONE)


def _check(got: Got, what: str) -> None:
    if isinstance(got.outcome, Refusal):
        raise Refused(what, got.outcome)


def _number_of_arguments(name: str, function: Callable[..., Any], most: int) -> int:
    wanted = "(task, data) or (task)" if most == 2 else "(me)"
    try:
        parameters = inspect.signature(function).parameters.values()
        number = sum(parameter.default is parameter.empty for parameter in parameters)
    except (TypeError, ValueError):
        raise ScenarioError(f"the script of {name} is {function!r}: write a function of {wanted}") from None
    if not 1 <= number <= most or inspect.isgeneratorfunction(function):
        raise ScenarioError(f"the script of {name} is no plain function of {wanted}: write one")
    return number
