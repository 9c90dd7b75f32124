"""Scenarios as users write them: modules, what their handlers do, what may happen to them, and what
must be true.
"""

from collections.abc import Callable, Collection, Iterable
from itertools import combinations
from typing import Any, NoReturn, Unpack

from tca_module import checks
from tca_module.sending.sender import Sender
from tca_module.serving.handler_options import HandlerOptions, checked_format
from tca_tools.explore.errors import ScenarioError
from tca_tools.explore.scenario.argument_checks import as_scenario_error, check
from tca_tools.explore.scenario.script import Program
from tca_tools.properties import CasesProperty, Property
from tca_wire.messages.declarations import Message
from tca_wire.packets.parts import HandlerFormat

Function = Callable[..., Any]


_NOT_EXPLORED = frozenset(
    (
        "after",
        "central",
        "every",
        "observes",
        "on_readable",
        "run",
        "running",
        "serve",
        "stop",
        "stopping",
        *(name for name in dir(Sender) if not name.startswith("_")),
    )
)
"""Methods that a module of the library has and a scenario's has not."""


class ScenarioModule:
    """A module of a scenario. Made by ``Scenario.module``."""

    def __init__(
        self,
        name: str,
        capacity: int,
        *,
        may_be_lost: int,
        comes_back: bool,
        may_leave: bool,
        arrives_late: bool,
        prefetch: int | None,
        requires: Collection[Message[Any, Any]],
    ) -> None:
        check("module()", checks.NAME, name=name)
        what = f"module '{name}'"
        check(what, checks.CAPACITY, capacity=capacity)
        check(what, checks.AMOUNT, may_be_lost=may_be_lost)
        check(
            what, checks.FLAG, comes_back=comes_back, may_leave=may_leave, arrives_late=arrives_late
        )
        check(what, checks.AMOUNT.or_none(), prefetch=prefetch)
        check(what, checks.MESSAGES, requires=requires)
        self.name, self.prefetch = name, prefetch
        self.may_be_lost, self.comes_back = may_be_lost, comes_back
        self.may_leave, self.arrives_late = may_leave, arrives_late
        self.handlers: dict[str, Program] = {}  #: by message name
        self.formats: list[HandlerFormat] = []  #: the declarations of its handlers
        self.own_program: Program | None = None  #: the module's own program
        self._capacities = {name: capacity}
        self._required = list(requires)
        self._wait = Program(
            f"requires in {name}", lambda me: me.wait_until_handled(*self._awaited()), None
        )
        self._start_programs: list[Program] = []

    def __getattr__(self, name: str) -> NoReturn:
        if name in _NOT_EXPLORED:
            raise ScenarioError(
                f"{name} of module '{self.name}' is not explored: what a module sends by itself goes "
                "into a function under @module.does or @module.at_start"
            )
        raise AttributeError(f"a module of a scenario has no '{name}'")

    def resource(self, name: str, capacity: int = 1) -> str:
        """Declare a further resource of this module; handlers name it with ``resource=``."""
        check("resource()", checks.NAME, name=name)
        check(f"resource '{name}'", checks.CAPACITY, capacity=capacity)
        self._capacities[name] = capacity
        return name

    def handles(
        self, message: Message[Any, Any], **options: Unpack[HandlerOptions]
    ) -> Callable[[Function], Function]:
        """Declare the decorated function as this module's handler of *message*, as the module
        library's ``handles`` does. Messages that come *direct* are not explored.
        """
        with as_scenario_error(f"module '{self.name}'"):
            handler = checked_format(message, options, self.name, {})
        if message.name in self.handlers:
            raise ScenarioError(
                f"module '{self.name}' handles '{message.name}' already: one handler a message"
            )
        if handler.direct:
            raise ScenarioError(
                f"direct=True of '{message.name}' in module '{self.name}' is not explored: leave it "
                "out, and each goes through central, which happens on the robot, too"
            )
        if handler.resource not in self._capacities:
            raise ScenarioError(
                f"module '{self.name}' has no resource '{handler.resource}': declare it with resource()"
            )

        def declare(function: Function) -> Function:
            self.handlers[message.name] = Program(
                f"'{message.name}' in {self.name}", function, message
            )
            self.formats.append(handler)
            return function

        return declare

    def does(self, function: Function) -> Function:
        """Declare the decorated function as what this module does by itself, outside of any
        task.
        """
        if self.own_program is not None:
            raise ScenarioError(
                f"module '{self.name}' does something already: make it one function, or two modules"
            )
        self.own_program = Program(self.name, function, None)
        return function

    def at_start(self, function: Function) -> Function:
        """Declare the decorated function as what this module does once it has joined, before it
        handles anything.
        """
        self._start_programs.append(Program(f"at_start in {self.name}", function, None))
        return function

    @property
    def start_programs(self) -> list[Program]:
        """The programs that run before it handles anything."""
        return [*([self._wait] if self._awaited() else []), *self._start_programs]

    def _awaited(self) -> list[Message[Any, Any]]:
        return [message for message in self._required if message.name not in self.handlers]

    @property
    def slots(self) -> list[str]:
        """The resource of each of its slots."""
        used = {handler.resource for handler in self.formats}
        return [
            name
            for name, capacity in self._capacities.items()
            for _ in range(capacity)
            if name in used
        ]


class Scenario:
    """A small robot, and what must be true of it whatever the order in which things happen.

    *title* names it in results; *properties* are checked in every state (see tca_tools.properties).
    """

    def __init__(self, title: str, *properties: Property) -> None:
        check("Scenario()", checks.NAME, title=title)
        self.title = title
        self.properties = checked_properties(properties)
        self.modules: dict[str, ScenarioModule] = {}
        self.is_observed = False
        self.may_be_killed: dict[str, int] = {}  #: by message: how many such tasks
        self.may_be_suspended: dict[str, int] = {}  #: by message: how many such tasks

    def module(
        self,
        name: str,
        *,
        capacity: int = 1,
        may_be_lost: int = 0,
        comes_back: bool = False,
        may_leave: bool = False,
        arrives_late: bool = False,
        prefetch: int | None = None,
        requires: Collection[Message[Any, Any]] = (),
    ) -> ScenarioModule:
        """Add a module whose own resource takes *capacity* messages at a time.

        It may be lost (its process dies) at any moment, *may_be_lost* times; with *comes_back* it
        is started again each time. With *may_leave* it may say goodbye at any moment. With
        *arrives_late* it joins at some moment of the run instead of before it. It handles nothing
        before somebody handles all messages that it *requires*. With *prefetch* its slots hear of
        central's messages some time later, and may have so many ahead.
        """
        if name in self.modules:
            raise ScenarioError(f"there is a module '{name}' already: choose another name")
        module = ScenarioModule(
            name,
            capacity,
            may_be_lost=may_be_lost,
            comes_back=comes_back,
            may_leave=may_leave,
            arrives_late=arrives_late,
            prefetch=prefetch,
            requires=requires,
        )
        self.modules[name] = module
        return module

    def observe(self) -> None:
        """Somebody observes the states of all tasks: that no change is missed is checked then,
        too.
        """
        self.is_observed = True

    @property
    def has_prefetch(self) -> bool:
        """Whether a module may have messages ahead: then states differ in what scripts have lived,
        too.
        """
        return any(module.prefetch is not None for module in self.modules.values())

    def may_kill(self, message: Message[Any, Any], times: int = 1) -> None:
        """Somebody may kill tasks of this message at any moment, so many of them."""
        check("may_kill()", checks.AMOUNT, times=times)
        self.may_be_killed[_task(message, "may_kill").name] = times

    def may_suspend(self, message: Message[Any, Any], times: int = 1) -> None:
        """Somebody may suspend tasks of this message at any moment, so many times; each is resumed
        some time later.
        """
        check("may_suspend()", checks.AMOUNT, times=times)
        self.may_be_suspended[_task(message, "may_suspend").name] = times

    def queue_groups(self) -> dict[str, int]:
        """By message: a number that those share which may wait for the same resource."""
        groups = {name: number for number, name in enumerate(self.messages())}
        for module in self.modules.values():
            for one, other in combinations(module.formats, 2):
                if one.resource == other.resource:
                    old, new = groups[one.message], groups[other.message]
                    groups = {
                        name: new if group == old else group for name, group in groups.items()
                    }
        return groups

    def owners(self, resource: str) -> list[str]:
        """The modules that have a resource of that name, which is one that handles something."""
        return [module.name for module in self.modules.values() if resource in module.slots]

    def messages(self) -> dict[str, Message[Any, Any]]:
        """All messages that a module handles, by name. Raises ScenarioError where two differ in
        class.
        """
        found: dict[str, Message[Any, Any]] = {}
        for module in self.modules.values():
            for program in module.handlers.values():
                message = program.message
                assert message is not None
                if (
                    found.setdefault(message.name, message).message_class
                    is not message.message_class
                ):
                    raise ScenarioError(
                        f"'{message.name}' is a {message.message_class} in {module.name} and a "
                        f"{found[message.name].message_class} elsewhere: use one"
                    )
        return found


def checked_properties(properties: Iterable[Any]) -> tuple[Property, ...]:
    """*properties*, if they are. Raises ScenarioError."""
    found = tuple(properties)
    for one in found:
        if not isinstance(one, Property):
            raise ScenarioError(
                f"{one!r:.60} is no property: give never(...), before(...), never_stuck(), ..."
            )
        if isinstance(one, CasesProperty):
            raise ScenarioError(
                f"'{one}' counts cases of a whole run: ask it of a journal, with tca check"
            )
    return found


def _task(message: Message[Any, Any], call: str) -> Message[Any, Any]:
    if not isinstance(message, Message) or not message.message_class.is_task:
        raise ScenarioError(f"{call}() wants a goal or command, and {message!r} is none")
    return message
