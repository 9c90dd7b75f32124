"""Data types and bases of components, made by tca generate from cleaning.toml.

Do not change this file: changes would be lost.
"""
# isort: skip_file

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from tca_behaviours.activities.components import Component
from robots.cartesian_sim.mechanism import Sensed
from robots.cartesian_sim.mechanism import Scene
from robots.cartesian_sim.messages import WallPoint


@dataclass(frozen=True)
class MotorOrder:
    """Data that ports pass."""

    is_on: bool
    speed: float


@dataclass(frozen=True)
class JointTarget:
    """Data that ports pass."""

    position: float
    speed: float


@dataclass
class JointData:
    """Data that the activities of Joint share."""

    length: float = 1.0
    reading: float = 0.0
    zero: float = 0.0
    measured_speed: float = 0.0
    is_powered: bool = False
    at_low: bool = False
    at_high: bool = False
    is_on: bool = False
    target: float = 0.0
    speed: float = 0.0


class JointBase(Component[JointData], ABC):
    """The base of Joint."""

    def __init__(self, name: str, data: Callable[[], JointData] = JointData) -> None:
        super().__init__(name, data, period=0.01, estimate=0.0001)
        self.sensed = self.input("sensed", Sensed, self.take_sensed)
        self.command = self.input("command", str, self.take_command, keep=8)
        self.target = self.input("target", JointTarget, self.take_target)
        self.jog = self.input("jog", float, self.take_jog)
        self.drive = self.output("drive", MotorOrder)
        self.position = self.output("position", float)
        self.limits = self.region("limits", period=0.01, estimate=0.0001)
        self.referencing = self.region("referencing", period=0.02, estimate=0.0001)
        self.enabling = self.region("enabling", period=0.02, estimate=0.0001)
        self.movement = self.region("movement", period=0.01, estimate=0.0001)
        self._write_limits()
        self._write_referencing()
        self._write_enabling()
        self._write_movement()

    def _write_limits(self) -> None:
        region = self.limits
        states = region.states
        region.state("in range")
        region.state("at low")
        region.state("at high")
        states["in range"].to(states["at low"], when=self.is_at_low)
        states["in range"].to(states["at high"], when=self.is_at_high)
        states["at low"].to(states["in range"], when=self.is_in_range)
        states["at high"].to(states["in range"], when=self.is_in_range)

    def _write_referencing(self) -> None:
        region = self.referencing
        states = region.states
        region.state("unreferenced")
        region.state("searching", exit=self.halt)
        states["searching"].state(
            "to switch",
            activity=self.seek_switch,
            period=0.02,
            estimate=0.0001,
        )
        states["searching"].state(
            "off switch",
            activity=self.leave_switch,
            period=0.01,
            estimate=0.0001,
        )
        region.state("referenced", entry=self.set_zero)
        states["unreferenced"].to(
            states["searching"],
            on="reference",
            needs=["enabling.enabled", "movement.standing"],
        )
        states["referenced"].to(
            states["searching"],
            on="reference",
            needs=["enabling.enabled", "movement.standing"],
        )
        states["to switch"].to(states["off switch"], needs=["limits.at low"])
        states["off switch"].to(states["referenced"], needs=["limits.in range"])
        states["searching"].to(states["unreferenced"], on="stop")
        states["searching"].to(states["unreferenced"], on="disable")

    def _write_enabling(self) -> None:
        region = self.enabling
        states = region.states
        region.state("disabled", entry=self.power_off)
        region.state("powering", entry=self.power_on)
        region.state("enabled")
        states["disabled"].to(states["powering"], on="enable")
        states["powering"].to(states["enabled"], when=self.has_power)
        states["powering"].to(states["disabled"], on="disable")
        states["enabled"].to(states["disabled"], on="disable")

    def _write_movement(self) -> None:
        region = self.movement
        states = region.states
        region.state("standing")
        region.state("moving")
        states["moving"].state(
            "to position",
            activity=self.approach,
            period=0.01,
            estimate=0.0001,
        )
        states["moving"].state(
            "at speed",
            activity=self.keep_speed,
            period=0.05,
            estimate=0.0001,
        )
        region.state("braking", entry=self.halt)
        states["standing"].to(
            states["to position"],
            on="move",
            needs=["enabling.enabled", "referencing.referenced"],
        )
        states["standing"].to(
            states["at speed"],
            on="jog",
            when=self.may_jog,
            needs=["enabling.enabled"],
        )
        states["moving"].to(states["standing"], on="disable")
        states["moving"].to(states["braking"], on="stop")
        states["moving"].to(
            states["to position"],
            on="move",
            needs=["referencing.referenced"],
        )
        states["moving"].to(states["at speed"], on="jog")
        states["at speed"].to(
            states["braking"],
            when=self.goes_down,
            needs=["limits.at low"],
        )
        states["at speed"].to(
            states["braking"],
            when=self.goes_up,
            needs=["limits.at high"],
        )
        states["to position"].to(states["braking"], when=self.has_arrived)
        states["braking"].to(
            states["to position"],
            on="move",
            needs=["enabling.enabled", "referencing.referenced"],
        )
        states["braking"].to(states["standing"], when=self.is_still)

    @abstractmethod
    def take_sensed(self, value: Sensed) -> None:
        """A value has arrived at port 'sensed'."""

    @abstractmethod
    def take_command(self, value: str) -> None:
        """A value has arrived at port 'command'."""

    @abstractmethod
    def take_target(self, value: JointTarget) -> None:
        """A value has arrived at port 'target'."""

    @abstractmethod
    def take_jog(self, value: float) -> None:
        """A value has arrived at port 'jog'."""

    @abstractmethod
    def is_at_low(self) -> bool:
        """Whether 'limits' may go from 'in range' to 'at low'."""

    @abstractmethod
    def is_at_high(self) -> bool:
        """Whether 'limits' may go from 'in range' to 'at high'."""

    @abstractmethod
    def is_in_range(self) -> bool:
        """Whether 'limits' may go from 'at low' to 'in range'."""

    @abstractmethod
    def seek_switch(self) -> None:
        """Called once a period while 'referencing' is in 'to switch'."""

    @abstractmethod
    def leave_switch(self) -> None:
        """Called once a period while 'referencing' is in 'off switch'."""

    @abstractmethod
    def set_zero(self) -> None:
        """'referencing' enters 'referenced'."""

    @abstractmethod
    def power_off(self) -> None:
        """'enabling' enters 'disabled'."""

    @abstractmethod
    def power_on(self) -> None:
        """'enabling' enters 'powering'."""

    @abstractmethod
    def has_power(self) -> bool:
        """Whether 'enabling' may go from 'powering' to 'enabled'."""

    @abstractmethod
    def approach(self) -> None:
        """Called once a period while 'movement' is in 'to position'."""

    @abstractmethod
    def keep_speed(self) -> None:
        """Called once a period while 'movement' is in 'at speed'."""

    @abstractmethod
    def halt(self) -> None:
        """'referencing' leaves 'searching'."""

    @abstractmethod
    def may_jog(self) -> bool:
        """Whether 'movement' may go from 'standing' to 'at speed'."""

    @abstractmethod
    def goes_down(self) -> bool:
        """Whether 'movement' may go from 'at speed' to 'braking'."""

    @abstractmethod
    def goes_up(self) -> bool:
        """Whether 'movement' may go from 'at speed' to 'braking'."""

    @abstractmethod
    def has_arrived(self) -> bool:
        """Whether 'movement' may go from 'to position' to 'braking'."""

    @abstractmethod
    def is_still(self) -> bool:
        """Whether 'movement' may go from 'braking' to 'standing'."""


@dataclass
class DeviceData:
    """Data that the activities of Device share."""


class DeviceBase(Component[DeviceData], ABC):
    """The base of Device."""

    def __init__(self, name: str, data: Callable[[], DeviceData] = DeviceData) -> None:
        super().__init__(name, data, period=0.01, estimate=0.0001)
        self.drive_x = self.input("drive_x", MotorOrder, self.take_drive_x)
        self.drive_y = self.input("drive_y", MotorOrder, self.take_drive_y)
        self.drive_tool = self.input("drive_tool", MotorOrder, self.take_drive_tool)
        self.sensed_x = self.output("sensed_x", Sensed)
        self.sensed_y = self.output("sensed_y", Sensed)
        self.sensed_tool = self.output("sensed_tool", Sensed)
        self.scene = self.output("scene", Scene)
        self.simulation = self.region("simulation", period=0.1, estimate=0.0001)
        self._write_simulation()

    def _write_simulation(self) -> None:
        region = self.simulation
        region.state(
            "running",
            entry=self.switch_on,
            activity=self.simulate,
            period=0.01,
            estimate=0.0003,
        )

    @abstractmethod
    def take_drive_x(self, value: MotorOrder) -> None:
        """A value has arrived at port 'drive_x'."""

    @abstractmethod
    def take_drive_y(self, value: MotorOrder) -> None:
        """A value has arrived at port 'drive_y'."""

    @abstractmethod
    def take_drive_tool(self, value: MotorOrder) -> None:
        """A value has arrived at port 'drive_tool'."""

    @abstractmethod
    def switch_on(self) -> None:
        """'simulation' enters 'running'."""

    @abstractmethod
    def simulate(self) -> None:
        """Called once a period while 'simulation' is in 'running'."""


@dataclass
class GuideData:
    """Data that the activities of Guide share."""

    x: float = 0.0
    y: float = 0.0
    tool: float = 0.0
    goal_x: float = 0.0
    goal_y: float = 0.0
    speed: float = 0.5
    passed: int = 0


class GuideBase(Component[GuideData], ABC):
    """The base of Guide."""

    def __init__(self, name: str, data: Callable[[], GuideData] = GuideData) -> None:
        super().__init__(name, data, period=0.02, estimate=0.0001)
        self.command = self.input("command", str, self.take_command, keep=8)
        self.goal = self.input("goal", WallPoint, self.take_goal)
        self.speed = self.input("speed", float, self.take_speed)
        self.x = self.input("x", float, self.take_x)
        self.y = self.input("y", float, self.take_y)
        self.tool = self.input("tool", float, self.take_tool)
        self.target_x = self.output("target_x", JointTarget)
        self.target_y = self.output("target_y", JointTarget)
        self.target_tool = self.output("target_tool", JointTarget)
        self.travel = self.region("travel", period=0.02, estimate=0.0001)
        self.cleaning = self.region("cleaning", period=0.02, estimate=0.0001)
        self._write_travel()
        self._write_cleaning()

    def _write_travel(self) -> None:
        region = self.travel
        states = region.states
        region.state("resting")
        region.state("travelling", entry=self.set_out)
        states["resting"].to(states["travelling"], on="go", needs=["cleaning.idle"])
        states["travelling"].to(states["travelling"], on="go")
        states["travelling"].to(states["resting"], when=self.is_there)
        states["travelling"].to(states["resting"], on="stop")

    def _write_cleaning(self) -> None:
        region = self.cleaning
        states = region.states
        region.state("idle")
        region.state("working")
        states["working"].state("approaching", entry=self.go_to_first)
        states["working"].state("pressing", entry=self.put_tool_out)
        states["working"].state(
            "wiping",
            activity=self.follow,
            period=0.05,
            estimate=0.0001,
        )
        region.state("lifting", entry=self.take_tool_back)
        states["idle"].to(states["working"], on="clean", needs=["travel.resting"])
        states["approaching"].to(states["pressing"], when=self.is_there)
        states["pressing"].to(states["wiping"], when=self.is_tool_out)
        states["wiping"].to(states["lifting"], when=self.is_pattern_done)
        states["lifting"].to(states["idle"], when=self.is_tool_back)
        states["lifting"].to(states["idle"], on="stop")
        states["working"].to(states["idle"], on="stop")

    @abstractmethod
    def take_command(self, value: str) -> None:
        """A value has arrived at port 'command'."""

    @abstractmethod
    def take_goal(self, value: WallPoint) -> None:
        """A value has arrived at port 'goal'."""

    @abstractmethod
    def take_speed(self, value: float) -> None:
        """A value has arrived at port 'speed'."""

    @abstractmethod
    def take_x(self, value: float) -> None:
        """A value has arrived at port 'x'."""

    @abstractmethod
    def take_y(self, value: float) -> None:
        """A value has arrived at port 'y'."""

    @abstractmethod
    def take_tool(self, value: float) -> None:
        """A value has arrived at port 'tool'."""

    @abstractmethod
    def set_out(self) -> None:
        """'travel' enters 'travelling'."""

    @abstractmethod
    def go_to_first(self) -> None:
        """'cleaning' enters 'approaching'."""

    @abstractmethod
    def put_tool_out(self) -> None:
        """'cleaning' enters 'pressing'."""

    @abstractmethod
    def follow(self) -> None:
        """Called once a period while 'cleaning' is in 'wiping'."""

    @abstractmethod
    def take_tool_back(self) -> None:
        """'cleaning' enters 'lifting'."""

    @abstractmethod
    def is_there(self) -> bool:
        """Whether 'travel' may go from 'travelling' to 'resting'."""

    @abstractmethod
    def is_tool_out(self) -> bool:
        """Whether 'cleaning' may go from 'pressing' to 'wiping'."""

    @abstractmethod
    def is_pattern_done(self) -> bool:
        """Whether 'cleaning' may go from 'wiping' to 'lifting'."""

    @abstractmethod
    def is_tool_back(self) -> bool:
        """Whether 'cleaning' may go from 'lifting' to 'idle'."""
