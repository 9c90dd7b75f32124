"""Show the cleaning robot: it is enabled and referenced, moves to a point and cleans the wall.

While it cleans, its activities are reallocated every two seconds. With --page the show stays open
for the page and its buttons.
"""

import argparse
import contextlib
import itertools
import sys
import threading
import time
from pathlib import Path

from robots.cartesian_sim.messages import CLEAN, ENABLE, MOVE_TO, REFERENCE, SET_SPEED, WallPoint
from robots.cartesian_sim.robot import NAME, CleaningRobot
from robots.options import show_parser
from robots.show import run_show, save_picture
from tca_behaviours.activities import Application
from tca_behaviours.activities.manager import ActivityMove, ApplicationMessages
from tca_behaviours.activities.page.command import activities
from tca_module import Client, SentTask, TcaError, connect
from tca_tools.supervise.programs import START_TIME, central_in
from tca_wire.text.measures import duration

REALLOCATION_PERIOD = 2.0
"""Seconds between two allocations while the robot cleans."""

POLICIES = ("one_each", "automatic", "one_for_all")


class CleaningShow:
    """One run, with a time for each of its lines."""

    def __init__(self, robot: CleaningRobot, address: str) -> None:
        self._robot, self._central = robot, address
        self._began = time.monotonic()
        self.transitions: list[str] = []
        for component in robot.components.all:
            for region in component.regions.values():
                region.on_transition(lambda change: self.transitions.append(self._stamped(change)))

    def _stamped(self, text: object) -> str:
        return f"{time.monotonic() - self._began:7.3f} s  {text}"

    def say(self, text: str) -> None:
        """Print a line with its time."""
        print(self._stamped(text), flush=True)

    def run(self) -> int:
        """Run the whole show. Returns the exit code."""
        try:
            with connect("operator", self._central, START_TIME) as operator:
                self._run_commands(operator)
        except TcaError as error:
            self.say(f"ended: {error}")
            return 1
        return 0

    def _run_commands(self, operator: Client) -> None:
        self._carry_out("enable", operator.command(ENABLE))
        self._carry_out("reference", operator.command(REFERENCE))
        operator.inform(SET_SPEED, 0.8)
        self._carry_out("move to (1.5, 0.9)", operator.command(MOVE_TO, WallPoint(1.5, 0.9)))
        is_over = threading.Event()
        reallocating = threading.Thread(target=self._keep_reallocating, args=[is_over])
        reallocating.start()
        try:
            self._carry_out("clean", operator.command(CLEAN))
        finally:
            is_over.set()
            reallocating.join()
        self.say(describe_ticks(self._robot.application))

    def _carry_out(self, text: str, sent: SentTask[None]) -> None:
        self.say(text)
        sent.result()
        self.say(f"{text}: done")

    def _keep_reallocating(self, is_over: threading.Event) -> None:
        """Until *is_over* is set, set one policy after the other, and move an activity by hand."""
        messages, policies = ApplicationMessages(NAME), itertools.cycle(POLICIES)
        with connect("allocator", self._central) as allocator:
            while not is_over.wait(REALLOCATION_PERIOD):
                policy = next(policies)
                allocator.command(messages.set_policy, policy).result()
                allocator.command(
                    messages.move, ActivityMove("x.movement.machine", "the x axis")
                ).result()
                processors = self._robot.application.allocation().processors
                self.say(f"reallocated: {policy}, then by hand: {len(processors)} processors")


def describe_ticks(application: Application) -> str:
    """Describe how many ticks of activities were due, made and left out."""
    figures, processors = application.figures(), application.allocation().processors
    periods = [activity.period for processor in processors for activity in processor.activities]
    # A tick is due once in each period of its activity, the first one at once.
    due = sum(int(figures.running_for / period) + 1 for period in periods)
    ticks = sum(activity.ticks for activity in figures.activities)
    late = sum(activity.overruns for activity in figures.activities)
    left_out = sum(activity.left_out for activity in figures.activities)
    lost = due - ticks - left_out
    missing = "none is missing" if abs(lost) <= len(periods) else f"{lost:,} are missing"
    return (
        f"{due:,} ticks were due in {duration(figures.running_for)}: {ticks:,} were made"
        f" ({late:,} too late), {left_out:,} were left out because the next was due, {missing}"
    )


def _save(robot: CleaningRobot, transitions: list[str], folder: Path) -> None:
    """Write a picture of the wall, and the transitions of all regions."""
    (folder / "transitions.txt").write_text("".join(f"{each}\n" for each in transitions))
    made = ", ".join(path.name for path in save_picture(folder / "wall", robot.picture()))
    print(f"made {made} and transitions.txt in {folder}; 'tca view {folder}/journal' shows the run")


def _show(options: argparse.Namespace) -> int:
    with central_in(options.out) as (address, _), contextlib.ExitStack() as stack:
        robot = CleaningRobot(address)
        stack.enter_context(robot.module.running())
        show = CleaningShow(robot, address)
        stack.enter_context(robot.application.running())
        if options.page:
            threading.Thread(target=show.run, daemon=True).start()
            opens = "--no-browser" if options.no_browser else "--browser"
            activities.main(
                [NAME, "--central", address, opens], "tca activities", standalone_mode=False
            )
            code = 0
        else:
            code = show.run()
        _save(robot, show.transitions, options.out)
    return code


def main() -> int:
    """Run the command line. Returns the exit code."""
    parser = show_parser("cartesian_sim", __doc__, out="runs/cartesian")
    parser.add_argument(
        "--page", action="store_true", help="open 'tca activities', and stay until Ctrl-C"
    )
    parser.add_argument(
        "--no-browser", action="store_true", help="with --page: print its address only"
    )
    return run_show(parser, _show)


if __name__ == "__main__":
    sys.exit(main())
