"""Simulates the lab and the robot in it. No other program has access to them."""

from robots.office_sim.messages import (
    BATTERY,
    CAMERA,
    CLOSE_FINGERS,
    DOCK,
    DRIVE,
    FLOOR_PLAN,
    HALT,
    OPEN_FINGERS,
    OPEN_LAB,
    ROBOT_SPOT,
    SCENE,
)
from robots.office_sim.world import OfficeWorld
from robots.options import program_parser
from tca_module import Module, Task


def make_module(world: OfficeWorld, pace: float) -> Module:
    """Make the module. From OPEN_LAB on, the lab's time passes *pace* times as fast as the
    programs'.
    """
    simulator = Module("simulator")
    opening_times: list[float] = []
    simulator.handles(OPEN_LAB)(lambda task: opening_times.append(task.time()))

    def now(task: Task) -> OfficeWorld:
        """Return the world, advanced to the present time."""
        if opening_times:
            world.advance((task.time() - opening_times[0]) * pace)
        return world

    def dock(task: Task) -> float | None:
        seconds = now(task).dock()
        return None if seconds is None else seconds / pace

    simulator.handles(DRIVE)(lambda task, way: now(task).drive(way) / pace)
    simulator.handles(HALT)(lambda task: now(task).halt())
    simulator.handles(CLOSE_FINGERS)(lambda task, spot: now(task).close_fingers(spot))
    simulator.handles(OPEN_FINGERS)(lambda task: now(task).open_fingers())
    simulator.handles(DOCK)(dock)
    simulator.handles(CAMERA)(lambda task: now(task).seen_spots())
    simulator.handles(ROBOT_SPOT)(lambda task: now(task).robot)
    simulator.handles(BATTERY)(lambda task: now(task).battery)
    simulator.handles(FLOOR_PLAN)(lambda _: world.floor)
    simulator.handles(SCENE)(lambda task: now(task).scene())
    return simulator


def main() -> None:
    """Run the simulator."""
    parser = program_parser("office_sim.modules.simulator", __doc__)
    parser.add_argument(
        "--pace", type=float, default=1.0, help="how fast the lab's time passes (%(default)s)"
    )
    parser.add_argument(
        "--seed", type=int, default=1, help="which lab, and which cups (%(default)s)"
    )
    parser.add_argument(
        "--shift", type=float, default=240.0, help="seconds in which cups fall (%(default)s)"
    )
    options = parser.parse_args()
    make_module(OfficeWorld(options.seed, options.shift), options.pace).run()


if __name__ == "__main__":
    main()
