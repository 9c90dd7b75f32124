"""A walk: central, modules, layers and simulator, each as a process; then pictures of the run."""

import argparse
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
from rich.console import Console
from rich.progress import BarColumn, Progress, TimeElapsedColumn

from robots.ambler_sim.messages import PICTURE, TRAVERSE_PATH, Bend
from robots.ambler_sim.messages import Path as PathToWalk
from robots.ambler_sim.modules import task_manager
from robots.ambler_sim.modules.controller import RECORD
from robots.ambler_sim.modules.planners import PLANNERS
from robots.ambler_sim.options import LAYERS
from robots.ambler_sim.pictures.film import FRAMES, join_frames
from robots.ambler_sim.recovery import GIVE_UP, is_attached
from robots.ambler_sim.run.figures import Figures, Usage, figures_of
from robots.ambler_sim.run.losing import ProgramKiller
from robots.show import draw_history
from tca_module import Module, TcaError
from tca_module.sending.task_ref import SentTask
from tca_tools.supervise.programs import START_TIME, Programs, central_in

PICTURE_TIME = 300.0
"""Seconds for the last picture. Without a graphics card it may take more than half a minute."""

SAMPLE_PERIOD = 0.5
"""Seconds between two measurements of the programs' memory use."""

ARC = 10.0
"""The approximate length (m) of an arc."""

console = Console(highlight=False)


@dataclass
class Walk:
    """One run, its command line and its output files."""

    options: argparse.Namespace
    arguments: list[str]
    folder: Path
    outputs: list[tuple[str, Path]] = field(default_factory=list)
    usage: Usage = field(default_factory=Usage)
    walked: float = 0.0
    wall: float = 0.0

    def __post_init__(self) -> None:
        columns = (
            "[bold]{task.description}",
            BarColumn(),
            "{task.completed:4.1f} of {task.total:.1f} m",
        )
        self._progress = Progress(*columns, TimeElapsedColumn(), console=console)

    @property
    def bends(self) -> tuple[Bend, ...]:
        """The path: pieces of equal length, in turn straight, to the left and to the right."""
        arcs = self.options.arcs or max(2, round(self.options.metres / ARC))
        curvatures = [0.0, 0.04, -0.04]
        return tuple(
            Bend(curvatures[number % 3], self.options.metres / arcs) for number in range(arcs)
        )

    @property
    def layers(self) -> list[str]:
        """The names of the reactive layers in this walk."""
        if self.options.bare:
            return []
        return [name for name in LAYERS if name not in self.options.without]

    def programs(self) -> Iterator[tuple[str, str, list[str]]]:
        """Yield all programs but central, controller and task manager: name, module and
        arguments.
        """
        for name in ("scanner", "mapper", *([] if self.options.bare else ["error recovery"])):
            yield name, f"modules.{name}", []
        yield "gait planner", "modules.gait planner", self.arguments
        for name in PLANNERS:
            yield name, "modules.planners", [name]
        for name in self.layers:
            yield f"{name} layer", f"layers.{name}", []
        if self.options.faults or self.options.fault:
            yield "fault injector", "modules.fault injector", self.arguments

    def run(self) -> int:
        """Walk, then draw. Returns the exit code."""
        with central_in(self.folder, is_fresh=False) as (address, programs):
            for name, module, arguments in self.programs():
                programs.start_module(
                    name, f"robots.ambler_sim.{module.replace(' ', '_')}", *arguments
                )
            self.start_controller(programs)
            has_arrived = self.conduct(address, programs)
        titles = {"tree.svg": "task tree", "gantt.svg": "Gantt chart"}
        self.outputs += [(titles[path.name], path) for path in draw_history(self.folder, _warn)]
        self.outputs.append(("journal", self.folder / "journal"))
        if self.options.film and join_frames(self.folder / FRAMES, self.options.film):
            self.outputs.append(("film", self.options.film.resolve()))
        return int(not has_arrived)

    def start_controller(self, programs: Programs, number: int = 0) -> None:
        """Start a controller. It takes over the robot from an earlier controller. Every second
        controller has the backend of --swap-to, if given.
        """
        other = ["--backend", self.options.swap_to] if self.options.swap_to and number % 2 else []
        programs.start_module(
            "controller", "robots.ambler_sim.modules.controller", *self.arguments, *other
        )

    def conduct(self, address: str, programs: Programs) -> bool:
        """Act as the task manager: send and watch the goal. Returns whether the robot arrived."""
        with closing(ProgramKiller(programs, address)) as killer, self._progress:
            self._bar = self._progress.add_task("walking", total=self.options.metres)
            module = task_manager.make_module(
                self.show, lambda number: self.confirm(number, programs), killer.kill
            )
            module.central = address
            with module.running():
                if not self.options.bare:
                    programs.wait_until_handled(module, GIVE_UP, *map(is_attached, self.layers))
                for layer in self.layers:
                    module.query(is_attached(layer), timeout=START_TIME)
                goal = module.goal(
                    TRAVERSE_PATH, PathToWalk(self.bends, ask=bool(self.options.between_arcs))
                )
                has_arrived = self.watch(goal, programs)
                killer.close()
                if has_arrived:
                    self.photograph(module)
        return has_arrived

    def watch(self, goal: SentTask[None], programs: Programs) -> bool:
        """Wait for the end of the walk. Returns whether the robot has arrived."""
        began = time.monotonic()
        try:
            for is_over in programs.watch(goal, SAMPLE_PERIOD):
                if not is_over:
                    self.usage.measure(self.walked, programs.numbers())
            goal.result()
        except TcaError as error:
            self._progress.console.print(f"the walk failed: {error}", style="red")
            return False
        finally:
            self.wall = time.monotonic() - began
        self._progress.update(self._bar, completed=self.options.metres)
        return True

    def photograph(self, module: Module) -> None:
        """Get a picture of the robot where it is now. A missing picture does not fail the walk."""
        try:
            picture = module.query(PICTURE, str(self.folder / "robot.png"), timeout=PICTURE_TIME)
        except TcaError as error:
            _warn(f"no picture of the robot: {error}")
        else:
            self.outputs.append(("the robot", Path(picture)))

    def show(self, metres: float) -> None:
        """Show the metres walked so far."""
        self.walked = metres
        self._progress.update(self._bar, completed=min(metres, self.options.metres))

    def confirm(self, number: int, programs: Programs) -> None:
        """Do what --between-arcs asks for between two arcs."""
        arcs = f"between arcs {number} and {number + 1}"
        say = self._progress.console.print
        if self.options.between_arcs == "swap":
            (code,) = programs.stop("controller")
            say(f"{arcs}: the controller ended ({code}); starting another")
            self.start_controller(programs, number)
        else:
            say(f"{arcs}: press Enter to continue")
            sys.stdin.readline()

    def save_figures(self) -> Figures:
        """Write the figures of the walk into its folder, and return them."""
        figures = figures_of(self.folder / RECORD, self.folder / "journal", self.usage, self.wall)
        (self.folder / "figures.json").write_bytes(
            msgspec.json.format(msgspec.json.encode(figures))
        )
        return figures


def _warn(words: str) -> None:
    console.print(words, style="yellow")
