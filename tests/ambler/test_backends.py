"""The choice of the simulator, and the pace of simulated time."""

import threading

import pytest
from ambler.builders import a_stance, the_first_leg_move

from robots.ambler_sim.machine import making as robot_module
from robots.ambler_sim.machine.making import make_robot
from robots.ambler_sim.machine.pacing import MoveWatch, Pacer
from robots.ambler_sim.machine.shared import Machine
from robots.ambler_sim.planning.elevation import points_of
from robots.ambler_sim.planning.gait import plan_shift
from robots.ambler_sim.vocabulary import Scan, TerrainSpec


class FakeClock:
    """A replacement of the time module. Sleeping only advances its clock."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> FakeClock:
    clock = FakeClock()
    monkeypatch.setattr("robots.ambler_sim.machine.pacing.time", clock)
    return clock


def test_kinematic_backend_is_the_default_without_pybullet(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_module, "pybullet_is_installed", lambda: False)
    assert make_robot().backend == "kinematic"


def test_pybullet_backend_is_the_default_when_installed() -> None:
    pytest.importorskip("pybullet")
    robot = make_robot()
    assert robot.backend == "pybullet"
    robot.close()


def test_snapshot_determines_terrain_and_backend() -> None:
    robot = make_robot("kinematic", terrain=TerrainSpec(seed=9, slope=0.2))
    other = make_robot(terrain=TerrainSpec(seed=1), state=robot.state())
    assert other.backend == "kinematic"
    assert other.terrain.spec == TerrainSpec(seed=9, slope=0.2)


def test_snapshot_can_be_continued_on_another_backend() -> None:
    pytest.importorskip("pybullet")
    physical = make_robot("pybullet")
    other = make_robot("kinematic", state=physical.state())
    assert other.stance().pose.x == pytest.approx(physical.stance().pose.x, abs=0.01)
    physical.close()


def test_pace_limits_simulated_time_to_a_multiple_of_real_time(clock: FakeClock) -> None:
    robot = make_robot("kinematic", pace=10.0)
    began_simulated, began_real = robot.time, clock.now
    robot.move_body(plan_shift(robot.stance(), a_stance().pose))
    assert clock.now - began_real == pytest.approx((robot.time - began_simulated) / 10.0, abs=0.01)


def test_pace_zero_never_waits(clock: FakeClock) -> None:
    Pacer(0.0).wait(1000.0)
    assert clock.now == 0.0


def test_pacer_does_not_catch_up_idle_time(clock: FakeClock) -> None:
    pacer = Pacer(1.0)
    clock.now = 100.0
    pacer.restart()
    pacer.wait(2.0)
    assert clock.now == 102.0


def test_move_listener_is_not_called_again_after_stop() -> None:
    answers = iter([False])
    watch = MoveWatch(lambda: next(answers))
    watch.tick()
    watch.tick()
    assert watch.stopped


def test_standing_robot_is_scanned_at_once() -> None:
    machine = Machine(make_robot("kinematic"))
    assert len(points_of(machine.scan())) > 1000


def test_scan_during_a_leg_move_sees_all_feet_on_the_ground() -> None:
    robot = make_robot("kinematic")
    machine = Machine(robot)
    before = robot.stance()
    move = the_first_leg_move(robot)
    scans: list[Scan] = []
    other = threading.Thread(target=lambda: scans.append(machine.scan()))
    half_way = robot.time + 4.0

    def on_tick() -> bool:
        if robot.time > half_way and not scans:
            if not other.ident:
                other.start()
            machine.tick()
        return True

    with machine.exclusive(move.leg):
        robot.move_leg(move, on_tick)
    other.join(timeout=5)
    assert scans[0].stance.feet[move.leg] == before.feet[move.leg]
    assert robot.stance().feet[move.leg] != before.feet[move.leg]
