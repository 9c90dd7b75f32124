"""Why a step of the critical path began just then: every link from what had to be over, and who went on in vain."""

from tools.story import QUERY, Story
from tools.test_critical_path import path_of

from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.critical_path import critical_path
from tca_tools.analysis.step_words import why_then
from tca_tools.report.contents import contents
from tca_tools.run.whole_run import Run
from tca_wire.constraints import sequential_achievement
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass, Outcome, Role

END = Moment.END_ACHIEVING


def whys(run: Run, task: int) -> list[str]:
    return [why_then(run, step) for step in critical_path(run, Causes(run), run.tasks[task]).steps]


def one_after_the_other() -> tuple[Story, list[int]]:
    """A day, a walk and a cleaning in sequence; the walk and the cleaning are planned, the day is killed at 5.0."""
    story = Story().module("user").module("boss", "day", "walk", "clean").module("arm", "grip", "move").at(1.0)
    tasks: list[int] = []
    for name in ("day", "walk", "clean"):
        tasks.append(story.goal(name, "user", 0, *[sequential_achievement(TaskId(one), THIS) for one in tasks[-1:]]))
    day, walk, clean = tasks
    grip = story.delivered(day, "boss").reached(day, Moment.START_ACHIEVING).command("grip", "boss", day)
    story.delivered(grip, "arm").returned(day).reached(day, Moment.END_PLANNING).at(2.0)
    story.delivered(walk, "boss").returned(walk).reached(walk, Moment.END_PLANNING).at(3.0).delivered(clean, "boss")
    tasks.append(story.command("move", "boss", clean))
    story.returned(clean).reached(clean, Moment.END_PLANNING).at(5.0).returned(grip, Outcome.FAILED)
    story.say(facts.Failed(grip, "slipped", ""), facts.Unhandled(TaskId(grip)), facts.Killed(TaskId(grip), "why"))
    story.say(facts.Killed(TaskId(day), "it slipped")).reached(grip, *Moment).reached(day, *Moment)
    return story.reached(walk, Moment.START_ACHIEVING, END).reached(clean, Moment.START_ACHIEVING), tasks


THIS = TaskId(-1)
LINKS = (
    "; clean {3} waited until walk {2} is achieved; walk {2} waited until day {1} is achieved; "
    "day {1} was killed: it slipped"
)


def test_what_waits_for_what_is_told_link_by_link() -> None:
    story, (_, _, clean, move) = one_after_the_other()
    story.delivered(move, "arm").at(7.0).returned(move).reached(move, END).reached(clean, END)
    assert whys(story.fold(), clean)[-1] == f"it waited until its parent clean {{3}} is being achieved{LINKS}"


def test_so_it_is_of_a_listener() -> None:
    story, (_, _, clean, move) = one_after_the_other()
    story.module("safety", "check")
    check = story.received(
        "check", MessageClass.COMMAND, "central", move, origin=0, role=Role.LISTENER, about=move, to="safety"
    )
    story.at(6.0).returned(check).reached(check, END)
    story.delivered(move, "arm").at(7.0).returned(move).reached(move, END).reached(clean, END)
    assert whys(story.fold(), clean)[-2] == (
        f"listener for move {{{move}}}, which waited until its parent clean {{3}} is being achieved{LINKS}"
    )


def given_up() -> Run:
    """*go* asks for a look, gives up after a second, then asks all, of whom the eye still looks; in vain, too."""
    story = Story().module("user").module("m", "go").module("eye", "look", "all").at(1.0)
    go = story.command("go", "user", to="m")
    look = story.at(2.0).received("look", QUERY, "m", origin=go, blocking=True, to="eye")
    story.at(3.0).say(facts.Dropped(look, "any", "its sender gave up")).at(4.0)
    every = story.received("all", MessageClass.MULTI_QUERY, "m", origin=go, blocking=True)
    story._next_id += 1
    story.say(facts.Queued(every + 1, every, "eye", "eye")).at(5.0).say(
        facts.Dropped(every, "any", "its sender gave up")
    )
    story.at(6.0).returned(go).reached(go, END).at(8.0).returned(look)
    return story.at(9.0).fold()


STILL = "look {2} was given up at 3.000 s, but eye went on with it until 8.000 s"


def test_a_question_to_many_that_is_given_up_stood_in_a_queue() -> None:
    run = given_up()
    assert path_of(run) == [
        ("go", "m", 1.0, 2.0), ("look", "eye", 2.0, 3.0), ("go", "m", 3.0, 4.0), ("queued", "eye", 4.0, 5.0),
        ("go", "m", 5.0, 6.0),
    ]  # fmt: skip
    assert any(f"for eye, busy with look {{2}}; {STILL}" in why for why in whys(run, 1))


def test_who_goes_on_with_what_was_given_up_is_named() -> None:
    told = {one.title: one for one in contents(given_up()).advice}
    for name in ("look", "all"):
        one = told[f"The reply to '{name}' is waited for in vain"]
        assert one.example.endswith(STILL)
        assert "Giving up does not end the handler: it keeps its resource" in one.remedy
