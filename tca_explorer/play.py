"""One run of a scenario, at one moment: central, the modules and their scripts, and what may happen next.

Theory of operation. An action is one thing that happens: a script takes its next step, a module joins, a connection
breaks. Each is at most a few events that central handles at once, and what central sends is received at once, too: all
that modules can do to each other goes through central, so the order in which central receives things is all that
interleavings can differ in. Equal actions on equal runs have equal results.
"""

from collections.abc import Callable, Iterator
from enum import StrEnum
from typing import Any

import msgspec

from tca_central.core import Central
from tca_central.events import ConnectionId, ConnectionLost, Event, Received, Record
from tca_explorer.actors import Actor, Line, Run
from tca_explorer.errors import CentralFault, ScenarioError
from tca_explorer.marks import Id, Number
from tca_explorer.scenario import Scenario
from tca_explorer.steps import AddConstraints, Fail, Got, Hang, KillTask, Return, Say, Step, WaitUntil
from tca_explorer.world import Seen, World
from tca_wire import headers
from tca_wire.controls import PointMonitor
from tca_wire.declarations import Message
from tca_wire.facts import Fact
from tca_wire.facts import Received as Birth
from tca_wire.headers import PROTOCOL_VERSION
from tca_wire.parts import MessageFormat
from tca_wire.points import TaskId
from tca_wire.vocabulary import MessageClass, Outcome

SOMEBODY = "somebody"
"""The module that kills what may be killed."""

_NOW = 0.0
"""Time stands still: nothing in central depends on it yet. That time passes would be one more kind of action."""

_NOTHING = b"\xc0"  # None as MessagePack


class Kind(StrEnum):
    """What an action is."""

    STEP = "step"  # a script goes on
    JOIN = "join"  # a run of a module takes its next step of joining
    BREAK = "break"  # a connection breaks: its module dies with it, or has
    LEAVE = "leave"  # a module begins to leave
    BYE = "bye"  # a connection of a leaving module says goodbye
    KILL = "kill"  # somebody kills a task


class Action(msgspec.Struct, frozen=True):
    """One thing that may happen. *name* is a line's, run's or message's; *index* says which branch or task."""

    kind: Kind
    name: str
    index: int = 0
    is_optional: bool = False
    """It need not happen."""


class Play:
    """A run so far. ``perform`` is the only way it changes."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.central = Central("explored")
        self.central.tree.newest = Id(0)
        self.world = World()
        self.runs: dict[str, Run] = {}  #: of modules, by name, until their last connection has ended
        self.lines: dict[str, Line] = {}  #: connections that central has not seen end
        self.losses = {module.name: module.may_be_lost for module in scenario.modules.values()}
        self.kills = dict(scenario.may_be_killed)
        self.facts: list[Fact] = []  #: recorded with the last action
        self.names: dict[int, str] = {}  #: of all messages ever sent; for people
        self._started = dict.fromkeys(scenario.modules, 0)  #: how often
        self.rivals = scenario.rivals()  #: by message: which may wait for the same resource
        self._known = scenario.messages()
        self._number = Number(0)
        for module in scenario.modules.values():
            run = self._start(module.name)
            while not (module.arrives_late or run.is_joined):
                self._join(run)
        if self.kills:
            self._receive(SOMEBODY, headers.Hello(self._next_number(), PROTOCOL_VERSION, SOMEBODY, SOMEBODY))

    # --- what may happen ---------------------------------------------------------------------------------------------

    def actions(self) -> list[Action]:
        """Everything that may happen now."""
        return [*self._steps(), *self._comings_and_goings(), *self._kills()]

    def _steps(self) -> Iterator[Action]:
        for line in self.lines.values():
            if line.stack and (actor := line.stack[-1]).step is None:
                for index, branch in enumerate(actor.branches):
                    if actor.may_take(branch):
                        yield Action(Kind.STEP, line.name, index)

    def _comings_and_goings(self) -> Iterator[Action]:
        for run in self.runs.values():
            if run.is_alive:
                if not run.is_joined:
                    yield Action(Kind.JOIN, run.name)
                elif run.module.may_leave and not run.is_leaving:
                    yield Action(Kind.LEAVE, run.name, is_optional=True)
                yield from (Action(Kind.BYE, line.name) for line in run.may_say_goodbye())
            if not run.is_alive or self.losses[run.module.name]:
                yield from (Action(Kind.BREAK, line.name, is_optional=run.is_alive) for line in run.lines)

    def _kills(self) -> Iterator[Action]:
        for message, times in self.kills.items():
            for index, _ in enumerate(self.killable(message) if times else []):
                yield Action(Kind.KILL, message, index, is_optional=True)

    def killable(self, message: str) -> list[Seen]:
        """The tasks of that message which somebody may kill."""
        return [task for task in self.world.tasks if task.message == message and not (task.is_killed or task.is_over)]

    # --- what happens ------------------------------------------------------------------------------------------------

    def perform(self, action: Action) -> None:
        """Let an action happen. Raises ScenarioError if a script can't go on, CentralFault if central can't."""
        self.facts = []
        self.world.forget_what_is_over()
        _PERFORM[action.kind](self, action)

    def _take_step(self, action: Action) -> None:
        line = self.lines[action.name]
        actor = line.stack[-1]
        branch = actor.branches[action.index]
        actor.history += branch.decisions
        actor.step = branch.step
        _TAKE[type(branch.step)](self, line, actor, branch.step)
        self._end_story(line)

    def _say(self, line: Line, actor: Actor, step: Say) -> None:
        message = step.message
        self._declare(line, message)
        is_told = message.message_class in (MessageClass.INFORM, MessageClass.BROADCAST)
        if is_told:
            actor.get(Got(step.kind))
        else:
            actor.number = self._next_number()
        is_task = message.message_class.is_task
        header = headers.Send(
            Number(0) if is_told else actor.number, message.name, actor.task if is_task else TaskId(0), actor.delivery,
            step.flags, actor.real_constraints(step.constraints), step.priority, not is_told and not is_task,
            step.maximum,
        )  # fmt: skip
        self._receive(line.name, header, step.body)

    def _declare(self, line: Line, message: Message[Any, Any]) -> None:
        """A module declares a message when it first sends it."""
        known = self._known.get(message.name)
        fans_out = message.message_class in (MessageClass.BROADCAST, MessageClass.MULTI_QUERY)
        parts = message.parts if isinstance(message, PointMonitor) else ()
        for part in parts:
            if part is not None:
                self._declare(line, part)
        if known is None and not fans_out and not parts:
            text = f"{line.run.name} sends {message.message_class} '{message.name}', which no module of the scenario"
            raise ScenarioError(f"{text} handles: give one a handler for it")
        if message.name not in self.central.registry.messages:
            self._receive(line.name, headers.Register(self._next_number(), [_format(message)]))

    def _wait(self, line: Line, actor: Actor, step: WaitUntil) -> None:
        actor.number = self._next_number()
        self._receive(line.name, headers.WaitFor(actor.number, actor.real_point(step.point), actor.delivery))

    def _kill_task(self, line: Line, actor: Actor, step: KillTask) -> None:
        actor.number = self._next_number()
        self._receive(line.name, headers.Kill(actor.number, actor.real(step.task)))

    def _add_constraints(self, line: Line, actor: Actor, step: AddConstraints) -> None:
        actor.number = self._next_number()
        self._receive(line.name, headers.Constrain(actor.number, actor.real_constraints(step.constraints)))

    def _return(self, line: Line, actor: Actor, step: Return) -> None:
        line.stack.pop()
        if actor.delivery:
            self._receive(line.name, headers.Reply(actor.delivery), step.body)

    def _fail(self, line: Line, actor: Actor, step: Fail) -> None:
        line.stack.pop()
        if actor.delivery:
            self._receive(line.name, headers.Fail(actor.delivery, step.failure, step.text), step.body)

    def _hang(self, _line: Line, _actor: Actor, _step: Step) -> None:
        """It never gets anything for that step."""

    def _end_story(self, line: Line) -> None:
        """That a module has nothing more to do by itself is no action: nobody can tell."""
        actor = line.stack[-1] if line.stack else None
        if actor is not None and not actor.delivery and actor.step is None and _only_returns(actor):
            line.stack.pop()

    # --- modules come and go -----------------------------------------------------------------------------------------

    def _start(self, module: str) -> Run:
        self._started[module] += 1
        run = Run(self.scenario.modules[module], self._started[module])
        self.runs[run.name] = run
        return run

    def _join(self, run: Run) -> None:
        """The next step of joining."""
        module, done = run.module, run.steps_joined
        if done == 1:
            messages = [_format(program.message) for program in module.handlers.values() if program.message]
            self._receive(run.name, headers.Register(self._next_number(), messages, module.formats))
        else:
            resource = module.slots[done - 2] if done else ""
            line = Line(f"{run.name}/{done - 1}" if done else run.name, run)
            run.lines.append(line)
            self.lines[line.name] = line
            hello = headers.Hello(self._next_number(), PROTOCOL_VERSION, module.name, run.name, done, resource)
            self._receive(line.name, hello)
        run.steps_joined += 1
        if run.is_joined and module.story:
            run.lines[0].stack.append(Actor(module.story, _NOTHING))

    def _break(self, action: Action) -> None:
        line = self.lines[action.name]
        run = line.run
        if run.is_alive:
            run.die()
            self.losses[run.module.name] -= 1
            if run.module.comes_back:
                self._start(run.module.name)
        self._close(line)
        self._handle(ConnectionLost(_NOW, connection_of(line.name)))

    def _close(self, line: Line) -> None:
        line.run.lines.remove(line)
        del self.lines[line.name]
        if not line.run.lines:
            del self.runs[line.run.name]

    def _leave(self, action: Action) -> None:
        run = self.runs[action.name]
        run.is_leaving = True
        run.lines[0].stack.clear()
        self._receive(run.name, headers.Unregister(self._next_number(), []))

    def _say_goodbye(self, action: Action) -> None:
        line = self.lines[action.name]
        self._close(line)
        self._receive(line.name, headers.Bye())

    def _kill(self, action: Action) -> None:
        self.kills[action.name] -= 1
        task = self.killable(action.name)[action.index]
        self._receive(SOMEBODY, headers.Kill(self._next_number(), TaskId(task.id)))

    # --- between the modules and central -----------------------------------------------------------------------------

    def _next_number(self) -> Number:
        self._number += 1
        return self._number

    def _receive(self, line: str, header: headers.ToCentral, body: bytes = b"") -> None:
        self._handle(Received(_NOW, connection_of(line), header, body))

    def _handle(self, event: Event) -> None:
        """Let central handle an event, and everybody get what it sends."""
        try:
            effects = self.central.handle(event)
        except Exception as error:
            raise CentralFault(f"central can't handle {event}: {error!r}") from error
        for effect in effects:
            if isinstance(effect, Record):
                self._record(effect.entry.facts)
            elif get := _GET.get(type(effect.header)):
                line = self.lines.get(effect.connection.decode())
                if line is not None and line.run.is_alive:
                    get(self, line, effect.header, effect.body)

    def _record(self, recorded: list[Fact]) -> None:
        self.facts += recorded
        self.world.take(recorded)
        self.names.update({fact.id: fact.message for fact in recorded if isinstance(fact, Birth)})

    def _get_delivery(self, line: Line, header: headers.Deliver, body: bytes) -> None:
        program = line.run.module.handlers[header.message]
        line.stack.append(Actor(program, body, header.delivery, header.task))

    def _get_accepted(self, line: Line, header: headers.Accepted, _: bytes) -> None:
        actor, step = _waiting(line, header.number)
        if actor and step:
            if isinstance(step, Say):
                actor.sent.append(TaskId(header.id))
            actor.get(Got(step.kind))

    def _get_refused(self, line: Line, header: headers.Refused, _: bytes) -> None:
        actor, step = _waiting(line, header.number)
        if actor and step:
            actor.refusal = header.text
            actor.get(Got(step.kind, header.refusal))

    def _get_answer(self, line: Line, header: headers.Answer, body: bytes) -> None:
        actor, step = _waiting(line, header.number)
        if actor and step:
            if header.more or (header.outcome is Outcome.DONE and _is_query(step)):
                actor.bodies += (body,)
            if not header.more:
                actor.get(Got(step.kind, header.outcome, header.failure, actor.bodies))
                self._end_story(line)

    def _get_cancelled(self, line: Line, header: headers.Cancelled, _: bytes) -> None:
        for actor in line.stack:
            actor.is_told = actor.is_told or actor.delivery == header.delivery


def _waiting(line: Line, number: int) -> tuple[Actor | None, Step | None]:
    """The actor that waits for the answer to that request, and its step."""
    found = next((actor for actor in line.stack if number and actor.number == number), None)
    return found, found.step if found else None


def _only_returns(actor: Actor) -> bool:
    return [type(branch.step) for branch in actor.branches] == [Return]


def _is_query(step: Step) -> bool:
    return isinstance(step, Say) and step.message.message_class is MessageClass.QUERY


def _format(message: Message[Any, Any]) -> MessageFormat:
    """What central is told of a message; scenarios may send other data than the robot does, so no formats."""
    parts = message.format.parts if isinstance(message, PointMonitor) else []
    return MessageFormat(message.name, message.message_class, "", parts=parts)


def connection_of(name: str) -> ConnectionId:
    """The id by which central knows a line."""
    return ConnectionId(name.encode())


# ruff: noqa: SLF001
_PERFORM: dict[Kind, Callable[[Play, Action], None]] = {
    Kind.STEP: Play._take_step,
    Kind.JOIN: lambda play, action: play._join(play.runs[action.name]),
    Kind.BREAK: Play._break,
    Kind.LEAVE: Play._leave,
    Kind.BYE: Play._say_goodbye,
    Kind.KILL: Play._kill,
}
_TAKE: dict[type, Callable[[Play, Line, Actor, Any], None]] = {
    Say: Play._say,
    WaitUntil: Play._wait,
    KillTask: Play._kill_task,
    AddConstraints: Play._add_constraints,
    Return: Play._return,
    Fail: Play._fail,
    Hang: Play._hang,
}
_GET: dict[type, Callable[[Play, Line, Any, bytes], None]] = {
    headers.Deliver: Play._get_delivery,
    headers.Accepted: Play._get_accepted,
    headers.Refused: Play._get_refused,
    headers.Answer: Play._get_answer,
    headers.Cancelled: Play._get_cancelled,
}
