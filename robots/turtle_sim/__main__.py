"""Show a mission: start central, the turtle and its task server, run it, and draw the result."""

import argparse
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from robots.options import add_number, show_parser
from robots.show import run_show, save_picture
from robots.turtle_sim.drawing import draw
from robots.turtle_sim.missions.background import background
from robots.turtle_sim.missions.interrupted import interrupted
from robots.turtle_sim.missions.letters import letters
from robots.turtle_sim.missions.machine import machine
from robots.turtle_sim.missions.patrol import patrol
from robots.turtle_sim.missions.three_turtles import MISSIONS
from robots.turtle_sim.missions.too_far import too_far
from robots.turtle_sim.simulator import Simulator
from robots.turtle_sim.sync.team import free_team, save_team
from robots.turtle_sim.world import CENTRE, Pen, Pose, TurtleWorld
from tca_behaviours.missions import ConditionVerified, Mission
from tca_module.link.opening import CentralAddress
from tca_tools.supervise.programs import central_in

TIME_LIMIT = 15.0
"""Seconds after which the show ends an endless mission."""


class TimeIsUp:
    """A condition of missions: verified after a number of seconds."""

    def __init__(self, seconds: float) -> None:
        self._end = time.monotonic() + seconds

    def is_verified(self) -> bool:
        """Return whether the time has passed."""
        return time.monotonic() >= self._end


def for_some_time(mission: Mission, endless: Callable[[Mission], object]) -> None:
    """Run an endless mission for TIME_LIMIT seconds."""
    time_is_up = TimeIsUp(TIME_LIMIT)
    mission.add_condition(time_is_up)
    try:
        endless(mission)
    except ConditionVerified as verified:
        if time_is_up not in verified.conditions:
            raise


Missions = Mapping[str, Callable[[Mission], object]]
"""The mission of each turtle, by the turtle's name."""

SHOWS: dict[str, Missions] = {
    "letters": {"turtle": letters},
    "patrol": {"turtle": lambda mission: for_some_time(mission, patrol)},
    "too-far": {"turtle": too_far},
    "background": {"turtle": background},
    "interrupted": {"turtle": interrupted},
    "machine": {"turtle": lambda mission: for_some_time(mission, machine().run)},
    "three-turtles": MISSIONS,
}

STARTS = {"turtle2": Pose(4.0, 4.0), "turtle3": Pose(7.0, 7.0)}
"""The start of each turtle that does not start in the centre."""

PENS = {"turtle2": Pen(200, 60, 40), "turtle3": Pen(40, 90, 170)}
"""The pen of each turtle that does not have a black one."""

RATE = 10.0
"""Iterations of a task per second of the turtle's time."""


class ShowIsOver:
    """A condition of all missions of a show: one has failed, or the user has pressed Ctrl-C."""

    reason = ""

    def __str__(self) -> str:
        return self.reason

    def is_verified(self) -> bool:
        """Return whether the show is over."""
        return bool(self.reason)


class ShownMission(Mission):
    """A mission that prints each of its tasks, and ends with the show."""

    def __init__(
        self, server: str, central: CentralAddress, began: float, show_is_over: ShowIsOver
    ) -> None:
        super().__init__(server, name=f"show of {server}", central=central, patience=60.0)
        self._began = began
        self._show_is_over = show_is_over
        self.clear_conditions()

    def clear_conditions(self) -> None:
        """Clear all conditions except the end of the show."""
        super().clear_conditions()
        self.add_condition(self._show_is_over)

    def run(self, name: str, /, **parameters: Any) -> Any:
        """Print the task's name and parameters, and run it."""
        given = ", ".join(f"{key}={value!r}" for key, value in parameters.items())
        print(
            f"{time.monotonic() - self._began:6.2f} s  {self.server}: {name}({given})", flush=True
        )
        return super().run(name, **parameters)


class Show:
    """One run of one or more missions."""

    def __init__(self, missions: Missions, folder: Path, pace: float, loss: float) -> None:
        self._missions = missions
        self._folder = folder
        self._pace = pace
        self._loss = loss
        self._world = TurtleWorld()
        for name in missions:
            self._world.spawn(name, STARTS.get(name, CENTRE))
            self._world.set_pen(name, PENS.get(name, Pen()))
        self._simulator = Simulator(self._world, pace)
        self._began = time.monotonic()
        self._show_is_over = ShowIsOver()

    def run(self) -> None:
        """Run the missions, each in a thread. Raises the error of the first one that fails."""
        with ExitStack() as stack:
            centrals = {
                name: stack.enter_context(central_in(self._folder, f"{name} "))
                for name in self._missions
            }
            servers = self._servers()
            for name, (address, programs) in centrals.items():
                stack.enter_context(self._simulator.module(name, address).running())
                programs.start_module(f"{name} task server", *servers[name])
            with ThreadPoolExecutor(len(centrals)) as pool:
                try:
                    for future in as_completed(
                        pool.submit(self._carry_out, name, centrals[name][0]) for name in centrals
                    ):
                        future.result()
                except BaseException as error:
                    self._show_is_over.reason = f"{type(error).__name__} has ended the show"
                    raise

    def _servers(self) -> dict[str, list[str]]:
        """Return the Python module and arguments of each turtle's task server. A single turtle
        needs no link to partners.
        """
        names, rate = list(self._missions), ["--rate", str(RATE * self._pace)]
        if len(names) == 1:
            return {name: ["robots.turtle_sim.task_server", name, *rate] for name in names}
        team = self._folder / "team.toml"
        save_team(free_team(*names), team)
        link = [str(team), "--loss", str(self._loss)]
        return {name: ["robots.turtle_sim.sync.task_server", name, *link, *rate] for name in names}

    def _carry_out(self, name: str, address: str) -> None:
        with ShownMission(name, address, self._began, self._show_is_over) as mission:
            self._missions[name](mission)

    def draw(self, title: str) -> list[Path]:
        """Draw the sheet. Returns the files written."""
        return save_picture(self._folder / "sheet", draw(self._simulator.sheet(), title))


def main() -> int:
    """Show the mission that the command line names. Returns the exit code."""
    parser = show_parser("turtle_sim", __doc__, out="runs/turtle")
    parser.add_argument(
        "show",
        nargs="?",
        default="letters",
        choices=SHOWS,
        help="the mission (default: %(default)s)",
    )
    add_number(parser, "pace", (0.01, 100.0), 8.0, "how fast the turtles' time passes")
    loss = "share of the datagrams between turtles that is lost"
    add_number(parser, "loss", (0.0, 0.99), 0.5, loss)
    return run_show(parser, _show)


def _show(options: argparse.Namespace) -> int:
    show = Show(SHOWS[options.show], options.out, options.pace, options.loss)
    try:
        show.run()
    finally:
        for path in show.draw(options.show):
            print("made", path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
