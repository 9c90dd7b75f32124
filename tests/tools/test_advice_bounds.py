"""Upper bounds of the savings that advice promises.

The same robot runs again as advised, with the real central. In random runs, no advice promises
more than the run lasted.
"""

import heapq
from typing import Any

import pytest
from central.player import Player
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.life import Life, operation
from tools.story import THIS, Story, made, stepping

from tca_central.events import ConnectionId, RequestReceived, Transmit
from tca_tools.analysis.advice import advice
from tca_tools.analysis.advice_words import Advice, Topic
from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.concurrency import Overlap, overlaps
from tca_tools.analysis.critical_path import critical_path, last_task, longest_task
from tca_tools.analysis.failures import failures
from tca_tools.analysis.resources import uses
from tca_tools.analysis.summary import summary
from tca_tools.journal.fold import History
from tca_tools.journal.records import Task
from tca_tools.journal.whole_run import Run
from tca_tools.report.contents import contents
from tca_tools.spans import Cover
from tca_wire.constraints import Constraint, delay_planning, plan_ahead
from tca_wire.journal import facts
from tca_wire.points import TaskId
from tca_wire.text.facts_in_words import called

TOLERANCE = 1e-6


def all_advice(run: Run) -> list[Advice]:
    return [
        one
        for task in (last_task(run), longest_task(run))
        if task
        for one in advised(run, 0.0, task)
    ]


class Timed(Player):
    """A player whose handlers take given times."""

    def __init__(self) -> None:
        super().__init__(check=False)
        self.due: list[tuple[float, int, str]] = []
        self.begun: set[int] = set()

    def receive(self, connection: str, header: Any, body: bytes = b"") -> list[Any]:
        effects = self.event(
            RequestReceived(self.time, ConnectionId(connection.encode()), header, body)
        )
        return [effect.header for effect in effects if isinstance(effect, Transmit)]

    def schedule_returns(self, slots: list[str]) -> None:
        """Schedule the return of each new delivery."""
        for slot in slots:
            for delivery in self.delivered(slot):
                if delivery not in self.begun and (took := self.duration_of(slot, delivery)):
                    self.begun.add(delivery)
                    heapq.heappush(self.due, (self.time + took, delivery, slot))

    def duration_of(self, slot: str, delivery: int) -> float:
        """Return the seconds of a delivery. 0 means that other code lets the delivery return."""
        raise NotImplementedError


# --- one more slot --------------------------------------------------------------------------------

Job = tuple[int, list[int], int]
"""The arrival of a job, the seconds of its chops, and the seconds of its packing."""
JOBS = st.lists(
    st.tuples(
        st.integers(1, 12), st.lists(st.integers(1, 6), min_size=1, max_size=2), st.integers(1, 12)
    ),
    min_size=1,
    max_size=7,
)


class Kitchen(Timed):
    """A chef that plans in no time, a cutter with few slots, and enough packers."""

    def __init__(self, jobs: list[Job], slots: int) -> None:
        super().__init__()
        self.seconds: dict[int, float] = {}
        self.module("user")
        self.module("chef", "goal job", capacity=len(jobs))
        self.module("cutter", "command chop", capacity=slots)
        self.module("packer", "command pack", capacity=len(jobs))
        self.jobs = sorted(jobs)
        self.slots = [f"cutter/{n + 1}" for n in range(slots)] + [
            f"packer/{n + 1}" for n in range(len(jobs))
        ]

    def duration_of(self, slot: str, delivery: int) -> float:
        return self.seconds.get(delivery, 0.0)

    def run(self) -> History:
        waiting = list(self.jobs)
        while waiting or self.due:
            if not self.due or (waiting and waiting[0][0] <= self.due[0][0]):
                self.time, chops, packing = waiting.pop(0)
                self.plan(chops, packing)
            else:
                self.time, delivery, slot = heapq.heappop(self.due)
                self.reply(slot, delivery)
            self.schedule_returns(self.slots)
        return History.until(self.entries)

    def plan(self, chops: list[int], packing: int) -> None:
        job = self.task("user", "job")
        chef = next(
            slot for slot in self.inbox if slot.startswith("chef/") and job in self.delivered(slot)
        )
        for seconds in chops:
            self.seconds[self.task(chef, "chop", under=job)] = seconds
        self.seconds[self.task(chef, "pack", under=job)] = packing
        self.reply(chef, job)


@given(JOBS, st.integers(1, 2))
@settings(max_examples=40)
def test_extra_slot_saves_at_most_the_advised_time(jobs: list[Job], slots: int) -> None:
    run = Kitchen(jobs, slots).run()
    saved = summary(run).seconds - summary(Kitchen(jobs, slots + 1).run()).seconds
    advised_saving = max(
        (one.saving for one in all_advice(run) if one.title == "cutter is a bottleneck"),
        default=0.0,
    )
    assert saved <= advised_saving + TOLERANCE


# --- planning while acting ------------------------------------------------------------------------

DURATIONS = st.lists(st.tuples(st.integers(1, 6), st.integers(1, 6)), min_size=1, max_size=6)


class Robot(Timed):
    """A planner, legs and a user. *durations* has the seconds of each step's plan and move."""

    def __init__(self, durations: list[tuple[int, int]], *, plans_ahead: bool) -> None:
        super().__init__()
        self.durations = durations
        self.plans_ahead = plans_ahead
        self.steps: list[int] = []
        self.moves: dict[int, int] = {}
        self.module("user")
        self.module("planner", "goal walk", "goal step")
        self.module("legs", "command move")

    def duration_of(self, slot: str, delivery: int) -> float:
        planning = slot == "planner/1"
        step = self.steps.index(delivery) if planning else self.moves[delivery]
        return self.durations[step][0 if planning else 1]

    def run(self) -> History:
        walk = self.task("user", "walk")
        for _ in self.durations:
            self.steps.append(
                self.task(
                    "planner/1", "step", under=walk, constraints=self.constraints_of_next_step()
                )
            )
        self.reply("planner/1")
        self.schedule_returns(["planner/1", "legs/1"])
        while self.due:
            self.time, delivery, slot = heapq.heappop(self.due)
            if slot == "planner/1":
                self.moves[self.task("planner/1", "move", under=delivery)] = self.steps.index(
                    delivery
                )
            self.reply(slot, delivery)
            self.schedule_returns(["planner/1", "legs/1"])
        return History.until(self.entries)

    def constraints_of_next_step(self) -> tuple[Constraint, ...]:
        """Return the constraints on the planning of the next step."""
        if not self.plans_ahead:
            return (delay_planning(THIS),)
        return (plan_ahead(TaskId(self.steps[-1]), THIS),) if self.steps else ()


@given(DURATIONS)
@settings(max_examples=30)
def test_planning_one_step_ahead_saves_the_advised_time(
    durations: list[tuple[int, int]],
) -> None:
    """The critical path is as long as the run, with and without planning ahead."""
    slow = Robot(durations, plans_ahead=False).run()
    fast = Robot(durations, plans_ahead=True).run()
    saved = summary(slow).seconds - summary(fast).seconds
    for run, advised_saving in ((slow, saved), (fast, 0.0)):
        causes, task = Causes(run), last_task(run)
        assert sum(overlap.saving for overlap in overlaps(run, causes)) == pytest.approx(
            advised_saving, abs=1e-6
        )
        assert task is not None
        steps = critical_path(run, causes, task).steps
        assert sum(step.seconds for step in steps) == pytest.approx(summary(run).seconds)


# --- a burst --------------------------------------------------------------------------------------


def burst(number: int, took: float) -> Run:
    """Return a run in which *number* commands come at once for one resource."""
    story = Story().module("user").module("cutter", "chop")
    chops = [story.at(1.0).command("chop", "user") for _ in range(number)]
    story.delivered(chops[0], "cutter")
    for chop in chops[1:]:
        story.queued(chop, "cutter")
    for place, chop in enumerate(chops):
        story.at(1.0 + (place + 1) * took).achieved(chop)
        if place + 1 < number:
            story.delivered(chops[place + 1], "cutter")
    return story.fold()


def test_overlapping_queue_waits_are_not_summed_in_advice() -> None:
    """The run lasts 3 s and its waits add up to 449 s, but a second slot saves only 1.5 s."""
    (one,) = {one.title: one for one in all_advice(burst(300, 0.01))}.values()
    assert (one.title, round(one.saving, 6), round(one.on_path, 6)) == (
        "cutter is a bottleneck",
        1.5,
        1.5,
    )
    assert "waits 299 times in the queue for cutter, 2.99 s in all" in one.text


# --- random runs ----------------------------------------------------------------------------------


@given(st.lists(operation, max_size=60), st.integers(1, 5))
@settings(max_examples=40)
def test_advice_saving_never_exceeds_a_random_run(operations: list[Any], tick: int) -> None:
    life = Life(Player(check=False))
    for name, *numbers in operations:
        life.do(name, *numbers)
    check(life, tick)


@given(st.integers(0, 1 << 32), st.integers(1, 5))
@settings(max_examples=2)
def test_advice_saving_never_exceeds_a_long_random_run(seed: int, tick: int) -> None:
    life = Life(Player(check=False))
    life.go_on(seed, 1_000)
    check(life, tick)


def check(life: Life, tick: int) -> None:
    """Check all advice on a life, with a clock that steps by *tick* seconds."""
    entries = [
        facts.Entry(entry.number, entry.time // tick * tick, entry.facts)
        for entry in life.player.entries
    ]
    run = History.until(entries)
    seconds = summary(run).seconds
    check_ends(run)
    for one in all_advice(run):
        assert "'?'" not in one.title + one.text + one.remedy + one.example, one
        assert 0.0 <= one.on_path <= one.saving + TOLERANCE, one
        assert one.saving <= seconds + TOLERANCE, one
        if one.topic in (Topic.CAPACITY, Topic.LOCK):
            assert one.saving <= waited(run, one.title.split(" is ")[0]) + TOLERANCE, one


def check_ends(run: Run) -> None:
    """Check which task's end the advice brings nearer: the one of the first path, or the one that
    the advice names.
    """
    found = contents(run)
    for one in found.advice:
        assert found.path is not None or not one.on_path, one
        assert not found.path or one.on_path <= found.path.path.seconds + TOLERANCE, one
        if one.sooner:
            assert found.longest is not None, one
            path = found.longest.path
            assert (one.sooner, one.on_path) == (str(path.task), 0.0), one
            assert one.saving <= path.seconds + TOLERANCE or one.topic is Topic.CAPACITY, one
    assert [one.on_path for one in found.advice] == sorted(
        (one.on_path for one in found.advice), reverse=True
    )


def waited(run: Run, where: str) -> float:
    """Return the time in which a resource had a queue, in any copy, or a claim that was not granted
    yet.
    """
    module, _, resource = where.partition(" / ")
    key = (called(module), resource or module)
    queues = [
        (one.start, one.end) for one in run.queueings if (called(one.module), one.resource) == key
    ]
    claims = [
        (one.start, one.granted)
        for one in run.claims.values()
        if (called(one.module), one.resource) == key
    ]
    return Cover(
        (since, run.time if until is None else until) for since, until in queues + claims
    ).total


# --- worked out by hand ---------------------------------------------------------------------------


def found_in(run: Run) -> list[Overlap]:
    return overlaps(run, Causes(run))


def advised(run: Run, at_least: float = 1e-6, task: Task | None = None) -> list[Advice]:
    """Return the advice on the path of a task (default: the last one)."""
    handling, task, causes = summary(run), task or last_task(run), Causes(run)
    path = critical_path(run, causes, task) if task else None
    use = uses(run, handling.start, handling.end)
    return advice(run, causes, path, overlaps(run, causes), use, failures(run), at_least)


def test_overlaps_find_plans_that_could_overlap_the_step_before() -> None:
    """Two gaps with 1 s of planning each make 2 s. Planning ahead takes 7.3 s, not 9.3 s."""
    (overlap,) = found_in(stepping().fold())
    assert [(round(one.start, 6), round(one.end, 6)) for one in overlap.chances] == [
        (4.3, 5.3),
        (7.3, 8.3),
    ]
    assert overlap.saving == pytest.approx(2.0)
    slow, fast = (summary(story.fold()).seconds for story in (stepping(), made("looking_ahead")))
    assert slow - fast == pytest.approx(overlap.saving)
