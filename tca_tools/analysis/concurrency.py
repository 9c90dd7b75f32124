"""Which overlap would help: pairs of *act, then plan the next* that could be *act while planning the next*. Pure.

Method. Between two commands of one resource lies a gap in which it acts nothing. The gap's causes are walked backwards,
from the second command to the first one's end. If something that plans was ready before that end and only an order held
it back (a constraint, the parent's turn, a handler or script that waited), then all that was planned since could have
been planned beside the acting. What that saves is bounded by three numbers, and the least counts: what the gap holds of
planning, how long the acting before it took, and how long the planners were free meanwhile. Acting that is looked at is
never looked at for a second gap: this is one step of lookahead, as the Ambler has it.

A bound and no promise: whether the plan needs what the acting brings to light, the journal can't tell.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import nextafter

from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.critical_path import named
from tca_tools.analysis.resources import Key, capacity_of
from tca_tools.analysis.steps import Doing, Step
from tca_tools.run.at_time import RunAt
from tca_tools.run.records import HandlerWait, Handling, Message, Task
from tca_tools.run.whole_run import Run
from tca_tools.spans import Cover
from tca_tools.why.wait_words import told
from tca_tools.why.waits import waits_now
from tca_wire.points import ROOT, Moment, Point
from tca_wire.text.waits_in_words import several_in_words
from tca_wire.vocabulary import Role

_PLANNING = (Moment.START_HANDLING, Moment.START_PLANNING)
_REACTIONS = (Role.LISTENER, Role.EXCEPTION, Role.TERMINATION)
"""What is made of something that has just happened can't be done before it."""


@dataclass(slots=True)
class Chance:
    """One gap in which planning could have been done before."""

    acting: Key
    first: int
    """The command whose end let the planning begin."""
    second: int
    """The command that waited for the plan."""
    held: Step
    """What an order held back: the step that began, or went on, only in the gap."""
    start: float
    """When the acting resource had nothing to act any more."""
    end: float
    """When the resource acted again."""
    steps: list[Step]
    """The planning."""
    remedy: str
    """What would have to change."""
    saving: float
    """At most so many seconds."""


@dataclass(slots=True)
class Overlap:
    """The chances of one kind: the same order holds back the same planning."""

    chances: list[Chance] = field(default_factory=list)

    @property
    def saving(self) -> float:
        """At most so many seconds of the resource's idle time, all together."""
        return sum(chance.saving for chance in self.chances)

    @property
    def idle(self) -> float:
        """How long the resource stood idle in these gaps."""
        return sum(chance.end - chance.start for chance in self.chances)

    @property
    def planning(self) -> float:
        """How long was planned in these gaps."""
        return sum(step.seconds for chance in self.chances for step in chance.steps)

    @property
    def example(self) -> Chance:
        """The first chance that saves most."""
        return max(self.chances, key=lambda chance: round(chance.saving, 6))


def overlaps(run: Run, causes: Causes) -> list[Overlap]:
    """All planning that could have been done while something was acted, that which saves most first."""
    found: dict[tuple[object, ...], Overlap] = {}
    free = _Free(run)
    seen: set[tuple[int, float]] = set()
    for acting, runs in _acting(run).items():
        for chance in _chances(run, causes, free, acting, runs):
            place_in_time = (id(chance.steps[0].handling), chance.steps[0].start)
            if place_in_time not in seen:  # two resources may wait for the same plan
                seen.add(place_in_time)
                found.setdefault(_kind(run, chance), Overlap()).chances.append(chance)
    return sorted(found.values(), key=lambda overlap: -overlap.saving)


def _kind(run: Run, chance: Chance) -> tuple[object, ...]:
    return chance.acting, run.name(chance.held.message_id), chance.remedy


def _acting(run: Run) -> dict[Key, list[Handling]]:
    """The resources that act, and their runs of commands as they began."""
    found: dict[Key, list[Handling]] = {}
    for key, runs in run.runs.items():
        if commands := [handling for handling in runs if _is_command(run, handling.message_id)]:
            found[key] = commands
    return found


def _is_command(run: Run, message_id: int) -> bool:
    message = run.messages.get(message_id)
    return message is not None and message.message_class.only_acts and message.role not in _REACTIONS


def _chances(run: Run, causes: Causes, free: "_Free", acting: Key, runs: list[Handling]) -> Iterator[Chance]:
    """The gaps of one resource in which something was planned that could have been before."""
    end, acts_since, last = runs[0].start, runs[0].start, runs[0]
    for handling in runs:
        if handling.start > end:
            chance = _chance(run, causes, acting, (last, handling), end)
            if chance is not None:
                _bound(run, free, chance, acts_since)
                if chance.saving > 0:
                    yield chance
                acts_since = handling.start
        if handling.end is None or handling.end > end:
            end, last = run.time if handling.end is None else handling.end, handling


def _chance(run: Run, causes: Causes, acting: Key, pair: tuple[Handling, Handling], gap: float) -> Chance | None:
    """What a gap between two commands holds, if an order held planning back until its start or later."""
    first, second = pair
    if _was_queued(run, second.message_id, gap):
        return None  # there was something to act: only it could not begin
    steps: list[Step] = []
    for step in causes.back_from(second.start, second.message_id):
        if step.end <= gap:
            break
        steps.append(step)
    else:
        return None  # somebody acted of his own will
    if not steps or steps[-1].start < gap:
        return None  # the planning went on already: its speed is what counts
    steps.reverse()
    number = next((n for n, step in enumerate(steps) if _was_held(run, step, gap)), None)
    if number is None:
        return None
    held = steps[number]
    planning = [step for step in steps[number:] if _plans(run, step, acting)]
    if not planning:
        return None
    ids = first.message_id, second.message_id
    return Chance(acting, *ids, held, gap, second.start, planning, _remedy(run, held), 0.0)


def _was_queued(run: Run, message_id: int, time: float) -> bool:
    """Whether a message stood in a queue at a time, and had since before."""
    message = run.messages.get(message_id)
    queueings = message.queueings if message else []
    return any(one.start < time and (one.end is None or one.end > time) for one in queueings)


def _was_held(run: Run, step: Step, gap: float) -> bool:
    """Whether a step could have begun before the gap, had an order not held it back."""
    if step.resumed:
        return step.resumed.start < gap and step.resumed.awaited not in run.claims  # a lock is no order
    message = run.messages.get(step.message_id)
    if message is None or step.doing is not Doing.WORK or not isinstance(message, Task):
        return False
    is_first = any(handling.start == step.start for handling in message.handlings[:1])
    was_queued = any(one.end == step.start and one.start < gap for one in message.queueings)
    return message.received < gap and is_first and message.message_class.is_goal and not was_queued


def _plans(run: Run, step: Step, acting: Key) -> bool:
    """Whether a step is planning: work, of something else than commands, elsewhere than where is acted."""
    message = run.messages.get(step.message_id)
    if step.doing is not Doing.WORK or message is None or (step.module, step.resource) == acting:
        return False
    return not message.message_class.only_acts and message.role not in _REACTIONS


# --- what held it back ---------------------------------------------------------------------------------------------


def why_held(run: Run, held: Step) -> str:
    """What held the planning back, in words."""
    if not held.resumed:
        at = RunAt(run, nextafter(held.start, 0.0))
        reasons = several_in_words(told(at, waits_now(at, held.message_id)))
        return f"{run.describe(held.message_id)} was held {reasons}"
    is_outside = held.doing is Doing.OUTSIDE
    who = held.module if is_outside else f"the handler of {run.describe(held.message_id)}"
    asked = _queued_question(run, held.resumed)
    return f"{who} waited for {f'the reply to {asked}' if asked else run.describe(held.resumed.awaited)}"


def _remedy(run: Run, held: Step) -> str:
    """What would have to change: the same of all chances of a kind."""
    if not held.resumed:
        return _remedy_of_order(run, run.tasks[held.message_id], held.start)
    if asked := _queued_question(run, held.resumed):
        return f"'{asked.name}' queues behind commands: let a resource of its own handle it"
    who = held.module if held.doing is Doing.OUTSIDE else f"the handler of '{run.name(held.message_id)}'"
    return (
        f"{who} waits for {_quoted(run, held.resumed.awaited)} and only then goes on: let it send what follows at "
        "once, in a sequence with plan_ahead=1"
    )


def _quoted(run: Run, number: int) -> str:
    """The name of a message in quotes, where it has one."""
    name = named(run, number)
    return f"'{name}'" if name == run.name(number) else name


def _queued_question(run: Run, wait: HandlerWait) -> Message | None:
    """The query that was waited for, if it stood in a queue."""
    asked = None if wait.moment else run.messages.get(wait.awaited)
    return asked if asked and asked.queueings and asked.message_class.has_reply else None


def _remedy_of_order(run: Run, task: Task, released: float) -> str:
    """What holds tasks of this kind back: a constraint, or the parent's turn."""
    for hold in task.holds:
        before, after = hold.constraint.before, hold.constraint.after
        if after.moment not in _PLANNING or before.task == ROOT or _reached(run, before) < released:
            continue
        if before.task == task.id and before.moment is Moment.START_ACHIEVING:
            what = "let it be planned one ahead (plan_ahead=1, not 0 and not delay_planning)"
            return f"'{task.name}' is not planned before it may be achieved: {what}"
        other = run.name(before.task)
        if before.moment is Moment.START_ACHIEVING:
            return f"'{task.name}' is not planned before '{other}' is being achieved: plan further ahead (plan_ahead)"
        return f"a constraint lets '{task.name}' be planned only after '{other}': let it hold back the achieving alone"
    parent = run.name(task.parent)
    return f"'{task.name}' is planned only when its parent '{parent}' is: take away what delays the planning of that"


def _reached(run: Run, point: Point) -> float:
    task = run.tasks.get(point.task)
    return task.reached.get(point.moment, 0.0) if task else 0.0


# --- how much it would save ----------------------------------------------------------------------------------------


class _Free:
    """How long a resource had a free slot."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._covers: dict[Key, Cover] = {}

    def within(self, key: Key, start: float, end: float) -> float:
        """Seconds of a window in which it had one."""
        if key not in self._covers:
            runs = self._run.runs.get(key, [])
            spans = ((run.start, self._run.time if run.end is None else run.end) for run in runs)
            self._covers[key] = Cover(spans, capacity_of(self._run, key))
        return max(end - start, 0.0) - self._covers[key].within(start, end)


def _bound(run: Run, free: _Free, chance: Chance, acts_since: float) -> None:
    """The least of: the planning, place by place no more than its resource was free; and the acting before it."""
    since = max(acts_since, _might_begin(run, chance))
    window = max(chance.held.start - since, 0.0)
    work: dict[Key, float] = {}
    for step in chance.steps:
        key = (step.module, step.resource)
        work[key] = work.get(key, 0.0) + step.seconds
    waited = chance.held.handling if chance.held.resumed else None
    possible = 0.0
    for key, seconds in work.items():
        is_own = waited is not None and key == (waited.module, waited.resource)
        possible += min(seconds, window if is_own else free.within(key, since, chance.held.start))
    chance.saving = min(possible, window)


def _might_begin(run: Run, chance: Chance) -> float:
    """When the planning might have begun at the earliest, were it not for what held it back last."""
    if chance.held.resumed:
        return chance.held.resumed.start
    task = run.tasks.get(chance.held.message_id)
    if task is None:
        return chance.held.start
    times = [task.received]
    for hold in task.holds:
        before = hold.constraint.before
        if hold.constraint.after.moment in _PLANNING and before.task != task.id:
            times.append(_reached(run, before))
    if (parent := run.tasks.get(task.parent)) is not None:
        times.append(parent.reached.get(Moment.START_PLANNING, 0.0))
    return max((time for time in times if time < chance.held.start), default=task.received)
