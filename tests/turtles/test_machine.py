"""The patrol as a state machine."""

from robots.turtle_sim.missions.machine import machine


def test_the_machine() -> None:
    states = machine([(1.0, 9.0)]).chart.states
    assert [(state.label, state.parent) for state in states] == [
        ("patrol", -1), ("Wait", 0), ("GoTo", 0), ("concurrence", 0), ("WaitForROI", 3), ("sequence", 3),
        ("Wait 2", 5), ("GoTo 2", 5), ("GoTo 3", 0),
    ]  # fmt: skip
    assert states[-1].next["completed"] == 1
