"""Scenarios as users write them: modules, handlers, possible mishaps, and properties."""

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
        "arun",
        "central",
        "every",
        "handles_on_loop",
        "observes",
        "on_readable",
        "run",
        "running",
        "required_elsewhere",
        "running_async",
        "serve",
        "stop",
        "stopping",
        *(name for name in dir(Sender) if not name.startswith("_")),
    )
)
"""Methods of the library's Module that a scenario's module does not have."""


class ScenarioModule:
    """A module of a scenario. ``Scenario.module`` creates it."""

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
        owner = f"module '{name}'"
        check(owner, checks.CAPACITY, capacity=capacity)
        check(owner, checks.AMOUNT, may_be_lost=may_be_lost)
        flags = {"comes_back": comes_back, "may_leave": may_leave, "arrives_late": arrives_late}
        check(owner, checks.FLAG, **flags)
        check(owner, checks.AMOUNT.or_none(), prefetch=prefetch)
        check(owner, checks.MESSAGES, requires=requires)
        self.name, self.prefetch = name, prefetch
        self.may_be_lost, self.comes_back = may_be_lost, comes_back
        self.may_leave, self.arrives_late = may_leave, arrives_late
        self.handlers: dict[str, Program] = {}  #: by message name
        self.formats: list[HandlerFormat] = []  #: the declarations of its handlers
        self.own_program: Program | None = None  #: set by ``does``
        self._capacities = {name: capacity}
        self._required = list(requires)
        self._wait = Program(
            f"requires in {name}", lambda me: me.wait_until_handled(*self._awaited()), None
        )
        self._start_programs: list[Program] = []

    def __getattr__(self, name: str) -> NoReturn:
        if name in _NOT_EXPLORED:
            raise ScenarioError(
                f"{name} of module '{self.name}' is not explored: write what the module sends "
                "outside of tasks as a function under @module.does or @module.at_start"
            )
        raise AttributeError(f"a module of a scenario has no '{name}'")

    def resource(self, name: str, capacity: int = 1) -> str:
        """Declare a further resource of this module; handlers refer to it with ``resource=``.

        Args:
            name: the resource's name.
            capacity: the number of messages that it handles at a time; 1 by default.

        Returns:
            The name.
        """
        check("resource()", checks.NAME, name=name)
        check(f"resource '{name}'", checks.CAPACITY, capacity=capacity)
        self._capacities[name] = capacity
        return name

    @checks.with_options
    def handles(
        self, message: Message[Any, Any], **options: Unpack[HandlerOptions]
    ) -> Callable[[Function], Function]:
        """Declare the decorated function as this module's handler of *message*.

        Args:
            message: the message; one handler each.
            options: Those of the module library's ``handles``.

        Returns:
            The decorator.

        Raises:
            ScenarioError: the message has a handler already, or an option is not possible.
        """
        with as_scenario_error(f"module '{self.name}'"):
            handler = checked_format(message, options, self.name, {})
        if message.name in self.handlers:
            raise ScenarioError(
                f"module '{self.name}' handles '{message.name}' already: "
                "a message has one handler in a module"
            )
        if handler.resource not in self._capacities:
            raise ScenarioError(
                f"module '{self.name}' has no resource '{handler.resource}': "
                "declare it with resource()"
            )

        def declare(function: Function) -> Function:
            self.handlers[message.name] = Program(
                f"'{message.name}' in {self.name}", function, message
            )
            self.formats.append(handler)
            return function

        return declare

    def does(self, function: Function) -> Function:
        """Declare the decorated function as the module's own program, which runs outside of tasks.

        A module has at most one.

        Args:
            function: takes a ``Script``.

        Returns:
            The function.

        Raises:
            ScenarioError: the module has a program already.
        """
        if self.own_program is not None:
            raise ScenarioError(
                f"module '{self.name}' has a function under @module.does already: "
                "join the two, or use two modules"
            )
        self.own_program = Program(self.name, function, None)
        return function

    def at_start(self, function: Function) -> Function:
        """Declare a function that runs when the module has joined, before it handles anything.

        Args:
            function: takes a ``Script``.

        Returns:
            The function.
        """
        self._start_programs.append(Program(f"at_start in {self.name}", function, None))
        return function

    @property
    def start_programs(self) -> list[Program]:
        """The programs that run before the module handles anything."""
        return [*([self._wait] if self._awaited() else []), *self._start_programs]

    def _awaited(self) -> list[Message[Any, Any]]:
        return [message for message in self._required if message.name not in self.handlers]

    @property
    def slots(self) -> list[str]:
        """The resource of each slot of the module."""
        used = {handler.resource for handler in self.formats}
        return [
            name
            for name, capacity in self._capacities.items()
            for _ in range(capacity)
            if name in used
        ]


class Scenario:
    """A small robot, and the properties that must hold in whatever order things happen.

    Args:
        title: its name in results.
        properties: the properties to check in every state (see ``tca_tools.properties``).

    Example::

        scenario = Scenario("fetching", before(achieved(DRIVE), begun(GRASP)), never_stuck())
        scenario.module("base").handles(DRIVE)(lambda task: None)
    """

    def __init__(self, title: str, *properties: Property) -> None:
        check("Scenario()", checks.NAME, title=title)
        self.title = title
        self.properties = checked_properties(properties)
        self.modules: dict[str, ScenarioModule] = {}
        self.is_observed = False
        self.may_be_killed: dict[str, int] = {}  #: by message: the number of kills
        self.may_be_suspended: dict[str, int] = {}  #: by message: the number of suspensions

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
        """Add a module.

        Args:
            name: the module's name; its own resource has the same.
            capacity: the number of messages that its own resource handles at a time.
            may_be_lost: the number of times that its process may die, at any time.
            comes_back: whether it is started again each time that it was lost.
            may_leave: whether it may say goodbye at any time.
            arrives_late: whether it joins at some time of the run, instead of before it.
            prefetch: the number of messages that each of its slots may have prefetched; packets to
                the slots then take some time. None: slots receive packets at once.
            requires: messages that must have a handler before this module handles anything.

        Returns:
            The module, for its handlers.

        Raises:
            ScenarioError: the name is in use, or an argument is not possible.
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
        """Add an observer of the states of all tasks, and check that it misses no change."""
        self.is_observed = True

    @property
    def has_prefetch(self) -> bool:
        """Whether a module has a prefetch. If so, what scripts have done is part of the state."""
        return any(module.prefetch is not None for module in self.modules.values())

    def may_kill(self, message: Message[Any, Any], times: int = 1) -> None:
        """Let the operator kill tasks of *message*, at any time.

        Args:
            message: a goal or command.
            times: the number of kills; 1 by default.
        """
        check("may_kill()", checks.AMOUNT, times=times)
        self.may_be_killed[_task(message, "may_kill").name] = times

    def may_suspend(self, message: Message[Any, Any], times: int = 1) -> None:
        """Let the operator suspend tasks of *message* at any time, and resume them later.

        Args:
            message: a goal or command.
            times: the number of suspensions; 1 by default.
        """
        check("may_suspend()", checks.AMOUNT, times=times)
        self.may_be_suspended[_task(message, "may_suspend").name] = times

    def queue_groups(self) -> dict[str, int]:
        """Return the group of each message. Messages of a group may wait for the same resource."""
        groups = {name: number for number, name in enumerate(self.messages())}
        for module in self.modules.values():
            for first, second in combinations(module.formats, 2):
                if first.resource == second.resource:
                    old, new = groups[first.message], groups[second.message]
                    groups = {
                        name: new if group == old else group for name, group in groups.items()
                    }
        return groups

    def owners(self, resource: str) -> list[str]:
        """Return the modules with a resource of that name that handles something."""
        return [module.name for module in self.modules.values() if resource in module.slots]

    def messages(self) -> dict[str, Message[Any, Any]]:
        """Return all messages that modules handle, by name.

        Raises ScenarioError if modules declare one with different classes.
        """
        found: dict[str, Message[Any, Any]] = {}
        for module in self.modules.values():
            for program in module.handlers.values():
                message = program.message
                assert message is not None
                other = found.setdefault(message.name, message).message_class
                if other is not message.message_class:
                    raise ScenarioError(
                        f"'{message.name}' is a {message.message_class} in {module.name} and a "
                        f"{other} elsewhere: use one"
                    )
        return found


def checked_properties(properties: Iterable[Any]) -> tuple[Property, ...]:
    """Return *properties*; raise ScenarioError if one is not a property of states."""
    checked = tuple(properties)
    for prop in checked:
        if not isinstance(prop, Property):
            raise ScenarioError(
                f"{prop!r:.60} is not a property: use never(...), before(...), never_stuck(), ..."
            )
        if isinstance(prop, CasesProperty):
            raise ScenarioError(
                f"'{prop}' counts the cases of a whole run: check it with tca check, on a journal"
            )
    return checked


def _task(message: Message[Any, Any], call: str) -> Message[Any, Any]:
    if not isinstance(message, Message) or not message.message_class.is_task:
        raise ScenarioError(f"{call}() needs a goal or command, not {message!r}")
    return message
