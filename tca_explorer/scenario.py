"""Scenarios as users write them: modules, what their handlers do, what may happen to them, and what must be true."""

from collections.abc import Callable
from itertools import combinations
from typing import Any

from tca_explorer.errors import ScenarioError
from tca_explorer.properties import Property
from tca_explorer.script import Program
from tca_wire.controls import Monitor
from tca_wire.declarations import Message
from tca_wire.parts import HandlerFormat

Function = Callable[..., Any]


class ScenarioModule:
    """A module of a scenario. Made by ``Scenario.module``."""

    def __init__(self, name: str, capacity: int, *, may_be_lost: int, comes_back: bool, may_leave: bool,
                 arrives_late: bool) -> None:  # fmt: skip
        self.name = name
        self.may_be_lost = may_be_lost
        self.comes_back = comes_back
        self.may_leave = may_leave
        self.arrives_late = arrives_late
        self.handlers: dict[str, Program] = {}  #: by message name
        self.formats: list[HandlerFormat] = []  #: what central is told of them
        self.story: Program | None = None  #: what the module does by itself
        self._capacities = {name: capacity}

    def resource(self, name: str, capacity: int = 1) -> str:
        """Declare a further resource of this module; handlers name it with ``resource=``."""
        self._capacities[name] = capacity
        return name

    def handles(
        self, message: Message[Any, Any], *, resource: str = "", pool: str = ""
    ) -> Callable[[Function], Function]:
        """Declare the decorated function as this module's handler of *message*."""
        if not isinstance(message, Message):
            raise ScenarioError(f"handles() wants a message (Goal, Command, Query, ...), and {message!r} is none")
        if isinstance(message, Monitor):
            raise ScenarioError(f"{message!r} is a monitor: central carries it out, handle its parts")
        if message.name in self.handlers:
            raise ScenarioError(f"module '{self.name}' handles '{message.name}' already: one handler a message")
        if resource and resource not in self._capacities:
            raise ScenarioError(f"module '{self.name}' has no resource '{resource}': declare it with resource()")

        def declare(function: Function) -> Function:
            self.handlers[message.name] = Program(f"'{message.name}' in {self.name}", function, message)
            self.formats.append(HandlerFormat(message.name, resource or self.name, pool))
            return function

        return declare

    def does(self, function: Function) -> Function:
        """Declare the decorated function as what this module does by itself, outside of any task."""
        if self.story is not None:
            raise ScenarioError(f"module '{self.name}' does something already: make it one function, or two modules")
        self.story = Program(self.name, function, None)
        return function

    @property
    def slots(self) -> list[str]:
        """The resource of each of its slots."""
        used = {handler.resource for handler in self.formats}
        return [name for name, capacity in self._capacities.items() for _ in range(capacity) if name in used]


class Scenario:
    """A small robot, and what must be true of it whatever the order in which things happen.

    *title* names it in results; *properties* are checked in every state (see properties.py).
    """

    def __init__(self, title: str, *properties: Property) -> None:
        self.title = title
        self.properties = properties
        self.modules: dict[str, ScenarioModule] = {}
        self.may_be_killed: dict[str, int] = {}  #: by message: how many such tasks
        self.may_be_suspended: dict[str, int] = {}  #: the same

    def module(
        self, name: str, *, capacity: int = 1, may_be_lost: int = 0, comes_back: bool = False, may_leave: bool = False,
        arrives_late: bool = False,
    ) -> ScenarioModule:  # fmt: skip
        """Add a module whose own resource takes *capacity* messages at a time.

        It may be lost (its process dies) at any moment, *may_be_lost* times; with *comes_back* it is started again each
        time. With *may_leave* it may say goodbye at any moment. With *arrives_late* it joins at some moment of the run
        instead of before it.
        """
        if name in self.modules:
            raise ScenarioError(f"there is a module '{name}' already: choose another name")
        self.modules[name] = ScenarioModule(name, capacity, may_be_lost=may_be_lost, comes_back=comes_back,
                                            may_leave=may_leave, arrives_late=arrives_late)  # fmt: skip
        return self.modules[name]

    def may_kill(self, message: Message[Any, Any], times: int = 1) -> None:
        """Somebody may kill tasks of this message at any moment, so many of them."""
        self.may_be_killed[_task(message, "may_kill").name] = times

    def may_suspend(self, message: Message[Any, Any], times: int = 1) -> None:
        """Somebody may suspend tasks of this message at any moment, so many times; each is resumed some time later."""
        self.may_be_suspended[_task(message, "may_suspend").name] = times

    def rivals(self) -> dict[str, int]:
        """By message: a number that those share which may wait for the same resource."""
        groups = {name: number for number, name in enumerate(self.messages())}
        for module in self.modules.values():
            for one, other in combinations(module.formats, 2):
                if one.resource == other.resource:
                    old, new = groups[one.message], groups[other.message]
                    groups = {name: new if group == old else group for name, group in groups.items()}
        return groups

    def messages(self) -> dict[str, Message[Any, Any]]:
        """All messages that a module handles, by name. Raises ScenarioError where two differ in class."""
        found: dict[str, Message[Any, Any]] = {}
        for module in self.modules.values():
            for program in module.handlers.values():
                message = program.message
                assert message is not None
                if found.setdefault(message.name, message).message_class is not message.message_class:
                    raise ScenarioError(f"'{message.name}' is a {message.message_class} in {module.name} and a "
                                        f"{found[message.name].message_class} elsewhere: use one")  # fmt: skip
        return found


def _task(message: Message[Any, Any], call: str) -> Message[Any, Any]:
    if not message.message_class.is_task:
        raise ScenarioError(f"{call}() wants a goal or command, and {message!r} is none")
    return message
