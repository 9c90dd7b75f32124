"""A shift of the robot: central, its programs and layers, each a process; then the pictures of the run."""

import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from click import ClickException, Command

from robots.office_sim.drawing import draw
from robots.office_sim.layers.battery import IS_LOW
from robots.office_sim.layers.grasps import GRASP_AGAIN
from robots.office_sim.layers.vanished_cups import IS_GONE
from robots.office_sim.messages import (
    CALL_IT_A_DAY,
    CUPS_IN_VIEW,
    FOLLOW_PATH,
    KEEP_FLOOR_FREE,
    NAVIGATE,
    OPEN_LAB,
    SCENE,
)
from robots.office_sim.vocabulary import CupState, LabScene
from robots.processes import Processes
from tca_module import Client, Message, SentTask, TcaError, Timeout, connect
from tca_tools.drawing.pictures import converted
from tca_tools.errors import NoPicture
from tca_tools.gantt.__main__ import gantt
from tca_tools.tasktree_viz.__main__ import tree

PROGRAMS: dict[str, Message[Any, Any]] = {
    "vision": CUPS_IN_VIEW,
    "controller": FOLLOW_PATH,
    "planner": NAVIGATE,
    "task manager": KEEP_FLOOR_FREE,
}
LAYERS: dict[str, Message[Any, Any]] = {"vanished cups": IS_GONE, "battery": IS_LOW, "grasps": GRASP_AGAIN}
"""Programs that the others have never heard of. Beside each program is a message that it handles: once it does, all
that it attaches is in force.
"""

START_TIME = 60.0
"""Seconds within which all must be there."""

LOOKS = 0.1
"""Seconds between two looks at the lab."""

PATIENCE = 900.0
"""Seconds of the lab within which no cup must be left after the last has fallen; else some stay there."""


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
    """Have the floor kept free, in place of an earlier run, and say what happens; the lab at the end."""
    shutil.rmtree(folder / "journal", ignore_errors=True)
    pace = "--pace", str(shift.pace)
    with tempfile.TemporaryDirectory(prefix="office") as sockets:
        address = f"ipc://{sockets}/central.sock"
        with Processes(folder, {"TCA_CENTRAL": address}) as processes:
            processes.start("central", "tca_central", "--journal", str(folder / "journal"))
            world = "--seed", str(shift.seed), "--shift", str(shift.seconds)
            processes.start("simulator", "robots.office_sim.modules.simulator", *pace, *world)
            for name in PROGRAMS:
                processes.start(name, f"robots.office_sim.modules.{name.replace(' ', '_')}", *pace)
            for name in shift.layers:
                processes.start(f"{name} layer", f"robots.office_sim.layers.{name.replace(' ', '_')}", *pace)
            with connect("user", address) as user:
                layers = (LAYERS[name] for name in shift.layers)
                user.wait_until_handled(OPEN_LAB, *PROGRAMS.values(), *layers, timeout=START_TIME)
                user.inform(OPEN_LAB)
                return _watch(user, shift, processes)


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
        if not has_called and (_is_done(scene) or scene.time > shift.seconds + PATIENCE):
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
