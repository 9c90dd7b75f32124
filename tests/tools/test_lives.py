"""The states, updates and progress of tasks, as the tools tell of them."""

from typing import Any

import msgspec
import pytest
from msgspec.structs import replace
from tools.runs import checked
from tools.story import Story
from tools.test_export_mcap import topics_of

from tca_tools.check import rules
from tca_tools.export.tables import TABLES
from tca_tools.gantt.build import chart
from tca_wire.journal import facts
from tca_wire.journal.facts import StateChanged
from tca_wire.life_cycles import GENERAL
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Party

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
