"""Running machines, on a mission whose tasks end as scripted."""

from typing import Any

import pytest
from missions.charts.played import Played, PlayedMission

from tca_behaviours.missions.charts import Concurrence, Sequence, StateMachine


def patrol() -> StateMachine:
    with Sequence("patrol") as sm:
        start = sm.Wait()
        with sm.concurrence():
            sm.Look(foreground=False)
            with sm.sequence():
                sm.Turn()
                sm.GoTo(goal_x=1)
        sm.GoTo("home", goal_x=5).on(completed=start)
    return sm


def test_sequence_restarts_by_its_transition() -> None:
    run = Played(
        patrol(),
        "Wait completed",
        "Turn completed",
        "GoTo completed",
        "GoTo completed",
        "Wait timeout",
    )
    assert run.end == ("timeout", "Wait was not done in time")
    assert run.happened == [
        "start Wait",
        "Wait completed",
        "start Look(False)",
        "start Turn",
        "Turn completed",
        "start GoTo(1)",
        "GoTo(1) completed",
        "stop Look(False)",
        "Look(False) interrupted",  # before the next task starts
        "start GoTo(5)",
        "GoTo(5) completed",
        "start Wait",
        "Wait timeout",
    ]
    assert run.active == [
        ["Wait"],
        ["concurrence", "Look", "sequence", "Turn"],
        ["concurrence", "Look", "sequence", "GoTo"],
        ["home"],
        ["Wait"],
    ]
    assert [(one.running, one.after) for one in run.published][:2] == [
        (["Wait"], ""),
        (["Look", "Turn"], "Wait has completed"),
    ]


def test_concurrence_ends_with_its_first_state() -> None:
    run = Played(patrol(), "Wait completed", "Look completed")
    assert run.happened[3:] == [
        "start Turn",
        "Look(False) completed",
        "stop Turn",
        "Turn interrupted",
        "start GoTo(5)",
        "stop GoTo(5)",
        "GoTo(5) interrupted",  # at the end of the script, nothing is left running
    ]
    run = Played(patrol(), "Wait completed", "Look failed + Turn completed")
    assert run.end == ("failed", "Look has failed")
    assert run.happened[3:] == ["start Turn", "Look(False) failed", "Turn completed"]


def test_concurrence_until_all_ends_with_its_last_state() -> None:
    with Concurrence("both", until="all") as sm:
        sm.Look(foreground=False)
        with sm.concurrence(until="all"):
            sm.Listen(foreground=False)
            with sm.sequence():
                sm.Turn()
                sm.GoTo()
    run = Played(sm, "Listen completed", "Turn completed", "Look completed", "GoTo completed")
    assert run.end == ("completed", "GoTo has completed")
    assert run.active[-1] == ["concurrence", "sequence", "GoTo"]
    run = Played(sm, "Look completed + Listen interrupted")
    assert run.end == ("interrupted", "Listen was interrupted")
    assert run.happened[-2:] == ["stop Turn", "Turn interrupted"]


@pytest.mark.parametrize(
    ("script", "end"),
    [
        (("Look failed", "Listen completed", "Turn failed"), ("failed", "Look has failed")),
        (("Listen timeout", "Turn failed", "Look completed"), ("timeout", "Listen was not done")),
        (("Look completed", "Listen completed", "Turn completed"), ("completed", "Turn has")),
    ],
)
def test_cause_is_the_first_ending_that_counts(
    script: tuple[str, ...], end: tuple[str, str]
) -> None:
    with Concurrence("both", until="all ended") as sm:
        sm.Look(foreground=False)
        with sm.concurrence(until="all ended"):
            sm.Listen(foreground=False)
            sm.Turn()
    run = Played(sm, *script)
    assert run.end is not None
    assert (run.end.ending, run.end.event[: len(end[1])]) == end


def test_machine_follows_written_transitions_only() -> None:
    with StateMachine("fetch") as sm:
        sm.GoTo().on(completed="grasp", failed="Turn")
        sm.Turn().on(completed="GoTo")
        with sm.sequence("grasp") as grasp:
            sm.Open()
            sm.Close()
        grasp.on(timeout=grasp)
    run = Played(
        sm,
        "GoTo failed",
        "Turn completed",
        "GoTo completed",
        "Open completed",
        "Close timeout",
        "Open completed",
        "Close completed",
    )
    assert run.end == ("completed", "Close has completed")
    assert [name for name in run.happened if name.startswith("start")] == [
        "start GoTo",
        "start Turn",
        "start GoTo",
        "start Open",
        "start Close",
        "start Open",
        "start Close",
    ]


def test_branch_restarts_without_the_others() -> None:
    with Sequence("robot") as sm:
        with sm.concurrence():
            look = sm.Look(foreground=False)
            with sm.sequence() as steps:
                sm.Turn()
                sm.GoTo()
        look.on(failed=look)
        steps.on(failed=steps)
        sm.Wait()
    run = Played(
        sm,
        "Look failed",
        "Turn completed",
        "GoTo failed",
        "Turn failed",
        "Look completed",
        "Wait completed",
    )
    assert run.end == ("completed", "Wait has completed")
    assert [name for name in run.happened if "Look" in name or name == "start Turn"] == [
        "start Look(False)",
        "start Turn",
        "Look(False) failed",
        "start Look(False)",
        "start Turn",
        "start Turn",
        "Look(False) completed",
    ]


def test_transitions_lead_out_of_containers() -> None:
    """A state may lead out of its containers, and a container may restart from inside."""
    with Sequence("robot") as sm:
        with sm.concurrence("both"):
            sm.Look(foreground=False).on(completed="found")
            with sm.sequence("steps"):
                sm.Turn().on(timeout="steps", failed="both")
                sm.GoTo().on(failed="home")
        sm.epsilon("nothing found")
        sm.Home("home")
        sm.Sing("found")
    run = Played(
        sm,
        "Turn timeout",
        "Turn failed",
        "Turn completed",
        "GoTo failed",
        "Home completed",
        "Sing completed",
    )
    assert run.end == ("completed", "found has completed")
    assert run.happened == [
        "start Look(False)",
        "start Turn",
        "Turn timeout",
        "start Turn",
        "Turn failed",
        "stop Look(False)",
        "Look(False) interrupted",
        "start Look(False)",
        "start Turn",
        "Turn completed",
        "start GoTo",
        "GoTo failed",
        "stop Look(False)",
        "Look(False) interrupted",
        "start Home",
        "Home completed",
        "start Sing",
        "Sing completed",
    ]
    assert Played(sm, "Look completed", "Sing completed").happened[-2:] == [
        "start Sing",
        "Sing completed",
    ]


def test_error_in_one_branch_stops_all_tasks() -> None:
    with Concurrence("both") as sm:
        sm.Look(foreground=False)
        sm.Listen(foreground=False)
        with sm.sequence():
            sm.Wait()
            sm.Broken()
    mission = PlayedMission("Wait completed")
    with pytest.raises(ZeroDivisionError):
        Played(sm, on=mission)
    assert mission.happened[-4:] == [
        "stop Look(False)",
        "stop Listen(False)",
        "Look(False) interrupted",
        "Listen(False) interrupted",
    ]


def test_ctrl_c_stops_all_tasks_of_the_machine() -> None:
    mission = PlayedMission("Wait completed", "Ctrl-C")
    with pytest.raises(KeyboardInterrupt):
        Played(patrol(), on=mission)
    assert mission.happened[-4:] == [
        "stop Look(False)",
        "stop Turn",
        "Look(False) interrupted",
        "Turn interrupted",
    ]
    assert not mission.running


def test_tasks_start_in_written_and_stop_in_reverse_order() -> None:
    with Concurrence("both", until="all") as sm:
        with sm.sequence(), sm.sequence(), sm.sequence():
            sm.First(foreground=False)
        sm.Second(foreground=False)
        sm.Third(foreground=False)
    run = Played(sm, "Third failed")
    assert run.happened == [
        "start First(False)",
        "start Second(False)",
        "start Third(False)",
        "Third(False) failed",
        "stop Second(False)",
        "stop First(False)",
        "Second(False) interrupted",
        "First(False) interrupted",
    ]


def test_machine_leaves_a_state_after_a_time() -> None:
    with StateMachine("wait") as sm:
        sm.Listen("listen").after(2.0, "outer").on(completed="listen")
        with sm.sequence("outer").after(5.0, "timeout"):
            sm.Look().after(3.0, "Turn")
            sm.Turn()
    run = Played(sm, "Listen completed", "time", "time", "time")
    assert run.end == ("timeout", "outer: after 5 s")
    assert run.mission.now == 7.0
    assert [one.after for one in run.published] == [
        "",
        "listen has completed",
        "listen: after 2 s",
        "Look: after 3 s",
    ]
    assert run.happened[2:] == [
        "start Listen",
        "stop Listen",
        "Listen interrupted",
        "start Look",
        "stop Look",
        "Look interrupted",
        "start Turn",
        "stop Turn",
        "Turn interrupted",
    ]


def test_task_that_ends_in_time_stops_the_timer() -> None:
    with StateMachine("wait") as sm:
        sm.Listen().after(2.0, "Turn").on(completed="Look")
        sm.Look().after(9.0, "completed")
        sm.Turn()
    run = Played(sm, "Listen completed", "time")
    assert run.end == ("completed", "Look: after 9 s")
    assert run.mission.now == 9.0


def test_python_states_wait_for_tasks_that_have_ended() -> None:
    """A branch of Python states does not keep the other branch from its turn."""
    calls: list[int] = []
    with Concurrence("both") as sm:
        sm.Look(foreground=False)
        sm.call(lambda _: calls.append(1), "count").on(completed="count")
    mission = PlayedMission()
    first_ended = mission.first_ended

    def end_after_three(tasks: Any, timeout: float | None = None) -> Any:
        if len(calls) == 3:
            mission.script, timeout = ["Look completed"], None
        return first_ended(tasks, timeout)

    mission.first_ended = end_after_three  # type: ignore[method-assign]
    assert Played(sm, on=mission).end == ("completed", "Look has completed")
    assert len(calls) == 3
