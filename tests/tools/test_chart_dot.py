"""A state machine as a picture."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from tca_behaviours.missions.charts import Sequence, StateMachine
from tca_module import MisuseError
from tca_tools.drawing.chart_dot import chart_dot


def machine() -> StateMachine:
    with Sequence('look <"around">') as sm:
        start = sm.Wait(duration=1.0)
        sm.GoTo(goal_x=1.0, goal_y=1.0).on(failed="home", timeout="home")
        with sm.concurrence():
            sm.Look(foreground=False)
            with sm.machine("steps"):
                sm.Turn("left", angle=1.5).on(completed="again")
                sm.epsilon("again")
        sm.GoTo("home").on(completed=start)
    return sm


ARROWS = [
    "begin_0 -> s1",
    "s1 -> s2",
    "s2 -> begin_3 lhead=cluster_3",
    "s2 -> s8 failed dashed",
    "s2 -> s8 timeout dashed",
    "begin_3 -> s4 invis",
    "s4 -> end_3 invis",
    "begin_3 -> begin_5 invis",
    "end_5 -> end_3 invis",
    "end_3 -> s8 ltail=cluster_3",
    "begin_5 -> s6",
    "s6 -> s7",
    "s7 -> end_5",
    "s1 -> s8 dir=back",
    "s8 -> end_0 invis",
]


def test_chart_dot_draws_each_transition_as_an_arrow() -> None:
    found = []
    for line in chart_dot(machine().chart).splitlines():
        if arrow := re.match(r" *(\w+ -> \w+) \[(.*)\];", line):
            looks = re.findall(
                r"style=(\w+)|label=<&#160;(\w+)&#160;>|([lh]\w+=cluster_\d|dir=back)", arrow[2]
            )
            found.append(
                " ".join([arrow[1], *sorted(("".join(one) for one in looks), key="dashed".__eq__)])
            )
    assert sorted(found) == sorted(ARROWS)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # Graphviz warns of missing fonts
def test_drawn_machine_marks_its_active_states(tmp_path: Path) -> None:
    sm = machine()
    sm.draw(tmp_path / "machine.svg", active=[0, 3, 4])
    groups = {
        group.get("id", ""): group.get("class", "").split()
        for group in ET.parse(tmp_path / "machine.svg").iter("{http://www.w3.org/2000/svg}g")
    }
    states = {name: classes for name, classes in groups.items() if name.startswith("state-")}
    assert sorted(states) == [f"state-{number}" for number in range(9)]
    assert {name for name, classes in states.items() if "active" in classes} == {
        "state-0",
        "state-3",
        "state-4",
    }


def test_draw_refuses_unknown_suffix_and_foreign_file(tmp_path: Path) -> None:
    sm = machine()
    with pytest.raises(
        MisuseError, match=r"a machine can be drawn as .dot, .svg, .png, .pdf, not as 'machine.txt'"
    ):
        sm.draw(tmp_path / "machine.txt")
    (tmp_path / "mine.dot").write_text("mine")
    with pytest.raises(MisuseError, match="exists already"):
        sm.draw(tmp_path / "mine.dot")
    sm.draw(str(tmp_path / "machine.dot"))
    assert (tmp_path / "machine.dot").read_text().startswith("digraph machine {")
