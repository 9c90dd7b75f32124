"""What a bottleneck costs at most, held against the real central: the same kitchen, once with a slot more. And in any
life, no advice promises more than there is.
"""

import heapq
from typing import Any

from central.player import Player
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.life import Life, operation
from tools.story import Story

from tca_central.events import ConnectionId, RequestReceived, Transmit
from tca_tools.analysis.advice import advice
from tca_tools.analysis.advice_words import Advice, Topic
from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.concurrency import overlaps
from tca_tools.analysis.critical_path import critical_path, last_task, longest_task
from tca_tools.analysis.failures import failures
from tca_tools.analysis.resources import uses
from tca_tools.analysis.summary import summary
from tca_tools.report.contents import contents
from tca_tools.run.fold import History
from tca_tools.run.whole_run import Run
from tca_tools.spans import Cover
from tca_wire.journal import facts
from tca_wire.points import Moment
from tca_wire.text.facts_in_words import called

_A_HAIR = 1e-6


def all_advice(run: Run) -> list[Advice]:
    handling, causes = summary(run), Causes(run)
    use, kinds = uses(run, handling.start, handling.end), failures(run)
    told = []
    for task in filter(None, (last_task(run), longest_task(run))):
        path = critical_path(run, causes, task)
        told += advice(run, causes, path, overlaps(run, causes), use, kinds, 0.0)
    return told


# --- a slot more ---------------------------------------------------------------------------------------------------

Job = tuple[int, list[int], int]
"""When it comes, how long each of its chops takes, and the packing after them."""
JOBS = st.lists(
    st.tuples(st.integers(1, 12), st.lists(st.integers(1, 6), min_size=1, max_size=2), st.integers(1, 12)),
    min_size=1,
    max_size=7,
)


class Kitchen(Player):
    """A chef who plans in no time, a cutter with few slots that all queue for, and packers enough."""

    def __init__(self, jobs: list[Job], slots: int) -> None:
        super().__init__()
        self.due: list[tuple[float, int, str]] = []
        self.takes: dict[int, float] = {}
        self.module("user")
        self.module("chef", "goal job", capacity=len(jobs))
        self.module("cutter", "command chop", capacity=slots)
        self.module("packer", "command pack", capacity=len(jobs))
        self.jobs = sorted(jobs)
        self.slots = [f"cutter/{n + 1}" for n in range(slots)] + [f"packer/{n + 1}" for n in range(len(jobs))]

    def receive(self, connection: str, header: Any, body: bytes = b"") -> list[Any]:
        effects = self.event(RequestReceived(self.time, ConnectionId(connection.encode()), header, body))
        return [effect.header for effect in effects if isinstance(effect, Transmit)]

    def run(self) -> History:
        waiting = list(self.jobs)
        while waiting or self.due:
            if not self.due or (waiting and waiting[0][0] <= self.due[0][0]):
                self.time, chops, packing = waiting.pop(0)
                self.plan(chops, packing)
            else:
                self.time, delivery, slot = heapq.heappop(self.due)
                self.reply(slot, delivery)
            self.begin()
        return History.until(self.entries)

    def plan(self, chops: list[int], packing: int) -> None:
        job = self.task("user", "job")
        chef = next(slot for slot in self.inbox if slot.startswith("chef/") and job in self.delivered(slot))
        for seconds in chops:
            self.takes[self.task(chef, "chop", under=job)] = seconds
        self.takes[self.task(chef, "pack", under=job)] = packing
        self.reply(chef, job)

    def begin(self) -> None:
        """Whoever was given something will have done it after its time."""
        for slot in self.slots:
            for delivery in self.delivered(slot):
                if delivery in self.takes:
                    heapq.heappush(self.due, (self.time + self.takes.pop(delivery), delivery, slot))


@given(JOBS, st.integers(1, 2))
@settings(max_examples=100)
def test_one_more_slot_saves_no_more_than_the_report_said(jobs: list[Job], slots: int) -> None:
    run = Kitchen(jobs, slots).run()
    saved = summary(run).seconds - summary(Kitchen(jobs, slots + 1).run()).seconds
    said = max((one.saving for one in all_advice(run) if one.title == "cutter is a bottleneck"), default=0.0)
    assert saved <= said + _A_HAIR


# --- a burst -------------------------------------------------------------------------------------------------------


def burst(number: int, took: float) -> Run:
    """So many commands come at once for one resource."""
    story = Story().module("user").module("cutter", "chop")
    chops = [story.at(1.0).command("chop", "user") for _ in range(number)]
    story.delivered(chops[0], "cutter")
    for chop in chops[1:]:
        story.queued(chop, "cutter")
    for place, chop in enumerate(chops):
        story.at(1.0 + (place + 1) * took).returned(chop).reached(chop, Moment.END_ACHIEVING)
        if place + 1 < number:
            story.delivered(chops[place + 1], "cutter")
    return story.fold()


def test_waits_of_three_hundred_in_one_queue_are_no_twelve_minutes() -> None:
    """The run lasts 3 s; all waits added up are 449 s, and with two slots the commands would still take 1.5."""
    (one,) = {one.title: one for one in all_advice(burst(300, 0.01))}.values()
    assert (one.title, round(one.saving, 6), round(one.on_path, 6)) == ("cutter is a bottleneck", 1.5, 1.5)
    assert "stands 299 times in the queue for cutter, 2.99 s in all" in one.text


def test_handlers_that_wait_for_one_lock_at_once() -> None:
    """Ten sweepers each want the broom for 1 s; the last of them waits for nine others, all at the same time."""
    story = Story().module("user").module("broom", "lend").module("sweeper", "sweep")
    story.say(facts.ResourceChanged("sweeper", "sweeper", 10)).at(1.0)
    sweeps = [story.command("sweep", "user") for _ in range(10)]
    for number, sweep in enumerate(sweeps):
        story.delivered(sweep, "sweeper").say(facts.Claimed(900 + number, "broom", "broom", False, "sweeper", sweep))
    for number, sweep in enumerate(sweeps):
        story.say(facts.Granted(900 + number))
        story.at(2.0 + number).say(facts.ClaimEnded(900 + number, "released"))
        story.returned(sweep).reached(sweep, Moment.END_ACHIEVING)
    (one,) = {one.title: one for one in all_advice(story.fold())}.values()
    assert (one.topic, round(one.saving, 6)) == (Topic.LOCK, 9.0)


# --- any life ------------------------------------------------------------------------------------------------------


@given(st.lists(operation, max_size=60), st.integers(1, 5))
@settings(max_examples=60)
def test_no_advice_on_a_random_life_promises_more_than_there_is(operations: list[Any], tick: int) -> None:
    life = Life(Player(check=False))
    for name, *numbers in operations:
        life.do(name, *numbers)
    check(life, tick)


@given(st.integers(0, 1 << 32), st.integers(1, 5))
@settings(max_examples=3)
def test_nor_on_a_longer_one(seed: int, tick: int) -> None:
    life = Life(Player(check=False))
    life.go_on(seed, 1_000)
    check(life, tick)


def check(life: Life, tick: int) -> None:
    """With a clock that goes on every so many seconds only."""
    entries = [facts.Entry(entry.number, entry.time // tick * tick, entry.facts) for entry in life.player.entries]
    run = History.until(entries)
    seconds = summary(run).seconds
    check_ends(run)
    for one in all_advice(run):
        assert "'?'" not in one.title + one.text + one.remedy + one.example, one
        assert 0.0 <= one.on_path <= one.saving + _A_HAIR, one
        assert one.saving <= seconds + _A_HAIR, one
        if one.topic in (Topic.CAPACITY, Topic.LOCK):
            assert one.saving <= waited(run, one.title.split(" is ")[0]) + _A_HAIR, one


def check_ends(run: Run) -> None:
    """Whose end would come sooner: of the path that is shown first, or of the one that advice names."""
    found = contents(run)
    for one in found.advice:
        assert found.path is not None or not one.on_path, one
        assert not found.path or one.on_path <= found.path.path.seconds + _A_HAIR, one
        if one.sooner:
            assert found.longest is not None, one
            path = found.longest.path
            assert (one.sooner, one.on_path) == (str(path.task), 0.0), one
            assert one.saving <= path.seconds + _A_HAIR or one.topic is Topic.CAPACITY, one
    assert [one.on_path for one in found.advice] == sorted((one.on_path for one in found.advice), reverse=True)


def waited(run: Run, where: str) -> float:
    """How long anything stood in the queue of a resource, in any copy, or wanted to lock it; what overlaps once."""
    module, _, resource = where.partition(" / ")
    key = (called(module), resource or module)
    queues = [(one.start, one.end) for one in run.queueings if (called(one.module), one.resource) == key]
    claims = [(one.start, one.granted) for one in run.claims.values() if (called(one.module), one.resource) == key]
    return Cover((since, run.time if until is None else until) for since, until in queues + claims).total
