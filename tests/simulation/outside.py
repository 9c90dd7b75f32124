"""The world outside of all processes, which no crash affects: the runs of handlers, and the
promises made to users.

Every message carries a token of its own as data. The promises are those of dev/records/promises.md. No
acknowledged task is lost, and no command starts twice without notice. Constraints hold, locks
exclude handlers, and each result is one that a handler returned.
"""

from collections import defaultdict
from typing import Any, NamedTuple

import msgspec
from simulation.clockwork import Broken, Clockwork
from simulation.threads import Failing, Process, Thread, Work

from tca_wire.journal import facts
from tca_wire.journal.facts import Entry
from tca_wire.messages.failures import MODULE_LOST, UNCERTAIN
from tca_wire.packets import headers
from tca_wire.vocabulary import Outcome

decode, encode = msgspec.msgpack.decode, msgspec.msgpack.encode
LOSSES = frozenset((MODULE_LOST, UNCERTAIN))


class Run:
    """One run of a handler, as seen from outside."""

    __slots__ = (
        "began",
        "delivery",
        "ended",
        "failure",
        "is_lost",
        "message",
        "module",
        "process",
        "reply",
        "resource",
        "task",
        "token",
    )

    def __init__(self, work: Work, header: headers.Deliver, token: int, began: float) -> None:
        thread = work.thread
        self.process, self.module, self.resource = (
            thread.process,
            thread.session.module,
            thread.resource,
        )
        self.message, self.delivery, self.task = header.message, header.delivery, int(header.task)
        self.token, self.began = token, began
        self.ended = -1.0  #: below 0 before its end
        self.reply = b""
        self.failure = ""
        self.is_lost = False  #: its process has ended, or central has given its connection up

    @property
    def goes_on(self) -> bool:
        return self.ended < 0 and not self.is_lost

    def __str__(self) -> str:
        return f"'{self.message}' (token {self.token}, task {self.task}, delivery {self.delivery}) in {self.process.name}"


class Sent(NamedTuple):
    """A sent message."""

    token: int
    message: str
    above: int  #: token of its parent (0: the root)
    after: tuple[int, ...]  #: tokens of its predecessors
    not_before: float


class Claim(NamedTuple):
    """A lock that central has granted."""

    module: str
    resource: str
    is_reserved: bool
    sender: str
    origin: int


class Outside:
    """Everything observed in a life."""

    def __init__(self, clockwork: Clockwork, *, is_lossy: bool = False) -> None:
        self.clockwork = clockwork
        self.is_lossy = is_lossy  #: whether central may forget acknowledged messages
        self.tokens = 0
        self.sent: dict[int, Sent] = {}
        self.under: defaultdict[int, list[int]] = defaultdict(list)
        self.followed_by: defaultdict[int, list[int]] = defaultdict(list)
        self.runs: list[Run] = []
        self.at_work: dict[Work, Run] = {}
        self.of_token: defaultdict[int, list[Run]] = defaultdict(list)
        self.of_task: defaultdict[int, list[Run]] = defaultdict(list)
        self.deliveries: dict[int, Run] = {}
        self.task_of: dict[int, int] = {}  #: by token: the acknowledged task
        self.asked_again: defaultdict[int, int] = defaultdict(int)  #: by task: requested retries
        self.outcomes: dict[int, tuple[Outcome, str, bytes]] = {}  #: by token: the outcome received
        self.informs: dict[Any, list[int]] = {}  #: by sender: the tokens, in order
        self.heard: defaultdict[tuple[Any, str], list[int]] = defaultdict(list)
        self.sender_of: dict[int, Any] = {}
        self.lock_ended: dict[Claim, float] = {}
        self.counts: defaultdict[str, int] = defaultdict(int)
        self._begin_journal()

    def _begin_journal(self) -> None:
        """Clear the state that the journal gives."""
        self.known: set[int] = set()
        self.ended: set[int] = set()
        self.killed: set[int] = set()
        self.lost_tasks: set[int] = set()
        self.dropped = 0
        self.wanted: dict[int, Claim] = {}
        self.granted: dict[int, Claim] = {}
        self.tasks: set[int] = set()
        self.are_tasks_paused = False
        self.newest = 0

    def trace(self, who: str, what: object) -> None:
        self.clockwork.trace(who, what)

    # --- programs ---------------------------------------------------------------------------------

    def sends(
        self,
        message: str,
        above: int = 0,
        after: tuple[int, ...] = (),
        not_before: float = 0.0,
        sender: Any = None,
    ) -> int:
        """Register a sent message. Return its token."""
        self.tokens += 1
        token = self.tokens
        self.sent[token] = Sent(token, message, above, after, not_before)
        if above:
            self.under[above].append(token)
        for one in after:
            self.followed_by[one].append(token)
        if sender is not None:
            self.informs.setdefault(sender, []).append(token)
            self.sender_of[token] = sender
        return token

    def orders(self, one: int, other: int) -> None:
        """Note that central has accepted the order of two tasks."""
        sent = self.sent[other]
        self.sent[other] = sent._replace(after=(*sent.after, one))

    def acknowledged(self, token: int, task: int) -> None:
        """Note that central has acknowledged a task."""
        known = self.task_of.setdefault(token, task)
        if known != task and not self.is_lossy:
            raise Broken(f"token {token} became task {known}, and then task {task}")
        self.counts["acknowledged"] += 1

    def answered(self, token: int, outcome: Outcome, failure: str, body: bytes) -> None:
        """Note the outcome that a waiting client received, and check it."""
        self.outcomes[token] = (outcome, failure, body)
        self.counts["answered"] += 1
        if outcome is Outcome.DONE and not failure:
            done = [run for run in self.of_token[token] if run.ended >= 0 and not run.failure]
            replies = [run.reply for run in done]
            if not replies or body not in (
                replies[-1],
                b"" if replies[-1] == b"\xc0" else replies[-1],
            ):
                raise Broken(
                    f"token {token} '{self.sent[token].message}': told {body!r}, handlers returned {replies}"
                )

    # --- handlers ---------------------------------------------------------------------------------

    def begin(self, work: Work, header: headers.Deliver, body: bytes) -> None:
        """Note that a handler starts, and check that it may."""
        clockwork, process = self.clockwork, work.thread.process
        value = decode(body) if body else 0
        token = (
            value if header.context is None and isinstance(value, int) and value in self.sent else 0
        )
        if token and self.sent[token].message != header.message:
            raise Broken(
                f"token {token} of '{self.sent[token].message}' came as '{header.message}'"
            )
        run = Run(work, header, token, clockwork.now)
        self.trace(process.name, f"BEGINS {run}")
        clockwork.note(b"begin %d %d" % (header.delivery, token))
        self.counts["begun"] += 1
        earlier = self.deliveries.get(run.delivery)
        if earlier is not None and not (
            self.is_lossy and (earlier.token, earlier.task) == (run.token, run.task)
        ):
            raise Broken(f"{run} begins again, and began as {earlier}")
        if not self.is_lossy:
            self._check_once(run)
        self.deliveries[header.delivery], self.at_work[work] = run, run
        self.runs.append(run)
        if run.task:
            self.of_task[run.task].append(run)
            if token and self.task_of.setdefault(token, run.task) != run.task and not self.is_lossy:
                raise Broken(f"{run}: its sender was told that it is task {self.task_of[token]}")
        if token:
            self.of_token[token].append(run)
        if self.is_lossy:
            return
        if token:
            self._check_order(run, self.sent[token])
        self._check_claims(run, is_nested=len(work.thread.stack) > 0)

    def end(
        self, work: Work, header: headers.Deliver, body: bytes, failing: Failing | None
    ) -> None:
        """Note that a handler has ended."""
        run = self.at_work.pop(work)  # not by number: a lossy central may use a number again
        run.ended, run.reply = self.clockwork.now, body
        run.failure = failing.failure if failing is not None else ""
        self.trace(run.process.name, f"ENDS   {run} {run.failure}")
        self.clockwork.note(b"end %d" % header.delivery)

    def retries(self, task: int) -> None:
        """Note that an exception handler requests a retry."""
        self.asked_again[task] += 1
        self.counts["retries"] += 1

    def die(self, process: Process) -> None:
        """Note that a process has ended. Its running handlers are lost."""
        for run in self.runs:
            if run.process is process and run.ended < 0:
                run.is_lost = True
                self.counts["died"] += 1

    def _check_once(self, run: Run) -> None:
        if run.task:
            earlier = self.of_task[run.task]
            if len(earlier) > self.asked_again[run.task]:
                raise Broken(
                    f"{run} begins, and began before: {earlier[-1]}; retries: {self.asked_again[run.task]}"
                )
            if any(one.goes_on for one in earlier):
                raise Broken(f"{run} begins, while it is handled: {earlier[-1]}")
        elif run.token and not self._is_shared(run.message):
            if self.of_token[run.token]:
                raise Broken(f"{run} begins, and began before: {self.of_token[run.token][-1]}")
        elif (
            run.token
            and run.message != "mode"
            and any(one.process is run.process for one in self.of_token[run.token])
        ):
            raise Broken(f"{run} begins twice in one process")
        if run.token in self.sender_of:
            heard = self.heard[self.sender_of[run.token], run.process.name]
            if heard and heard[-1] >= run.token:
                raise Broken(f"{run} comes after {heard[-1]}, of the same sender")
            heard.append(run.token)

    @staticmethod
    def _is_shared(message: str) -> bool:
        """Whether a message has several receivers."""
        return message in SHARED

    def _check_order(self, run: Run, sent: Sent) -> None:
        if run.began < sent.not_before - 1e-6:
            raise Broken(f"{run} begins before {sent.not_before}")
        if run.message in GOALS:
            return
        above: Sent | None = sent
        while above is not None:
            for one in above.after:
                going_on = next(self._going_on(one), None)
                if going_on is not None:
                    raise Broken(f"{run} begins, and {going_on}, which comes before it, goes on")
            for one in self.followed_by[above.token]:
                begun = next((other for other in self._commands(one) if other.began >= 0), None)
                if begun is not None:
                    raise Broken(f"{run} begins, and {begun}, which comes after it, has begun")
            above = self.sent.get(above.above)

    def _commands(self, token: int) -> Any:
        """Yield the runs of a command, or of all commands below a goal."""
        if self.sent[token].message not in GOALS:
            yield from self.of_token[token]
        for one in self.under[token]:
            yield from self._commands(one)

    def _going_on(self, token: int) -> Any:
        yield from (
            run for run in self.of_token[token] if run.goes_on and run.task not in self.lost_tasks
        )
        for one in self.under[token]:
            yield from self._going_on(one)

    def holds(self, thread: Thread, resource: str, origin: int, patience: float) -> None:
        """Check a lock that a program believes it holds. If the lock has ended, the program may not
        know so for *patience* after its next welcome.
        """
        if self.is_lossy:
            return
        sender = thread.session.module
        mine = [
            claim
            for claim in self.granted.values()
            if (claim.sender, claim.origin) == (sender, origin)
        ]
        ended = [
            at
            for claim, at in self.lock_ended.items()
            if (claim.sender, claim.origin, claim.resource) == (sender, origin, resource)
        ]
        if (
            not mine
            and thread.welcomed_at > max(ended, default=0.0)
            and self.clockwork.now > thread.welcomed_at + patience
        ):
            raise Broken(
                f"{thread.name} believes that it has locked '{resource}', and was not told that it has lost it"
            )

    def _check_claims(self, run: Run, *, is_nested: bool) -> None:
        for claim in self.granted.values():
            is_it = claim.resource == run.resource and claim.module == run.module
            if is_it and not claim.is_reserved and not is_nested:
                raise Broken(f"{run} begins, and '{run.resource}' is locked by {claim}")

    # --- the journal ------------------------------------------------------------------------------

    def take_back(self, journal: list[Entry]) -> None:
        """Begin again with *journal*, because the journal has lost all other entries."""
        counts = self.counts.copy()
        self._begin_journal()
        self.publish(journal)
        self.counts = counts

    def publish(self, entries: list[Entry]) -> None:
        """Check the new entries of the journal."""
        for entry in entries:
            if entry.number <= self.newest:
                raise Broken(f"entry {entry.number} comes after {self.newest}")
            self.newest = entry.number
            for fact in entry.facts:
                if (take := _TAKE.get(type(fact))) is not None:
                    take(self, fact)

    def _received(self, fact: facts.Received) -> None:
        if fact.id in self.known:
            raise Broken(f"message {fact.id} is born twice")
        self.known.add(fact.id)
        if fact.message_class.is_task:
            self.tasks.add(fact.id)

    def _reached(self, fact: facts.Reached) -> None:
        if fact.moments & 32:
            self.ended.add(int(fact.task))

    def _failed(self, fact: facts.Failed) -> None:
        if fact.failure in LOSSES and not fact.is_beside:
            self.counts["lost by module"] += 1
            self.lost_tasks.add(fact.id)
            delivered = self.deliveries.get(fact.id)
            for run in [
                *self.of_task.get(fact.id, ()),
                *([delivered] if delivered is not None else []),
            ]:
                run.is_lost = run.is_lost or run.ended < 0

    def _delivered(self, fact: facts.Delivered) -> None:
        if self.are_tasks_paused and fact.message_id in self.tasks:
            raise Broken(f"task {fact.message_id} starts, and not all are back")

    def _restarted(self, _: facts.CentralRestarted) -> None:
        self.are_tasks_paused = True

    def _went_on(self, _: facts.WentOn) -> None:
        self.are_tasks_paused = False

    def _dropped(self, fact: facts.Dropped) -> None:
        self.dropped += 1

    def _claimed(self, fact: facts.Claimed) -> None:
        self.wanted[fact.id] = Claim(
            fact.module, fact.resource, fact.is_reserved, fact.sender, fact.origin
        )

    def _granted(self, fact: facts.Granted) -> None:
        claim = self.granted[fact.id] = self.wanted[fact.id]
        self.counts["locks"] += 1
        if self.is_lossy:
            return
        for run in self.runs:
            is_it = claim.resource == run.resource and claim.module == run.module
            if (
                is_it
                and run.goes_on
                and run.delivery != claim.origin
                and not claim.is_reserved
                and run.task not in self.lost_tasks
            ):
                raise Broken(f"{claim} is granted while {run} goes on")

    def _claim_ended(self, fact: facts.ClaimEnded) -> None:
        self.lock_ended[self.wanted.pop(fact.id)] = self.clockwork.now
        self.granted.pop(fact.id, None)


GOALS = frozenset(("walk", "step"))
SHARED = frozenset(("health", "pose", "mode"))

_TAKE: dict[type, Any] = {
    facts.Received: Outside._received,
    facts.Delivered: Outside._delivered,
    facts.CentralRestarted: Outside._restarted,
    facts.WentOn: Outside._went_on,
    facts.Reached: Outside._reached,
    facts.Killed: lambda self, fact: self.killed.add(int(fact.task)),
    facts.Failed: Outside._failed,
    facts.Dropped: Outside._dropped,
    facts.Claimed: Outside._claimed,
    facts.Granted: Outside._granted,
    facts.ClaimEnded: Outside._claim_ended,
}
