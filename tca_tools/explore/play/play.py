"""One state of a run: central, the modules, their scripts, and the actions that are possible next.

An action is a script's next step, a step of joining, a connection that breaks, time that passes to
the next event, and the like. Central handles an action at once. Central's packets arrive at once,
except at slots with a prefetch. Everything goes through central, so interleavings differ only in
the order in which central receives things. Equal actions on equal runs have equal results.
"""

from collections.abc import Callable, Iterator, Sequence
from enum import StrEnum

import msgspec

from tca_central.events import ConnectionLost, Tick
from tca_tools.check.records import MessageRecord
from tca_tools.explore.errors import ScenarioError
from tca_tools.explore.observed.observer import Observer
from tca_tools.explore.play.actors import Actor, ModuleLine, ModuleRun
from tca_tools.explore.play.exchange import OBSERVER, Exchange, connection_of
from tca_tools.explore.play.identifiers import numbers_shown
from tca_tools.explore.play.inbox import SlotInbox
from tca_tools.explore.scenario.scenario import Scenario
from tca_tools.explore.scenario.steps import HandlerInput, ScriptRun, StepResult
from tca_wire.messages.message import with_needed
from tca_wire.packets import headers
from tca_wire.packets.changes import Observe
from tca_wire.packets.headers import PROTOCOL_VERSION
from tca_wire.points import TaskId

OPERATOR = "the operator"
"""The module that kills and suspends tasks where the scenario allows that."""

NOTHING = b"\xc0"  # None as MessagePack


class ActionKind(StrEnum):
    """The kind of an action."""

    STEP = "step"  # a script continues
    RECEIVE = "receive"  # a slot with a prefetch receives the next packet from central
    START = "start"  # a slot with a prefetch starts its next prefetched message
    REPLY = "reply"  # a slot with a prefetch sends the replies that it holds
    TIME = "time"  # time passes until the next event is due
    TIMEOUT = "timeout"  # the wait of a script times out
    JOIN = "join"  # a run of a module takes its next step of joining
    BREAK = "break"  # a connection breaks; the first one ends the module
    LEAVE = "leave"  # a module starts to leave
    GOODBYE = "goodbye"  # a connection of a leaving module says goodbye
    KILL = "kill"  # the operator kills a task
    SUSPEND = "suspend"  # the operator suspends a task
    RESUME = "resume"  # the operator resumes a task


class Action(msgspec.Struct, frozen=True):
    """One action that is possible in a state."""

    kind: ActionKind
    name: str = ""
    """The name of a line, run or message."""
    index: int = 0
    """The place of a branch or task."""
    is_optional: bool = False
    """Whether the action need never happen, as the loss of a module."""


class Play(Exchange):
    """A run so far. Only ``perform`` changes it."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        #: By name: the runs of modules with an open connection.
        self.runs: dict[str, ModuleRun] = {}
        self.losses = {module.name: module.may_be_lost for module in scenario.modules.values()}
        self.kills = dict(scenario.may_be_killed)
        self.suspensions = dict(scenario.may_be_suspended)
        #: By message: the tasks that the operator has suspended.
        self.suspended: dict[str, list[TaskId]] = {name: [] for name in self.suspensions}
        self.queue_groups = scenario.queue_groups()
        self._started = dict.fromkeys(scenario.modules, 0)  #: by module: the number of its runs
        if scenario.is_observed:
            self.observer = Observer()
            name = OBSERVER.decode()
            self.receive(name, headers.Hello(self.next_number(), PROTOCOL_VERSION, name, name))
            self.receive(name, Observe(self.next_number()))
        for module in scenario.modules.values():
            self._start(module.name)
        self._start_all()
        if self.kills or self.suspensions:
            hello = headers.Hello(self.next_number(), PROTOCOL_VERSION, OPERATOR, OPERATOR)
            self.receive(OPERATOR, hello)
        #: The promise that central broke with the last action; "" for none.
        self.broken = next(self._broken(), "")

    # --- possible actions -------------------------------------------------------------------------

    def actions(self) -> list[Action]:
        """Return the actions that are possible now."""
        return [
            *self._steps(),
            *self._with_inboxes(),
            *self._passing_of_time(),
            *self._joins_and_losses(),
            *self._interventions(),
        ]

    def _steps(self) -> Iterator[Action]:
        for line in self.lines.values():
            if (actor := line.actor) is not None and actor.step is None:
                for index, branch in enumerate(actor.branches):
                    if actor.can_take(branch):
                        yield Action(ActionKind.STEP, line.name, index)

    def _with_inboxes(self) -> Iterator[Action]:
        for line in self.lines.values():
            if (inbox := line.inbox) is None:
                continue
            if inbox.session.held_replies.ended:
                yield Action(ActionKind.REPLY, line.name)
            elif inbox.in_transit:
                yield Action(ActionKind.RECEIVE, line.name)
            if inbox.session.may_begin_next and not line.run.is_leaving:
                yield Action(ActionKind.START, line.name)

    def _passing_of_time(self) -> Iterator[Action]:
        if self.next_time is not None:
            yield Action(ActionKind.TIME)
        yield from (
            Action(ActionKind.TIMEOUT, line.name) for line, at in self._timeouts() if at <= self.now
        )

    def _timeouts(self) -> list[tuple[ModuleLine, float]]:
        """Return the lines whose script waits with a timeout, each with the end of the timeout."""
        newest = [(line, line.stack[-1].times_out_at) for line in self.lines.values() if line.stack]
        return [(line, at) for line, at in newest if at is not None]

    @property
    def next_time(self) -> float | None:
        """The time of the next event that is due; None if none is."""
        times = [at for _, at in self._timeouts() if at > self.now]
        due = self.central.clock.next
        return min([*times, due] if due is not None else times, default=None)

    def _joins_and_losses(self) -> Iterator[Action]:
        for run in self.runs.values():
            if run.is_alive:
                if not run.is_joined:
                    if not run.is_starting:
                        yield Action(ActionKind.JOIN, run.name)
                elif run.module.may_leave and not run.is_leaving:
                    yield Action(ActionKind.LEAVE, run.name, is_optional=True)
                yield from (Action(ActionKind.GOODBYE, line.name) for line in run.closable_lines())
            if not run.is_alive or self.losses[run.module.name]:
                yield from (
                    Action(ActionKind.BREAK, line.name, is_optional=run.is_alive)
                    for line in run.lines
                )

    def _interventions(self) -> Iterator[Action]:
        for message, times in self.kills.items():
            for index, _ in enumerate(self.killable(message) if times else []):
                yield Action(ActionKind.KILL, message, index, is_optional=True)
        for message, times in self.suspensions.items():
            for index, _ in enumerate(self.suspendable(message) if times else []):
                yield Action(ActionKind.SUSPEND, message, index, is_optional=True)
            yield from (
                Action(ActionKind.RESUME, message, index)
                for index, _ in enumerate(self.suspended[message])
            )

    def killable(self, message: str) -> list[MessageRecord]:
        """Return the tasks of *message* that the operator may kill."""
        return [
            task
            for task in self.world.tasks
            if task.message == message and not (task.is_killed or task.is_over)
        ]

    def suspendable(self, message: str) -> list[MessageRecord]:
        """Return the tasks of *message* that the operator may suspend."""
        return [task for task in self.killable(message) if not task.is_suspended]

    # --- actions played ---------------------------------------------------------------------------

    def perform(self, action: Action) -> None:
        """Perform an action.

        Raises:
            ScenarioError: a script can't be played.
            CentralFault: central raised an error.
        """
        self.facts, self.taken = [], None
        self.world.violations.clear()
        self.world.forget()
        _PERFORM[action.kind](self, action)
        self._advance_all()
        self.broken = next(self._broken(), "")

    def _broken(self) -> Iterator[str]:
        """Yield the promises that central broke with the last action."""
        yield from (violation.what for violation in self.world.violations)
        if self.observer is not None:
            with numbers_shown():
                yield from filter(None, [self.observer.breach(self.world)])
        for line in self.lines.values():
            if line.inbox is not None and (wrong := self.inbox_mismatch(line, line.inbox)):
                yield wrong

    def _advance_all(self) -> None:
        for line in list(self.lines.values()):
            if line.stack or line.owing:
                self.advance(line)
            while line.run.is_starting and not line.stack and line is line.run.lines[0]:
                line.stack.append(Actor(line.run.first_programs.popleft(), HandlerInput(NOTHING)))
                self.advance(line)

    def _take_step(self, action: Action) -> None:
        line = self.lines[action.name]
        actor = line.actor
        assert actor is not None
        line.start(actor)
        script_run, branch = actor.script_run, actor.branches[action.index]
        actor.record(*branch.decisions)
        actor.step = branch.step
        try:
            self.carry_out(line, actor)
        except ScenarioError as error:
            raise ScenarioError(
                f"{actor.program.place_of_step(script_run, branch)}: {error}"
            ) from None

    def inbox(self, action: Action) -> SlotInbox:
        """Return the inbox of the slot that *action* is about."""
        inbox = self.lines[action.name].inbox
        assert inbox is not None
        return inbox

    def _receive_packet(self, action: Action) -> None:
        inbox = self.inbox(action)
        self.receive_packet(self.lines[action.name], inbox, *inbox.in_transit.popleft())

    def _pass_time(self, _: Action) -> None:
        assert self.next_time is not None
        self.now = self.next_time
        self.world.advance_to(self.now)
        self.handle(Tick(self.now))

    def _time_out(self, action: Action) -> None:
        actor = self.lines[action.name].stack[-1]
        assert actor.step is not None
        actor.receive(StepResult(actor.step.kind, is_late=True))

    # --- modules come and go ----------------------------------------------------------------------

    def _start(self, module: str) -> ModuleRun:
        self._started[module] += 1
        run = ModuleRun(self.scenario.modules[module], self._started[module])
        self.runs[run.name] = run
        return run

    def _start_all(self) -> None:
        """Let modules join until none can continue.

        A module that still waits for another one, or has a choice, continues to join in the run.
        """
        has_moved = True
        while has_moved:
            has_moved = False
            for run in self.runs.values():
                while self._start_further(run):
                    has_moved = True

    def _start_further(self, run: ModuleRun) -> bool:
        """Take the next step of a module that joins before the run.

        Return False if it has no next step, or a choice of several.
        """
        if run.module.arrives_late or run.is_joined:
            return False
        if not run.is_starting:
            self._join(run)
        else:
            actor = run.lines[0].actor
            if actor is None or actor.step is not None or len(actor.branches) > 1:
                return False
            self._take_step(Action(ActionKind.STEP, run.lines[0].name))
        self._advance_all()
        return True

    def _join(self, run: ModuleRun) -> None:
        """Take the next step of joining."""
        module, done = run.module, run.steps_joined
        if done == 1:
            programs = module.handlers.values()
            handled = [one.message for one in programs if one.message]
            messages = [message.format for message in with_needed(handled)]
            self.receive(run.name, headers.Register(self.next_number(), messages, module.formats))
        else:
            resource = module.slots[done - 2] if done else ""
            line = ModuleLine(f"{run.name}/{done - 1}" if done else run.name, run)
            run.lines.append(line)
            self.lines[line.name] = line
            hello = headers.Hello(
                self.next_number(),
                PROTOCOL_VERSION,
                module.name,
                run.name,
                done,
                resource,
                prefetch=module.prefetch or 0,
            )
            line.inbox = SlotInbox(hello) if done and module.prefetch is not None else None
            self.receive(line.name, hello)
        run.steps_joined += 1
        if run.is_joined and module.own_program:
            run.lines[0].stack.append(Actor(module.own_program, HandlerInput(NOTHING)))

    def _break(self, action: Action) -> None:
        line = self.lines[action.name]
        run = line.run
        if run.is_alive:
            run.die()
            self.losses[run.module.name] -= 1
            if run.module.comes_back:
                self._start(run.module.name)
        self._close(line)
        self.handle(ConnectionLost(self.now, connection_of(line.name)))

    def _close(self, line: ModuleLine) -> None:
        line.run.lines.remove(line)
        del self.lines[line.name]
        if not line.run.lines:
            del self.runs[line.run.name]

    def _leave(self, action: Action) -> None:
        run = self.runs[action.name]
        run.is_leaving = True
        run.lines[0].clear()
        for actor in (actor for line in run.lines for actor in line.actors):
            actor.request_end(module_ends=True)
        self.receive(run.name, headers.Unregister(self.next_number(), []))

    def _say_goodbye(self, action: Action) -> None:
        line = self.lines[action.name]
        if line.inbox is not None:
            self.return_prefetched(line, line.inbox)
        self._close(line)
        self.receive(line.name, headers.Bye())

    def _kill(self, action: Action) -> None:
        self.kills[action.name] -= 1
        task = self.killable(action.name)[action.index]
        self.receive(OPERATOR, headers.Kill(self.next_number(), TaskId(task.id)))

    def _suspend(self, action: Action) -> None:
        self.suspensions[action.name] -= 1
        task = TaskId(self.suspendable(action.name)[action.index].id)
        self.suspended[action.name].append(task)
        self.receive(OPERATOR, headers.Suspend(self.next_number(), task))

    def _resume(self, action: Action) -> None:
        task = self.suspended[action.name].pop(action.index)
        self.receive(OPERATOR, headers.Suspend(self.next_number(), task, resume=True))


# ruff: noqa: SLF001
_PERFORM: dict[ActionKind, Callable[[Play, Action], object]] = {
    ActionKind.STEP: Play._take_step,
    ActionKind.RECEIVE: Play._receive_packet,
    ActionKind.START: lambda play, action: play.start_next(
        play.lines[action.name], play.inbox(action)
    ),
    ActionKind.REPLY: lambda play, action: play.flush(action.name, play.inbox(action)),
    ActionKind.TIME: Play._pass_time,
    ActionKind.TIMEOUT: Play._time_out,
    ActionKind.JOIN: lambda play, action: play._join(play.runs[action.name]),
    ActionKind.BREAK: Play._break,
    ActionKind.LEAVE: Play._leave,
    ActionKind.GOODBYE: Play._say_goodbye,
    ActionKind.KILL: Play._kill,
    ActionKind.SUSPEND: Play._suspend,
    ActionKind.RESUME: Play._resume,
}


def outcome(play: Play) -> bytes:
    """Return the end of a run: results, open scripts and messages, and mishaps that did not happen.

    Equal ends are equal bytes, in all explorations.
    """
    unfinished = {
        name: [actor.digest() for actor in line.actors] for name, line in sorted(play.lines.items())
    }
    left = sorted(
        (one.message, one.body, one.module) for one in play.world.messages if not one.is_over
    )
    return repr(
        (sorted(play.digests.items()), unfinished, left, play.losses, play.kills, play.suspensions)
    ).encode()


Waiter = tuple[int] | tuple[Actor, ScriptRun]
"""The id of a task that is held or queued; or a script, with its run so far."""


def waiters(play: Play) -> list[Waiter]:
    """Return all waiters: first tasks without open tasks below them, oldest first; then scripts."""
    tasks = play.world.tasks
    parents = {task.parent_id for task in tasks if not task.is_over}
    return [
        *((task.id,) for task in tasks if _is_waiting(task) and task.id not in parents),
        *(
            (actor, actor.script_run)
            for name in sorted(play.lines)
            for actor in play.lines[name].actors
            if actor.step is not None
        ),
    ]


def still_waiting(before: Sequence[Waiter], play: Play) -> tuple[int, ...]:
    """Return the place of each waiter of *before* among the present ones; -1: it waits no more."""
    now = waiters(play)
    return tuple(now.index(waiter) if waiter in now else -1 for waiter in before)


def _is_waiting(task: MessageRecord) -> bool:
    """Whether a task is held or queued. Monitors never are: central itself carries them out."""
    return not (task.is_over or task.is_handled or task.message_class.is_monitor)
