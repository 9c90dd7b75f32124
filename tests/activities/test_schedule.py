"""The schedule in virtual time: ticks stay correct under any changes."""

from itertools import pairwise

from activities.scheduling import Ticked, in_virtual_time, task_sets
from hypothesis import given
from hypothesis import strategies as st

from tca_behaviours.activities import VirtualBaton
from tca_behaviours.activities.analysis import Demand
from tca_behaviours.activities.processing.schedule import Schedule

UNIT = 1000.0
PERIODS = [2 * UNIT, 3 * UNIT, 4 * UNIT, 10 * UNIT]


class RunningSchedule:
    """Activities on processors in virtual time. A tick takes 10 units by default."""

    def __init__(self, periods: list[float], costs: dict[str, float] = {}) -> None:  # noqa: B006 - never changed
        self.baton = VirtualBaton(lambda activity: costs.get(activity.name, 10.0))
        self.log: list[tuple[str, float]] = []
        self.names = [f"a{number}" for number in range(len(periods))]
        with self.baton.changing() as schedule:
            for name, period in zip(self.names, periods, strict=True):
                schedule.add(Ticked(name, period, log=self.log, now=self.baton.clock))
                self.move(name, "p0")
        self.baton.start()

    def move(self, name: str, processor: str, position: int | None = None) -> None:
        with self.baton.changing() as schedule:
            now = self.baton.clock()
            to = schedule.processor(processor) or schedule.new_processor(processor, now)
            schedule.put(schedule.activity(name), to, now, position)

    def set_period(self, name: str, seconds: float) -> None:
        with self.baton.changing() as schedule:
            schedule.set_period(schedule.activity(name), seconds, self.baton.clock())

    def ticks(self, name: str) -> list[float]:
        return [at for ticked, at in self.log if ticked == name]


@given(st.lists(st.sampled_from(PERIODS), min_size=1, max_size=5), st.data())
def test_no_tick_is_lost_or_doubled_when_activities_move(
    periods: list[float], data: st.DataObject
) -> None:
    running = RunningSchedule(periods)
    for _ in range(12):
        running.baton.run(data.draw(st.integers(1, 5000)))
        to = data.draw(st.sampled_from(["p0", "p1", "p2"]))
        running.move(
            data.draw(st.sampled_from(running.names)), to, data.draw(st.sampled_from([None, 0, 1]))
        )
        with running.baton.changing() as schedule:
            data.draw(st.sampled_from(schedule.processors)).priority = data.draw(st.integers(0, 2))
    now = running.baton.clock()
    for name, period in zip(running.names, periods, strict=True):
        turns = [at // period for at in running.ticks(name)]
        assert turns == list(range(len(turns)))  # one in each period
        assert len(turns) in (now // period, now // period + 1)
    assert not any(one.release.missed for one in running.baton.schedule.activities.values())


@given(st.data())
def test_changed_period_counts_from_the_previous_tick(data: st.DataObject) -> None:
    running = RunningSchedule([4 * UNIT, 3 * UNIT])
    wanted = 4 * UNIT
    in_force = [(0.0, wanted)]
    for _ in range(10):
        running.baton.run(data.draw(st.integers(1, 6000)))
        in_force.append((running.baton.clock(), wanted := data.draw(st.sampled_from(PERIODS))))
        running.set_period("a0", wanted)
        running.move("a0", data.draw(st.sampled_from(["p0", "p1"])))
    running.baton.run(2 * wanted)
    ticks = running.ticks("a0")
    assert ticks[-1] > running.baton.clock() - wanted - 20
    for before, after in pairwise(ticks):
        seconds = [each for at, each in in_force if before < at <= after]
        seconds.append(next(each for at, each in reversed(in_force) if at <= before))
        assert (
            min(seconds) - 20 <= after - before <= max(seconds) + 20
        )  # other ticks may delay it by as much
    assert [at // (3 * UNIT) for at in running.ticks("a1")] == list(range(len(running.ticks("a1"))))


@given(st.lists(task_sets(), min_size=1, max_size=3))
def test_processor_of_highest_priority_runs_first(sets: list[list[Demand]]) -> None:
    processors = [
        [Demand(f"{number}.{one.name}", *one[1:]) for one in demands]
        for number, demands in enumerate(sets)
    ]
    baton = in_virtual_time(processors)
    schedule, now = baton.schedule, 0.0
    for _ in range(200):
        turn = schedule.next_turn(now)
        assert turn is not None
        now = max(now, turn.at)
        one = schedule.begin(turn.processor, now)
        higher = schedule.processors[: schedule.processors.index(turn.processor)]
        assert not [
            each.name
            for processor in higher
            for each in processor.activities
            if each.release.due <= now
        ]
        assert one.release.due <= now
        now += one.cost or 0.0
        schedule.end(now)


@given(st.permutations(["a", "b", "c", "d"]), st.integers(1, 1000))
def test_processor_ticks_activities_in_subscription_order(names: list[str], cost: int) -> None:
    """The order also holds under overload, when all activities tick less often."""
    baton = in_virtual_time([[Demand(name, 1000.0, cost) for name in names]])
    baton.run(100_000)
    log = [name for one in baton.schedule.activities.values() for name, _ in one.activity.log]  # type: ignore[attr-defined]
    assert {log.count(name) for name in names} <= {log.count(names[0]), log.count(names[0]) - 1}
    assert log.count(names[0]) == -(-100_000 // max(1000, 4 * cost)) or 4 * cost > 1000


def test_activity_due_during_a_round_waits_for_the_next() -> None:
    running = RunningSchedule([2 * UNIT, 10 * UNIT, 10 * UNIT], {"a1": 3 * UNIT, "a2": 3 * UNIT})
    running.baton.run(6 * UNIT)
    assert [name for name, _ in running.log] == ["a0", "a1", "a2"]
    running.baton.run(1 * UNIT)
    assert running.log[3:] == [
        ("a0", 6 * UNIT + 10),
        ("a0", 6 * UNIT + 20),
    ]  # due at 2 and 6; the one at 4 is skipped


def test_unassigned_activity_is_due_when_reassigned() -> None:
    running = RunningSchedule([2 * UNIT, 2 * UNIT])
    with running.baton.changing() as schedule:
        schedule.unassign(schedule.activity("a0"))
    running.baton.run(5 * UNIT)
    assert running.ticks("a0") == []
    running.move("a0", "p1")
    running.baton.run(5 * UNIT)
    assert running.ticks("a0") == [5 * UNIT, 7 * UNIT, 9 * UNIT]


def test_activity_moved_during_its_tick_is_not_ticked_twice() -> None:
    schedule = Schedule()
    schedule.add(Ticked("a", 10.0))
    one = schedule.activity("a")
    schedule.put(one, schedule.new_processor("p", 0.0), 0.0)
    schedule.start(0.0)
    turn = schedule.next_turn(0.0)
    assert turn is not None
    schedule.begin(turn.processor, 0.0)
    schedule.put(one, schedule.new_processor("q", 0.0), 1.0)
    schedule.set_period(one, 5.0, 1.0)
    schedule.update_order()
    schedule.end(2.0)
    turn = schedule.next_turn(2.0)
    assert turn is not None
    assert (turn.processor.name, turn.at) == ("q", 5.0)


def test_activity_moved_in_a_round_runs_on_its_new_processor() -> None:
    schedule = Schedule()
    old = schedule.new_processor("old", 0.0)
    for name in ("first", "second"):
        schedule.add(Ticked(name, 10.0))
        schedule.put(schedule.activity(name), old, 0.0)
    schedule.start(0.0)
    assert schedule.begin(old, 0.0).name == "first"
    new = schedule.new_processor("new", 1.0)
    schedule.put(schedule.activity("second"), new, 1.0)
    schedule.update_order()
    schedule.end(1.0)
    turn = schedule.next_turn(1.0)
    assert turn is not None
    assert turn.processor is new
    assert schedule.begin(new, 1.0).name == "second"
    schedule.end(2.0)
    turn = schedule.next_turn(2.0)
    assert turn is not None
    assert turn.at == 10.0


def test_schedule_measures_response_times_overruns_and_jitter() -> None:
    baton = in_virtual_time([[Demand("fast", 4.0, 1.0)], [Demand("slow", 12.0, 6.0)]])
    baton.run(24.0)
    fast, slow = baton.schedule.processors
    # fast begins at 0, 7 (due at 4), 8, 12, 19 (due at 16), 20
    assert (fast.ticks, fast.overruns, fast.times.response, fast.times.jitter) == (6, 0, 4.0, 3.0)
    assert (slow.ticks, slow.overruns, slow.times.response, slow.times.jitter) == (2, 0, 7.0, 0.0)
    assert [one.release.missed for one in baton.schedule.activities.values()] == [0, 0]
