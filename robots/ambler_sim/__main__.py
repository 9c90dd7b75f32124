"""The walk: central, the Ambler's modules and the simulator, each a process; then the pictures of the run."""

import argparse
import fcntl
import logging
import os
import pkgutil
import shutil
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import astuple, dataclass, field
from pathlib import Path

import msgspec
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TimeElapsedColumn

from robots.ambler_sim import layers
from robots.ambler_sim.machine.making import BACKENDS, WITHOUT_PHYSICS, pybullet_is_installed, why_no_window
from robots.ambler_sim.machine.terrain import TERRAINS, scattered_rocks
from robots.ambler_sim.messages import PICTURE, TRAVERSE_PATH, Bend
from robots.ambler_sim.messages import Path as PathToWalk
from robots.ambler_sim.modules import task_manager
from robots.ambler_sim.modules.fault_injector import kinds_of, scheduled
from robots.ambler_sim.modules.planners import PLANNERS
from robots.ambler_sim.pictures.film import join_frames, why_no_film
from robots.ambler_sim.recovery import GIVE_UP, is_attached
from robots.ambler_sim.run.figures import Figures, Usage, figures_of
from robots.ambler_sim.run.losing import ProgramKiller
from robots.ambler_sim.vocabulary import KINDS, Rock
from robots.processes import Processes
from robots.show import between, central, history
from tca_module import Module, Outcome, TaskFailed, TcaError, Timeout
from tca_module.sending.task_ref import SentTask

MODULES = ("scanner", "mapper", "gait planner")
RECOVERY = "error recovery"

LAYERS = tuple(sorted(each.name.replace("_", " ") for each in pkgutil.iter_modules(layers.__path__)))
"""Programs that the others have never heard of: checks before and after moves, and what is done about failures."""

ROCK_HEIGHTS = (0.6, 0.8)
START_TIME = 60.0
"""Seconds within which they must be there."""

PICTURE_TIME = 300.0
"""Seconds that the last picture may take: on a busy machine without a graphics card more than half a minute."""

LOOK_PERIOD = 0.5
"""Seconds between two looks at whether all programs are still there, and whether one is to be killed."""

FARTHEST = 1500.0
"""Metres of a walk; hills go on for a little more."""

ARC = 10.0
"""Metres, about."""

FRAMES = "frames"
"""The folder of photographs, within the walk's."""

MARKER = ".ambler-walk"
"""A file by which a folder is known to hold a walk, and locked while the walk goes on."""

console = Console(highlight=False)


@dataclass
class Walk:
    """One run and where its files go."""

    options: argparse.Namespace
    folder: Path
    outputs: list[tuple[str, Path]] = field(default_factory=list)
    usage: Usage = field(default_factory=Usage)
    walked: float = 0.0
    wall: float = 0.0

    @property
    def bends(self) -> tuple[Bend, ...]:
        """The path: pieces of equal length, first straight, then gently left and right."""
        arcs = self.options.arcs or max(2, round(self.options.metres / ARC))
        curvatures = [0.0, 0.04, -0.04]
        return tuple(Bend(curvatures[number % 3], self.options.metres / arcs) for number in range(arcs))

    @property
    def modules(self) -> tuple[str, ...]:
        """The programs beside central, controller and task manager."""
        return MODULES if self.options.bare else (*MODULES, RECOVERY)

    @property
    def layers(self) -> tuple[str, ...]:
        """The reactive layers."""
        return () if self.options.bare else tuple(name for name in LAYERS if name not in self.options.without)

    @property
    def rocks(self) -> list[Rock]:
        """The rocks that the scanner does not see."""
        options = self.options
        scattered = scattered_rocks(options.seed, options.rocks, options.metres, ROCK_HEIGHTS)
        return [*scattered, *(Rock(*rock) for rock in options.rock)]

    @property
    def look(self) -> str:
        """The command that shows it, now or later."""
        tca = "tca" if shutil.which("tca") else Path(sys.executable).with_name("tca")
        return f"{tca} view {self.folder}/journal"

    def run(self) -> int:
        """Walk, then draw; the exit code."""
        with central(self.folder, is_fresh=False) as (address, processes):
            for name in self.modules:
                mode = ("--mode", self.options.mode) if name == "gait planner" else ()
                processes.start(name, f"robots.ambler_sim.modules.{name.replace(' ', '_')}", *mode)
            for name in PLANNERS:
                processes.start(name, "robots.ambler_sim.modules.planners", name)
            for name in self.layers:
                processes.start(f"{name} layer", f"robots.ambler_sim.layers.{name.replace(' ', '_')}")
            if self.options.faults or self.options.fault:
                self.start_injector(processes)
            self.start_controller(processes)
            code = self.conduct(address, processes)
        self.draw_history()
        if self.options.film and join_frames(self.folder / FRAMES, self.options.film):
            self.outputs.append(("film", self.options.film.resolve()))
        return code

    def start_controller(self, processes: Processes, number: int = 0) -> None:
        """Start a controller; it takes the robot over from the one before, if there was one. With --swap-to, every
        other one is of that kind.
        """
        options = self.options
        backend = options.swap_to if options.swap_to and number % 2 else options.backend
        processes.start(
            "controller", "robots.ambler_sim.modules.controller",
            "--state", str(self.folder / "robot.json"), "--record", str(self.folder / "footsteps.jsonl"),
            "--backend", backend, *(("--gui",) if options.gui else ()),
            *(("--film", str(self.folder / FRAMES), str(options.film_from)) if options.film else ()),
            "--pace", str(options.pace), "--seed", str(options.seed), "--slope", str(options.slope),
            "--terrain", options.terrain,
            *(text for rock in self.rocks for text in ("--rock", *map(str, astuple(rock)[:4]))),
        )  # fmt: skip

    def start_injector(self, processes: Processes) -> None:
        """Start what makes things go wrong."""
        options = self.options
        processes.start(
            "fault injector", "robots.ambler_sim.modules.fault_injector", "--seed", str(options.seed),
            *(("--faults", ",".join(options.faults)) if options.faults else ()),
            *(text for fault in options.fault for text in ("--fault", fault)),
        )  # fmt: skip

    def conduct(self, address: str, processes: Processes) -> int:
        """Be the task manager: send the goal and watch it being achieved."""
        columns = ("[bold]{task.description}", BarColumn(), "{task.completed:4.1f} of {task.total:.1f} m")
        killer = ProgramKiller(processes, address)
        with killer, Progress(*columns, TimeElapsedColumn(), console=console) as progress:
            bar = progress.add_task("walking", total=self.options.metres)
            module = task_manager.make_module(
                lambda metres: self.show(metres, progress, bar),
                lambda number: self.confirm(number, progress, processes),
                killer.kill,
            )
            module.central = address
            with module.running():
                if not self.options.bare:
                    module.wait_until_handled(GIVE_UP, *map(is_attached, self.layers), timeout=START_TIME)
                for layer in self.layers:
                    module.query(is_attached(layer), timeout=START_TIME)
                goal = module.goal(TRAVERSE_PATH, PathToWalk(self.bends, ask=bool(self.options.between_arcs)))
                began = time.monotonic()
                code = _watch(
                    goal,
                    processes,
                    progress,
                    bar,
                    lambda: self.usage.look(self.walked, processes.numbers()),
                )
                self.wall = time.monotonic() - began
                killer.end()
                if code == 0:
                    self.photograph(module)
        return code

    def photograph(self, module: Module) -> None:
        """Have the robot drawn where it is now. A walk without a picture is a walk."""
        try:
            picture = module.query(PICTURE, str(self.folder / "robot.png"), timeout=PICTURE_TIME)
        except TcaError as error:
            _warn(f"no picture of the robot: {error}")
        else:
            self.outputs.append(("the robot", Path(picture)))

    def show(self, metres: float, progress: Progress, bar: TaskID) -> None:
        """The robot has come so far."""
        self.walked = metres
        progress.update(bar, completed=min(metres, self.options.metres))

    def confirm(self, number: int, progress: Progress, processes: Processes) -> None:
        """Between two arcs: what --between-arcs asked for."""
        if self.options.between_arcs == "swap":
            code = processes.stop("controller")
            progress.console.print(
                f"between arcs {number} and {number + 1}: the controller ended ({code}); another starts"
            )
            self.start_controller(processes, number)
        else:
            progress.console.print(f"between arcs {number} and {number + 1}: Enter goes on")
            sys.stdin.readline()

    def judge(self) -> Figures:
        """The walk in figures, which are also written into its folder."""
        figures = figures_of(self.folder / "footsteps.jsonl", self.folder / "journal", self.usage, self.wall)
        (self.folder / "figures.json").write_bytes(msgspec.json.format(msgspec.json.encode(figures)))
        return figures

    def draw_history(self) -> None:
        """The task tree and the Gantt chart, from the journal, by the tools that anybody would use."""
        titles = {"tree.svg": "task tree", "gantt.svg": "Gantt chart"}
        self.outputs += [(titles[path.name], path) for path in history(self.folder, _warn)]
        self.outputs.append(("journal", self.folder / "journal"))


def _watch(
    goal: SentTask[None], processes: Processes, progress: Progress, bar: TaskID, look: Callable[[], None]
) -> int:
    """Wait for the end of the walk, and for anything that ends before its time; *look* now and then."""
    while True:
        try:
            outcome = goal.wait(timeout=LOOK_PERIOD)
        except Timeout:
            if (name := processes.ended()) is None:
                look()
                continue
            progress.console.print(f"{name} ended before the walk did; see {processes.log(name)}", style="red")
            return 1
        if outcome is Outcome.DONE:
            progress.update(bar, completed=progress.tasks[0].total)
            return 0
        try:
            goal.result()
        except TaskFailed as error:
            progress.console.print(f"the walk failed: {error}", style="red")
        else:
            progress.console.print("the walk was killed", style="red")
        return 1


def _warn(words: str) -> None:
    console.print(words, style="yellow")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m robots.ambler_sim", description=__doc__)
    parser.add_argument("--distance", dest="metres", type=between(0.1, FARTHEST, "the distance"), default=6.0,
                        metavar="METRES", help="how far to walk")  # fmt: skip
    parser.add_argument("--arcs", type=int, help="in how many arcs; by default two or more, of about 10 m")
    parser.add_argument("--terrain", choices=TERRAINS, default="rolling", help="what kind of ground")
    parser.add_argument("--out", type=Path, default=Path("walk"), help="folder for journal, logs and pictures")
    parser.add_argument("--backend", choices=BACKENDS, default="auto")
    parser.add_argument("--gui", action="store_true", help="show physics in PyBullet's own window")
    parser.add_argument(
        "--film", type=Path, metavar="FILE", help="an animated picture of the walk: .webp, .gif or .png"
    )
    parser.add_argument("--film-from", type=int, default=0, metavar="STEP", help="film from that footstep on")
    parser.add_argument("--pace", type=float, default=10.0, help="times real time; 0 is as fast as possible")
    parser.add_argument("--seed", type=int, default=1, help="which hills")
    parser.add_argument("--slope", type=float, default=0.30, help="steepest rise per run of hills")
    parser.add_argument(
        "--rocks", type=int, default=0, help="how many rocks lie on the way, which the scanner does not see"
    )
    parser.add_argument("--rock", nargs=4, type=float, action="append", default=[],
                        metavar=("X", "Y", "RADIUS", "HEIGHT"), help="one more; may be repeated")  # fmt: skip
    parser.add_argument("--without", action="append", default=[], choices=LAYERS, metavar="LAYER",
                        help=f"leave out a layer: {', '.join(LAYERS)}")  # fmt: skip
    parser.add_argument("--bare", action="store_true", help="without any layer, and without error recovery")
    parser.add_argument("--faults", type=kinds_of, default=(), metavar="all|KIND,...",
                        help=f"what goes wrong at random: {', '.join(KINDS)}")  # fmt: skip
    parser.add_argument("--fault", action="append", default=[], metavar="KIND@STEP",
                        help="one fault with that leg move (1, 2, ...); may be repeated")  # fmt: skip
    parser.add_argument("--mode", choices=("sequential", "ahead", "concurrent"), default="concurrent",
                        help="how much goes on at once: nothing; planning one step ahead; perception, too")  # fmt: skip
    parser.add_argument("--swap-to", choices=BACKENDS[1:], help="the other controller of --between-arcs swap")
    parser.add_argument("--between-arcs", choices=("swap", "ask"),
                        help="swap: stop the controller and start another; ask: wait for Enter")  # fmt: skip
    return parser


def _fresh(folder: Path) -> Path:
    """An empty folder, where only an earlier walk may have been."""
    marker = folder / MARKER
    if folder.exists() and any(folder.iterdir()) and not marker.exists():
        raise SystemExit(f"ambler: {folder} holds something else than a walk: name another folder with --out")
    if marker.exists() and not _may_lock(marker):
        raise SystemExit(f"ambler: another walk is going on in {folder}: name another folder with --out")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    marker.touch()
    _may_lock(marker)
    return folder.resolve()


def _may_lock(marker: Path) -> bool:
    """Whether no other walk has this folder; it is ours from then on, for as long as this process lives."""
    handle = os.open(marker, os.O_RDWR | os.O_CLOEXEC)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        return False
    return True


def without_physics(options: argparse.Namespace) -> str:
    """Why this walk has no camera and no window; empty: it has physics, in which there are both."""
    if options.backend in WITHOUT_PHYSICS:
        return f"the {options.backend} backend has no physics to look at: leave --backend out"
    return "" if pybullet_is_installed() else "it needs PyBullet, which is not installed here"


def main() -> int:
    """The command line."""
    logging.basicConfig(level=logging.WARNING, format="%(name)s: %(message)s")
    parser = _parser()
    options = parser.parse_args()
    try:
        scheduled(options.fault)
    except ValueError as error:
        parser.error(str(error))
    if options.gui and (missing := without_physics(options) or why_no_window()):
        raise SystemExit(f"ambler: --gui: {missing}")
    if options.film and (missing := without_physics(options) or why_no_film(options.film)):
        raise SystemExit(f"ambler: --film: {missing}")
    has_physics = options.backend not in WITHOUT_PHYSICS and pybullet_is_installed()
    missing = "" if pybullet_is_installed() else " (no PyBullet here)"
    how = "with PyBullet's physics" if has_physics else f"kinematically, without physics{missing}"
    pace = f"{options.pace:g} times as fast as in reality" if options.pace else "as fast as can be"
    console.print(f"The Ambler walks {options.metres:g} m {how}, {pace}.")
    began = time.monotonic()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: the programs are stopped in order
    try:
        walk = Walk(options, _fresh(options.out))
        console.print(f"Watch it in the browser: [bold]{walk.look}[/bold]", soft_wrap=True)
        code = walk.run()
    except KeyboardInterrupt:
        console.print(f"stopped; what happened so far is in {options.out}", soft_wrap=True)
        return 130
    except TcaError as error:
        console.print(f"ambler: {error}", style="red")
        return 1
    console.print(f"{'Done' if code == 0 else 'Ended'} after {time.monotonic() - began:.0f} s:")
    for line in walk.judge().lines():
        console.print(f"  {line}", soft_wrap=True)
    for title, path in walk.outputs:
        console.print(f"  {title:12} {path}", soft_wrap=True)
    console.print(f"Look at any moment again, in the browser: [bold]{walk.look}[/bold]", soft_wrap=True)
    return code


if __name__ == "__main__":
    sys.exit(main())
