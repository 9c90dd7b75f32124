"""The module that carries out users' commands, and the controls that the page offers for them.

The module writes a command to the components' ports, and waits until the regions show the end of
the command.
"""

from collections.abc import Callable

from robots.cartesian_sim.application import Components
from robots.cartesian_sim.drawing import HEIGHT, WIDTH
from robots.cartesian_sim.generated import JointTarget
from robots.cartesian_sim.joint import Joint
from robots.cartesian_sim.messages import (
    CLEAN,
    DISABLE,
    ENABLE,
    INTERRUPTED,
    JOINTS,
    MOVE_JOINT,
    MOVE_TO,
    NO_SUCH_JOINT,
    NOT_READY,
    REFERENCE,
    SET_JOINT_SPEED,
    SET_SPEED,
    STOP,
    JointMove,
    JointSpeed,
    WallPoint,
)
from tca_behaviours.activities.components import Region
from tca_behaviours.activities.manager import Control, ControlField
from tca_module import Module, Task
from tca_module.link.opening import CentralAddress

CHECK_PERIOD = 0.05
"""Seconds between two checks whether a command is done."""

START_LIMIT = 0.5
"""Seconds within which an accepted command shows in a region."""


class Operator:
    """Carries out commands on the components of a robot."""

    def __init__(self, components: Components) -> None:
        self.parts = components
        self._stopped = False
        self.joints: dict[str, Joint] = {name: getattr(components, name) for name in JOINTS}

    def module(self, central: CentralAddress = None) -> Module:
        """Return the module that handles the commands. Stopping commands do not wait for others."""
        module = Module("cleaning robot", central)
        at_once = module.resource("at once")
        module.handles(ENABLE)(self.enable)
        module.handles(REFERENCE)(self.reference)
        module.handles(MOVE_TO)(self.move_to)
        module.handles(MOVE_JOINT)(self.move_joint)
        module.handles(CLEAN)(self.clean)
        module.handles(DISABLE, resource=at_once)(self.disable)
        module.handles(STOP, resource=at_once)(self.stop)
        module.handles(SET_SPEED, resource=at_once)(self.set_speed)
        module.handles(SET_JOINT_SPEED, resource=at_once)(self.set_joint_speed)
        return module

    def enable(self, task: Task) -> None:
        """Enable all joints."""
        self._command_joints("enable")
        self._wait(task, lambda: self._all_are("enabling", "enabled"), lambda: False)

    def disable(self, task: Task) -> None:
        """Stop, and close all brakes."""
        self.stop(task)
        self._command_joints("disable")

    def reference(self, task: Task) -> None:
        """Let all joints find their zero."""
        self._check_ready("enabling.enabled", "movement.standing")
        self._command_joints("reference")
        self._wait_for_start(
            task, lambda: self._any_is("searching") and not self._any_is("unreferenced")
        )
        self._wait(
            task,
            lambda: self._all_are("referencing", "referenced"),
            lambda: self._any_is("unreferenced"),
        )

    def move_to(self, task: Task, point: WallPoint) -> None:
        """Go to a point of the wall."""
        self._check_movable()
        self.parts.guide.goal.put(point)
        self._wait_for_rest(task, self.parts.guide.travel, "resting")

    def move_joint(self, task: Task, move: JointMove) -> None:
        """Move one joint to a position."""
        joint = self._joint(move.joint)
        self._check_movable()
        joint.target.put(JointTarget(move.position, move.speed))
        self._wait_for_rest(task, joint.movement, "standing")

    def clean(self, task: Task) -> None:
        """Clean the wall."""
        self._check_movable()
        self.parts.guide.command.put("clean")
        self._wait_for_rest(task, self.parts.guide.cleaning, "idle")

    def stop(self, _task: Task) -> None:
        """Stop all movement."""
        self._stopped = True
        self.parts.guide.command.put("stop")
        self._command_joints("stop")

    def set_speed(self, _task: Task, speed: float) -> None:
        """Set the speed of moves in two dimensions, from the next one on."""
        self.parts.guide.speed.put(abs(speed))

    def set_joint_speed(self, _task: Task, wanted: JointSpeed) -> None:
        """Move one joint at a speed; 0 stops it."""
        joint = self._joint(wanted.joint)
        if not joint.enabling.is_in("enabled"):
            raise NOT_READY(
                joint.name, f"joint {joint.name} is not enabled: enable the joints first"
            )
        if wanted.speed:
            joint.jog.put(wanted.speed)
        else:
            joint.command.put("stop")

    # --- shared by the commands -------------------------------------------------------------------

    def _all_are(self, region: str, state: str) -> bool:
        """Return whether this region of all joints is in this state."""
        return all(joint.regions[region].is_in(state) for joint in self.joints.values())

    def _any_is(self, state: str) -> bool:
        """Return whether the referencing region of any joint is in this state."""
        return any(joint.referencing.is_in(state) for joint in self.joints.values())

    def _command_joints(self, command: str) -> None:
        for joint in self.joints.values():
            joint.command.put(command)

    def _joint(self, name: str) -> Joint:
        if name not in self.joints:
            raise NO_SUCH_JOINT(name, f"there is no joint '{name}': use one of {', '.join(JOINTS)}")
        return self.joints[name]

    def _check_movable(self) -> None:
        self._check_ready("enabling.enabled", "referencing.referenced")

    def _check_ready(self, *states: str) -> None:
        self._stopped = False
        for joint in self.joints.values():
            for region, state in (each.split(".") for each in states):
                if not joint.regions[region].is_in(state):
                    raise NOT_READY(
                        joint.name,
                        f"joint {joint.name} is not {state}: {joint.regions[region].current}",
                    )

    def _wait_for_rest(self, task: Task, region: Region, rest: str) -> None:
        """Wait until a region has left its state of rest and returned to it."""
        self._wait_for_start(task, lambda: not region.is_in(rest))
        self._wait(
            task,
            lambda: region.is_in(rest),
            lambda: self._stopped or not self._all_are("enabling", "enabled"),
        )

    def _wait_for_start(self, task: Task, has_started: Callable[[], bool]) -> None:
        """Wait a little for a start. A start that is not seen is no failure: the action may be
        over.
        """
        deadline = task.time() + START_LIMIT
        while not has_started() and task.time() < deadline:
            task.sleep(CHECK_PERIOD / 5)

    def _wait(
        self, task: Task, is_done: Callable[[], bool], is_interrupted: Callable[[], bool]
    ) -> None:
        """Wait for the end of a command. Raises INTERRUPTED. A kill of the task stops the robot."""
        try:
            while not is_done() and not is_interrupted():
                task.sleep(CHECK_PERIOD)
        except BaseException:
            self.stop(task)
            raise
        if is_interrupted():
            raise INTERRUPTED(text="the robot was stopped, or a joint disabled")


# --- on the page ----------------------------------------------------------------------------------

LENGTHS = {"x": WIDTH, "y": HEIGHT, "tool": 0.2}


def _controls_of(joint: str, length: float) -> list[Control]:
    group = f"joint {joint}"
    position = ControlField("position", length / 2, "m", 0.0, length)
    speed = ControlField("speed", 0.1, "m/s", -0.8, 0.8)
    return [
        Control("move", MOVE_JOINT.name, {"joint": joint}, [position], group),
        Control("set speed", SET_JOINT_SPEED.name, {"joint": joint}, [speed], group),
        Control("stop", SET_JOINT_SPEED.name, {"joint": joint, "speed": 0.0}, group=group),
    ]


CONTROLS = [
    Control("enable", ENABLE.name, group="robot"),
    Control("disable", DISABLE.name, group="robot"),
    Control("reference", REFERENCE.name, group="robot"),
    Control("clean", CLEAN.name, group="robot"),
    Control("stop", STOP.name, group="robot"),
    Control(
        "move to", MOVE_TO.name, group="position",
        fields=[ControlField("x", 1.0, "m", 0.0, WIDTH), ControlField("y", 0.6, "m", 0.0, HEIGHT)],
    ),
    Control(
        "set speed", SET_SPEED.name, group="position",
        fields=[ControlField("", 0.5, "m/s", 0.01, 0.8)],
    ),
    *(control for joint, length in LENGTHS.items() for control in _controls_of(joint, length)),
]  # fmt: skip
