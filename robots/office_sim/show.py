"""A shift of the robot: central, its programs and layers, each a process; then the pictures of the run."""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from click import ClickException, Command

from robots.office_sim.drawing import draw
from robots.office_sim.messages import CALL_IT_A_DAY, KEEP_FLOOR_FREE, SCENE
from robots.office_sim.vocabulary import CupState, LabScene
from robots.processes import Processes
from tca_module import Client, SentTask, TcaError, Timeout, connect
from tca_tools.drawing.pictures import converted
from tca_tools.errors import NoPicture
from tca_tools.gantt.__main__ import gantt
from tca_tools.tasktree_viz.__main__ import tree

PROGRAMS = ("vision", "controller", "planner", "task manager")
LAYERS = ("vanished cups", "battery", "grasps")
"""Programs that the others have never heard of."""

START_TIME = 60.0
"""Seconds within which all must be there."""

LOOKS = 0.1
"""Seconds between two looks at the lab."""

ENOUGH = 5.0
"""So many times as long as a shift it may take until no cup is left."""


@dataclass(frozen=True, slots=True)
class OfficeShift:
    """What happens, and how fast."""

    seed: int
    seconds: float
    pace: float
    without: tuple[str, ...] = ()
    """Layers that are left out."""

    @property
    def layers(self) -> tuple[str, ...]:
        """Those that are there."""
        return tuple(name for name in LAYERS if name not in self.without)


def work(shift: OfficeShift, folder: Path) -> LabScene:
    """Have the floor kept free, and say what happens; the lab at the end."""
    with tempfile.TemporaryDirectory(prefix="office") as sockets:
        address = f"ipc://{sockets}/central.sock"
        with Processes(folder, {"TCA_CENTRAL": address}) as processes:
            processes.start("central", "tca_central", "--journal", str(folder / "journal"), "--fresh")
            pace = ["--pace", str(shift.pace)]
            for name in PROGRAMS:
                processes.start(name, f"robots.office_sim.modules.{name.replace(' ', '_')}", *pace)
            for name in shift.layers:
                processes.start(f"{name} layer", f"robots.office_sim.layers.{name.replace(' ', '_')}", *pace)
            with connect("user", address) as user:
                _wait_for_programs(user, shift, processes)
                world = "--seed", str(shift.seed), "--shift", str(shift.seconds)
                processes.start("simulator", "robots.office_sim.modules.simulator", *pace, *world)
                return _watch(user, shift, processes)


def _wait_for_programs(user: Client, shift: OfficeShift, processes: Processes) -> None:
    """The layers, too: once they are ready, all that they attach is in force."""
    wanted = {*PROGRAMS, *(f"{name} layer" for name in shift.layers)}
    end = user.time() + START_TIME
    while missing := wanted - {module.name for module in user.modules()}:
        _check(processes)
        if user.time() > end:
            raise TcaError(f"not there after {START_TIME:.0f} s: {', '.join(sorted(missing))}")


def _watch(user: Client, shift: OfficeShift, processes: Processes) -> LabScene:
    """Wait until all cups have fallen and none is left, then call it a day."""
    keeping = user.goal(KEEP_FLOOR_FREE)
    told, has_called = 0, False
    while True:
        is_over = _has_ended(keeping)
        _check(processes)
        scene = user.query(SCENE)
        for line in scene.happened[told:]:
            print(line, flush=True)
        told = len(scene.happened)
        if is_over:
            keeping.result()
            return scene
        if not has_called and (_is_done(scene) or scene.time > ENOUGH * shift.seconds):
            user.inform(CALL_IT_A_DAY)
            has_called = True


def _is_done(scene: LabScene) -> bool:
    return all(cup.state in (CupState.BIN, CupState.TAKEN) for cup in scene.cups)


def _has_ended(task: SentTask[None]) -> bool:
    try:
        task.wait(LOOKS)
    except Timeout:
        return False
    return True


def _check(processes: Processes) -> None:
    if name := processes.ended():
        raise TcaError(f"{name} has ended: see {processes.log(name)}")


def pictures(scene: LabScene, title: str, folder: Path) -> Iterator[Path]:
    """The lab from above; the task tree and the Gantt chart of the run. What can't be made says why."""
    svg = draw(scene, title)
    (folder / "lab.svg").write_text(svg)
    yield folder / "lab.svg"
    try:
        (folder / "lab.png").write_bytes(converted(svg, "png"))
        yield folder / "lab.png"
    except NoPicture as error:
        print(error)
    tools: dict[str, Command] = {"tree.svg": tree, "gantt.svg": gantt}
    for name, tool in tools.items():
        try:
            tool.main([str(folder / "journal"), "-o", str(folder / name)], standalone_mode=False)
        except ClickException as error:
            print(error.format_message())
        else:
            yield folder / name
