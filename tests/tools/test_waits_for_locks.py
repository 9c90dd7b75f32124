"""Waits because of a lock that holds for all copies of a module, and queues that only grow."""

from itertools import pairwise
from random import Random

import pytest
from central.player import Player
from central.test_claims_of_copies import CLIENTS, OPERATIONS, is_granted, join
from hypothesis import given, settings
from hypothesis import strategies as st
from tools.story import Story

from tca_tools.analysis.advice import advice
from tca_tools.analysis.advice_words import Advice, Topic
from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.resources import growing_queues, locked_out
from tca_tools.analysis.summary import span_of
from tca_tools.journal.fold import History
from tca_tools.journal.whole_run import Run
from tca_tools.report.contents import Contents, contents
from tca_wire.constraints import Flags
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.text.facts_in_words import called
from tca_wire.vocabulary import MessageClass


def advised(found: Contents) -> dict[Topic, Advice]:
    return {one.topic: one for one in found.advice}


def all_texts(found: Contents) -> str:
    texts = [
        text for one in found.advice for text in (one.title, one.text, one.remedy, one.example)
    ]
    for shown in filter(None, (found.path, found.longest)):
        texts += [share.name for share in shown.shares] + [
            what + why for _, what, why in shown.steps
        ]
    return "\n".join(texts)


def two_copies() -> Contents:
    """Run two copies of the legs, of which one moves and the other is idle. Return the report's
    contents.

    The map's handler waits for a lock of both copies. The move that is sent after the lock waits,
    too.
    """
    player = Player.of("legs: command move")
    join(player, "new")
    player.module("map", "query where")
    player.module("user")
    player.task("user", "move", flags=Flags.NONE)
    player.send("user", "where")
    number, (asked,) = player.number("map/1"), player.delivered("map/1")
    player.receive("map/1", headers.Lock(number, "legs", "legs", origin=asked, blocking=True))
    player.task("user", "move", flags=Flags.NONE)
    assert not player.delivered("legs/1"), "the idle copy"
    player.tick(20.0)
    player.reply("new/1")
    player.tick(10.0)
    player.request("map/1", headers.Release, number)
    player.reply(next(one for one in ("legs/1", "new/1") if player.delivered(one)))
    return contents(History.until(player.entries))


def test_lock_of_all_copies_is_not_a_capacity_bottleneck() -> None:
    found = two_copies()
    advice_of = advised(found)
    assert (advice_of[Topic.LOCK].title, Topic.CAPACITY in advice_of) == (
        "legs is locked while others wait",
        False,
    )
    assert "map held it" in advice_of[Topic.LOCK].example
    assert advice_of[Topic.LOCK].saving > 30
    assert Topic.OVERLAP not in advice_of, "behind a lock nothing is planned"
    assert next(use for use in found.uses if use.name.startswith("legs")).locked > 10


def test_reservation_does_not_keep_out_its_holder() -> None:
    story = Story().module("m").module("legs", "move")
    run = (
        story.at(1.0)
        .say(facts.Claimed(50, "legs", "legs", True, "m", 0), facts.Granted(50))
        .at(9.0)
        .fold()
    )
    assert [
        locked_out(run, ("legs", "legs"), 2.0, 5.0, sender=who)[0] for who in ("m", "user")
    ] == [
        0.0,
        3.0,
    ]


# --- random runs ----------------------------------------------------------------------------------


@given(
    st.lists(
        st.tuples(st.sampled_from([*OPERATIONS, "move", "reply"]), st.integers(0, 7)), max_size=60
    )
)
@settings(max_examples=60)
def test_kept_out_time_matches_the_claims_of_all_copies(life: list[tuple[str, int]]) -> None:
    """The time is compared with a sum over the facts. While a claim is in force, a queueing is due
    to this claim.
    """
    run = random_run(life)
    for queueing in run.queueings:
        if queueing.module:
            sender = run.messages[queueing.message_id].sender
            end = run.time if queueing.end is None else queueing.end
            seconds, _ = locked_out(
                run, (queueing.module, queueing.resource), queueing.start, end, sender=sender
            )
            assert -1e-6 <= seconds <= end - queueing.start + 1e-6
            assert seconds == pytest.approx(
                kept_out_by_facts(run, queueing.module, queueing.start, end, sender)
            )
    assert "?" not in all_texts(contents(run))


def random_run(life: list[tuple[str, int]]) -> Run:
    player = Player()
    wanted: list[tuple[str, int]] = []
    copies: list[str] = []
    for client in ("user", *CLIENTS):
        player.module(client)
    player.declare("user", "command move")
    for what, number in life:
        if what == "join":
            copies.append(f"copy{len(copies)}")
            join(player, copies[-1])
        elif what == "move":
            player.task((*CLIENTS, "user")[number % 4], "move", flags=Flags.NONE)
        elif what == "reply" and (busy := [one for one in copies if player.delivered(f"{one}/1")]):
            player.reply(f"{busy[number % len(busy)]}/1")
        elif what in ("lock", "reserve") and copies:
            client = CLIENTS[number % len(CLIENTS)]
            wanted.append((client, player.number(client)))
            player.receive(client, headers.Lock(wanted[-1][1], "legs", reserve=what == "reserve"))
        elif what == "release" and (had := [one for one in wanted if is_granted(player, *one)]):
            client, lock = wanted.pop(wanted.index(had[number % len(had)]))
            player.request(client, headers.Release, lock)
        player.tick(float(number))
    return History.until(player.entries)


def kept_out_by_facts(run: Run, module: str, start: float, end: float, sender: str) -> float:
    """Return the kept-out time, summed over the intervals between entries."""
    times = sorted({start, end, *(time for time in run.times if start < time < end)})
    return sum(
        after - time
        for time, after in pairwise(times)
        if any(
            claim.start <= time
            and (claim.end is None or claim.end > time)
            and (claim.start <= start or (claim.granted is not None and claim.granted <= time))
            and not (claim.is_reserved and claim.sender == sender)
            for claim in run.claims.values()
            if called(claim.module) == called(module)
        )
    )


# --- growing queues -------------------------------------------------------------------------------


def served(
    arrivals: list[float],
    took: float,
    end: float = 100.0,
    capacity: int = 1,
    *,
    closes: bool = False,
) -> Run:
    """Return a run of informs that arrive at given times. A resource handles each of them for
    *took* seconds.
    """
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
        story.say(
            *(facts.Unqueued(frame) for frame in waiting), facts.HandlerRemoved("frame", "eye")
        )
        story.at(end + 1.0).say(facts.ModuleLeft("eye", "it said goodbye"))
    return story.fold()


def periodic(period: float, until: float = 100.0) -> list[float]:
    return [1.0 + period * number for number in range(int((until - 1.0) / period))]


@pytest.mark.parametrize("closes", [False, True])
def test_growing_queue_is_reported_with_its_rates(closes: bool) -> None:
    run = served(periodic(0.5), took=0.8, closes=closes)
    (queue,) = growing_queues(run, *span_of(run))
    assert (queue.key, queue.message, queue.needed) == (("eye", "eye"), "frame", 2)
    assert queue.rate_in == pytest.approx(2.0, rel=0.05)
    assert queue.rate_out == pytest.approx(1.25, rel=0.05)
    assert queue.length == pytest.approx(75, abs=3)
    (growth_advice,) = advice(run, Causes(run), None, [], [], [], 0.5)
    assert (growth_advice.topic, growth_advice.title) == (Topic.CAPACITY, "eye is a bottleneck")
    assert "2.01 arrive per second, 1.25 are handled" in growth_advice.text
    assert "let it handle 2 at a time instead of 1" in growth_advice.remedy
    assert contents(run).advice[0].title == growth_advice.title


def test_growing_queue_of_two_slots_needs_four() -> None:
    run = served(periodic(0.25), took=1.0, capacity=2)
    (queue,) = growing_queues(run, *span_of(run))
    assert (queue.capacity, queue.needed) == (2, 4)


@pytest.mark.parametrize(
    ("name", "run"),
    [
        ("keeps up", served(periodic(1.0), took=0.8)),
        (
            "handled burst",
            served([1.0 + number / 100 for number in range(60)], took=1.0),
        ),
        (
            "unfinished burst",
            served([1.0 + number / 100 for number in range(200)], took=1.0),
        ),
        ("grew and emptied", served(periodic(0.5, 40.0), took=0.8, end=120.0)),
        ("shrinking at the end", served(periodic(0.5, 60.0), took=0.8)),
        ("hung handler, few messages", served(periodic(10.0), took=1e6)),
        ("hung handler, many messages", served(periodic(0.5), took=1e6)),
    ],
)
def test_bounded_queue_gives_no_alarm(name: str, run: Run) -> None:
    assert growing_queues(run, *span_of(run)) == [], name


def test_random_arrivals_below_capacity_give_no_alarm() -> None:
    """At a load of 0.9, long queues come and go. Forty runs give no false alarm."""
    alarms = 0
    for seed in range(40):
        random, time, arrivals = Random(seed), 0.0, []
        while time < 500.0:
            arrivals.append(time := time + random.expovariate(0.9))
        run = served(arrivals, took=1.0, end=500.0)
        alarms += len(growing_queues(run, *span_of(run)))
    assert alarms == 0


def test_queue_behind_a_lock_is_not_called_growing() -> None:
    story = (
        Story()
        .module("eye", "frame")
        .at(1.0)
        .say(facts.Claimed(900, "eye", "eye", False, "user", 0), facts.Granted(900))
    )
    for number in range(50):
        story.at(2.0 + number).queued(story.received("frame", MessageClass.INFORM, "camera"), "eye")
    run = story.fold()
    assert growing_queues(run, *span_of(run)) == []
