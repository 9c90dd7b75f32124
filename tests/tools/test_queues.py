"""Queues that only grow, and queues that do not."""

from random import Random

import pytest
from tools.story import Story

from tca_tools.analysis.advice import advice
from tca_tools.analysis.advice_words import Topic
from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.queues import growing
from tca_tools.analysis.summary import span_of
from tca_tools.report.contents import contents
from tca_tools.run.at_time import RunAt
from tca_tools.run.whole_run import Run
from tca_tools.tasktree_viz import words
from tca_wire.journal import facts
from tca_wire.points import TaskId
from tca_wire.vocabulary import MessageClass


def served(arrivals: list[float], took: float, end: float = 100.0, capacity: int = 1, *, closes: bool = False) -> Run:
    """Informs that come at these times to a resource that handles each for so long."""
    story = Story().at(0.5).module("camera").module("eye", "frame")
    story.say(facts.ResourceChanged("eye", "eye", capacity))
    events = sorted((time, 1) for time in arrivals)
    running: list[tuple[float, int]] = []
    waiting: list[int] = []

    def finish(until: float) -> None:
        while running and running[0][0] <= until:
            time, done = running.pop(0)
            story.at(time).returned(done)
            if waiting:
                story.delivered(waiting.pop(0), "eye")
                running.append((time + took, story_ids.pop(0)))
                running.sort()

    story_ids: list[int] = []
    for time, _ in events:
        finish(time)
        frame = story.at(time).received("frame", MessageClass.INFORM, "camera")
        if len(running) < capacity:
            story.delivered(frame, "eye")
            running.append((time + took, frame))
            running.sort()
        else:
            story.queued(frame, "eye")
            waiting.append(frame)
            story_ids.append(frame)
    finish(end)
    story.at(end)
    if closes:
        story.say(*(facts.Unqueued(frame) for frame in waiting), facts.HandlerRemoved("frame", "eye"))
        story.at(end + 1.0).say(facts.ModuleLeft("eye", "it said goodbye"))
    return story.fold()


def every(period: float, until: float = 100.0) -> list[float]:
    return [1.0 + period * number for number in range(int((until - 1.0) / period))]


@pytest.mark.parametrize("closes", [False, True])
def test_a_queue_that_only_grows_is_named_with_its_rates(closes: bool) -> None:
    run = served(every(0.5), took=0.8, closes=closes)
    (queue,) = growing(run, *span_of(run))
    assert (queue.key, queue.message, queue.needed) == (("eye", "eye"), "frame", 2)
    assert queue.rate_in == pytest.approx(2.0, rel=0.05)
    assert queue.rate_out == pytest.approx(1.25, rel=0.05)
    assert queue.length == pytest.approx(75, abs=3)
    (told,) = advice(run, Causes(run), None, [], [], [], 0.5)
    assert (told.topic, told.title) == (Topic.CAPACITY, "eye is a bottleneck")
    assert "2.01 a second come, 1.25 are handled" in told.text
    assert "let it handle 2 at a time instead of 1" in told.remedy
    assert contents(run).advice[0].title == told.title


def test_a_queue_that_grows_for_two_slots() -> None:
    run = served(every(0.25), took=1.0, capacity=2)
    (queue,) = growing(run, *span_of(run))
    assert (queue.capacity, queue.needed) == (2, 4)


@pytest.mark.parametrize(
    ("name", "run"),
    [
        ("it keeps up", served(every(1.0), took=0.8)),
        ("a burst that is worked off", served([1.0 + number / 100 for number in range(60)], took=1.0)),
        ("a burst that is not worked off yet", served([1.0 + number / 100 for number in range(200)], took=1.0)),
        ("it grew, and was empty again", served(every(0.5, 40.0), took=0.8, end=120.0)),
        ("it grew, and is worked off at the end", served(every(0.5, 60.0), took=0.8)),
        ("two that wait for one that hangs", served(every(10.0), took=1e6)),
        ("a handler hangs, and all that comes waits", served(every(0.5), took=1e6)),
    ],
)
def test_queues_that_give_no_alarm(name: str, run: Run) -> None:
    assert growing(run, *span_of(run)) == [], name


def test_a_busy_resource_whose_messages_come_at_random_gives_no_alarm() -> None:
    """Nine tenths busy, forty runs: long queues come and go."""
    alarms = 0
    for seed in range(40):
        random, time, arrivals = Random(seed), 0.0, []
        while time < 500.0:
            arrivals.append(time := time + random.expovariate(0.9))
        run = served(arrivals, took=1.0, end=500.0)
        alarms += len(growing(run, *span_of(run)))
    assert alarms == 0


def test_what_is_locked_needs_shorter_locks_and_no_more_slots() -> None:
    story = Story().module("eye", "frame").at(1.0).say(
        facts.Claimed(900, "eye", "eye", False, "user", 0), facts.Granted(900)
    )  # fmt: skip
    for number in range(50):
        story.at(2.0 + number).queued(story.received("frame", MessageClass.INFORM, "camera"), "eye")
    run = story.fold()
    assert growing(run, *span_of(run)) == []


def test_how_long_a_task_has_been_queued_is_told_of_the_queue_that_it_is_in() -> None:
    """It waits for busy legs, then for a module, then is suspended and goes back into the queue that it never left."""
    story = Story().module("legs", "move")
    first, second = (story.command("move", "user") for _ in range(2))
    story.delivered(first, "legs").at(10.0).queued(second, "legs").at(70.0).queued(second)
    story.at(72.0).say(facts.SuspendedOrResumed(TaskId(second), True)).at(80.0)
    story.say(facts.SuspendedOrResumed(TaskId(second), False)).at(81.0).say(facts.Closed("done"))
    run = story.fold()
    told = [words.note(at := RunAt.by_clock(run, time), at.tasks[second]) for time in (69.0, 71.5, 81.0)]
    assert told == [
        "waits for legs, busy with move {1}, for 59 s",
        "waits for a module that handles move, for 1.5 s",
        "waits for a module that handles move, for 11 s",
    ]
