"""The scripts of a scenario: plain functions that do what a module's handlers do, with the module library's calls."""

import inspect
import traceback
from collections.abc import Callable, Iterable
from typing import Any, NoReturn, TypeVar, cast

from tca_explorer.errors import ExplorerError, ScenarioError
from tca_explorer.link import CHOOSE, MOST_DECISIONS, Fork, Link, Pause
from tca_explorer.steps import HERE, OWN, Branch, Fail, Given, History, Return, Step
from tca_module.connection import Connection
from tca_module.errors import QueryFailed, Refused, TaskFailed, TaskKilled, Timeout, VariableNotSet
from tca_module.failing import BAD_DATA, HANDLER_ERROR, Reissued, failed
from tca_module.sender import Sender
from tca_module.task import Task as ModuleTask
from tca_wire.declarations import FailureRaised, Message
from tca_wire.errors import BadData
from tca_wire.headers import Deliver
from tca_wire.points import ROOT
from tca_wire.vocabulary import Refusal

T = TypeVar("T")

_OF_THE_WORLD = (QueryFailed, TaskFailed, TaskKilled, Timeout, VariableNotSet)
"""Errors that a handler need not catch: it fails with them. All others are mistakes of the script's author."""

_BY_CHANCE = (Refusal.TOO_LATE, Refusal.OVERLOAD, Refusal.UNKNOWN)
"""What central refuses because of what happened meanwhile: a module that is lost takes its resources along."""


class _Choices:
    """What only a scenario has."""

    _explored: Link

    def choose(self, *alternatives: T) -> T:
        """One of these: each is explored."""
        if not alternatives:
            raise ScenarioError("choose() has nothing to choose from: give it the alternatives")
        return alternatives[self._explored.decide(CHOOSE, [str(one) for one in alternatives])]

    def hang(self) -> NoReturn:
        """Never go on, and never return."""
        self._explored.hang()


class Script(_Choices, Sender):
    """What a module does by itself: each call that reaches central is one step of the exploration."""

    def __init__(self, link: Link) -> None:
        Sender.__init__(self)
        self._explored = link

    def _connection(self) -> Connection:
        return cast("Connection", self._explored)


class Task(_Choices, ModuleTask):
    """What a handler sees of the message that it handles, and sends from: the module library's Task, and choices."""

    def __init__(self, link: Link, given: Given, message: Message[Any, Any]) -> None:
        delivery = Deliver(HERE, message.name, OWN if given.is_task else ROOT, given.context)
        ModuleTask.__init__(self, cast("Connection", link), delivery, message)
        self._explored = link


class Program:
    """A script of the scenario: a function, and what it has been seen to do."""

    def __init__(self, name: str, function: Callable[..., Any], message: Message[Any, Any] | None) -> None:
        self.name = name
        self.message = message  #: None: what a module does by itself
        self._function = function
        self._arguments = _number_of_arguments(name, function, 2 if message else 1)
        self._branches: dict[tuple[Given, History], tuple[Branch, ...]] = {}
        self._lives: dict[tuple[Given, History], int] = {}

    def branches(self, given: Given, history: History) -> tuple[Branch, ...]:
        """The ways in which a script that was given this and has this life may go on. Raises ScenarioError."""
        key = given, history
        if key not in self._branches:
            self._branches[key] = tuple(self._explore(given, history, ()))
        return self._branches[key]

    def life(self, given: Given, history: History) -> int:
        """A number for what was given and this life; equal ones have the same."""
        return self._lives.setdefault((given, history), len(self._lives))

    def _explore(self, given: Given, history: History, decisions: History) -> Iterable[Branch]:
        if len(decisions) > MOST_DECISIONS:
            text = f"{self.name} decides {MOST_DECISIONS} times without sending or asking anything in between"
            raise ScenarioError(f"the script of {text}: it would never go on")
        try:
            step = self._run(given, history + decisions)
        except Fork as fork:
            for decision in fork.decisions:
                yield from self._explore(given, history, (*decisions, decision))
        else:
            yield Branch(decisions, step)

    def _run(self, given: Given, history: History) -> Step:
        """Run to the first step that is not past."""
        link = Link(history)
        try:
            step = self._called(link, given)
        except (Pause, Fork):
            assert link.stopped is not None
        except Exception as error:
            raise ScenarioError(f"{self._where(error)}: {_described(link.error or error)}") from error
        if link.error is not None:  # and the script went on
            raise ScenarioError(f"{self._where(link.error)}: {link.error}")
        if isinstance(link.stopped, Fork):
            raise link.stopped
        return link.stopped.step if link.stopped is not None else step

    def _called(self, link: Link, given: Given) -> Step:
        """Call the function; how it ended."""
        message = self.message
        if message is None:
            script: Script | Task = Script(link)
            arguments: list[Any] = []
        else:
            script = Task(link, given, message)
            try:
                arguments = [message.decode_data(given.body)]
            except BadData as error:
                return Fail(BAD_DATA, str(error))
        try:
            result = self._function(script, *arguments[: self._arguments - 1])
            return Return(message.encode_reply(result) if message is not None else b"")
        except FailureRaised as failure:
            return Fail(failure.name, failure.text, failure.body, tuple(failure.kinds))
        except Reissued:
            return Fail("", reissue=True)
        except _OF_THE_WORLD as error:
            header, body = failed(HERE, error)
            return Fail(header.failure, str(error), body, tuple(header.kinds))
        except Refused as error:
            if error.refusal not in _BY_CHANCE:
                raise
            return Fail(HANDLER_ERROR, str(error))

    def _where(self, error: Exception) -> str:
        """The place in the script at which an error was raised."""
        code = inspect.unwrap(self._function).__code__
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if frame.filename == code.co_filename]
        return f"the script of {self.name} ({code.co_filename}, line {lines[-1] if lines else code.co_firstlineno})"


def _described(error: Exception) -> str:
    known = isinstance(error, ExplorerError) or type(error).__module__.startswith(("tca_module", "tca_wire"))
    return str(error) if known else repr(error)


def _number_of_arguments(name: str, function: Callable[..., Any], most: int) -> int:
    wanted = "(task, data) or (task)" if most == 2 else "(me)"
    try:
        parameters = inspect.signature(function).parameters.values()
        number = sum(parameter.default is parameter.empty for parameter in parameters)
    except (TypeError, ValueError):
        raise ScenarioError(f"the script of {name} is {function!r}: write a function of {wanted}") from None
    is_plain = not (inspect.isgeneratorfunction(function) or inspect.iscoroutinefunction(function))
    if not 1 <= number <= most or not is_plain:
        raise ScenarioError(f"the script of {name} is no plain function of {wanted}: write one")
    return number
