"""The scripts of a scenario: plain functions that make calls of the module library."""

import inspect
import re
import traceback
from collections.abc import Callable, Iterable
from contextlib import suppress
from itertools import count
from typing import Any, NoReturn, TypeVar, cast, overload
from weakref import ref

from msgspec.structs import replace

from tca_module.checks import check_function
from tca_module.errors import (
    LockLost,
    QueryFailed,
    Refused,
    Stopped,
    TaskFailed,
    TaskKilled,
    Timeout,
    VariableNotSet,
)
from tca_module.link.connection import Connection
from tca_module.sending.handler_errors import Reissued, failure_of
from tca_module.sending.later_reply import LaterReply
from tca_module.sending.sender import Sender
from tca_module.sending.task import Task as ModuleTask
from tca_module.sending.task_requests import TaskRequest
from tca_tools.explore.errors import ExplorerError, ScenarioError
from tca_tools.explore.scenario import steps
from tca_tools.explore.scenario.argument_checks import as_scenario_error
from tca_tools.explore.scenario.script_connection import (
    CHOOSE,
    MAX_DECISIONS,
    DecisionReached,
    ScriptConnection,
    StepReached,
)
from tca_tools.explore.scenario.worker_thread import abandon_thread
from tca_wire.errors import BadData
from tca_wire.messages.declarations import FailureRaised, Message
from tca_wire.messages.failures import BAD_DATA, HANDLER_ERROR
from tca_wire.messages.large_data import inline
from tca_wire.packets import headers
from tca_wire.points import ROOT
from tca_wire.vocabulary import Refusal

T = TypeVar("T")

_RUNTIME_ERRORS = (LockLost, QueryFailed, Stopped, TaskFailed, TaskKilled, Timeout, VariableNotSet)
"""Errors that make a handler fail, as on the robot. Any other error is a mistake in the script."""

_CHANCE_REFUSALS = (Refusal.TOO_LATE, Refusal.UNKNOWN)
"""Refusals because of an earlier event, such as the loss of the module with the resource.

A resource that no module of the scenario has is a mistake, which Exchange finds.
"""


class _Choices:
    """The calls that only a scenario has."""

    _explored: ScriptConnection

    def choose(self, *alternatives: T) -> T:
        """Return one of *alternatives*; each of them is explored.

        Args:
            alternatives: the values to choose from.
        """
        if not alternatives:
            self._explored.end(
                ScenarioError("choose() has nothing to choose from: give it the alternatives")
            )
        # Addresses in memory differ from run to run.
        words = [re.sub(r" at 0x[0-9a-f]+", "", str(one)) for one in alternatives]
        return alternatives[self._explored.decide(CHOOSE, words)]

    def hang(self) -> NoReturn:
        """Wait forever."""
        self._explored.hang()

    def use_kept(self, message: Message[Any, Any], words: str = "") -> None:
        """Use the replies that this module's handlers of *message* keep with ``keep_reply``.

        This also applies to handlers that have started already and keep their reply only later.

        Args:
            message: the message whose handlers keep a reply.
            words: a text for the function that was given to ``keep_reply``.
        """
        self._explored.do(steps.UseKeptReplies(message.name, words))


class Script(_Choices, Sender):
    """The argument of a module's own program. Each call that reaches central is one action."""

    def __init__(self, link: ScriptConnection) -> None:
        Sender.__init__(self)
        self._explored = link

    def _connection(self) -> Connection:
        return cast("Connection", self._explored)


class Task(_Choices, ModuleTask):
    """The task of a handler: the module library's Task with the explorer's own calls."""

    def __init__(
        self, link: ScriptConnection, given: steps.HandlerInput, message: Message[Any, Any]
    ) -> None:
        delivery = headers.Deliver(
            steps.HERE, message.name, steps.OWN if given.is_task else ROOT, given.context
        )
        ModuleTask.__init__(self, cast("Connection", link), delivery, message)
        self._accepts = given.accepts
        self._explored = link

    def keep_reply(self, later: LaterReply[Any], then: Callable[..., object]) -> None:
        """Keep the LaterReply that this handler returns, until another script calls ``use_kept``.

        At that call the module calls *then*. After it the reply is no longer kept, unless *then*
        calls ``keep_reply`` again.

        Args:
            later: the reply, from ``reply_later()``.
            then: a function of the LaterReply and the words given to ``use_kept``.
        """
        self._explored.kept = later, then

    @overload
    def wait_for_request(self, timeout: None = None) -> TaskRequest: ...
    @overload
    def wait_for_request(self, timeout: float | None) -> TaskRequest | None: ...
    def wait_for_request(self, timeout: float | None = None) -> TaskRequest | None:
        """Wait for the next request of a client to this task.

        Args:
            timeout: the most seconds to wait; None, the default, waits forever.

        Returns:
            The request; None when the time is over. Each request is returned once.
        """
        served = self._server_state()
        if not served.has_new:
            self._explored.wait_for_client(timeout, f"a request to {self}")
        return served.pop_new_request()


class Program:
    """A script of the scenario: a function and its runs so far."""

    def __init__(
        self, name: str, function: Callable[..., Any], message: Message[Any, Any] | None
    ) -> None:
        self.name = name
        self.message = message  #: None for a program of a module outside of handlers
        self._function = function
        self._arguments = _number_of_arguments(
            name, function, "(task, data)" if message else "(me)"
        )
        self._starts: dict[steps.HandlerInput, steps.ScriptRun] = {}
        self._numbers = count()

    def start(self, given: steps.HandlerInput) -> steps.ScriptRun:
        """Return the run of a script with this input, before its first step."""
        if given not in self._starts:
            self._starts[given] = steps.ScriptRun(given, next(self._numbers))
        return self._starts[given]

    def extend(self, script_run: steps.ScriptRun, *got: steps.StepResult) -> steps.ScriptRun:
        """Return *script_run* with further results."""
        for result in got:
            script_run = script_run.extended(result, next(self._numbers))
        return script_run

    def branches(self, script_run: steps.ScriptRun) -> tuple[steps.Branch, ...]:
        """Return the ways in which a run may continue; raise ScenarioError for a mistake."""
        if script_run.branches is None:
            script_run.branches = tuple(self._explore(script_run.given, script_run.history(), ()))
        return script_run.branches

    def place_of_step(self, script_run: steps.ScriptRun, branch: steps.Branch) -> str:
        """Return the file and line of the script at which a branch takes its step."""
        link = ScriptConnection(script_run.history() + branch.decisions, self._abandon_thread)
        with suppress(Exception, StepReached):
            self._call(link, script_run.given)
        return self._place_of_error(link.stopped)

    def _explore(
        self, given: steps.HandlerInput, history: steps.History, decisions: steps.History
    ) -> Iterable[steps.Branch]:
        if len(decisions) > MAX_DECISIONS:
            raise ScenarioError(
                f"the script of {self.name} decides {MAX_DECISIONS} times without sending or "
                "asking anything in between: it would never continue"
            )
        try:
            step = self._run(ScriptConnection(history + decisions, self._abandon_thread), given)
        except DecisionReached as fork:
            for decision in fork.decisions:
                yield from self._explore(given, history, (*decisions, decision))
        else:
            yield steps.Branch(decisions, step)

    def _abandon_thread(self, error: ScenarioError | None) -> NoReturn:
        """Abandon the thread: the script catches the exceptions that end a run, and continues."""
        text = (
            "it catches the exception that ends a run (it is run again after each answer) and "
            "continues forever: write 'except Exception:' instead of 'except:' or "
            "'except BaseException:'"
        )
        if error is not None:
            text = f"{error}; it catches this, and continues forever"
        abandon_thread(ScenarioError(f"{self._place_in(traceback.extract_stack())}: {text}"))

    def _run(self, link: ScriptConnection, given: steps.HandlerInput) -> steps.Step:
        """Run the script to its first step without a result, and return that step."""
        try:
            step = self._call(link, given) or _end_step(*link.owed())
        except (StepReached, DecisionReached):
            assert link.stopped is not None
        except (Exception, SystemExit) as error:
            raise ScenarioError(
                f"{self._place_of_error(error)}: {_described(link.error or error)}"
            ) from error
        if link.error is not None:  # the script caught it
            raise ScenarioError(f"{self._place_of_error(link.error)}: {link.error}")
        if isinstance(link.stopped, DecisionReached):
            raise link.stopped
        return link.stopped.step if link.stopped is not None else step

    def _call(self, link: ScriptConnection, given: steps.HandlerInput) -> steps.Step | None:
        """Call the function; return its last step, or None if it owes its reply."""
        message = self.message
        if message is None:
            script: Script | Task = Script(link)
            arguments: list[Any] = []
        else:
            script = Task(link, given, message)
            try:
                arguments = [message.decode_data(given.body)]
            except BadData as error:
                return steps.Fail(BAD_DATA, str(error))
        try:
            result = self._function(script, *arguments[: self._arguments - 1])
            link.raise_refusals()
            return self._result_step(script, result)
        except (FailureRaised, Reissued) as error:
            return _end_step(*failure_of(steps.HERE, error))
        except _RUNTIME_ERRORS as error:
            was_killed = isinstance(error, TaskKilled | Stopped)
            return replace(
                _end_step(*failure_of(steps.HERE, error)), text=str(error), was_killed=was_killed
            )
        except Refused as error:
            if error.refusal not in _CHANCE_REFUSALS:
                raise
            return steps.Fail(HANDLER_ERROR, str(error))

    def _result_step(self, script: Task | Script, result: Any) -> steps.Return | None:
        if isinstance(script, Task) and script.later is not None:
            if result is not script.later:
                raise ScenarioError("it called reply_later(), so it must return the LaterReply")
            script.handler_returned()
            result.handler_returned()
            script._explored.returned_reply = ref(result)  # noqa: SLF001
            return None
        body = inline(self.message.encode_reply(result)) if self.message else b""
        return steps.Return(body, script.ending if isinstance(script, Task) else "")

    def _place_of_error(self, error: BaseException | None) -> str:
        """Return the place in the script at which an error was raised."""
        return self._place_in(
            traceback.extract_tb(error.__traceback__) if error is not None else []
        )

    def _place_in(self, frames: Iterable[traceback.FrameSummary]) -> str:
        code = inspect.unwrap(self._function).__code__
        lines = [frame.lineno for frame in frames if frame.filename == code.co_filename]
        line = lines[-1] if lines else code.co_firstlineno
        return f"the script of {self.name} ({code.co_filename}, line {line})"


def _end_step(header: headers.Reply | headers.Fail, body: bytes) -> steps.Return | steps.Fail:
    """Return the end of a handler as a step."""
    if isinstance(header, headers.Reply):
        return steps.Return(body, header.transition)
    return steps.Fail(header.failure, header.text, body, (*header.kinds,), header.reissue)


def _described(error: BaseException) -> str:
    known = isinstance(error, ExplorerError) or type(error).__module__.startswith(
        ("tca_module", "tca_wire")
    )
    return str(error) if known else repr(error)


def _number_of_arguments(name: str, function: Callable[..., Any], wanted: str) -> int:
    with as_scenario_error():
        return check_function(
            f"the script of {name}", function, wanted, range(1, wanted.count(",") + 2)
        )
