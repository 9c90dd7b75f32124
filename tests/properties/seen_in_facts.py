"""The spans of a run, found slowly in its facts. The records of the tools are not used."""

from collections.abc import Iterator
from math import inf
from typing import Any, NamedTuple

from tca_tools.analysis.steps import PathStep
from tca_wire.journal import facts
from tca_wire.points import ROOT, Moment, Point


class Span(NamedTuple):
    """A span of a run: its kind, its owner, its start and end."""

    kind: str
    """One of: run, queue, wait, claim, lock, suspension, life, member."""
    owner: Any
    start: float
    end: float
    about: Any = None

    def covers(self, step: PathStep) -> bool:
        return self.start <= step.start and step.end <= self.end

    def meets(self, step: PathStep) -> bool:
        return self.start < self.end and self.start < step.end and step.start < self.end


class Facts:
    """All spans of a run, by kind."""

    def __init__(self, entries: list[facts.Entry], times: list[float]) -> None:
        self.spans: list[Span] = []
        self.timed_facts: list[tuple[float, Any]] = []
        self._claims: dict[int, tuple[tuple[str, str], str]] = {}
        self._open: dict[tuple[str, Any], list[tuple[Any, float, Any]]] = {}
        for entry, time in zip(entries, times, strict=True):
            for fact in entry.facts:
                self.timed_facts.append((time, fact))
                self._add(fact, time)
        for kind, key in self._open:
            while self._open[kind, key]:
                self._end(kind, key, inf)

    def of(self, kind: str, owner: Any = None) -> Iterator[Span]:
        return (
            one for one in self.spans if one.kind == kind and (owner is None or one.owner == owner)
        )

    def _begin(self, kind: str, key: Any, owner: Any, time: float, about: Any = None) -> None:
        self._open.setdefault((kind, key), []).append((owner, time, about))

    def _end(self, kind: str, key: Any, time: float) -> None:
        if found := self._open.get((kind, key)):
            owner, start, about = found.pop()
            self.spans.append(Span(kind, owner, start, time, about))

    def _add(self, fact: Any, time: float) -> None:
        self._add_handling(fact, time)
        self._add_waiting(fact, time)
        self._add_life(fact, time)

    def _add_handling(self, fact: Any, time: float) -> None:
        """Record runs of handlers, and stays in queues."""
        if isinstance(fact, facts.Killed):
            self._end("queue", fact.task, time)
            return
        is_left = isinstance(fact, facts.Failed) and not fact.is_beside
        if is_left or isinstance(
            fact, facts.Queued | facts.Unqueued | facts.Returned | facts.Delivered
        ):
            self._end("run", fact.id, time)
            self._end("queue", fact.id, time)
        if isinstance(fact, facts.Queued):
            self._begin("queue", fact.id, fact.message_id, time, (fact.module, fact.resource))
        elif isinstance(fact, facts.Delivered):
            self._begin(
                "run", fact.id, fact.message_id, time, (fact.module, fact.resource, fact.id)
            )

    def _add_waiting(self, fact: Any, time: float) -> None:
        """Record waits of handlers and programs, and locks."""
        match fact:
            case facts.Received() if fact.blocking and not fact.message_class.is_task:
                self._waits(fact.id, fact.sender, fact.origin, time)
            case facts.Awaited():
                sent = next(
                    timed_facts
                    for _, timed_facts in self.timed_facts
                    if isinstance(timed_facts, facts.Received) and timed_facts.id == fact.id
                )
                self._waits(fact.id, sent.sender, sent.origin, time)
            case facts.Dropped() | facts.Answered():
                for copy in self._queued_copies(fact.id):
                    self._end("queue", copy, time)
                self._end("wait", fact.id, time)
            case facts.WaitBegan():
                self._begin(
                    "wait", (fact.module, fact.origin, fact.task), (fact.module, fact.origin), time
                )
            case facts.WaitEnded():
                self._end("wait", (fact.module, fact.origin, fact.task), time)
            case facts.Claimed():
                self._claims[fact.id] = (fact.module, fact.resource), fact.sender
                self._begin("claim", fact.id, fact.id, time)
                self._waits(fact.id, fact.sender, fact.origin, time)
            case facts.Granted() | facts.ClaimEnded():
                for kind in ("wait", "claim", "lock"):
                    self._end(kind, fact.id, time)
        if isinstance(fact, facts.Granted):
            self._begin("lock", fact.id, fact.id, time)

    def _queued_copies(self, message: int) -> list[int]:
        """Return the queued copies of a message with several receivers."""
        return [
            key
            for (kind, key), found in self._open.items()
            if kind == "queue" and found and found[-1][0] == message
        ]

    def _add_life(self, fact: Any, time: float) -> None:
        """Record lifetimes of messages and modules, and suspensions."""
        match fact:
            case facts.Received():
                self._begin("life", fact.id, fact.id, time)
            case facts.SuspendedOrResumed():
                if not fact.is_suspended:
                    self._end("suspension", fact.task, time)
                elif not self._open.get(("suspension", fact.task)):
                    self._begin("suspension", fact.task, fact.task, time)
            case facts.Reached() if fact.moments & Moment.END_ACHIEVING:
                self._end("life", fact.task, time)
                self._end("suspension", fact.task, time)
            case facts.ModuleJoined():
                self._begin("member", fact.module, fact.module, time)
            case facts.ModuleLeft():
                self._end("member", fact.module, time)

    def _waits(self, awaited: int, module: str, origin: int, time: float) -> None:
        if not self._open.get(("wait", awaited)):
            self._begin("wait", awaited, (module, origin), time)

    # --- questions --------------------------------------------------------------------------------

    def confirms(self, step: PathStep) -> bool:
        """Whether a step of a path agrees with the spans during all its time."""
        return bool(getattr(self, f"_{step.doing.name.lower()}")(step))

    def _work(self, step: PathStep) -> bool:
        runs = [one for one in self.of("run", step.message_id) if one.covers(step)]
        runs = [one for one in runs if one.about[:2] == (step.module, step.resource)]
        return any(not any(self._own_waits(run, step)) for run in runs)

    def _own_waits(self, run: Span, step: PathStep) -> Iterator[Span]:
        module, _, delivery = run.about
        return (one for one in self.of("wait", (module, delivery)) if one.meets(step))

    def _outside(self, step: PathStep) -> bool:
        waits = (one for one in self.of("wait", (step.module, 0)) if one.meets(step))
        return any(one.covers(step) for one in self.of("member", step.module)) and not any(waits)

    def _delay(self, step: PathStep) -> bool:
        over = [
            fact
            for time, fact in self.timed_facts
            if isinstance(fact, facts.TimedOut) and time == step.end
        ]
        is_over = any(fact.constraint.after.task == step.message_id for fact in over)
        return is_over or step.end == self.timed_facts[-1][0] or self._is_cut_off(step)

    def _is_cut_off(self, step: PathStep) -> bool:
        """Whether a delay would have lasted longer than the step."""
        constraining = (
            (time, fact)
            for time, fact in self.timed_facts
            if isinstance(fact, facts.Received | facts.Constrained)
        )
        constraints = (
            (time, one)
            for time, fact in constraining
            for one in fact.constraints
            if one.after.task == step.message_id
        )
        return any(
            self._reached_at(one.before, time)
            <= step.start
            < step.end
            <= max(time, self._reached_at(one.before, time)) + one.delay
            for time, one in constraints
        )

    def _reached_at(self, point: Point, timed_facts: float) -> float:
        """Return the time when a point was reached; for the root, the time of the constraint."""
        reached = (
            time
            for time, fact in self.timed_facts
            if isinstance(fact, facts.Reached)
            and fact.task == point.task
            and fact.moments & point.moment
        )
        return next(reached, timed_facts if point.task == ROOT else inf)

    def _no_handler(self, step: PathStep) -> bool:
        return any(
            one.covers(step) and not one.about[0] for one in self.of("queue", step.message_id)
        )

    def _queued(self, step: PathStep) -> bool:
        where = step.module, step.resource
        return any(
            one.covers(step) and one.about == where for one in self.of("queue", step.message_id)
        )

    def _locked(self, step: PathStep) -> bool:
        """Whether the module held a lock, or a claim of the resource was pending."""
        had = any(
            one.covers(step) and self._claims[one.owner][1] == step.module
            for one in self.of("lock")
        )
        where = step.module, step.resource
        return had or any(
            one.covers(step) and self._claims[one.owner][0] == where for one in self.of("claim")
        )

    def _suspended(self, step: PathStep) -> bool:
        was_suspended = any(one.covers(step) for one in self.of("suspension", step.message_id))
        below = self.under(step.message_id)
        runs_below = (run for run in self.of("run") if run.owner in below and run.meets(step))
        return was_suspended and all(any(self._own_waits(run, step)) for run in runs_below)

    def _killed(self, step: PathStep) -> bool:
        return self._unknown(step)

    def _held(self, step: PathStep) -> bool:
        return self._is_alive(step) and not any(
            one.meets(step) for one in self.of("run", step.message_id)
        )

    def _circle(self, step: PathStep) -> bool:
        """Whether nobody works for a message that waits for itself. Of a multi-query it is enough
        that the handler of one copy waits.
        """
        runs = [one for one in self.of("run", step.message_id) if one.covers(step)]
        does_one_wait = len(runs) > 1 and any(any(self._own_waits(one, step)) for one in runs)
        return self._is_alive(step) and (does_one_wait or not any(self.working_under(step)))

    def _watching(self, step: PathStep) -> bool:
        return self._is_alive(step)

    def _unknown(self, step: PathStep) -> bool:
        """Whether a step has no known cause: no handler that could be the reason worked, and the
        task stood in no queue.
        """
        was_suspended = any(one.covers(step) for one in self.of("queue", step.message_id))
        return self._is_alive(step) and not was_suspended and not any(self.working_under(step))

    def _is_alive(self, step: PathStep) -> bool:
        return any(one.covers(step) for one in self.of("life", step.message_id))

    def under(self, task: int) -> set[int]:
        """Return the ids of a task and its descendants."""
        found = {task}
        for _, fact in self.timed_facts:
            if (
                isinstance(fact, facts.Received)
                and fact.parent in found
                and fact.message_class.is_task
            ):
                found.add(fact.id)
        return found

    def working_under(self, step: PathStep) -> Iterator[Span]:
        """Return the runs of handlers that worked for a task during a whole step, never waiting."""
        below = self.under(step.message_id)
        runs = (one for one in self.of("run") if one.owner in below and one.covers(step))
        return (run for run in runs if not any(self._own_waits(run, step)))

    def is_independent(self, time: float) -> bool:
        """Whether some module sent or claimed at *time* without a known cause: no run of a handler,
        and no earlier wait of its program.
        """
        for when, fact in self.timed_facts:
            if when != time or not isinstance(fact, facts.Received | facts.Claimed):
                continue
            sender, origin = fact.sender, fact.origin
            waited = any(
                one.end <= time and one.end > one.start for one in self.of("wait", (sender, 0))
            )
            runs = [one for one in self.of("run") if one.about[2] == origin and one.start < time]
            if not runs and not waited:
                return True
        return False

    def ends(self, task: int) -> float:
        """Return the time when a task ended; inf if it did not."""
        bits = 0
        for time, fact in self.timed_facts:
            if isinstance(fact, facts.Reached) and fact.task == task:
                bits |= fact.moments
                if bits & Moment.END_ACHIEVING:
                    return time
        return inf
