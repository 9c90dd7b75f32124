"""Applications: components whose activities are allocated to threads, and reallocated while they
run.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import pytest
from activities.joint import Joint, Target
from hypothesis import given
from hypothesis import strategies as st

from tca_behaviours.activities import Application, VirtualBaton, automatic, one_each, one_for_all
from tca_behaviours.activities.components import Component
from tca_behaviours.activities.figures import application_figures
from tca_behaviours.activities.processing import Baton
from tca_behaviours.activities.processing.schedule import Schedule
from tca_module import MisuseError


class Counts:
    def __init__(self) -> None:
        self.ticks = [0, 0, 0]


class Counter(Component[Counts]):
    """A component with three activities that count their ticks."""

    def __init__(self, name: str, *, estimate: float | None = None) -> None:
        super().__init__(name, Counts)
        self.inside = 0
        self.most_inside = 0
        self.enough = threading.Event()
        self.on_tick: Callable[[int], object] = lambda _number: None
        for number, period in enumerate((0.001, 0.002, 0.004)):
            region = self.region(f"r{number}", period=0.01, estimate=estimate)
            region.state(
                "on", activity=partial(self.count, number), period=period, estimate=estimate
            )

    def count(self, number: int) -> None:
        self.inside += 1
        self.most_inside = max(self.inside, self.most_inside)
        self.data.ticks[number] += 1
        self.on_tick(number)
        self.inside -= 1
        if min(self.data.ticks) >= 10:
            self.enough.set()


def ticks(application: Application) -> dict[str, int]:
    return {one.name: one.ticks for one in application.figures().activities}


def allocated(application: Application) -> dict[str, list[str]]:
    return {
        one.name: [each.name for each in one.activities]
        for one in application.allocation().processors
    }


# --- with threads ---------------------------------------------------------------------------------


def test_activities_are_ticked_one_at_a_time_under_any_change() -> None:
    counter, other = Counter("c"), Counter("d")
    threads = set()
    counter.on_tick = lambda _: threads.add(threading.current_thread().name)
    application = Application("test", [counter, other], one_each)
    with application.running():
        for _ in range(5):
            application.allocate(one_for_all)
            application.move("c.r0.on", "extra")
            application.set_priority("extra", 3)
            application.set_period("c.r2.on", 0.003)
            application.allocate(one_each)
        assert counter.enough.wait(20)
        assert other.enough.wait(20)
        until = time.monotonic() + 20
        while not {f"processor c.r{number}.on" for number in range(3)} <= threads:
            assert time.monotonic() < until
            time.sleep(0.001)
    assert (counter.most_inside, other.most_inside) == (1, 1)
    after = ticks(application)
    assert min(after.values()) >= 1
    assert ticks(application) == after
    assert not [one.name for one in threading.enumerate() if one.name.startswith("processor ")]


class NotingBaton(Baton):
    """A baton that records which processors had a thread before the newest change."""

    def __init__(self) -> None:
        super().__init__()
        self.there: set[str] = set()

    @contextmanager
    def changing(self) -> Iterator[Schedule]:
        self.there = {thread.name for thread in threading.enumerate()}
        with super().changing() as schedule:
            yield schedule


def test_threads_are_started_before_the_schedule_is_locked() -> None:
    baton = NotingBaton()
    application = Application("test", [Counter("c")], baton=baton)
    with application.running():
        application.allocate(one_each)
        assert {f"processor {name}" for name in application.activity_names} <= baton.there


def test_application_requires_initialised_components() -> None:
    application = Application("test", [Counter("c")])
    with pytest.raises(
        MisuseError, match=r"Counter 'c' is not initialised: call initialise\(\) before start\(\)"
    ):
        application.start()
    late = Counter("late")
    with application.running():
        application.add(late)
        assert late.enough.wait(20)


def test_application_starts_and_stops_repeatedly() -> None:
    counter = Counter("c")
    application = Application("test", [counter], one_each)
    running_changes: list[bool] = []
    application.on_change(lambda: running_changes.append(application.is_running))
    for _ in range(3):
        counter.enough.clear()
        with application.running():
            assert counter.enough.wait(20)
            with pytest.raises(
                MisuseError,
                match=r"Application 'test' is running: call stop\(\) before initialise\(\)",
            ):
                application.initialise()
    application.start()  # the application continues from its old state
    application.start()
    application.stop()
    application.stop()
    assert running_changes == [True, False] * 3 + [True, True, False, False]


def test_raising_activity_does_not_disturb_others(caplog: pytest.LogCaptureFixture) -> None:
    counter = Counter("c")

    def fail(number: int) -> None:
        if number == 1:
            counter.inside -= 1
            raise SystemExit("no more")

    counter.on_tick = fail
    application = Application("test", [counter], one_each)
    with application.running():
        assert counter.enough.wait(20)
    figures = {one.name: one for one in application.figures().activities}
    assert figures["c.r1.on"].errors == figures["c.r1.on"].ticks >= 10
    assert figures["c.r1.on"].error == "SystemExit: no more"
    assert figures["c.r0.on"].errors == 0
    assert "a tick of activity 'c.r1.on' failed" in caplog.text


def test_activity_may_stop_the_application() -> None:
    counter = Counter("c")
    refused: list[str] = []

    def stop(_number: int) -> None:
        counter.on_tick = lambda _: None
        application.stop()
        try:
            application.start()
        except MisuseError as error:
            refused.append(str(error))
        counter.enough.set()

    counter.on_tick = stop
    application = Application("test", [counter], one_each)
    application.initialise()
    application.start()
    assert counter.enough.wait(20)
    assert not application.is_running
    assert refused == ["start() was called from the tick that called stop(): use another thread"]
    with application.running():  # waits for the end of the tick
        assert sum(ticks(application).values()) >= 1


def test_component_cannot_be_initialised_from_its_own_tick() -> None:
    """The component would wait for the end of its own tick."""
    counter, other = Counter("c"), Counter("d")
    refused: list[str] = []

    def begin_anew(_number: int) -> None:
        counter.on_tick = lambda _: None
        application.stop()
        for initialise in (counter.initialise, application.initialise, other.initialise):
            try:
                initialise()
            except MisuseError as error:
                refused.append(str(error))
        counter.enough.set()

    counter.on_tick = begin_anew
    application = Application("test", [other, counter])
    application.initialise()
    application.start()
    assert counter.enough.wait(20)
    assert (
        refused
        == ["Counter 'c' can't be initialised from one of its own ticks: use another thread"] * 2
    )
    application.stop()


def test_long_tick_does_not_block_allocation(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    counter, slow = Counter("c"), Counter("slow")
    inside, leave = threading.Event(), threading.Event()

    def block(_number: int) -> None:
        inside.set()
        leave.wait(20)

    slow.on_tick = block
    application = Application("test", [slow, counter], one_each)
    application.initialise()
    application.start()
    assert inside.wait(20)
    monkeypatch.setattr("tca_behaviours.activities.processing.schedule._LONG", 0.0)
    monkeypatch.setattr("tca_behaviours.activities.processing.baton._PATIENCE", 0.0)
    assert application.figures().held_by == "slow.r0.on"
    application.allocate(one_for_all)  # does not wait for the tick
    application.move("c.r0.on", "own")
    assert set(allocated(application)) == {"all", "own"}
    slow.on_tick = lambda _: None
    stopping = threading.Thread(target=application.stop)
    stopping.start()
    while stopping.is_alive() and not caplog.text:
        time.sleep(0.001)
    assert "stop() waits for a tick of activity 'slow.r0.on'" in caplog.text
    leave.set()
    stopping.join()
    with application.running():
        assert counter.enough.wait(20)


class HastyBaton(Baton):
    """A baton whose clock sometimes jumps between two readings."""

    def __init__(self) -> None:
        super().__init__()
        self.looks = 0

    def clock(self) -> float:
        self.looks += 1
        return self.looks * 0.00001 + self.looks // 7 * 0.0005


def test_baton_is_not_lost_when_the_clock_jumps() -> None:
    """Another processor may become due between the decision and the hand-over."""
    counter = Counter("c")
    with Application("test", [counter], one_each, baton=HastyBaton()).running():
        assert counter.enough.wait(20)


# --- in virtual time ------------------------------------------------------------------------------


@pytest.fixture
def baton() -> VirtualBaton:
    return VirtualBaton()


def test_joint_moves_under_any_policy(baton: VirtualBaton) -> None:
    joint = Joint()
    application = Application("test", [joint], one_each, baton=baton)
    with application.running():
        joint.command.put("enable")
        baton.run(0.02)
        joint.command.put("reference")
        baton.run(0.2)
        joint.target.put(Target(0.9))
        baton.run(0.05)
        assert joint.regions["movement"].path == ("moving", "fast")
        application.allocate(one_for_all)
        baton.run(1.0)
    assert joint.position.value == pytest.approx(0.9)


def test_virtual_runs_are_repeatable() -> None:
    def run() -> Any:
        baton = VirtualBaton()
        application = Application("test", [Counter("c", estimate=0.0003)], one_each, baton=baton)
        with application.running():
            baton.run(0.1)
            application.move("c.r0.on", "c.r1.on")
            baton.run(1.1)
            return application.figures(), application.allocation()

    assert run() == run()


def test_schedulability_verdict_agrees_with_the_run(baton: VirtualBaton) -> None:
    application = Application("test", [Counter("c", estimate=0.00015)], one_each, baton=baton)
    with application.running():
        baton.run(2.0)
        figures = application.figures()
    assert figures.is_schedulable
    assert figures.load == pytest.approx(figures.utilisation, rel=0.01)
    assert [(one.name, one.is_schedulable) for one in figures.processors[:2]] == [
        ("c.r0.on", True),
        ("c.r1.on", True),
    ]
    for one in figures.processors:
        assert one.bound is not None
        assert one.response <= one.bound + 1e-9
        assert one.overruns == 0


def test_automatic_policy_splits_an_overloaded_processor(baton: VirtualBaton) -> None:
    application = Application("test", [Counter("c", estimate=0.0003)], baton=baton)
    figures = application.figures()
    assert (figures.is_schedulable, figures.processors[0].bound, figures.processors[0].margin) == (
        False,
        None,
        None,
    )
    application.allocate(automatic)
    assert [one.is_schedulable for one in application.figures().processors] == [True, True]
    assert allocated(application)["processor 1"] == ["c.r0.on", "c.r1.on"]
    assert application.figures().running_for == 0.0


def test_late_and_skipped_ticks_are_counted(baton: VirtualBaton) -> None:
    application = Application("test", [Counter("c", estimate=0.0006)], baton=baton)
    with application.running():
        baton.run(0.5)
        figures = {one.name: one for one in application.figures().activities}
    for name, due in (("c.r0.on", 500), ("c.r1.on", 250), ("c.r2.on", 125)):
        one = figures[name]
        assert abs(one.ticks + one.left_out - due) <= 1
    assert figures["c.r0.on"].left_out > 0
    assert figures["c.r0.on"].overruns > 0


def test_measured_lateness_overrules_analysis_for_a_while() -> None:
    slow: list[float] = []
    baton = VirtualBaton(lambda _: slow.pop() if slow else 0.0001)
    application = Application("test", [Counter("c", estimate=0.0001)], one_each, baton=baton)
    with application.running():
        baton.run(0.5)
        assert application.figures().is_schedulable
        slow.append(0.05)
        baton.run(0.1)
        found = application.figures()
        assert not found.is_schedulable
        assert found.refuted == f"{found.processors[0].name}: {found.processors[0].refuted}"
        baton.run(20.0)
        later = application.figures()
        assert (later.is_schedulable, later.refuted) == (True, "")
        assert later.processors[0].last_late == pytest.approx(20.05, abs=0.01)
        turn = baton.schedule.next_turn(baton.clock() + 1.0)
        assert turn is not None
        baton.schedule.begin(turn.processor, baton.clock())
        hung = application_figures("test", 0.0, baton.clock() + 3.0, baton.schedule)
        assert all(one.refuted for one in hung.processors), "they wait for a tick that never ends"


def test_estimate_longer_than_the_period_is_rejected() -> None:
    with pytest.raises(
        MisuseError, match=r"'c\.r0\.on' takes 3 ms, longer than its period of 1 ms: divide it"
    ):
        Application("test", [Counter("c", estimate=0.003)])


def test_estimate_refuted_by_ticks_is_ignored() -> None:
    baton = VirtualBaton(lambda _: 0.002)
    application = Application("test", [Counter("c", estimate=0.0001)], baton=baton)
    assert application.figures().is_schedulable
    with application.running():
        baton.run(0.5)
        assert not application.figures().is_schedulable
        with pytest.raises(
            MisuseError, match=r"activity 'c\.r2\.on' takes 100 µs: its period can't be 10 µs"
        ):
            application.set_period("c.r2.on", 0.00001)


def test_schedulability_is_unknown_without_execution_times(baton: VirtualBaton) -> None:
    application = Application("test", [Counter("c")], baton=baton)
    with pytest.raises(
        MisuseError,
        match=r"'c\.r0\.machine' has neither an estimate nor a measured time: declare one",
    ):
        application.allocate(automatic)
    assert (application.policy, application.figures().is_schedulable) == ("one_for_all", None)
    with application.running():
        baton.run(0.1)
    baton.run(1.0)
    assert application.figures().running_for == 0.1
    assert application.figures().is_schedulable
    application.allocate(automatic)
    assert list(allocated(application)) == ["processor 1"]


def test_activities_are_allocated_by_hand(baton: VirtualBaton) -> None:
    application = Application("test", [Counter("c")], baton=baton)
    machines = ["c.r0.machine", "c.r1.machine", "c.r2.machine"]
    application.allocate({"machines": machines, "rest": ["c.r2.on", "c.r1.on", "c.r0.on"]})
    assert allocated(application) == {
        "rest": ["c.r2.on", "c.r1.on", "c.r0.on"],
        "machines": machines,
    }
    application.set_priority("machines", 1)
    assert list(allocated(application)) == ["machines", "rest"]
    application.move("c.r0.on", "rest", 0)
    application.move("c.r2.on", "rest", 10**30)  # to the end
    application.move("c.r1.on", "fresh")
    application.remove("c.r2.machine")
    report = application.allocation()
    assert allocated(application) == {
        "machines": machines[:2],
        "rest": ["c.r0.on", "c.r2.on"],
        "fresh": ["c.r1.on"],
    }
    assert [(one.name, one.priority, one.period) for one in report.processors] == [
        ("machines", 1, 0.01),
        ("rest", 0, 0.001),
        ("fresh", 0, 0.002),
    ]
    assert ([one.name for one in report.unallocated], report.policy) == (
        ["c.r2.machine"],
        "by hand",
    )
    application.set_period("c.r0.on", 0.05)
    assert [one.name for one in application.allocation().processors] == [
        "machines",
        "fresh",
        "rest",
    ]
    application.add(Counter("d"))
    assert len(application.allocation().unallocated) == 7
    application.allocate(one_for_all)
    application.add(Counter("e"))
    assert list(allocated(application).values()) == [application.activity_names]


@given(st.data())
def test_no_tick_is_lost_under_any_policy(data: st.DataObject) -> None:
    baton = VirtualBaton()
    application = Application("test", [Counter("c", estimate=0.00002)], baton=baton)
    names = application.activity_names
    with application.running():
        for _ in range(6):
            baton.run(data.draw(st.floats(0.0001, 0.01)))
            if policy := data.draw(st.sampled_from([one_for_all, one_each, automatic, None])):
                application.allocate(policy)
            else:
                order = data.draw(st.permutations(names))
                cut = data.draw(st.integers(1, len(names) - 1))
                application.allocate({"first": order[:cut], "all": order[cut:]})
                application.set_priority("all", data.draw(st.integers(-1, 1)))
        now = application.figures().running_for
    periods = {
        one.name: one.period
        for each in application.allocation().processors
        for one in each.activities
    }
    for one in application.figures().activities:
        assert one.overruns == 0
        assert now / periods[one.name] - 1 <= one.ticks <= now / periods[one.name] + 1


def test_application_misuse_is_rejected_without_effect(
    baton: VirtualBaton, approve: Callable[..., None]
) -> None:
    application = Application("test", [Counter("c")], baton=baton)
    before = application.allocation()

    def message_of(case: str) -> str:
        with pytest.raises(MisuseError) as raised:
            eval(case, {**globals(), "one": application})
        assert application.allocation() == before
        return str(raised.value)

    approve("mistakes.txt", message_of)
