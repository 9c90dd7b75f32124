"""A robot that is scanned from while it moves: no scan waits for the end of a move, none sees a foot in the air."""

import threading

from ambler.builders import the_first_leg_move

from robots.ambler_sim.machine import Machine
from robots.ambler_sim.perception import points_of
from robots.ambler_sim.robot import make_robot
from robots.ambler_sim.vocabulary import Scan


def test_a_standing_robot_is_scanned_at_once() -> None:
    machine = Machine(make_robot("kinematic"))
    assert len(points_of(machine.scan())) > 1000


def test_a_scan_is_taken_between_two_ticks_of_a_move_with_all_feet_on_the_ground() -> None:
    robot = make_robot("kinematic")
    machine = Machine(robot)
    before = robot.stance()
    move = the_first_leg_move(robot)
    scans: list[Scan] = []
    other = threading.Thread(target=lambda: scans.append(machine.scan()))
    taken_at: list[float] = []

    def on_tick(share: float) -> bool:
        if share > 0.4 and not taken_at:
            if not other.ident:
                other.start()
            machine.tick()
            if scans:
                taken_at.append(share)
        return True

    with machine.moving(move.leg):
        robot.move_leg(move, on_tick)
    other.join(timeout=5)
    assert scans[0].stance.feet[move.leg] == before.feet[move.leg]
    assert robot.stance().feet[move.leg] != before.feet[move.leg]
