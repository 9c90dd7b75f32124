"""What advice promises at most, held against the real central: the same robot once more, with what was advised. And in any
life, no advice promises more than there is.
"""

import heapq
from typing import Any

import pytest
from central.player import Player
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.life import Life, operation
from tools.made_robots import commanding, looking_ahead, near, recovering, stepping
from tools.story import THIS, Story, walking

from tca_central.events import ConnectionId, RequestReceived, Transmit
from tca_tools.analysis.advice import advice
from tca_tools.analysis.advice_words import Advice, Topic
from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.concurrency import Overlap, overlaps, why_held
from tca_tools.analysis.critical_path import critical_path, last_task, longest_task
from tca_tools.analysis.failures import failures
from tca_tools.analysis.resources import uses
from tca_tools.analysis.summary import summary
from tca_tools.journal.fold import History
from tca_tools.journal.records import Task
from tca_tools.journal.whole_run import Run
from tca_tools.report.contents import contents
from tca_tools.spans import Cover
from tca_wire.constraints import Constraint, delay_planning, plan_ahead, sequential_achievement
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.text.facts_in_words import called

_A_HAIR = 1e-6


def all_advice(run: Run) -> list[Advice]:
    return [one for task in (last_task(run), longest_task(run)) if task for one in advised(run, 0.0, task)]


class Timed(Player):
    """A robot whose handlers take the time that they are said to."""

    def __init__(self) -> None:
        super().__init__(check=False)
        self.due: list[tuple[float, int, str]] = []
        self.begun: set[int] = set()

    def receive(self, connection: str, header: Any, body: bytes = b"") -> list[Any]:
        effects = self.event(RequestReceived(self.time, ConnectionId(connection.encode()), header, body))
        return [effect.header for effect in effects if isinstance(effect, Transmit)]

    def returns_in(self, slots: list[str]) -> None:
        """Whoever was given something will have done it after its time."""
        for slot in slots:
            for delivery in self.delivered(slot):
                if delivery not in self.begun and (took := self.takes(slot, delivery)):
                    self.begun.add(delivery)
                    heapq.heappush(self.due, (self.time + took, delivery, slot))

    def takes(self, slot: str, delivery: int) -> float:
        """How long; 0: that is seen to elsewhere."""
        raise NotImplementedError


# --- a slot more ---------------------------------------------------------------------------------------------------

Job = tuple[int, list[int], int]
"""When it comes, how long each of its chops takes, and the packing after them."""
JOBS = st.lists(
    st.tuples(st.integers(1, 12), st.lists(st.integers(1, 6), min_size=1, max_size=2), st.integers(1, 12)),
    min_size=1,
    max_size=7,
)


class Kitchen(Timed):
    """A chef who plans in no time, a cutter with few slots that all queue for, and packers enough."""

    def __init__(self, jobs: list[Job], slots: int) -> None:
        super().__init__()
        self.seconds: dict[int, float] = {}
        self.module("user")
        self.module("chef", "goal job", capacity=len(jobs))
        self.module("cutter", "command chop", capacity=slots)
        self.module("packer", "command pack", capacity=len(jobs))
        self.jobs = sorted(jobs)
        self.slots = [f"cutter/{n + 1}" for n in range(slots)] + [f"packer/{n + 1}" for n in range(len(jobs))]

    def takes(self, slot: str, delivery: int) -> float:
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
            self.returns_in(self.slots)
        return History.until(self.entries)

    def plan(self, chops: list[int], packing: int) -> None:
        job = self.task("user", "job")
        chef = next(slot for slot in self.inbox if slot.startswith("chef/") and job in self.delivered(slot))
        for seconds in chops:
            self.seconds[self.task(chef, "chop", under=job)] = seconds
        self.seconds[self.task(chef, "pack", under=job)] = packing
        self.reply(chef, job)


@given(JOBS, st.integers(1, 2))
@settings(max_examples=40)
def test_one_more_slot_saves_no_more_than_the_report_said(jobs: list[Job], slots: int) -> None:
    run = Kitchen(jobs, slots).run()
    saved = summary(run).seconds - summary(Kitchen(jobs, slots + 1).run()).seconds
    said = max((one.saving for one in all_advice(run) if one.title == "cutter is a bottleneck"), default=0.0)
    assert saved <= said + _A_HAIR


# --- planning while acting -----------------------------------------------------------------------------------------

DURATIONS = st.lists(st.tuples(st.integers(1, 6), st.integers(1, 6)), min_size=1, max_size=6)


class Robot(Timed):
    """A planner, legs and a user. Messages take no time; plans and moves take what *durations* say, step by step."""

    def __init__(self, durations: list[tuple[int, int]], *, looks_ahead: bool) -> None:
        super().__init__()
        self.durations = durations
        self.looks_ahead = looks_ahead
        self.steps: list[int] = []
        self.moves: dict[int, int] = {}
        self.module("user")
        self.module("planner", "goal walk", "goal step")
        self.module("legs", "command move")

    def takes(self, slot: str, delivery: int) -> float:
        planning = slot == "planner/1"
        step = self.steps.index(delivery) if planning else self.moves[delivery]
        return self.durations[step][0 if planning else 1]

    def run(self) -> History:
        walk = self.task("user", "walk")
        for _ in self.durations:
            self.steps.append(self.task("planner/1", "step", under=walk, constraints=self.order()))
        self.reply("planner/1")
        self.returns_in(["planner/1", "legs/1"])
        while self.due:
            self.time, delivery, slot = heapq.heappop(self.due)
            if slot == "planner/1":
                self.moves[self.task("planner/1", "move", under=delivery)] = self.steps.index(delivery)
            self.reply(slot, delivery)
            self.returns_in(["planner/1", "legs/1"])
        return History.until(self.entries)

    def order(self) -> tuple[Constraint, ...]:
        """What holds back the planning of the next step."""
        if not self.looks_ahead:
            return (delay_planning(THIS),)
        return (plan_ahead(TaskId(self.steps[-1]), THIS),) if self.steps else ()


@given(DURATIONS)
@settings(max_examples=30)
def test_looking_one_step_ahead_saves_what_the_report_said(durations: list[tuple[int, int]]) -> None:
    """And the critical path is as long as the run, whether it looks ahead or not."""
    slow = Robot(durations, looks_ahead=False).run()
    fast = Robot(durations, looks_ahead=True).run()
    saved = summary(slow).seconds - summary(fast).seconds
    for run, said in ((slow, saved), (fast, 0.0)):
        causes, task = Causes(run), last_task(run)
        assert sum(overlap.saving for overlap in overlaps(run, causes)) == pytest.approx(said, abs=1e-6)
        assert task is not None
        steps = critical_path(run, causes, task).steps
        assert sum(step.seconds for step in steps) == pytest.approx(summary(run).seconds)


# --- a burst -------------------------------------------------------------------------------------------------------


def burst(number: int, took: float) -> Run:
    """So many commands come at once for one resource."""
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
        story.say(facts.Granted(900 + number)).at(2.0 + number).say(facts.ClaimEnded(900 + number, "released"))
        story.achieved(sweep)
    (one,) = {one.title: one for one in all_advice(story.fold())}.values()
    assert (one.topic, round(one.saving, 6)) == (Topic.LOCK, 9.0)


# --- whose end would come sooner -----------------------------------------------------------------------------------


def test_first_comes_what_moves_the_end() -> None:
    """*pour* waits six seconds for a lock, and takes two; long after it comes a *clean*, which waits half a second until
    somebody handles it.
    """
    story = Story().module("op").module("tank", "pour")
    story.at(1.0).say(facts.Claimed(50, "tank", "tank", False, "op", 0), facts.Granted(50)).at(2.0)
    pour = story.command("pour", "user")
    story.queued(pour, "tank").at(8.0).say(facts.ClaimEnded(50, "released")).delivered(pour, "tank")
    story.at(10.0).achieved(pour).at(20.0)
    clean = story.command("clean", "user")
    story.queued(clean).at(20.5).module("maid", "clean").delivered(clean, "maid")
    found = contents(story.at(21.5).achieved(clean).fold())
    assert found.path
    assert found.longest
    assert (str(found.path.path.task), str(found.longest.path.task)) == ("clean {2}", "pour {1}")
    first, second = found.advice
    assert (first.title, first.sooner) == ("Nobody handles 'clean' for a while", "")
    assert (round(first.saving, 6), round(first.on_path, 6)) == (0.5, 0.5)
    assert (second.title, second.sooner) == ("tank is locked while others wait", "pour {1}")
    assert (round(second.saving, 6), second.on_path) == (6.0, 0.0)


# --- any life ------------------------------------------------------------------------------------------------------


@given(st.lists(operation, max_size=60), st.integers(1, 5))
@settings(max_examples=40)
def test_no_advice_on_a_random_life_promises_more_than_there_is(operations: list[Any], tick: int) -> None:
    life = Life(Player(check=False))
    for name, *numbers in operations:
        life.do(name, *numbers)
    check(life, tick)


@given(st.integers(0, 1 << 32), st.integers(1, 5))
@settings(max_examples=2)
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


# --- worked out by hand ----------------------------------------------------------------------------------------------


def found_in(run: Run) -> list[Overlap]:
    return overlaps(run, Causes(run))


def advised(run: Run, at_least: float = 1e-6, task: Task | None = None) -> list[Advice]:
    """By default for the path of the last task."""
    handling, task, causes = summary(run), task or last_task(run), Causes(run)
    path = critical_path(run, causes, task) if task else None
    use = uses(run, handling.start, handling.end)
    return advice(run, causes, path, overlaps(run, causes), use, failures(run), at_least)


def test_each_plan_but_the_first_could_have_been_made_while_the_step_before_was_taken() -> None:
    """Two gaps of 1 s, in each 1 s of planning, before each 2 s of acting with the planner free: 2 s. The robot that
    looks ahead needs just that much less: 7.3 s, not 9.3.
    """
    (overlap,) = found_in(stepping().fold())
    assert [(round(one.start, 6), round(one.end, 6)) for one in overlap.chances] == [(4.3, 5.3), (7.3, 8.3)]
    assert overlap.saving == pytest.approx(2.0)
    slow, fast = (summary(story.fold()).seconds for story in (stepping(), looking_ahead()))
    assert slow - fast == pytest.approx(overlap.saving)


def test_no_more_is_saved_than_the_planner_has_time_for() -> None:
    (overlap,) = found_in(stepping(planning=1.0, acting=2.0, errand=1.5).fold())
    assert overlap.saving == pytest.approx(2 * 0.5)


def test_who_looks_ahead_already_is_told_nothing() -> None:
    assert found_in(looking_ahead().fold()) == []
    assert found_in(walking().fold()) == []


def test_a_handler_that_waits_for_its_commands() -> None:
    """Between its moves: 0.1 s of thought, 0.4 s of asking, 0.1 s of thought, while the move before took 2 s."""
    run = commanding().fold()
    (overlap,) = found_in(run)
    assert overlap.saving == pytest.approx(0.6)
    assert why_held(run, overlap.chances[0].held) == "the handler of walk {1} waited until move {3} is achieved"
    assert "the handler of 'walk' waits for 'move'" in overlap.remedy


def test_a_script_that_waits_for_one_task_before_it_sends_the_next() -> None:
    story = Story().module("script").module("planner", "walk").module("legs", "move")
    now = 1.0
    for _ in range(2):
        walk = story.at(now).goal("walk", "script", to="planner", begins=True)
        story.at(now).say(facts.WaitBegan("script", 0, TaskId(walk), Moment.END_ACHIEVING))
        move = story.at(now + 1.0).command("move", "planner", walk, to="legs")
        story.at(now + 1.0).returned(walk).reached(walk, Moment.END_PLANNING)
        story.at(now + 4.0).achieved(move).reached(walk, Moment.END_ACHIEVING)
        story.say(facts.WaitEnded("script", 0, TaskId(walk)))
        now += 4.0
    run = story.fold()
    (overlap,) = found_in(run)
    assert near(overlap.saving, why_held(run, overlap.chances[0].held)) == (
        1.0, "script waited until walk {1} is achieved",
    )  # fmt: skip


def test_a_question_that_queues_behind_the_acting() -> None:
    """The planner asks the legs where they are, and gets its answer only when they have stopped."""
    story = Story().module("user").module("planner", "walk").module("legs", "move", "where")
    walk = story.at(1.0).goal("walk", "user", to="planner", begins=True)
    first = story.at(2.0).command("move", "planner", walk, to="legs")
    asked = story.at(2.5).received("where", story._classes[walk].QUERY, "planner", 0, origin=walk, blocking=True)
    story.queued(asked, "legs").at(5.0).achieved(first).delivered(asked, "legs")
    story.at(5.1).returned(asked).say(facts.Answered(asked))
    second = story.at(6.0).command("move", "planner", walk, sequential_achievement(TaskId(first), THIS), to="legs")
    story.at(8.0).achieved(second)
    (overlap,) = found_in(story.fold())
    assert overlap.saving == pytest.approx(0.9)
    assert overlap.remedy == "'where' queues behind commands: let a resource of its own handle it"


def test_what_somebody_decides_is_no_chance() -> None:
    story = Story().module("operator").module("legs", "move")
    for start in (1.0, 9.0):
        move = story.at(start).command("move", "operator")
        story.acted(move, "legs", 2.0)
    assert found_in(story.fold()) == []


def test_the_advice_in_words_with_its_numbers() -> None:
    (one,) = advised(stepping().fold(), at_least=0.5)
    assert (one.topic, one.title, one.times) == (Topic.OVERLAP, "Plan the next while legs acts", 2)
    assert one.text == (
        "legs stood idle twice between one 'move' and the next, 2 s in all. For 2 s of that planner planned what "
        "comes next"
    )
    assert near(one.saving, one.on_path) == (2.0, 2.0)
    assert (
        one.example == "4.300 s to 5.300 s, between move {5} and move {6}: step {3} was held until step {2} is achieved"
    )


def test_questions_on_the_critical_path() -> None:
    asked = next(one for one in advised(commanding().fold()) if one.topic is Topic.QUERY)
    assert asked.text == "The critical path waits twice for the reply to 'where', 800 ms in all"
    assert asked.saving == pytest.approx(0.8)


def test_a_resource_that_all_queue_for() -> None:
    """Three moves of 2 s come at once: the second waits 2 s, the third 4 at the same time, in all 4 and not 6."""
    story = Story().module("user").module("legs", "move")
    moves = [story.at(1.0).command("move", "user") for _ in range(3)]
    story.delivered(moves[0], "legs")
    for move in moves[1:]:
        story.queued(move, "legs")
    for number, end in enumerate((3.0, 5.0, 7.0)):
        story.at(end).achieved(moves[number])
        if number < 2:
            story.delivered(moves[number + 1], "legs")
    (one,) = advised(story.fold())
    assert near(one.topic, one.saving) == (Topic.CAPACITY, 3.0)  # with two slots 6 s of moves still take three
    assert "stands twice in the queue for legs, 4 s in all. It is busy 100% of the time, with 1 at a" in one.text
    assert one.text.endswith("would save at most 3 s: what it has to do would still take 3 s")


def test_a_lock_that_is_held_long() -> None:
    story = Story().module("eye").module("legs", "move")
    story.at(1.0).say(facts.Claimed(50, "legs", "legs", False, "eye", 0), facts.Granted(50))
    move = story.at(2.0).command("move", "user")
    story.queued(move, "legs").at(5.0).say(facts.ClaimEnded(50, "released")).delivered(move, "legs")
    story.at(6.0).achieved(move)
    (one,) = advised(story.fold())
    assert near(one.topic, one.saving) == (Topic.LOCK, 3.0)
    assert one.example == "move {1} waited 3 s, until 5.000 s; eye had it"


def test_failures_cost_what_was_done_in_vain_and_what_was_done_about_them() -> None:
    """The move that slipped: 1.0 s in vain, 0.2 s until it was retried. The last one was never overcome: it ended."""
    run = recovering().fold()
    causes = Causes(run)
    path = critical_path(run, causes, run.tasks[1])
    (one,) = advice(run, causes, path, [], [], failures(run), at_least=0.1)
    assert near(one.topic, one.saving, one.window) == (Topic.FAILURE, 1.2, (1.0, 2.2))
    assert [one.topic for one in advised(run, 0.1)] == []
