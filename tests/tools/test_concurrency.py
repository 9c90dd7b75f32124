"""Planning that could have been done while something was acted, and what that saves at most: worked out by hand."""

import pytest
from tools.made_robots import commanding, looking_ahead, near, recovering, stepping
from tools.story import THIS, Story, walking

from tca_tools.analysis.advice import advice
from tca_tools.analysis.advice_words import Advice, Topic
from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.concurrency import Overlap, overlaps, why_held
from tca_tools.analysis.critical_path import critical_path, last_task
from tca_tools.analysis.failures import failures
from tca_tools.analysis.resources import uses
from tca_tools.analysis.summary import summary
from tca_tools.run.records import Task
from tca_tools.run.whole_run import Run
from tca_wire.constraints import sequential_achievement
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId


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
