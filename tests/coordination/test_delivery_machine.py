"""A machine is written, drawn, flattened to an automaton with likelihoods, and run by hand."""

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from tca_behaviours.coordination import (
    Activity,
    Agent,
    Coordination,
    Do,
    Learned,
    LikelyArrow,
    Perceived,
    Prior,
    Situation,
    TakenArrow,
    Weighted,
)
from tca_module import Command, MisuseError, Variable
from tca_wire.coordination import CoordinationReport, Foreseen

MOVE_BASE = Command("move base", str, progress=float)
MOVE_ARM = Command("move arm", str, progress=float)
MOVE_GRIPPER = Command("move gripper", str)
BOX_B_FREE = Variable("box B is free", float)
BASE, ARM, GRIPPER = Agent("base"), Agent("arm"), Agent("gripper")


def is_late(situation: Situation) -> bool:
    return situation.progress > 0.5


with Coordination("deliver", facts={"base": "A", "arm": "home", "holding": True}) as DELIVER:
    waiting = DELIVER.state("waiting")
    to_b = DELIVER.state("going to B", Activity(Do(MOVE_BASE, "B", BASE), makes={"base": "B"}))
    with DELIVER.compound("at box B") as at_b:
        arm_b = DELIVER.state("arm to B", Activity(Do(MOVE_ARM, "B", ARM), makes={"arm": "B"}))
        drop_b = DELIVER.state(
            "drop",
            Activity(Do(MOVE_GRIPPER, "open", GRIPPER, ARM), needs={"arm": "B", "base": "B"}),
        )
        dropped = DELIVER.final("dropped")
        arm_b.to(drop_b)
        arm_b.to(arm_b, "failed", when=is_late, likelihood=Prior(0.1))
        drop_b.to(dropped)
    end = DELIVER.final("end")
    waiting.to(to_b, "object given")
    to_b.to(at_b, when=BOX_B_FREE, likelihood=Perceived(BOX_B_FREE))
    to_b.to("waiting", likelihood=Perceived(BOX_B_FREE, negated=True))
    at_b.to(end)
    at_b.to(waiting, on="failed", when=is_late)
    at_b.to(waiting, on="failed")
    at_b.to(waiting, on="stop")


def situation(free: float | None, progress: float = 0.0) -> Situation:
    return Situation("", {}, {BOX_B_FREE.name: free}, progress)


def test_chart_describes_states_arrows_and_agents() -> None:
    chart = DELIVER.chart
    assert chart.agents == ["base", "arm", "gripper"]
    assert [(state.label, state.parent) for state in chart.states] == [
        ("waiting", -1),
        ("going to B", -1),
        ("at box B", -1),
        ("arm to B", 2),
        ("drop", 2),
        ("dropped", 2),
        ("end", -1),
    ]
    assert chart.states[4].lines == ['move gripper "open" (gripper+arm)']
    assert [arrow.symbol for arrow in chart.arrows if arrow.source == 1] == [
        "done [box B is free]",
        "done",
    ]
    assert DELIVER.events == {"object given", "stop"}
    assert DELIVER.variables == [BOX_B_FREE]


def test_likelihoods_follow_from_the_situation() -> None:
    seen = DELIVER.automaton(situation(free=0.75))
    assert seen.initial == 0
    assert seen.arcs(0) == [LikelyArrow("object given", 1, 0.0)], (
        "an event of others is never foreseen"
    )
    assert seen.arcs(1) == [
        LikelyArrow("done [box B is free]", 3, 0.75),
        LikelyArrow("done", 0, 0.25),
    ]
    assert seen.arcs(3) == [
        LikelyArrow("done", 4, 0.9),
        LikelyArrow("failed [is_late]", 3, 0.1),
        LikelyArrow("failed", 0, 0.0),
        LikelyArrow("stop", 0, 0.0),
    ]
    assert seen.arcs(5) == [LikelyArrow("done", 6, 1.0)], "the compound's end"
    assert seen.arcs(6) == []
    assert [arrow.likelihood for arrow in DELIVER.automaton(situation(free=None)).arcs(1)] == [
        0,
        0,
    ], "unknown"


def test_event_takes_the_innermost_arrow_with_a_true_guard() -> None:
    run = DELIVER.interpreter()
    free, taken = situation(free=0.5), situation(free=0.49)
    assert run.take("done", free) == [], "a state that waits is never done"
    assert run.take("no such event", free) == []
    assert run.take("object given", free) == [TakenArrow(0, "object given", 1)]
    assert run.take("done", taken) == [TakenArrow(1, "done", 0)]
    run.take("object given", free)
    assert run.take("done", free) == [TakenArrow(1, "done [box B is free]", 3)]
    assert run.take("failed", situation(0.5, progress=0.7)) == [
        TakenArrow(3, "failed [is_late]", 3)
    ]
    assert run.take("done", free) == [TakenArrow(3, "done", 4)]
    assert run.take("done", free) == [TakenArrow(4, "done", 5), TakenArrow(5, "done", 6)]
    assert run.is_ended
    assert run.take("stop", free) == []


def test_likelihood_models_give_their_values() -> None:
    now = situation(free=3.0)
    assert Perceived(BOX_B_FREE).value(now, "", "") == 1.0, "cut to [0, 1]"
    assert Perceived(BOX_B_FREE).value(situation(free=float("nan")), "", "") is None
    learned = Learned({("a", "done"): 3, ("a", "failed"): 1})
    assert learned.value(now, "a", "failed") == 0.25
    assert learned.value(now, "a", "stop") == 0
    assert learned.value(now, "b", "done") is None, "never seen"
    mixed = Weighted([(3, Prior(0.5)), (1, Perceived(BOX_B_FREE)), (5, learned)])
    assert mixed.value(now, "b", "done") == 0.625


def test_likelihoods_above_one_in_sum_are_normalised() -> None:
    with Coordination("m") as machine:
        a = machine.state("a", Activity(Do(MOVE_BASE, "B")))
        a.to("end", when=BOX_B_FREE, likelihood=Perceived(BOX_B_FREE))
        a.to("end", likelihood=Prior(0.5))
        machine.final("end")
    assert [arrow.likelihood for arrow in machine.automaton(situation(free=0.75)).arcs(0)] == [
        0.6,
        0.4,
    ]
    assert [arrow.likelihood for arrow in machine.automaton(situation(free=0.25)).arcs(0)] == [
        0.25,
        0.5,
    ]
    assert [arrow.likelihood for arrow in machine.automaton(situation(free=None)).arcs(0)] == [
        0,
        0,
    ], "unknown"


def test_function_can_read_watched_variables_only() -> None:
    with Coordination("m") as machine:
        a = machine.state("a", Activity(Do(MOVE_BASE, "B"), cost=lambda now: 2 * now.progress))
        a.to("end", likelihood=lambda now: now.variable(BOX_B_FREE, default=0.0))
        machine.final("end")
    activity = machine.automaton(Situation()).activity(0)
    assert activity is not None
    assert activity.cost(situation(None, progress=0.5)) == 1.0
    assert machine.automaton(situation(None)).arcs(0)[0].likelihood == 0.0
    with pytest.raises(
        MisuseError, match="variable 'box B is free' is not watched: add it to Coordination"
    ):
        machine.automaton(Situation()).arcs(0)
    with pytest.raises(
        MisuseError,
        match=r"the likelihood of 'done' in state 'a' must be a number in \[0, 1\], not 7",
    ):
        machine.automaton(situation(free=7)).arcs(0)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # Graphviz warns about missing fonts
def test_picture_marks_foreseen_states(tmp_path: Path) -> None:
    report = CoordinationReport(1, preview=[Foreseen(3, 0.75, 0.75), Foreseen(4, 0.9, 0.675)])
    DELIVER.draw(tmp_path / "machine.svg", report)
    tree = ET.parse(tmp_path / "machine.svg")
    groups = tree.iter("{http://www.w3.org/2000/svg}g")
    classes = {group.get("id"): group.get("class", "").split()[-1] for group in groups}
    assert [classes[f"state-{number}"] for number in (0, 1, 3, 4)] == [
        "node",
        "current",
        "foreseen",
        "foreseen",
    ]
    assert {"75%", "90%"} <= {text.text for text in tree.iter("{http://www.w3.org/2000/svg}text")}
    with pytest.raises(MisuseError, match="a machine can be drawn as"):
        DELIVER.draw(tmp_path / "machine.txt")
