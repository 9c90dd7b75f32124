"""The states, updates and progress of tasks, as the tools tell of them."""

from typing import Any

import msgspec
import pytest
from msgspec.structs import replace
from tools.runs import checked
from tools.story import Story
from tools.test_export_mcap import topics_of

from tca_tools.check import rules
from tca_tools.explain.story import story
from tca_tools.export.tables import TABLES
from tca_tools.gantt.build import chart
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.lives import life_at, life_of
from tca_tools.tasktree_viz.words import note
from tca_wire.journal import facts
from tca_wire.journal.facts import StateChanged
from tca_wire.life_cycles import GENERAL, LifeCycle, Transition, ending
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass, Party

GRASP = TaskId(1)


def changed(tale: Story, serial: int, transition: str, state: str, text: str = "", data: Any = None) -> Story:
    """A transition of the task, by whoever may take it."""
    by = next(one.by for one in GENERAL.transitions if one.name == transition)
    module = {Party.CLIENT: "planner", Party.SERVER: "arm"}[by]
    body = b"" if data is None else msgspec.msgpack.encode(data)
    return tale.say(StateChanged(GRASP, transition, state, serial, by, module, text, body))


def grasping() -> Story:
    """A grasp is updated, tells how it goes, and is cancelled."""
    tale = Story().module("arm", "grasp").module("planner").at(1.0)
    tale.command("grasp", "planner", to="arm", data={"width": 0.10})
    changed(tale.at(2.0), 2, "result available", "running", data={"force": 1})
    changed(tale.at(3.0), 3, "update", "update requested", "it is narrower", data={"width": 0.05})
    changed(tale.at(4.0), 4, "accept", "running")
    changed(tale.at(5.0), 5, "result available", "running", data={"force": 2})
    changed(tale.at(6.0), 6, "result available", "running", data={"force": 3})
    changed(tale.at(7.0), 7, "cancel", "cancel requested", "too late")
    changed(tale.at(8.0), 7, "aborted", "cancel requested")
    tale.say(facts.Killed(GRASP, "too late", "planner")).at(9.0)
    return tale.returned(GRASP).reached(GRASP, Moment.END_ACHIEVING)


def test_a_life_is_what_the_journal_tells_and_what_that_implies() -> None:
    run = grasping().fold()
    assert [(one.time, one.transition, one.state, one.serial, one.by) for one in life_of(run, run.tasks[GRASP])] == [
        (1.0, "accepted", "running", 1, Party.SERVER),
        (2.0, "result available", "running", 2, Party.SERVER),
        (3.0, "update", "update requested", 3, Party.CLIENT),
        (4.0, "accept", "running", 4, Party.SERVER),
        (5.0, "result available", "running", 5, Party.SERVER),
        (6.0, "result available", "running", 6, Party.SERVER),
        (7.0, "cancel", "cancel requested", 7, Party.CLIENT),
        (9.0, "aborted", "cancelled", 8, Party.CENTRAL),
    ]
    asked = life_at(run, run.tasks[GRASP], 3.5)
    assert (asked.state, asked.serial, asked.is_telling) == ("update requested", 3, True)
    assert msgspec.msgpack.decode(asked.progress) == {"force": 1}
    assert msgspec.msgpack.decode(asked.asked) == {"width": 0.05}
    assert [msgspec.msgpack.decode(RunAt(run, time).tasks[GRASP].body)["width"] for time in (3.5, 4.0)] == [0.10, 0.05]


def test_a_task_that_is_handled_again_begins_anew() -> None:
    tale = Story().module("arm", "grasp").module("planner")
    grasp = tale.command("grasp", "planner", to="arm")
    changed(tale.at(1.0), 2, "result available", "running", data=1)
    changed(tale.at(2.0), 3, "update", "update requested", data=7)
    say = StateChanged(GRASP, "accept", "running", 4, Party.CENTRAL, "", "it begins anew with the new goal")
    tale.at(2.0).say(say, facts.Retried(GRASP, b"\x07", "planner")).at(3.0).returned(grasp).at(4.0)
    tale.say(facts.Delivered(2, GRASP, "arm", "arm"))
    run = tale.fold()
    assert [(one.time, one.transition, one.serial) for one in life_of(run, run.tasks[GRASP])][-3:] == [
        (pytest.approx(2.0), "accept", 4), (4.0, "restarted", 5), (4.0, "accepted", 6),
    ]  # fmt: skip
    assert not life_at(run, run.tasks[GRASP]).progress


def test_a_handler_that_accepts_by_itself_leaves_the_task_initiated() -> None:
    tale = Story().module("planner").say(facts.ModuleJoined("arm", "pid 1"), facts.ResourceChanged("arm", "arm", 1))
    tale.say(facts.HandlerAdded("grasp", "arm", "arm", accepts=True))
    tale.command("grasp", "planner", to="arm")
    run = tale.fold()
    assert life_at(run, run.tasks[GRASP])[:2] == ("initiated", 0)
    run = changed(tale.at(1.0), 1, "accepted", "running").fold()
    assert life_at(run, run.tasks[GRASP])[:2] == ("running", 1)
    assert checked(tale.caused()) == []


def test_its_story_tells_who_asked_for_what_and_how_it_went() -> None:
    told = [(one.time, one.text) for one in story(grasping().fold(), GRASP)]
    assert told[2:8] == [
        (2.0, 'result available by arm: {"force": 1}'),
        (3.0, 'update by planner, now update requested: it is narrower: {"width": 0.05}'),
        (4.0, "accept by arm, now running"),
        (5.0, 'result available by arm, 2 times; the last: {"force": 3}'),
        (7.0, "cancel by planner, now cancel requested: too late"),
        (8.0, "aborted by arm"),
    ]


def test_the_tree_shows_what_is_asked_for_and_the_newest_progress() -> None:
    run = grasping().fold()
    notes = [note(RunAt(run, time), RunAt(run, time).tasks[GRASP]) for time in (1.0, 2.0, 3.0, 7.0)]
    assert notes == ["", 'progress: {"force": 1}', 'update requested, progress: {"force": 1}',
                     'cancel requested, progress: {"force": 3}']  # fmt: skip


def test_of_progress_that_says_something_the_tree_shows_that() -> None:
    tale = Story().module("arm", "grasp").module("planner")
    tale.command("grasp", "planner", to="arm")
    changed(tale, 2, "result available", "running", data={"text": "closing", "overruns": 3, "active": [0, 1]})
    assert note(RunAt(run := tale.fold()), RunAt(run).tasks[GRASP]) == "progress: closing, overruns 3"


def test_requests_and_their_answers_are_marks_on_the_bar() -> None:
    (bar,) = (bar for row in chart(grasping().fold()).rows for bar in row.handled)
    assert [mark.time for mark in bar.marks] == [3.0, 4.0, 7.0, 8.0]
    assert bar.marks[0].title.startswith("grasp {1} at 3.000 s: update by planner, now update requested")


def test_exports_have_a_row_for_each_change_and_a_topic_of_progress() -> None:
    run = grasping().fold()
    table = next(one for one in TABLES if one.name == "changes")
    rows = list(table.rows(run))
    assert len(rows) == 7
    assert rows[1] == (1, "grasp", 3.0, "update", "update requested", 3, "client", "planner", "it is narrower",
                       '{"width": 0.05}')  # fmt: skip
    told = topics_of(grasping())["/progress/grasp"]
    assert (told.times, [one["data"]["force"] for one in told.contents]) == ([2.0, 5.0, 6.0], [1, 2, 3])


# --- the check ---------------------------------------------------------------------------------------------------------


def broken(**changes: Any) -> list[str]:
    """What the check says of the run with another update."""
    entries = grasping().caused()
    for entry in entries:
        for place, fact in enumerate(entry.facts):
            if isinstance(fact, StateChanged) and fact.transition == "update":
                entry.facts[place] = replace(fact, **changes)
    return [one.what for one in checked(entries) if one.rule == rules.LIFE.text]


def test_such_a_run_keeps_all_rules() -> None:
    assert checked(grasping().caused()) == []


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"by": Party.SERVER}, "was running, and a server took 'update', which is the client's"),
        ({"transition": "fly"}, "was running, and a client took 'fly': life cycle 'general' has no such transition"),
        ({"state": "running"}, "is running after 'update', which leads to update requested"),
        ({"serial": 7}, "changed its state for time 7, and it was time 3"),
    ],
)
def test_a_change_against_the_table_is_found(changes: dict[str, Any], what: str) -> None:
    assert f"grasp {{1}} {what}" in broken(**changes)


def test_nothing_changes_after_the_end() -> None:
    tale = changed(grasping().at(10.0), 8, "cancel", "cancel requested")
    assert [one.rule for one in checked(tale.caused())] == [rules.ENDED.text]


def test_a_table_of_its_own_is_what_a_task_is_held_against() -> None:
    pausable = LifeCycle(
        "pausable",
        [*GENERAL.transitions, Transition("pause", "running", "paused", Party.CLIENT), *ending("paused")],
    )
    tale = Story().module("arm", "grasp").module("planner")
    tale.say(facts.FormatDefined("grasp", MessageClass.COMMAND, "", "", "arm", pausable.text))
    tale.command("grasp", "planner", to="arm")
    tale.at(1.0).say(StateChanged(GRASP, "pause", "paused", 2, Party.CLIENT, "planner"))
    run = tale.fold()
    assert note(RunAt(run), RunAt(run).tasks[GRASP]) == "paused"
    assert checked(tale.caused()) == []
