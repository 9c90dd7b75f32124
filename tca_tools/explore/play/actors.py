"""The running scripts of a play (actors), their connections (lines), and the runs of modules."""

from collections import deque
from dataclasses import dataclass, field
from hashlib import blake2b
from typing import Any

from msgspec.structs import replace

from tca_module.session.request import WAITS_FOR_OTHERS
from tca_tools.explore.play.identifiers import MessageId, RequestNumber
from tca_tools.explore.play.inbox import SlotInbox
from tca_tools.explore.scenario import steps
from tca_tools.explore.scenario.scenario import ScenarioModule
from tca_tools.explore.scenario.script import Program
from tca_tools.explore.scenario.script_connection import CANCELLED, SUSPENDED
from tca_wire.packets.headers import Lock
from tca_wire.points import TaskId


@dataclass(eq=False)
class OpenRequest:
    """A request whose answer is awaited later, with the answers that its script has not read."""

    number: RequestNumber
    header: Any
    unread: deque[steps.StepResult] = field(default_factory=deque)
    is_over: bool = False  #: no further answer follows
    taken: str = ""  #: why a granted lock was taken away


class Actor:
    """A running script."""

    def __init__(
        self,
        program: Program,
        given: steps.HandlerInput,
        delivery: int = 0,
        task: TaskId = TaskId(0),  # noqa: B008
    ) -> None:
        self.program = program
        self.delivery = delivery  #: the delivery that it handles; 0 for a program of a module
        self.task = task  #: the task that it handles; 0 for none
        self.known_ids: list[TaskId] = []  #: the other tasks' ids that it has learned, by place
        self.script_run = program.start(given)
        #: The requests that may still get an answer, or whose lock may be released. The key of a
        #: request is the number of requests that the script had stored before it.
        self.requests: dict[int, OpenRequest] = {}
        self.asked = 0  #: the number of requests that it has stored so far
        self.step: steps.Step | None = None  #: the step whose result it waits for
        self.number = RequestNumber(0)  #: its request without a reply of central; 0 for none
        self.times_out_at: float | None = None  #: when its wait times out; None: never
        self.is_killed = False  #: its task was killed
        self.is_ending = False  #: its module leaves
        self.was_ending = False  #: when it last received a result, its task or module was ending
        self.knows_of_kill = False  #: it has read that its task was killed, or the kill woke it
        self.knows_of_module_end = False  #: it has read that its module ends, or the end woke it
        self.client_requests: deque[steps.StepResult] = deque()  #: the unread requests of clients
        #: The words with which other scripts use the reply that it owes; it has not read them yet.
        self.reply_uses: deque[str] = deque()
        #: Whether its task was suspended: first at the last result, then after each later change.
        self.suspended: tuple[bool, ...] = (False,)

    @property
    def branches(self) -> tuple[steps.Branch, ...]:
        """The ways in which it may continue. Raises ScenarioError."""
        return self.program.branches(self.script_run)

    @property
    def awaited(self) -> OpenRequest | None:
        """The request whose answer it waits for."""
        step = self.step
        return self.requests[step.request] if isinstance(step, steps.AwaitAnswer) else None

    def can_take(self, branch: steps.Branch) -> bool:
        """Whether *branch* reads only what the script can have been notified of by now.

        A branch reads whether the script is CANCELLED or SUSPENDED: decision 1 is yes, decision 0
        is no.
        """
        cancelled = {got.choice for got in branch.decisions if got.kind == CANCELLED}
        suspended = {bool(got.choice) for got in branch.decisions if got.kind == SUSPENDED}
        can_be_cancelled = self.is_killed or self.is_ending or 1 not in cancelled
        can_be_uncancelled = not self.was_ending or 0 not in cancelled
        return can_be_cancelled and can_be_uncancelled and suspended <= {*self.suspended}

    def is_woken_from(self, request: OpenRequest) -> bool:
        """Whether a kill, or the end of the module, interrupts the wait for *request*.

        A kill interrupts one wait only, as in ``Connection.wait``. So does the end of the module.
        """
        if not isinstance(request.header, WAITS_FOR_OTHERS):
            return False
        if self._is_woken_by_kill:
            return not request.unread or request.unread[0].is_void
        return self._is_woken_by_end and not request.unread

    @property
    def _is_woken_by_kill(self) -> bool:
        return self.is_killed and not self.knows_of_kill

    @property
    def _is_woken_by_end(self) -> bool:
        return self.is_ending and not self.knows_of_module_end

    def queue_request(self, got: steps.StepResult) -> None:
        """Queue a client's request to the script's task. A waiting script receives it at once."""
        self.client_requests.append(got)
        if isinstance(self.step, steps.ReadClientRequest):
            self.receive(self.client_requests.popleft())

    def wake_from_read(self) -> None:
        """Interrupt the script's wait for clients if its task was killed or its module ends.

        A kill interrupts one wait only, and so does the end of the module. The end of the module
        also ends the wait of a script that owes a reply.
        """
        by_kill = self._is_woken_by_kill
        if isinstance(self.step, steps.ReadClientRequest) and (by_kill or self._is_woken_by_end):
            self.notice_end()
            self.receive(steps.StepResult(self.step.kind, is_woken=True, module_ends=not by_kill))
        elif isinstance(self.step, steps.OweReply) and self.is_ending:
            self.receive(steps.StepResult(self.step.kind, module_ends=True))

    def use_reply(self, *words: str) -> None:
        """Queue *words* with which another script uses the owed reply; read the oldest words."""
        self.reply_uses.extend(words)
        if isinstance(self.step, steps.OweReply) and self.reply_uses:
            self.receive(steps.StepResult(self.step.kind, words=self.reply_uses.popleft()))
        self.wake_from_read()

    def notice_end(self) -> None:
        """Mark that the script knows of its kill and of the end of its module."""
        self.knows_of_kill, self.knows_of_module_end = self.is_killed, self.is_ending

    def request_end(self, *, module_ends: bool = False) -> None:
        """Signal to the script that it must end: its task was killed, or its module ends."""
        self.is_killed |= not module_ends
        self.is_ending |= module_ends
        if self.suspended[-1]:  # it must end now, not pause
            self.suspended = (*self.suspended, False)
        self.wake_from_read()

    def ask(self, request: OpenRequest) -> None:
        """Store a request that the script has made."""
        self.requests[self.asked] = request
        self.asked += 1

    def read(self) -> None:
        """Receive the next answer to the request that it waits for, or the interruption."""
        assert isinstance(self.step, steps.AwaitAnswer)
        place = self.step.request
        request = self.requests[place]
        if self.is_woken_from(request):
            unread = request.unread or deque([steps.StepResult(self.step.kind)])
            module_ends = not self._is_woken_by_kill
            self.notice_end()
            self.receive(replace(unread.popleft(), is_woken=True, module_ends=module_ends))
        else:
            self.receive(request.unread.popleft())
        # The request for a granted lock stays, since the lock can be released.
        if request.is_over and not request.unread and not isinstance(request.header, Lock):
            del self.requests[place]

    def record(self, *got: steps.StepResult) -> None:
        """Add results to the script's run."""
        if any(result.kind == CANCELLED and result.choice for result in got):
            self.notice_end()
        self.script_run = self.program.extend(self.script_run, *got)

    def receive(self, got: steps.StepResult) -> None:
        """Receive the result of the script's step."""
        self.record(got)
        self.step, self.number, self.times_out_at = None, RequestNumber(0), None
        self.was_ending = self.is_killed or self.is_ending
        self.suspended = self.suspended[-1:]

    def digest(self, before: bytes | None = None) -> bytes:
        """Return a digest of the script's run and of *before*, the same in all explorations."""
        run = repr((before, self.program.name, self.script_run.given, self.script_run.history()))
        return blake2b(run.encode(), digest_size=16).digest()

    def real_id(self, name: int) -> TaskId:
        """Return central's id for a name of the script."""
        if name == steps.OWN:
            return self.task
        return self.known_ids[steps.place_of(name)] if name < steps.OWN else TaskId(name)

    def script_name(self, real: int) -> TaskId:
        """Return the script's name for an id of central."""
        if not real or real == self.task:
            return steps.OWN if real else TaskId(0)
        task = TaskId(MessageId(real))
        if task not in self.known_ids:
            self.known_ids.append(task)
        return steps.known(self.known_ids.index(task))


@dataclass(eq=False)
class ModuleLine:
    """A connection of a module's run to central, and the scripts that use the connection."""

    name: str
    run: "ModuleRun"
    #: The started scripts. Each started while the previous one waited.
    stack: list[Actor] = field(default_factory=list)
    delivered: deque[Actor] = field(default_factory=deque)  #: not started yet
    owing: list[Actor] = field(
        default_factory=list
    )  #: handlers that have returned, and reply later
    inbox: SlotInbox | None = None  #: of a slot with a prefetch

    @property
    def actors(self) -> list[Actor]:
        """All scripts, in the order in which they arrived."""
        return [*self.owing, *self.stack, *self.delivered]

    @property
    def is_idle(self) -> bool:
        """Whether the connection may close: no script uses it.

        With a prefetch, messages that have not started do not prevent that, but held replies do.
        """
        if self.inbox is None:
            return not self.actors
        return not (self.stack or self.owing or self.inbox.session.held_replies.ended)

    @property
    def actor(self) -> Actor | None:
        """The script whose turn it is: one that uses its owed reply, else the newest started one.

        If that waits, the next delivered. None if there is no such script.
        """
        for owing in self.owing:
            if not isinstance(owing.step, steps.OweReply):
                return owing
        newest = self.stack[-1] if self.stack else None
        if self.delivered and (newest is None or isinstance(newest.step, steps.AwaitAnswer)):
            return self.delivered[0]
        return newest

    def start(self, actor: Actor) -> None:
        """Move a delivered script to the stack."""
        if self.delivered and self.delivered[0] is actor:
            self.stack.append(self.delivered.popleft())

    def remove_current(self) -> Actor:
        """Remove the script whose turn it is, and return it."""
        actor = self.actor
        assert actor is not None
        (self.owing if actor in self.owing else self.stack).remove(actor)
        return actor

    def clear(self) -> None:
        """Remove all scripts."""
        self.owing.clear()
        self.stack.clear()
        self.delivered.clear()
        self.inbox = None


class ModuleRun:
    """One run of a module's program, from its start until its last connection is closed."""

    def __init__(self, module: ScenarioModule, number: int) -> None:
        self.module = module
        self.name = module.name if number == 1 else f"{module.name} run {number}"
        self.lines: list[ModuleLine] = []  #: the open connections, the module's own first
        self.steps_joined = 0
        self.first_programs = deque(module.start_programs)  #: to run before it handles anything
        self.is_alive = True
        self.is_leaving = False

    @property
    def is_joined(self) -> bool:
        """Whether the module has completed all its steps of joining.

        The first step is its own hello. If it handles anything or runs a program at its start, its
        registration and a hello of each slot follow.
        """
        is_serving = self.module.formats or self.module.start_programs
        return self.steps_joined == (2 + len(self.module.slots) if is_serving else 1)

    @property
    def is_starting(self) -> bool:
        """Whether it runs the programs that come before its registration."""
        is_first = self.steps_joined == 1 and self.is_alive and not self.is_joined
        return is_first and bool(self.first_programs or self.lines[0].actors)

    def closable_lines(self) -> list[ModuleLine]:
        """Return the lines that a leaving module may close now: idle slots, then its own."""
        if not self.is_leaving:
            return []
        own, *slots = self.lines
        return [line for line in slots if line.is_idle] if slots else [own]

    def die(self) -> None:
        """End the process with all its scripts."""
        self.is_alive = False
        for line in self.lines:
            line.clear()
