"""Find planning after a command that could have been done during the command. Pure.

Method. Between two commands of one resource there is a gap in which it does not act. The causes of
the gap are walked backwards, from the second command to the end of the first. A planning step may
have been ready before the first command ended, but an order held it back. The order was a
constraint, the parent's turn, or a handler or program that waited before it continued. Then all
planning in the gap could have been done during the first command.

The saving has three bounds, and the least one counts: the planning in the gap, the duration of the
first command, and the free time of the planners during that command. A command counts for one gap
only: this is one step of lookahead, as in the Ambler.

The saving is a bound, not a promise. The plan may need the result of the command, and the journal
does not show whether it does.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import nextafter
from typing import NamedTuple

from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.resources import Key, capacity_of
from tca_tools.analysis.step_words import named, wait_in_words
from tca_tools.analysis.steps import Doing, PathStep
from tca_tools.explain.graph import waits_now
from tca_tools.explain.wait_words import named_waits
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.records import Handling, Task
from tca_tools.journal.whole_run import Run
from tca_tools.spans import Cover, Span
from tca_wire.points import Moment, Point
from tca_wire.text.waits_in_words import several_in_words
from tca_wire.vocabulary import Role

_PLANNING = (Moment.START_HANDLING, Moment.START_PLANNING)
_REACTIONS = (Role.LISTENER, Role.EXCEPTION, Role.TERMINATION)
"""Roles of messages that react to an event, so they can't run before it."""


class Chance(NamedTuple):
    """One gap whose planning could have been done earlier."""

    acting: Key
    first: int
    """The command before the gap."""
    second: int
    """The command after the gap, which waited for the plan."""
    held: PathStep
    """The step that an order held back: it started or resumed only in the gap."""
    start: float
    """When the resource stopped acting."""
    end: float
    """When the resource acted again."""
    steps: list[PathStep]
    """The planning steps."""
    saving: float
    """The largest possible saving, in seconds."""


@dataclass(slots=True)
class Overlap:
    """The chances of one kind: the same order holds back the same planning."""

    remedy: str
    """The change that would help."""
    chances: list[Chance]
    """The chances, sorted by saving, largest first."""

    @property
    def saving(self) -> float:
        """The largest possible saving of the resource's idle time, in seconds."""
        return sum(chance.saving for chance in self.chances)


def overlaps(run: Run, causes: Causes) -> list[Overlap]:
    """Return the planning that could have been done during commands, largest saving first."""
    found: dict[tuple[Key, str, str], Overlap] = {}
    covers: dict[Key, Cover] = {}
    seen: set[tuple[int, float]] = set()
    for acting, handlings in run.by_resource.items():
        commands = [handling for handling in handlings if _is_acting(run, handling.message_id)]
        for chance in _Gaps(run, causes, covers, acting).chances(commands):
            plan = id(chance.steps[0].handling), chance.steps[0].start
            if plan not in seen:  # two resources may wait for one plan
                seen.add(plan)
                remedy = _remedy(run, chance.held)
                key = acting, run.name(chance.held.message_id), remedy
                found.setdefault(key, Overlap(remedy, [])).chances.append(chance)
    for overlap in found.values():
        overlap.chances.sort(key=lambda chance: -round(chance.saving, 6))
    return sorted(found.values(), key=lambda overlap: -overlap.saving)


def _is_acting(run: Run, message_id: int) -> bool:
    """Whether a message is a command, and not a reaction to an event."""
    message = run.messages.get(message_id)
    if message is None or message.role in _REACTIONS:
        return False
    return message.message_class.only_acts


@dataclass(slots=True)
class _Gaps:
    """The gaps between the commands of one resource."""

    run: Run
    causes: Causes
    covers: dict[Key, Cover]
    key: Key

    def chances(self, commands: list[Handling]) -> Iterator[Chance]:
        """Yield the gaps whose planning could have been done earlier."""
        if not commands:
            return
        last = commands[0]
        end = acts_since = last.start
        for handling in commands:
            if handling.start > end and (found := self._held_step(handling, end)):
                held, steps = found
                saving = _saving(self.run, self.covers, held, steps, acts_since)
                if saving > 0:
                    ids = last.message_id, handling.message_id
                    yield Chance(self.key, *ids, held, end, handling.start, steps, saving)
                acts_since = handling.start
            if handling is last or handling.until > end:
                end, last = min(handling.until, self.run.time), handling

    def _held_step(self, second: Handling, gap: float) -> tuple[PathStep, list[PathStep]] | None:
        """Return the step that an order held back, and the planning from there on.

        Args:
            second: The command after the gap.
            gap: The start of the gap.
        """
        run = self.run
        queueings = run.messages[second.message_id].queueings
        if any(one.start < gap < one.until for one in queueings):
            return None  # a command was queued, so planning was not the cause
        steps: list[PathStep] = []
        for step in self.causes.back_from(second.start, second.message_id):
            if step.end <= gap:
                break
            steps.insert(0, step)
        else:
            return None  # a program acted on its own
        if not steps or steps[0].start < gap:
            return None  # planning had started before the gap
        while steps and not _was_held(run, steps[0], gap):
            steps.pop(0)
        planning = [step for step in steps if _is_planning(run, step, self.key)]
        return (steps[0], planning) if planning else None


def _was_held(run: Run, step: PathStep, gap: float) -> bool:
    """Whether a step was ready before the start of the *gap*, and only an order held it back."""
    if (wait := step.resumed) is not None:  # a wait for a lock is not due to an order
        return wait.start < gap and wait.awaited not in run.claims
    task = run.tasks.get(step.message_id)
    if task is None or step.doing is not Doing.WORK:
        return False
    if (
        not task.message_class.is_goal
        or task.received >= gap
        or task.handlings[0].start != step.start
    ):
        return False
    return not any(one.end == step.start and one.start < gap for one in task.queueings)


def _is_planning(run: Run, step: PathStep, acting: Key) -> bool:
    """Whether a step is planning: work on a message that is not a command, in another resource."""
    message = run.messages.get(step.message_id)
    if message is None or message.role in _REACTIONS or message.message_class.only_acts:
        return False
    return step.doing is Doing.WORK and (step.module, step.resource) != acting


# --- causes and remedies --------------------------------------------------------------------------


def why_held(run: Run, held: PathStep) -> str:
    """Return why the planning was held back, in words."""
    if held.resumed:
        return wait_in_words(run, held)
    at, number = RunAt(run, nextafter(held.start, 0.0)), held.message_id
    waits = several_in_words(named_waits(at, waits_now(at, number)))
    return f"{run.describe(number)} was held {waits}"


def _remedy(run: Run, held: PathStep) -> str:
    """Return the change that would help: the same for all chances of a kind."""
    name = run.name(held.message_id)
    if not held.resumed:
        return (
            f"plan '{name}' ahead: use plan_ahead=1 instead of 0 or delay_planning, "
            "or constrain only its achievement"
        )
    asked = run.messages.get(held.resumed.awaited)
    if asked and not held.resumed.moment and asked.queueings:
        return f"'{asked.name}' queues behind commands: handle it in a resource of its own"
    who = held.module if held.doing is Doing.OUTSIDE else f"the handler of '{name}'"
    return (
        f"{who} waits for '{named(run, held.resumed.awaited)}' before it continues: "
        "send the next steps at once, in a sequence with plan_ahead=1"
    )


# --- how much it would save -----------------------------------------------------------------------


def _saving(
    run: Run, covers: dict[Key, Cover], held: PathStep, steps: list[PathStep], acts_since: float
) -> float:
    """Return the possible saving in seconds.

    The planning could have started at *acts_since*, or when it was ready if that was later. From
    then until its real start, each resource can take as much of the planning as it has free time.
    """
    if held.resumed:
        since = max(acts_since, held.resumed.start)
    else:
        since = max(acts_since, _earliest_start(run, run.tasks[held.message_id], held))
    window = max(held.start - since, 0.0)
    work: dict[Key, float] = {}
    for step in steps:
        key = (step.module, step.resource)
        work[key] = work.get(key, 0.0) + step.seconds
    waits_in = held.handling if held.resumed else None
    possible = 0.0
    for key, seconds in work.items():
        free = window
        if waits_in is None or key != (waits_in.module, waits_in.resource):
            free -= _full_seconds(run, covers, key, (since, held.start))
        possible += min(seconds, free)
    return min(possible, window)


def _full_seconds(run: Run, covers: dict[Key, Cover], key: Key, window: Span) -> float:
    """Return how long all slots of a resource were busy in a window, in seconds."""
    if key not in covers:
        spans = ((one.start, min(one.until, run.time)) for one in run.by_resource.get(key, []))
        covers[key] = Cover(spans, capacity_of(run, key))
    return covers[key].within(*window)


def _earliest_start(run: Run, task: Task, held: PathStep) -> float:
    """Return when a task could have been planned without the order that held it back last."""
    constraints = (hold.constraint for hold in task.holds)
    planned = (one.before for one in constraints if one.after.moment in _PLANNING)
    points = [Point(task.parent, Moment.START_PLANNING)]
    points += (point for point in planned if point.task != task.id)
    earliest = task.received
    for point in points:
        if point.task in run.tasks:
            time = run.tasks[point.task].reached.get(point.moment, 0.0)
            earliest = max(earliest, time) if time < held.start else earliest
    return earliest
