"""Arrows that a coordination machine takes when it has been in a state for a time."""

from coordination.delivery_robot import AS_SOON_AS_LIKELY, AT_HOME, arm, base, play

from tca_behaviours.coordination import Coordination, Prior


def waiting() -> Coordination:
    """Return a machine that waits twice, inside a compound with a longer time of its own."""
    with Coordination("wait", facts=AT_HOME) as machine:
        with machine.compound("hoping") as hoping:
            first = machine.state("first")
            second = machine.state("second")
            first.after(3.0, second)
            first.to(second, on="go on")
            second.after(3.0, first)
            second.to(second, on="again")
        driving = machine.state("driving", base("B"))
        hoping.after(10.0, driving)
        driving.to(machine.final("there"))
    return machine


def test_states_are_left_after_their_times() -> None:
    with play(waiting(), None) as run:
        started = run.start()
        run.central.advance(60)
        assert started.result().state == "there"
        assert [line for line in run.event_lines() if "->" in line] == [
            "3 -> second (after 3 s)",
            "6 -> first (after 3 s)",
            "9 -> second (after 3 s)",
            "10 -> driving (after 10 s)",
            "18 -> there (done)",
        ]


def test_event_restarts_the_time_of_its_state_only() -> None:
    with play(waiting(), None) as run:
        run.start("go on", seconds=2.0)
        run.event("again")
        run.central.advance(3)
        assert [line for line in run.event_lines() if "->" in line] == [
            "0 -> second (go on)",
            "2 -> second (again)",
            "5 -> first (after 3 s)",
        ]


def test_time_stops_the_activity_of_its_state() -> None:
    with Coordination("drive", facts=AT_HOME) as machine:
        driving, late = machine.state("driving", base("B")), machine.final("late")
        driving.to(machine.final("there"))
        driving.after(4.0, late)
    with play(machine, None) as run:
        started = run.start()
        run.central.advance(30)
        assert started.result().state == "late"
        assert run.event_lines()[-2:] == ["4 base to B: killed", "4 -> late (after 4 s)"]


def test_likely_state_after_a_time_starts_early() -> None:
    with Coordination("wait", facts=AT_HOME) as machine:
        waits, fetching = machine.state("waits"), machine.state("fetching", arm("B"))
        waits.to(machine.final("called"), on="call", likelihood=Prior(0.0))
        waits.after(5.0, fetching, likelihood=Prior(0.9))
        fetching.to(machine.final("fetched"))
    with play(machine, AS_SOON_AS_LIKELY) as run:
        run.start()
        run.central.advance(30)
        assert run.event_lines()[0] == "0 arm to B: ahead"


def test_time_is_no_event_from_outside() -> None:
    assert waiting().events == {"go on", "again"}
