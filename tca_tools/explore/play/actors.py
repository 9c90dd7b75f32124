"""The scripts under way in a run (actors), the connections that they act on (lines), and the runs
of modules.
"""

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
    """A request of a script that wants an answer: the answers that it has not read."""

    number: RequestNumber
    header: Any
    unread: deque[steps.StepResult] = field(default_factory=deque)
    is_over: bool = False  #: nothing more comes
    taken: str = ""  #: of a lock that was granted: how it was lost


class Actor:
    """A script under way."""

    def __init__(
        self,
        program: Program,
        given: steps.HandlerInput,
        delivery: int = 0,
        task: TaskId = TaskId(0),  # noqa: B008
    ) -> None:
        self.program = program
        self.delivery = delivery  #: that it handles; 0: none, a module does this by itself
        self.task = task  #: that it handles; 0: none
        self.known: list[TaskId] = []  #: other things it has heard of, by place
        self.script_run = program.start(given)
        self.requests: dict[
            int, OpenRequest
        ] = {}  #: by place; those of which nothing more can come are left out
        self.asked = 0  #: how many there were
        self.step: steps.Step | None = None  #: that it is waiting to get something for
        self.number = RequestNumber(0)  #: of what it has just asked
        self.times_out_at: float | None = None  #: when it waits no longer
        self.is_killed = False  #: that its task was killed
        self.is_ending = False  #: its module leaves
        self.was_ending = False  #: one of these, when it last got something
        self.knows_of_kill = False  #: that its task was killed: it has read that, or was woken
        self.knows_of_module_end = False  #: that its module ends, in the same way
        self.client_requests: deque[steps.StepResult] = deque()  #: of clients, that it has not read
        self.reply_uses: deque[str] = (
            deque()
        )  #: of the reply that it leaves to others, in their words
        self.suspended: tuple[bool, ...] = (False,)  #: the news of that since it last got something

    @property
    def branches(self) -> tuple[steps.Branch, ...]:
        """How it may go on. Raises ScenarioError."""
        return self.program.branches(self.script_run)

    @property
    def awaited(self) -> OpenRequest | None:
        """The request whose answer it waits for."""
        return (
            self.requests[self.step.request] if isinstance(self.step, steps.AwaitAnswer) else None
        )

    def can_take(self, branch: steps.Branch) -> bool:
        """Whether *branch* reads of a kill, and of its suspension, only what it can have been
        told.
        """
        read = [got.choice for got in branch.decisions if got.kind == CANCELLED]
        if not (
            (self.is_killed or self.is_ending or 1 not in read)
            and (not self.was_ending or 0 not in read)
        ):
            return False
        return all(
            bool(got.choice) in self.suspended for got in branch.decisions if got.kind == SUSPENDED
        )

    def is_woken_from(self, request: OpenRequest) -> bool:
        """Whether it waits no longer for an answer because its task was killed, or its module ends:
        once for each, as Connection.wait has it.
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
        """A client wants something of its task."""
        self.client_requests.append(got)
        if isinstance(self.step, steps.ReadClientRequest):
            self.receive(self.client_requests.popleft())

    def wake_from_read(self) -> None:
        """It waits no longer for what clients want: its task was killed, or its module ends; once
        for each. Where it owes its reply, that has failed when its module ends.
        """
        by_kill = self._is_woken_by_kill
        if isinstance(self.step, steps.ReadClientRequest) and (by_kill or self._is_woken_by_end):
            self.notice_end()
            self.receive(steps.StepResult(self.step.kind, is_woken=True, module_ends=not by_kill))
        elif isinstance(self.step, steps.OweReply) and self.is_ending:
            self.receive(steps.StepResult(self.step.kind, module_ends=True))

    def use_reply(self, *words: str) -> None:
        """Others say these *words* of the reply that it leaves to them."""
        self.reply_uses.extend(words)
        if isinstance(self.step, steps.OweReply) and self.reply_uses:
            self.receive(steps.StepResult(self.step.kind, words=self.reply_uses.popleft()))
        self.wake_from_read()

    def notice_end(self) -> None:
        """It knows_of_kill all by now."""
        self.knows_of_kill, self.knows_of_module_end = self.is_killed, self.is_ending

    def request_end(self, *, module_ends: bool = False) -> None:
        """It is to end: its task was killed, or its module ends."""
        self.is_killed, self.is_ending = (
            self.is_killed or not module_ends,
            self.is_ending or module_ends,
        )
        if self.suspended[-1]:  # it is to end, not to hold
            self.suspended = (*self.suspended, False)
        self.wake_from_read()

    def ask(self, request: OpenRequest) -> None:
        """It has made a request."""
        self.requests[self.asked] = request
        self.asked += 1

    def read(self) -> None:
        """It gets the answer that is there to what it waits for, or is woken."""
        assert isinstance(self.step, steps.AwaitAnswer)
        place = self.step.request
        request = self.requests[place]
        if self.is_woken_from(request):
            answer = (
                request.unread.popleft() if request.unread else steps.StepResult(self.step.kind)
            )
            answer = replace(answer, is_woken=True, module_ends=not self._is_woken_by_kill)
            self.notice_end()
            self.receive(answer)
        else:
            self.receive(request.unread.popleft())
        if (
            request.is_over and not request.unread and not isinstance(request.header, Lock)
        ):  # one can be given back
            del self.requests[place]

    def record(self, *got: steps.StepResult) -> None:
        """That is part of its script_run now."""
        if any(one.kind == CANCELLED and one.choice for one in got):
            self.notice_end()
        self.script_run = self.program.extend(self.script_run, *got)

    def receive(self, got: steps.StepResult) -> None:
        """Something came back for its step."""
        self.record(got)
        self.step, self.number, self.times_out_at = None, RequestNumber(0), None
        self.was_ending = self.is_killed or self.is_ending
        self.suspended = self.suspended[-1:]

    def digest(self, before: bytes | None = None) -> bytes:
        """What it did and got, after what was there *before*; the same in all explorations."""
        lived = repr((before, self.program.name, self.script_run.given, self.script_run.history()))
        return blake2b(lived.encode(), digest_size=16).digest()

    def real_id(self, name: int) -> TaskId:
        """Central's id of what the script names."""
        if name == steps.OWN:
            return self.task
        return self.known[steps.place_of(name)] if name < steps.OWN else TaskId(name)

    def script_name(self, real: int) -> TaskId:
        """The script's name for what central calls so."""
        if not real or real == self.task:
            return steps.OWN if real else TaskId(0)
        task = TaskId(MessageId(real))
        if task not in self.known:
            self.known.append(task)
        return steps.known(self.known.index(task))


@dataclass(eq=False)
class ModuleLine:
    """A connection of a module's run to central, and what is being done on it."""

    name: str
    run: "ModuleRun"
    stack: list[Actor] = field(default_factory=list)  #: each began while the one before it waited
    delivered: deque[Actor] = field(default_factory=deque)  #: not begun yet
    inbox: SlotInbox | None = None  #: of a slot that may have messages ahead

    @property
    def actors(self) -> list[Actor]:
        """All of them, in the order in which they came."""
        return [*self.stack, *self.delivered]

    @property
    def is_idle(self) -> bool:
        """Whether it may end. What it has not begun goes to another: that is explored where
        messages may be ahead.
        """
        return not (
            self.actors if self.inbox is None else self.stack or self.inbox.session.held.ended
        )

    @property
    def actor(self) -> Actor | None:
        """Whose turn it is: the newest that has begun or, where that one waits, the next."""
        newest = self.stack[-1] if self.stack else None
        if self.delivered and (newest is None or isinstance(newest.step, steps.AwaitAnswer)):
            return self.delivered[0]
        return newest

    def start(self, actor: Actor) -> None:
        """It is its turn."""
        if self.delivered and self.delivered[0] is actor:
            self.stack.append(self.delivered.popleft())

    def clear(self) -> None:
        """Nothing is done here any more."""
        self.stack.clear()
        self.delivered.clear()
        self.inbox = None


class ModuleRun:
    """One run of a module's program, from its start until its last connection has ended."""

    def __init__(self, module: ScenarioModule, number: int) -> None:
        self.module = module
        self.name = module.name if number == 1 else f"{module.name} run {number}"
        self.lines: list[
            ModuleLine
        ] = []  #: those that central has not seen end; the module's own first
        self.steps_joined = 0
        self.first = deque(module.start_programs)  #: programs to run before it handles anything
        self.is_alive = True
        self.is_leaving = False

    @property
    def is_joined(self) -> bool:
        """Whether it has said hello; and, where it handles anything, what, and has said hello for
        each slot.
        """
        is_serving = self.module.formats or self.module.start_programs
        return self.steps_joined == (2 + len(self.module.slots) if is_serving else 1)

    @property
    def is_starting(self) -> bool:
        """Whether it does what it does before it handles anything."""
        is_first = self.steps_joined == 1 and self.is_alive and not self.is_joined
        return is_first and bool(self.first or self.lines[0].actors)

    def closable_lines(self) -> list[ModuleLine]:
        """Those of its lines that may end now because it leaves: what does nothing, its own line
        last.
        """
        if not self.is_leaving:
            return []
        own, *slots = self.lines
        return [line for line in slots if line.is_idle] if slots else [own]

    def die(self) -> None:
        """Its process is gone, and with it all that it was doing."""
        self.is_alive = False
        for line in self.lines:
            line.clear()
