"""The patrol as a state machine."""

from turtles.towns import bounded, carry_out, started, town

from robots.turtle_sim.missions.machine import machine


def test_turtle_machine_has_the_papers_states() -> None:
    chart = machine([(1.0, 9.0)]).chart
    assert [(state.label, state.parent) for state in chart.states] == [
        ("patrol", -1),
        ("Wait", 0),
        ("GoTo", 0),
        ("concurrence", 0),
        ("WaitForROI", 3),
        ("sequence", 3),
        ("Wait 2", 5),
        ("GoTo 2", 5),
        ("GoTo 3", 0),
    ]
    assert [arrow.target for arrow in chart.arrows if arrow.source == 8] == [1]


def test_turtle_machine_runs() -> None:
    """The turtle never enters the region. It visits all points and the middle, then starts over."""
    with town() as there:
        carry_out(there, bounded(there, 9, machine([(1.0, 3.0), (3.0, 3.0)]).run))
        tasks = [task for task in started(there) if task != "WaitForROI"]
        assert len(started(there)) <= len(tasks) + 2
        assert tasks[:8] == ["Wait", "GoTo", "Wait", "GoTo", "Wait", "GoTo", "GoTo", "Wait"]
        assert not there.server.runs


def test_region_of_interest_ends_the_concurrence() -> None:
    """The turtle enters the region on its way to the first point. It never drives to the second
    one.
    """
    with town() as there:
        carry_out(there, bounded(there, 6, machine([(10.0, 6.5), (10.0, 1.0)]).run))
        assert sorted(started(there)[2:4]) == ["Wait", "WaitForROI"]
        assert started(there)[4:6] == ["GoTo", "GoTo"]
        furthest = max(x for stroke in there.world.strokes for x, _ in stroke.points)
        assert 8.0 < furthest < 9.0
