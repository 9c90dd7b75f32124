"""Stories of small robots whose times can be worked out by hand."""

from typing import Any

from tools.story import QUERY, THIS, Story

from tca_wire.constraints import Constraint, delay_planning, sequential_achievement
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass, Outcome

INFORM = MessageClass.INFORM


def near(*values: Any) -> tuple[Any, ...]:
    """Values to compare: times to the microsecond, for entries at one time are a hair apart."""
    return tuple(round(value, 6) if isinstance(value, float) else value for value in values)


def stepping(planning: float = 1.0, acting: float = 2.0, steps: int = 3, errand: float = 0.0) -> Story:
    """A robot that plans a step, takes it, plans the next: each step's planning is delayed until the one before has been
    taken. The walk is sent at 1.0, its steps at 1.2 and 1.3; from then on planning and acting alternate. While each step
    but the last is taken, the planner is busy with an errand for so long.
    """
    story = Story().module("user").module("planner", "walk", "step", "errand").module("legs", "move")
    walk = story.at(1.0).goal("walk", "user", to="planner", begins=True)
    story.at(1.2)
    before: list[Constraint] = []
    sent = []
    for _ in range(steps):
        sent.append(story.goal("step", "planner", walk, *before))
        before = [sequential_achievement(TaskId(sent[-1]), THIS), delay_planning(THIS)]
    story.queued(sent[0], "planner").at(1.3).returned(walk)
    now = 1.3
    for step in sent:
        story.delivered(step, "planner").reached(step, Moment.START_ACHIEVING)
        now = round(now + planning, 6)
        move = story.at(now).command("move", "planner", step, to="legs")
        story.at(now).returned(step).reached(step, Moment.END_PLANNING)
        if errand and step is not sent[-1]:
            done = story.at(now).received("errand", INFORM, "user", origin=0, to="planner")
            story.at(round(now + errand, 6)).returned(done)
        now = round(now + acting, 6)
        story.at(now).achieved(move).reached(step, Moment.END_ACHIEVING)
    return story.reached(walk, Moment.END_PLANNING, Moment.END_ACHIEVING)


def looking_ahead() -> Story:
    """The same robot with three steps, each planned while the one before is taken (planning 1 s, acting 2 s)."""
    story = Story().module("user").module("planner", "walk", "step").module("legs", "move")
    walk = story.at(1.0).goal("walk", "user", to="planner", begins=True)
    story.at(1.2)
    steps = [story.goal("step", "planner", walk)]
    for _ in range(2):
        steps.append(story.goal("step", "planner", walk, sequential_achievement(TaskId(steps[-1]), THIS)))
    for step in steps:
        story.queued(step, "planner")
    story.at(1.3).returned(walk).delivered(steps[0], "planner").reached(steps[0], Moment.START_ACHIEVING)
    moves = []
    for number, now in enumerate((2.3, 3.3, 4.3)):
        story.at(now)
        moves.append(story.command("move", "planner", steps[number]))
        if number == 0:
            story.delivered(moves[0], "legs")
        story.at(now).returned(steps[number]).reached(steps[number], Moment.END_PLANNING)
        if number < 2:
            story.delivered(steps[number + 1], "planner")
        if number == 2:
            taken(story, moves[0], steps[0], moves[1], steps[1])
    taken(story.at(6.3), moves[1], steps[1], moves[2], steps[2])
    story.at(8.3).achieved(moves[2]).reached(steps[2], Moment.END_ACHIEVING)
    return story.reached(walk, Moment.END_PLANNING, Moment.END_ACHIEVING)


def taken(story: Story, move: int, step: int, then: int, after: int) -> None:
    """A step has been taken, and the legs go on with the next."""
    story.at(story.entries[-1].time).achieved(move)
    story.reached(step, Moment.END_ACHIEVING).reached(after, Moment.START_ACHIEVING).delivered(then, "legs")


def commanding(asks: float = 0.4) -> Story:
    """One handler does it all: it asks where to go, moves and waits for that, asks again, moves again; each question
    takes *asks*, each move 2 s. Sent at 1.0; it thinks 0.1 s before each question and each move.
    """
    story = Story().module("user").module("planner", "walk").module("eye", "where").module("legs", "move")
    walk = story.at(1.0).goal("walk", "user", to="planner", begins=True)
    now = 1.0
    for number in range(2):
        now = round(now + 0.1, 6)
        story.at(now).query("where", "planner", walk, "eye", took=asks)
        now = round(now + asks + 0.1, 6)
        move = story.at(now).command("move", "planner", walk, to="legs")
        story.at(now).say(facts.WaitBegan("planner", walk, TaskId(move), Moment.END_ACHIEVING))
        now = round(now + 2.0, 6)
        story.at(now).achieved(move).say(facts.WaitEnded("planner", walk, TaskId(move)))
        assert number < 2
    story.at(round(now + 0.1, 6)).returned(walk)
    return story.reached(walk, Moment.END_PLANNING, Moment.END_ACHIEVING)


def recovering() -> Story:
    """A move slips after 1.0 s, an exception handler takes 0.2 s to retry it, it then takes 1.5 s; the next move falls
    after 0.5 s, which an exception handler deals with in 0.3 s; the third jams after 0.4 s, and nobody handles that.
    """
    story = Story().module("user").module("legs", "move").module("expert", "recover").at(1.0)
    moves = [story.command("move", "user")]
    story.delivered(moves[0], "legs")
    fail(story.at(2.0), moves[0], "slip", "left foot")
    helper = story.rescued(moves[0], "recover", "expert")
    story.at(2.2).say(facts.Retried(TaskId(moves[0]), b"", "user")).returned(helper).reached(helper, *Moment)
    story.say(facts.Delivered(moves[0] + 100, moves[0], "legs", "legs"))
    story.at(3.7).say(facts.Returned(moves[0] + 100, Outcome.DONE, b"")).reached(moves[0], *Moment)
    moves.append(story.at(4.0).command("move", "user"))
    story.delivered(moves[1], "legs")
    fail(story.at(4.5), moves[1], "fall", "")
    helper = story.rescued(moves[1], "recover", "expert")
    story.at(4.8).returned(helper).reached(helper, *Moment).say(facts.Recovered(TaskId(moves[1])))
    story.reached(moves[1], *Moment)
    moves.append(story.at(5.0).command("move", "user"))
    story.delivered(moves[2], "legs")
    fail(story.at(5.4), moves[2], "jam", "<script>alert(1)</script>\x1b[31m")
    story.say(facts.Unhandled(TaskId(moves[2])))
    story.say(facts.Killed(TaskId(moves[2]), f"failure 'jam' of task {moves[2]} 'move' was not handled"))
    return story.reached(moves[2], *Moment)


def fail(story: Story, task: int, failure: str, text: str) -> None:
    story.say(facts.Returned(task, Outcome.FAILED, b""), facts.Failed(task, failure, text))


def asking(*, passed_on: bool = False, task_fails: bool = False, dealt_with: bool = False) -> Story:
    """A walk {1} asks where it is {2}; who handles that asks for a look {3}, which fails. What it then does, and the
    walk, is told; the walk's failure may be dealt with.
    """
    story = Story().module("planner", "walk").module("maps", "where").module("eye", "look").module("expert", "help")
    walk = story.at(1.0).goal("walk", "user", to="planner")
    where = story.at(1.1).received("where", QUERY, "planner", origin=walk, blocking=True, to="maps")
    look = story.at(1.2).received("look", QUERY, "maps", origin=where, blocking=True, to="eye")
    _blind(story.at(2.0), look).say(facts.Answered(look)).at(3.0)
    if not passed_on:
        story.returned(where).say(facts.Answered(where))
    else:
        _blind(story, where).say(facts.Answered(where))
    story.at(4.0)
    if not task_fails:
        return story.returned(walk).reached(walk, *Moment).at(5.0)
    _blind(story, walk)
    if not dealt_with:
        return story.say(facts.Unhandled(TaskId(walk))).reached(walk, *Moment).at(5.0)
    handler = story.rescued(walk, "help", "expert")
    story.at(4.5).returned(handler).reached(handler, *Moment).say(facts.Recovered(TaskId(walk)))
    return story.reached(walk, *Moment).at(5.0)


def replacing(*, top_fails: bool = False) -> Story:
    """A step {2} of a walk {1} fails, and is killed for that; the walk is achieved without it, or fails too."""
    story = Story().module("legs", "step").at(1.0)
    walk = story.goal("walk", "user")
    step = story.goal("step", "user", walk)
    _blind(story.delivered(step, "legs").at(2.0), step).say(facts.Unhandled(TaskId(step)))
    story.say(facts.Killed(TaskId(step), "not needed", "user")).reached(step, *Moment).at(3.0)
    if top_fails:
        story.say(facts.Killed(TaskId(walk), "no way", "user"))
    return story.reached(walk, *Moment).at(4.0)


def _blind(story: Story, number: int) -> Story:
    return story.failed(number, "blind", "fog")
